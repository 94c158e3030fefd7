"""The classifier's compiled pass and the recorder refuse the same slip intervals."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.features.slips import Intervals
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.protocol.intervals import intervals_objection

GEOMETRY = Geometry(period=8, bow_bridge=3, samples=16)
CELLS = 2


@given(st.integers(0, 2**32 - 1))
def test_both_refuse_the_same_intervals(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4))
    arrays = {"onset": np.sort(rng.integers(0, 17, count)), "duration": rng.integers(0, 5, count)}
    borders = np.array([0, rng.integers(count + 1), count])
    for array in (*arrays.values(), borders):
        if rng.random() < 0.2 and len(array):
            array[rng.integers(len(array))] = rng.choice([0, 1, 4, 15, 2**31, 2**32 - 1])
    values: dict[str, Any] = {name: np.array(x, np.uint32) for name, x in (arrays | {"offsets": borders}).items()}
    values |= {"slipping": np.zeros(CELLS, np.uint8), "slip": np.ones(count), "samples": GEOMETRY.samples}
    intervals = Intervals(*(values[name] for name in Intervals._fields))
    block = BlockClassifier(GEOMETRY, Thresholds(), CELLS)
    force = np.zeros((CELLS, GEOMETRY.samples), np.float32)
    if intervals_objection(values):
        with pytest.raises(ValueError, match="slip intervals: should be in order"):
            block.classify(force, intervals)
    else:
        block.classify(force, intervals)
