"""Edges of a map, bisected in parallel lanes of the kernel (PHYSICS.md section 15)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.cells import paper_lanes
from bow_sim.physics.kinds import is_kind
from bow_sweep.edges.boundary import Boundary, EdgesError
from bow_sweep.edges.motions import OUTCOMES, Motions, batches, compute
from bow_sweep.edges.parting import DECISION, GRAIN, KINDS, UNSTABLE, kind_of, part, slope_of
from bow_sweep.plan.sweep import Sweep

HALVINGS = 44
"""Of a cell: what remains is 1/2e13 of it, and two motions that differ by rounding only."""


@dataclass(frozen=True, eq=False)
class Edges:
    """Bisected edges of a map. Arrays are (edges,), or (edges, halvings + 1) where so said.

    Attributes
    ----------
    boundary
        Where they are.
    outcome
        What was bisected, one of `OUTCOMES`.
    low, high
        The values between which the outcome still changes, of the parameter along x or y.
    low_regime, high_regime
        uint8: regimes at the last test there.
    width
        (edges, halvings + 1): high - low before the first halving, and after each.
    step, release, parting
        (edges, halvings + 1): as in :class:`bow_sweep.edges.parting.Parting`, of each bracket.
    slope
        Periods by which the parting is later where the bracket is narrower by e.
    kind
        Index into `KINDS`.
    period
        Nominal period, samples.
    unlike
        Edges of the map that are none here: the two cells, computed again, have one outcome.
    """

    boundary: Boundary
    outcome: str
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    low_regime: NDArray[np.uint8]
    high_regime: NDArray[np.uint8]
    width: NDArray[np.float64]
    step: NDArray[np.int64]
    release: NDArray[np.bool_]
    parting: NDArray[np.int64]
    period: int
    unlike: int = 0
    slope: NDArray[np.float64] = field(init=False)
    kind: NDArray[np.uint8] = field(init=False)

    def __post_init__(self) -> None:
        slope = [slope_of(w, p) for w, p in zip(self.width, self.parting, strict=True)]
        each = zip(self.step, self.parting[:, -1].tolist(), slope, strict=True)
        kinds = [kind_of(steps, parting, rise, self.period) for steps, parting, rise in each]
        object.__setattr__(self, "slope", np.array(slope, float))
        object.__setattr__(self, "kind", np.array(kinds, np.uint8))

    def __len__(self) -> int:
        return len(self.low)

    @property
    def growth(self) -> NDArray[np.float64]:
        """(edges,) growth of a small difference, 1/slope per period; NaN where the kind is not *unstable*."""
        return np.where(self.kind == UNSTABLE, 1 / np.where(self.slope > 0, self.slope, np.inf), np.nan)

    @property
    def settled(self) -> NDArray[np.float64]:
        """(edges,) width of the widest bracket from which on the deciding step is the last one; NaN without one."""
        same = np.logical_and.accumulate((self.step == self.step[:, -1:])[:, ::-1], axis=1)[:, ::-1]
        widest = np.take_along_axis(self.width, same.argmax(axis=1)[:, None], axis=1)[:, 0]
        return np.where((self.step[:, -1] >= 0) & np.isin(self.kind, (DECISION, GRAIN)), widest, np.nan)

    def counts(self) -> dict[str, int]:
        """Return the number of edges of each kind."""
        return {name: int((self.kind == code).sum()) for code, name in enumerate(KINDS)}


def bisect(
    sweep: Sweep,
    boundary: Boundary,
    outcome: str = "helmholtz",
    halvings: int = HALVINGS,
    progress: Callable[[float, float], None] | None = None,
) -> Edges:
    """Bisect edges of the map of a sweep.

    The middle of a bracket takes the place of that end whose outcome it has; where it has neither, which regimes make
    possible, that of the high end. A bracket whose middle is one of its ends stays as it is.

    Parameters
    ----------
    progress
        Called with (halvings done, halvings of all edges).

    Raises
    ------
    EdgesError
        Where an axis has models or thresholds.
    """
    for axis in (sweep.x, sweep.y):
        if is_kind(axis.name):
            right = "should be a map whose axes are numbers of the string, for instance one of a single model"
            raise EdgesError(f"axis {axis.name}: its edges are not bisected; {right}")
    x, y = sweep.x.values(), sweep.y.values()
    parts = []
    for numbers in batches(len(boundary), sweep):
        batch = _Batch(sweep, boundary.only(numbers), x, y, outcome)
        for halving in range(halvings):
            batch.halve()
            if progress:
                progress(float(numbers[0]) * halvings + (halving + 1) * len(numbers), float(len(boundary)) * halvings)
        parts.append(batch)
    return _joined(parts, outcome, sweep.parameters.period)


class _Batch:
    """Edges that are bisected together."""

    def __init__(
        self, sweep: Sweep, edges: Boundary, x: NDArray[np.float64], y: NDArray[np.float64], outcome: str
    ) -> None:
        self.sweep, self.outcome = sweep, OUTCOMES[outcome]
        low_x, high_x, low_y, high_y = edges.ends(x, y)
        self.names = (sweep.x.name, sweep.y.name)
        low = compute(sweep, dict(zip(self.names, (low_x, low_y), strict=True)))
        high = compute(sweep, dict(zip(self.names, (high_x, high_y), strict=True)))
        real = np.flatnonzero(self.outcome(low.regimes) != self.outcome(high.regimes))
        self.unlike = len(edges) - len(real)
        self.edges = edges.only(real)
        self.motions = [Motions(m.force[real], m.slipping[real], m.regimes[:, real]) for m in (low, high)]
        along_x = self.edges.along == 0
        self.fixed = np.where(along_x, low_y[real], low_x[real])
        lanes = {name: values[real] for name, values in zip(self.names, (low_x, low_y), strict=True)}
        self.speed = np.broadcast_to(paper_lanes(sweep.parameters, lanes).get("v_b", sweep.parameters.v_b), len(real))
        self.values = [np.where(along_x, low_x[real], low_y[real]), np.where(along_x, high_x[real], high_y[real])]
        self.low_outcome = self.outcome(self.motions[0].regimes)
        self.rows: list[tuple[NDArray[np.float64], ...]] = []
        self._compare(np.arange(len(real)))

    def halve(self) -> None:
        """Halve all brackets once."""
        low, high = self.values
        middle = low + (high - low) / 2
        active = np.flatnonzero((middle != low) & (middle != high))
        if len(active):
            along_x, at, fixed = self.edges.along[active] == 0, middle[active], self.fixed[active]
            lanes = (np.where(along_x, at, fixed), np.where(along_x, fixed, at))
            found = compute(self.sweep, dict(zip(self.names, lanes, strict=True)))
            to_low = self.outcome(found.regimes) == self.low_outcome[active]
            for end, chosen in enumerate((to_low, ~to_low)):
                self.values[end][active[chosen]] = at[chosen]
                self.motions[end].take(active[chosen], found, np.flatnonzero(chosen))
        self._compare(active)

    def _compare(self, changed: NDArray[np.int64]) -> None:
        """Note how the two motions of each bracket differ; only some have changed since it was noted last."""
        low, high = self.motions
        force, slipping = (low.force[changed], high.force[changed]), (low.slipping[changed], high.slipping[changed])
        new = part(force, slipping, self.sweep.parameters.period, self.speed[changed])
        count = len(self.fixed)
        blank = (np.zeros(count), np.full(count, -1.0), np.zeros(count), np.full(count, -1.0))
        row = [column.copy() for column in (self.rows[-1] if self.rows else blank)]
        row[0][:] = np.abs(self.values[1] - self.values[0])
        for column, values in zip(row[1:], new, strict=True):
            column[changed] = values
        self.rows.append(tuple(row))


def _joined(parts: list[_Batch], outcome: str, period: int) -> Edges:
    """Return the edges of all batches."""

    def rows(column: int) -> NDArray[Any]:
        return np.concatenate([np.stack([row[column] for row in batch.rows], axis=1) for batch in parts])

    def each(values: Callable[[_Batch], NDArray[Any]]) -> NDArray[Any]:
        return np.concatenate([values(batch) for batch in parts])

    return Edges(
        boundary=Boundary(each(lambda b: b.edges.along), each(lambda b: b.edges.ix), each(lambda b: b.edges.iy)),
        outcome=outcome,
        low=each(lambda b: b.values[0]),
        high=each(lambda b: b.values[1]),
        low_regime=each(lambda b: b.motions[0].regimes[-1]),
        high_regime=each(lambda b: b.motions[1].regimes[-1]),
        width=rows(0),
        step=rows(1).astype(np.int64),
        release=rows(2) != 0,
        parting=rows(3).astype(np.int64),
        period=period,
        unlike=sum(batch.unlike for batch in parts),
    )
