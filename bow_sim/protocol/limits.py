"""How large a sweep may be: checked by everyone who takes one from the network, before anything is allocated for it."""

from __future__ import annotations

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection_text import FUNCTIONS

MAX_CELLS = 1 << 22
"""Cells of one sweep at most: 4 194 304, some 500 maps of the paper; beyond that a typing error is likelier."""

MAX_BLOCK_CELLS = 1024
"""Lanes of one kernel call at most."""

MAX_VERDICTS = 1 << 27
"""Cells times tests of a sweep at most: the map that the coordinator keeps of them has 17 bytes for each."""

MAX_CHUNK_VALUES = 400_000
"""Cells times samples of a chunk at most: a message of 1.6 MB, and the bound that BridgeForce.msg has."""

MAX_HISTORY = 1 << 23
"""Cells of a block times greatest lag of a reflection function at most: the kernel keeps a number for each."""


def check_size(nx: int, ny: int, block_cells: int, parameters: Parameters) -> None:
    """Refuse a sweep that is larger than anybody would want.

    Raises
    ------
    ParameterError
        Naming what is too large, and the limit.
    """
    for name, count in (("x.count", nx), ("y.count", ny)):
        if not 1 <= count <= MAX_CELLS:
            raise ParameterError(f"{name} = {count}: should be 1 ... {MAX_CELLS}")
    if nx * ny > MAX_CELLS:
        raise ParameterError(f"x.count * y.count = {nx * ny} cells: should be at most {MAX_CELLS}")
    if nx * ny * parameters.chunks > MAX_VERDICTS:
        raise ParameterError(
            f"periods = {parameters.periods}: {nx * ny} cells with {parameters.chunks} tests each; should be at most "
            f"{MAX_VERDICTS} in all"
        )
    check_block(min(block_cells, nx * ny), parameters)
    if not 1 <= block_cells <= MAX_BLOCK_CELLS:
        raise ParameterError(f"block_cells = {block_cells}: should be 1 ... {MAX_BLOCK_CELLS}")


def check_block(cells: int, parameters: Parameters) -> None:
    """Refuse a block whose computation or messages would take more memory than a block should.

    Raises
    ------
    ParameterError
        Naming what is too large, and the limit.
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
    from bow_sim.physics.reflection_text import parse  # it is large

    return parse(text, name).last
