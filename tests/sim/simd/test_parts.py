"""Functions that only compiled functions call are optimised once, with the whole that they are part of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from numba.core.codegen import CPUCodeLibrary

from bow_sim.simd.jit import njit, part


@pytest.fixture
def optimised(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The functions that Numba has optimised, by name."""
    names: list[str] = []
    optimise: Callable[[Any], None] = CPUCodeLibrary._optimize_final_module

    def noting(library: Any) -> None:
        names.append(library.name)
        optimise(library)

    monkeypatch.setattr(CPUCodeLibrary, "_optimize_final_module", noting)
    return names


def test_a_whole_is_optimised_once_with_all_its_parts(optimised: list[str]) -> None:
    @part()
    def third(x):
        return x * 3

    @part(forceinline=True)
    def sixth(x):
        return third(x) + third(x)

    @njit()
    def whole(x):
        return sixth(x) + third(x)

    assert whole(7) == 63
    assert [name.rpartition(".")[2] for name in optimised if name != "nrt"] == ["whole"]  # nrt is of Numba itself


def test_a_part_can_be_called_from_python_before_and_after(optimised: list[str]) -> None:
    @part()
    def double(x):
        return 2 * x

    @njit()
    def whole(x):
        return double(x) + 1

    assert (double(3), whole(3), double(4), double(0.5)) == (6, 7, 8, 1.0)
