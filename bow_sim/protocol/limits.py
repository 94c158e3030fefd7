"""The largest sweep that is accepted. Every node checks it before it allocates memory for a sweep from the network."""

from __future__ import annotations

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection_text import FUNCTIONS

MAX_CELLS = 1 << 22
"""Largest number of cells of a sweep, 500 times the paper's maps. A larger number is probably a typing error."""

MAX_BLOCK_CELLS = 1024
"""Largest number of cells of a block: lanes of one kernel call."""

MAX_VERDICTS = 1 << 27
"""Largest product of cells and tests of a sweep. The coordinator keeps 17 bytes of each test of each cell."""

MAX_CHUNK_VALUES = 400_000
"""Largest product of cells and samples of a chunk: a message of 1.6 MB, the bound in BridgeForce.msg."""

MAX_HISTORY = 1 << 23
"""Largest product of the cells of a block and the longest lag of a reflection function, in samples. The kernel keeps a
number for each."""


def check_size(nx: int, ny: int, block_cells: int, parameters: Parameters, repeats: int = 0) -> None:
    """Check the size of a sweep; `repeats` is how often each cell is repeated beside itself.

    Raises
    ------
    ParameterError
        For a sweep that is too large, or has no cells; names the setting and its limit.
    """
    for name, count in (("x.count", nx), ("y.count", ny)):
        if not 1 <= count <= MAX_CELLS:
            raise ParameterError(f"{name} = {count}: should be 1 ... {MAX_CELLS}")
    if nx * ny > MAX_CELLS:
        raise ParameterError(f"x.count * y.count = {nx * ny} cells: should be at most {MAX_CELLS}")
    cells = nx * ny * (1 + repeats)
    if cells > MAX_CELLS:
        most = MAX_CELLS // (nx * ny) - 1
        raise ParameterError(f"repeats = {repeats}: {cells} cells in all; should be at most {most} for this plane")
    if cells * parameters.chunks > MAX_VERDICTS:
        raise ParameterError(
            f"periods = {parameters.periods}: {cells} cells with {parameters.chunks} tests each; should be at most "
            f"{MAX_VERDICTS} in all"
        )
    check_block(min(block_cells, cells), parameters)
    if not 1 <= block_cells <= MAX_BLOCK_CELLS:
        raise ParameterError(f"block_cells = {block_cells}: should be 1 ... {MAX_BLOCK_CELLS}")


def check_block(cells: int, parameters: Parameters) -> None:
    """Check the memory that the computation of a block and its messages take.

    Raises
    ------
    ParameterError
        For a block that is too large, or has no cells; names the setting and its limit.
    """
    if not 1 <= cells <= MAX_BLOCK_CELLS:
        raise ParameterError(f"block_cells = {cells}: should be 1 ... {MAX_BLOCK_CELLS}")
    if cells * parameters.chunk_samples > MAX_CHUNK_VALUES:
        raise ParameterError(
            f"block_cells = {cells}: times {parameters.chunk_samples} samples of five periods is more than "
            f"{MAX_CHUNK_VALUES} a message; should be at most {MAX_CHUNK_VALUES // parameters.chunk_samples}"
        )
    for name in FUNCTIONS:
        text = getattr(parameters, name)
        if text and cells * _greatest_lag(text, name) > MAX_HISTORY:
            most = MAX_HISTORY // _greatest_lag(text, name)
            raise ParameterError(f"block_cells = {cells}: {name} looks back so far that it should be at most {most}")


def _greatest_lag(text: str, name: str) -> int:
    from bow_sim.physics.reflection_text import parse  # slow to import

    return parse(text, name).last
