"""Cells that differ in a few parameters, as arrays; the kernel computes each cell in a lane."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bow_sim.physics.body import MODE_RANGE, mode_setting, mode_unit
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import Range
from bow_sim.physics.instruments import SI, lanes_in_paper_units
from bow_sim.physics.parameters import FIELDS, SWEEPABLE, SWEEPABLE_NAMES, TYPES, Parameters, check_friction
from bow_sim.physics.reflection import Body, Ends, ends
from bow_sim.physics.schelleng import greatest

GESTURE = {"f_asym", "f_init_ratio", "sustained", "tau_f", "tau_v", "acceleration", "v_b"}
FREE = frozenset({*GESTURE, "mu_s", "mu_d", "v_mid", "string_length"}) | {
    name for name in FIELDS if name.startswith(("hair_", "rosin_", "ribbon_", "v_unit"))
}
"""Parameters of gesture, bow and friction; the other sweepable ones change the reflection functions, or
only the body."""


@dataclass(frozen=True)
class Cells:
    """Parameters of the cells of a block.

    Parameters
    ----------
    parameters : Parameters
        The parameters that all cells share.
    lanes : dict of str to ndarray, shape (cells,)
        The ones that differ, by name.
    ends : tuple of Ends
        One for each cell, or a single one that all share.
    bodies : tuple of Body
        One for each cell, a single one that all share, or none. The cells may have bodies of their own on a string that
        they share.
    """

    parameters: Parameters
    lanes: dict[str, NDArray[np.float64]]
    ends: tuple[Ends, ...]
    bodies: tuple[Body, ...] = ()

    @property
    def count(self) -> int:
        """The number of cells."""
        return len(next(iter(self.lanes.values())))

    def value(self, name: str) -> NDArray[np.float64]:
        """Return a parameter of every cell, shape (cells,)."""
        given = self.lanes.get(name)
        return np.full(self.count, float(getattr(self.parameters, name))) if given is None else given

    def taken(self, order: NDArray[np.int64]) -> Cells:
        """Return the cells of these numbers, in this order."""
        ends, bodies = self.ends, self.bodies
        return Cells(
            self.parameters,
            {name: values[order] for name, values in self.lanes.items()},
            tuple(ends[i] for i in order) if len(ends) > 1 else ends,
            tuple(bodies[i] for i in order) if len(bodies) > 1 else bodies,
        )

    def of_ends(self, name: str) -> NDArray[np.float64]:
        """Return an admittance (``y_t``, ``y_r`` or ``y``) of every cell, shape (cells,)."""
        values = np.array([getattr(e, name) for e in self.ends])
        return np.full(self.count, values[0]) if len(values) == 1 else values

    def hair_admittance(self) -> NDArray[np.float64]:
        """Return ``2 Z_0/R`` of the dashpot R of the bow hair, as y_t is 2; shape (cells,), 0 for a rigid bow.

        See PHYSICS.md section 12.
        """
        r = self.value("hair_r")
        return np.where(r > 0, self.of_ends("y_t") * self.value("z_0") / np.where(r > 0, r, 1.0), 0.0)

    def bow_admittance(self) -> NDArray[np.float64]:
        """Return the admittance that the friction force meets, string and hair together; shape (cells,)."""
        return self.of_ends("y") + self.hair_admittance()


def cells(parameters: Parameters, lanes: Mapping[str, ArrayLike]) -> Cells:
    """Check the parameters that differ between cells, and compute the reflection functions.

    Parameters
    ----------
    parameters : Parameters
        The parameters that all cells share.
    lanes : Mapping[str, array_like], each of shape (cells,)
        Values by the name of a parameter in :data:`bow_sim.physics.parameters.SWEEPABLE`.

    Raises
    ------
    ParameterError
        Naming ``lanes.<parameter>[<cell>]`` and the value.
    """
    arrays = {name: _lane(name, values) for name, values in paper_lanes(parameters, lanes).items()}
    sizes = {name: len(values) for name, values in arrays.items()}
    if not sizes or len(set(sizes.values())) > 1 or 0 in sizes.values():
        raise ParameterError(f"lanes: lengths {sizes}: must be one or more arrays of one length, at least 1")
    plain = Cells(parameters, arrays, ())
    mu_s, mu_d, v_mid, v_b = (plain.value(name) for name in ("mu_s", "mu_d", "v_mid", "v_b"))
    right = (mu_d < mu_s) & (v_mid < v_b) | (parameters.friction == "curve")
    for i in np.flatnonzero(~right)[:1]:
        check_friction(float(mu_s[i]), float(mu_d[i]), float(v_mid[i]), float(v_b[i]), f"lanes[{i}]: ")
    names = tuple(sorted(set(arrays) - FREE))
    if not names:
        return _sustained(_of(parameters, arrays, (ends(parameters),)))
    columns = zip(*(arrays[name].tolist() for name in names), strict=True)
    every = tuple(_ends(parameters, names, column, i) for i, column in enumerate(columns))
    one_string = all(name == "body_scale" or mode_setting(name) for name in names)
    return _sustained(_of(parameters, arrays, every, every[:1] if one_string else every))


def _of(
    parameters: Parameters, arrays: dict[str, NDArray[np.float64]], every: tuple[Ends, ...], own: tuple[Ends, ...] = ()
) -> Cells:
    """Return cells with the ends `own`, and the bodies that `every` has: one, if all have the same."""
    bodies = tuple(e.body for e in every if e.body is not None)
    return Cells(parameters, arrays, own or every, bodies[:1] if len(set(bodies)) == 1 else bodies)


def _sustained(made: Cells) -> Cells:
    """Give each cell the initial force that `sustained` says, as its own f_init_ratio (PHYSICS.md section 14)."""
    share = made.value("sustained")
    if not share.any():
        return made
    values = {name: made.value(name) for name in SWEEPABLE | {"period"}}
    most = greatest(made.parameters.friction, values, made.of_ends("y"))
    ratio = np.where(share > 0, share * most / made.value("f_asym"), made.value("f_init_ratio"))
    return replace(made, lanes=made.lanes | {"f_init_ratio": ratio})


def paper_lanes(parameters: Parameters, lanes: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Return the values of cells, by name, with those in SI units as values of the paper's settings."""
    if not lanes.keys() & SI.keys():
        return dict(lanes)
    arrays = {name: np.asarray(values, np.float64) for name, values in lanes.items()}
    return dict(lanes_in_paper_units(arrays, vars(parameters), "lanes."))


def _lane(name: str, values: ArrayLike) -> NDArray[np.float64]:
    mode = mode_unit(name)
    if mode is None and name not in SWEEPABLE:
        why = "is not a parameter" if name not in FIELDS else "is the same for all cells of a block"
        raise ParameterError(f"lanes.{name}: {why}; must be one of {SWEEPABLE_NAMES}")
    array: NDArray[np.float64] = np.array(values, dtype=np.float64)
    if array.ndim != 1:
        raise ParameterError(f"lanes.{name}: shape {array.shape}: must be one value for each cell")
    limits: Range = MODE_RANGE if mode else FIELDS[name].metadata["range"]
    right = np.isfinite(array)
    right &= (array > limits.low) if limits.low_open else (array >= limits.low)
    right &= (array < limits.high) if limits.high_open else (array <= limits.high)
    whole = TYPES.get(name) is int
    if whole:
        right &= array == np.floor(array)
    for i in np.flatnonzero(~right)[:1]:
        raise ParameterError(
            f"lanes.{name}[{i}] = {float(array[i])!r}: must be a {'whole ' if whole else ''}number {limits} "
            f"({mode[1] if mode else FIELDS[name].metadata['doc']})"
        )
    return array


def _ends(parameters: Parameters, names: tuple[str, ...], values: tuple[float, ...], cell: int) -> Ends:
    try:
        return _ends_of(parameters, names, values)
    except ParameterError as error:
        raise ParameterError(f"lanes[{cell}]: {error}") from None


@functools.lru_cache(maxsize=4096)
def _ends_of(parameters: Parameters, names: tuple[str, ...], values: tuple[float, ...]) -> Ends:
    """Return reflection functions; cached, as the blocks of a sweep need the same ones again."""
    changes: dict[str, Any] = dict(zip(names, values, strict=True))
    return ends(parameters.replace(**changes))
