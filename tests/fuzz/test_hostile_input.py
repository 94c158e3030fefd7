"""Whatever a stranger hands in: a clear refusal or a right answer; no crash, no hang, no memory by a stranger's number.

The targets are in `targets`, chance is in Hypothesis's hands. `python tests/stress/fuzz.py` runs many more of them.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from random import Random

import pytest
import targets
from chance import bounded_memory
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

CASES = 40
"""Times a target's share: some 4200 cases in all, and many more in `python tests/stress/fuzz.py`."""

NAMES = ("goal", "plan", "wire", "block", "answers", "stream", "preset", "ledger", "map", "scan", "bag", "beside")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[targets.Targets]:
    """All targets in a room of their own, in which nothing is left behind."""
    every = targets.make(tmp_path_factory.mktemp("fuzz") / "room")
    yield every
    every.check_room()


def test_all_targets_are_run(made: targets.Targets) -> None:
    assert tuple(made.all()) == NAMES


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.full] * (name == "goal")) for name in NAMES])
def test_hostile_input_does_no_harm(made: targets.Targets, name: str) -> None:
    share, case = made.all()[name]

    @settings(
        max_examples=CASES * share,
        deadline=5000,
        suppress_health_check=list(HealthCheck),
        database=None,
        print_blob=True,
    )
    @given(st.randoms(use_true_random=False) | st.integers(0, 2**32).map(Random))
    def attack(chance: Random) -> None:
        case(chance)

    with warnings.catch_warnings(), bounded_memory():
        warnings.simplefilter("ignore")
        attack()
