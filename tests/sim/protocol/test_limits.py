"""A sweep that would take too much memory is refused before any of it is allocated."""

from typing import Any

import pytest
from outlines import outline

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.protocol.limits import MAX_CELLS, check_size
from bow_sweep.plan.sweep import Sweep

LAGS = "nut_function=first=65536 taps=-0.9"

TOO_LARGE = [
    (["x.count=4194305", "y.count=1"], "x.count = 4194305"),
    (["x.count=2048", "y.count=4096"], "8388608 cells"),
    (["x.count=2048", "y.count=2048", "periods=1000000"], "tests each"),
    (["block_cells=1025"], "block_cells = 1025"),
    (["block_cells=1024"], "a message; should be at most 575"),
    (["block_cells=512", LAGS], "looks back so far"),
]


@pytest.mark.parametrize(("settings", "message"), TOO_LARGE)
def test_what_is_too_large_is_named_with_the_limit(settings: list[str], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        Sweep.from_spec("", settings)
    lines = {line.partition("=")[0]: line for line in [*Sweep.from_spec().settings(), *settings]}
    with pytest.raises(ParameterError, match=message):
        outline("a" * 16, "b" * 16, lines.values())


@pytest.mark.parametrize(
    "settings",
    [["x.count=2048", "y.count=2048"], ["block_cells=512"], ["block_cells=128", LAGS], ["period=4096"]],
)
def test_what_is_only_large_is_not(settings: list[str]) -> None:
    assert Sweep.from_spec("", settings).cells <= MAX_CELLS


@pytest.mark.parametrize("sizes", [(0, 1, 1), (1, 0, 1), (1, 1, 0), (-1, -1, 1)])
def test_a_sweep_without_cells_is_refused(sizes: Any) -> None:
    with pytest.raises(ParameterError):
        check_size(*sizes, Parameters())
