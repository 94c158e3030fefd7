"""How sure a map is: what the repeats of each cell, with slightly other bow forces, end as (PHYSICS.md section 15)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol.repeats import NAMES

if TYPE_CHECKING:
    from bow_sim.protocol.repeats import Repeats
    from bow_sweep.maps.basin_map import Basin

RELIABLE = 0.9
"""A cell is reliable if at least this share of its repeats ends as the cell itself does."""

LOW, HIGH = 0.1, 0.9
"""The percentiles of the transient lengths, as shares."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Reliability:
    """What the repeats of the cells of a map end as. Only blocks that are done count; the cells themselves do not.

    Attributes
    ----------
    reliability
        (ny, nx) float32: share of the repeats whose regime at the last test is that of the cell; NaN where the cell,
        or all of its repeats, are not done.
    same_transient
        (ny, nx) float32: share of the repeats whose transient length is that of the cell; NaN likewise.
    repeats_done
        (ny, nx) uint16: number of repeats.
    repeat_regimes
        (regimes, ny, nx) float32: share of the repeats that end in each regime; NaN where none is done.
    transient_low, transient_high
        (ny, nx) float32: 10th and 90th percentile of the repeats' transient lengths, periods: the shortest length that
        is not exceeded by so many of them. 0 = never, which counts as the longest; NaN where none is done.
    """

    reliability: np.ndarray
    same_transient: np.ndarray
    repeats_done: np.ndarray
    repeat_regimes: np.ndarray
    transient_low: np.ndarray
    transient_high: np.ndarray

    @classmethod
    def of(cls, shape: tuple[int, int], regime: np.ndarray, transient_periods: np.ndarray, done: np.ndarray) -> Any:
        """Return what repeats say of a map; None where there are none.

        Parameters
        ----------
        shape
            (ny, nx).
        regime, transient_periods, done
            ((1 + repeats) * ny * nx,), the cells first: code at the last test; periods, 0 = never; whether done.
        """
        ny, nx = shape
        regimes, lengths, known = (np.asarray(each).reshape(-1, ny, nx) for each in (regime, transient_periods, done))
        if len(known) < 2:
            return None
        there, count = known[1:], known[1:].sum(axis=0)
        with np.errstate(invalid="ignore"):  # 0/0 is NaN: no repeat is known
            shares = {
                name: np.where(known[0], ((each[1:] == each[0]) & there).sum(axis=0) / count, np.nan)
                for name, each in (("reliability", regimes), ("same_transient", lengths))
            }
            of_regimes = [((regimes[1:] == code) & there).sum(axis=0) / count for code in range(len(REGIMES))]
        # NaN is sorted behind "never"
        ordered = np.sort(np.where(there, np.where(lengths[1:] > 0, lengths[1:], np.inf), np.nan), axis=0)
        low, high = (_percentile(ordered, count, share) for share in (LOW, HIGH))
        return cls(
            **{name: share.astype(np.float32) for name, share in shares.items()},
            repeats_done=count.astype(np.uint16),
            repeat_regimes=np.array(of_regimes, np.float32),
            transient_low=low,
            transient_high=high,
        )

    @classmethod
    def of_basin(cls, basin: Basin, done: np.ndarray) -> Any:
        """Return what the repeats of a sweep's verdicts say; None where there are none. `done` as for :meth:`of`."""
        lengths = np.nan_to_num(basin.transient_periods)
        return cls.of((basin.ny, basin.nx), basin.latest("regime"), lengths, done)

    @classmethod
    def in_file(cls, arrays: Mapping[str, np.ndarray], shape: tuple[int, int]) -> Any:
        """Return what the arrays of a map file have of repeats; None where they have nothing.

        Raises
        ------
        ValueError
            Where an array is missing, or has another type or shape.
        """
        if "reliability" not in arrays:
            return None
        right = cls.of(shape, *(np.zeros((2, *shape), kind) for kind in (np.uint8, np.float32, bool)))
        found = {}
        for field in fields(cls):
            made = getattr(right, field.name)
            given = found[field.name] = arrays.get(field.name, np.zeros(0))
            whole = made.shape[-2:] if made.ndim == 3 else made.shape  # later versions may know more regimes
            if given.dtype != made.dtype or given.ndim != made.ndim or given.shape[-2:] != whole:
                what = f"{given.dtype} with shape {given.shape}" if field.name in arrays else "missing"
                raise ValueError(f"{field.name} is {what}, should be {made.dtype} with {made.shape}")
        return cls(**found)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, as in ``map.npz``."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def of_cells(self) -> dict[str, np.ndarray]:
        """Return the arrays that have one value for each cell, by name, (ny, nx) each."""
        return {name: values for name, values in self.arrays().items() if values.ndim == 2}

    @property
    def reliable(self) -> np.ndarray:
        """(ny, nx) bool: at least `RELIABLE` of the repeats end as the cell does; False where this is not known."""
        return np.nan_to_num(self.reliability) >= np.float32(RELIABLE)

    @property
    def known(self) -> np.ndarray:
        """(ny, nx) bool: the cell and some of its repeats are done."""
        return ~np.isnan(self.reliability)

    def findings(self, repeats: Repeats, helmholtz: np.ndarray) -> dict[str, Any]:
        """Return the entry `repeats` of a report.

        Parameters
        ----------
        repeats
            The settings.
        helmholtz
            (ny, nx) bool: where Helmholtz motion came.

        Returns
        -------
        dict
            ``repeats``, ``jitter``, ``seed``; ``reliable``, share of the cells that are reliable, and
            ``reliable_helmholtz``, of the cells with Helmholtz motion; ``verdict_changed`` and ``transient_changed``,
            shares of the repeats. None where no repeat is known.
        """
        known, count = self.known, np.where(self.known, self.repeats_done, 0).astype(float)

        def changed(same: np.ndarray) -> float | None:
            return float((count * (1 - np.nan_to_num(same.astype(float)))).sum() / count.sum()) if count.any() else None

        def share(of: np.ndarray) -> float | None:
            return float(self.reliable[of].mean()) if of.any() else None

        return {
            **dict(zip(NAMES, (repeats.count, repeats.jitter, repeats.seed), strict=True)),
            "reliable": share(known),
            "reliable_helmholtz": share(known & np.asarray(helmholtz, bool)),
            "verdict_changed": changed(self.reliability),
            "transient_changed": changed(self.same_transient),
        }


def in_words(found: Mapping[str, Any]) -> list[str]:
    """Return an entry of :meth:`Reliability.findings` as lines for people."""
    numbers = {name: found[name] for name in ("reliable", "verdict_changed", "transient_changed")}
    if None in numbers.values():
        return ["repeats: none is done"]
    of_helmholtz = found["reliable_helmholtz"]
    where = f", {of_helmholtz:.3f} of those with Helmholtz motion" if of_helmholtz is not None else ""
    return [
        f"{found['repeats']} repeats with forces up to {100 * found['jitter']:.4g} % off: "
        f"reliable in {numbers['reliable']:.3f} of the cells{where}",
        f"of the repeats, {numbers['verdict_changed']:.3f} end otherwise than their cell, "
        f"{numbers['transient_changed']:.3f} have another transient length",
    ]


def _percentile(ordered: np.ndarray, count: np.ndarray, share: float) -> np.ndarray:
    """Return the value of each cell that `share` of its first `count` sorted values do not exceed, (ny, nx) float32.

    Infinity, which is "never", becomes 0; NaN where there is no value.
    """
    ranks = np.array([max(math.ceil(round(share * n, 9)), 1) - 1 for n in range(len(ordered) + 1)])
    found = np.take_along_axis(ordered, ranks[count][None], axis=0)[0]
    return np.where(np.isinf(found), 0, found).astype(np.float32)
