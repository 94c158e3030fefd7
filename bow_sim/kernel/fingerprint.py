"""What a machine computes for a sweep, in a line of text: hashes of sources and of a reference computation.

Every operation of the kernel is exactly rounded and none is fused or reordered, and the tables that it gets are made of
such operations and of correctly rounded functions. So two machines should compute the same; here is seen that they do.
"""

from __future__ import annotations

import functools
import hashlib
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.sources import source_hash
from bow_sim.physics.kinds import MODEL, common, kinds_of
from bow_sim.physics.parameters import Parameters


class Axis(Protocol):
    """An axis of a sweep."""

    @property
    def name(self) -> str:
        """Of the parameter."""

    def values(self) -> NDArray[np.float64]:
        """Return the values along the axis."""


CHUNKS = 4
"""The reference computation is so many times five periods long, if the sweep is."""

PLACES = ((0, 0), (1, 0), (0, 1), (1, 1), (0.5, 0.5), (0.25, 0.75), (0.75, 0.25), (0.6, 0.9))
"""Its cells, as shares of both axes: eight, as many as the time loop computes at once."""


PARTS = {
    "source": "the sources of bow",
    "axes": "the values of the axes",
    "tables": "the reflection functions, gestures and laws that the time loop gets",
    "kernel": "the compiled time loop",
}
"""What a fingerprint has a hash of, in this order."""


def fingerprint(parameters: Parameters, x: Axis, y: Axis) -> str:
    """Return what this machine computes for a sweep: hashes of sources, axes, tables and a few waveforms; one line.

    Two machines with the same fingerprint give a cell the same bytes, whatever their processors and libraries are.
    Eight cells of the plane are simulated for some periods; that takes some hundredths of a second where the kernel
    is compiled.

    Parameters
    ----------
    parameters : Parameters
        Those that all cells share.
    x, y : Axis
        The axes of the sweep.

    Raises
    ------
    ParameterError
        If a cell cannot be.
    """
    own_x, own_y = ((axis.name, tuple(axis.values().tolist())) for axis in (x, y))
    return _fingerprint(parameters, own_x, own_y)


@functools.lru_cache(maxsize=64)
def _fingerprint(parameters: Parameters, x: tuple[str, tuple[float, ...]], y: tuple[str, tuple[float, ...]]) -> str:
    from bow_sim.kernel.block import Block  # Numba takes long to import

    places: list[tuple[float, float]] = [*PLACES]
    for along, (name, values) in enumerate((x, y)):
        if name == MODEL:  # each of them has its own tables
            shares = [n / max(len(values) - 1, 1) for n in range(len(values))]
            places += [(0.5, share) if along else (share, 0.5) for share in shares]
    cells = {
        name: np.array([values[round(share * (len(values) - 1))] for share in shares])
        for (name, values), shares in zip((x, y), np.array(places).T.tolist(), strict=True)
    }
    kinds = kinds_of(cells)
    given, computed = [], []
    for kind in [0] if kinds is None else np.unique(kinds).tolist():
        own = cells if kinds is None else {name: values[kinds == kind] for name, values in cells.items()}
        block = Block(*common(parameters, own)[:2])
        given.append(_digest(block.contents()))
        computed.append(([block.advance() for _ in range(min(CHUNKS, parameters.chunks))], block.contents()))
    hashes = (source_hash(), _digest((x, y)), _digest(given), _digest(computed))
    return " ".join(f"{part}-{found}" for part, found in zip(PARTS, hashes, strict=True))


def difference(there: str, here: str) -> str:
    """Return in words in which parts two fingerprints differ; "" if they are equal."""
    a, b = (dict(word.split("-", 1) for word in text.split() if "-" in word) for text in (there, here))
    if there == here:
        return ""
    if a.keys() != b.keys():
        return "one of them was made by another release of bow"
    return " and ".join(PARTS.get(part, part) for part in b if a[part] != b[part])


def _digest(values: Any) -> str:
    """Return a hash of numbers in nested tuples and arrays, every bit of them."""
    digest = hashlib.sha256()

    def take(value: Any) -> None:
        if isinstance(value, np.ndarray):
            digest.update(f"{value.dtype.str} {value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, (tuple, list)):
            digest.update(f"{len(value)}".encode())
            for one in value:
                take(one)
        elif value is None or isinstance(value, str):
            digest.update(f"{value}".encode())
        else:
            digest.update(float(value).hex().encode())

    take(values)
    return digest.hexdigest()[:8]
