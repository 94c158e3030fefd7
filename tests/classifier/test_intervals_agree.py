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


@given(st.data())
def test_both_refuse_the_same_intervals(data: st.DataObject) -> None:
    count = data.draw(st.integers(0, 3))
    few = st.integers(0, 17) | st.sampled_from([2**31, 2**32 - 1])
    arrays = {name: data.draw(st.lists(few, min_size=count, max_size=count)) for name in ("onset", "duration")}
    borders = [0, data.draw(st.integers(0, 4)), data.draw(st.just(count) | st.integers(0, 4))]
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
