"""The growing map: what it keeps of each cell follows from all verdicts so far, in whatever order they came."""

import numpy as np
import pytest

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS
from bow_sweep.maps import basin_map
from bow_sweep.maps.basin_map import Basin, transient_lengths

TESTS, NX, NY = 7, 6, 4


def verdict(rng: np.random.Generator, count: int, guettler: bool) -> dict[str, np.ndarray]:
    """Return the verdicts of one test of some cells; some pass, some have no verdict, some state a transient."""
    values = {name: field.array((count,)) for name, field in VERDICT_FIELDS.items()}
    values["regime"][:] = rng.choice([*range(len(REGIMES)), PENDING], count)
    values["correlation"][:] = rng.random(count)
    if guettler:
        values["transient"][:] = np.where(rng.random(count) < 0.5, rng.integers(0, 30, count) / 2, np.nan)
    return values


def check(basin: Basin) -> None:
    regime = basin.layers["regime"]
    heard = (regime != PENDING).any(axis=0) | ~np.isnan(basin.transient_periods)
    assert np.array_equal(basin.tested, np.count_nonzero(regime != PENDING, axis=0))
    lengths = transient_lengths(regime, basin.layers["transient"])
    assert basin.transient_periods.dtype == lengths.dtype
    assert basin.transient_periods[heard].tobytes() == lengths[heard].tobytes()


@pytest.mark.parametrize("guettler", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_kept_values_follow_from_all_verdicts(seed: int, guettler: bool) -> None:
    rng = np.random.default_rng(seed)
    basin = Basin(NX, NY, TESTS, repeats=1)
    cells = basin.tested.size
    for _ in range(60):  # out of order, some a second time with other values
        some = rng.permutation(cells)[: rng.integers(0, cells + 1)].astype(np.uint32)
        basin.take(int(rng.integers(TESTS)), some, verdict(rng, len(some), guettler))
        check(basin)


def test_taking_a_test_does_not_look_at_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coordinator takes a verdict for every chunk: all tests again at each test would be a square."""
    rng, looked = np.random.default_rng(1), []
    monkeypatch.setattr(
        basin_map, "transient_lengths", lambda *layers: looked.append(layers) or transient_lengths(*layers)
    )
    basin = Basin(NX, NY, TESTS)
    cells = np.arange(basin.tested.size)
    verdicts = [verdict(rng, len(cells), False) for _ in range(TESTS)]
    for test, one in enumerate(verdicts):
        basin.take(test, cells, one)
    assert not looked
    before = basin.transient_periods.copy()
    basin.take(3, cells, verdicts[3])
    assert len(looked) == 1, "what is known already is derived again"
    assert basin.transient_periods.tobytes() == before.tobytes()
