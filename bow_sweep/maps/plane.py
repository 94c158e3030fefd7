"""What every map has: a plane of two parameters and what is known of each cell. The map in the middle of a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS
from bow_sweep.maps.axes import PlotAxis

CLEAR, NEVER, NOT_COMPUTED = 0, 1, 2
"""Codes of :meth:`Plane.mask`."""

MODEL_NAMES = {
    "stiff_cremer": "Stiff/Cremer",
    "delta_cremer": "Delta/Cremer",
    "raman": "Raman",
    "friedlander": "Friedlander",
    "rounded_corner": "Rounded-corner",
    "torsion_absorbed": "Torsion-absorbed",
}
"""Names of the models in the paper."""

TEST_LAYERS = ("correlation", "slips", "corners")
"""The three tests of section III.B."""

TEST_RANGES = {"correlation": (0.0, 1.0), "slips": (0.0, 15.0), "corners": (0.0, 25.0)}
"""Range of the colour scale of each test; values outside take the colour of the nearer end."""

WANTED = {"correlation": 1.0, "slips": 5.0, "corners": 5.0}
"""Results of the tests for Helmholtz motion, over five periods."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """What every map has. Arrays are (ny, nx); row 0 is the first value of y.

    Attributes
    ----------
    x, y
        (nx,) and (ny,) values of the parameters `x_name` and `y_name`.
    transient_periods
        float32, periods until the tests first passed; 0 = never, NaN = pending or quarantined.
    regime
        uint8, index into `regime_names` at the latest test; `PENDING` = no verdict.
    settings
        "name=value", every setting of the sweep; () where they are unknown.
    """

    run_id: str
    sweep_id: str
    x_name: str
    y_name: str
    x: np.ndarray
    y: np.ndarray
    transient_periods: np.ndarray
    regime: np.ndarray
    regime_names: tuple[str, ...]
    settings: tuple[str, ...] = ()
    preset: str = ""

    @cached_property
    def axes(self) -> tuple[PlotAxis, PlotAxis]:
        """The axes along x and y."""
        return PlotAxis.of(self.x_name, self.x), PlotAxis.of(self.y_name, self.y)

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along y and x."""
        return len(self.y), len(self.x)

    @cached_property
    def values(self) -> dict[str, str]:
        """The settings by name."""
        return dict(setting.partition("=")[::2] for setting in self.settings)

    @property
    def periods(self) -> float:
        """Length of a simulation, periods: the longest transient that can be seen; a guess without the setting."""
        try:
            return max(float(self.values["periods"]), CHUNK_PERIODS)
        except (KeyError, ValueError):
            found = np.nanmax(self.transient_periods, initial=0)
            return max(100.0, float(found))

    def mask(self) -> np.ndarray:
        """Return whether each cell has a transient length, (ny, nx) uint8: CLEAR (yes), NEVER or NOT_COMPUTED."""
        length = self.transient_periods
        return np.where(np.isnan(length), NOT_COMPUTED, np.where(length > 0, CLEAR, NEVER)).astype(np.uint8)

    def regime_counts(self) -> np.ndarray:
        """Return how many cells are in each of `regime_names` and, last, in none of them, (regimes + 1,)."""
        counts = np.bincount(np.asarray(self.regime).ravel(), minlength=PENDING + 1)
        named = counts[: len(self.regime_names)]
        return np.append(named, self.regime.size - named.sum())

    def helmholtz_fraction(self) -> float:
        """Return the share of all cells in which Helmholtz motion came."""
        return float(np.mean(np.nan_to_num(self.transient_periods) > 0))

    def with_plan(self, settings: Iterable[str], preset: str = "") -> Any:
        """Return the same map with the settings of its sweep."""
        return replace(self, settings=tuple(settings), preset=preset)


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot(Plane):
    """The map in the middle of a sweep (BasinMap.msg).

    Attributes
    ----------
    tests, slips, corners
        (ny, nx) uint16: number of tests so far; slips and corners at the latest test.
    correlation
        (ny, nx) float32 at the latest test.
    done, quarantined, outstanding
        Numbers of cells, from the coordinator; their sum is `planned`.
    """

    tests: np.ndarray
    correlation: np.ndarray
    slips: np.ndarray
    corners: np.ndarray
    done: int = 0
    quarantined: int = 0
    outstanding: int = 0

    @classmethod
    def from_message(cls, values: Mapping[str, Any] | Any) -> Snapshot:
        """Return the map in a message BasinMap.

        Parameters
        ----------
        values
            The message, or its fields from :func:`bow_sim.protocol.cdr.decode`.

        Raises
        ------
        ValueError
            Where arrays do not fit the axes, or an axis cannot be.
        """
        get = values.__getitem__ if isinstance(values, Mapping) else lambda name: getattr(values, name)
        x, y = (np.array(get(name), float) for name in ("x", "y"))
        grids: dict[str, Any] = {}
        kinds: dict[str, Any] = {"transient_periods": np.float32, "tests": np.uint16}
        kinds |= {name: VERDICT_FIELDS[name].kind for name in ("regime", *TEST_LAYERS)}
        for name, kind in kinds.items():
            flat = np.array(get(name), kind)
            if flat.size != x.size * y.size:
                raise ValueError(f"BasinMap.{name}: {flat.size} values for {x.size} x {y.size} cells")
            grids[name] = flat.reshape(y.size, x.size)
        fields: dict[str, Any] = {name: str(get(name)) for name in ("run_id", "sweep_id", "x_name", "y_name")}
        fields |= {name: int(get(f"cells_{name}")) for name in ("done", "quarantined", "outstanding")}
        snapshot = cls(**fields, **grids, x=x, y=y, regime_names=tuple(get("regime_names")))
        _ = snapshot.axes  # raises for bad axes
        return snapshot

    @classmethod
    def empty(cls, outline: SweepOutline) -> Snapshot:
        """Return the map of a sweep that has just been planned: every cell is pending."""
        shape = outline.shape
        grids: dict[str, Any] = {name: VERDICT_FIELDS[name].array(shape) for name in (*TEST_LAYERS, "regime")}
        return cls(
            run_id=outline.run_id,
            sweep_id=outline.sweep_id,
            x_name=outline.x.name,
            y_name=outline.y.name,
            x=outline.x.values(),
            y=outline.y.values(),
            transient_periods=np.full(shape, np.nan, np.float32),
            tests=np.zeros(shape, np.uint16),
            regime_names=REGIMES,
            settings=outline.settings,
            preset=outline.preset,
            outstanding=outline.cells,
            **grids,
        )

    @property
    def planned(self) -> int:
        """Number of cells that are in a block."""
        return self.done + self.quarantined + self.outstanding


def upright(grid: np.ndarray) -> np.ndarray:
    """Return a layer as an image, (ny, nx): the first row of an image is at the top, that of a map at the bottom."""
    return np.ascontiguousarray(np.asarray(grid)[::-1])


def image_of(plane: Plane) -> tuple[int, int, bytes]:
    """Return height, width and data of a sensor_msgs/Image of the transient lengths.

    Encoding "32FC1", little endian, step 4 * width; the top row is the last y. Values in periods; 0 = never,
    NaN = not computed.
    """
    height, width = plane.shape
    return height, width, upright(plane.transient_periods).astype("<f4").tobytes()


def regime_label(name: str) -> str:
    """Return the name of a regime as text for people."""
    label = name.replace("_", " ")
    return label.replace("helmholtz", "Helmholtz").replace("raman", "Raman")


def terrain_label(kind: str) -> str:
    """Return the name of a kind of terrain as text for people."""
    return {"safe_speckle": "speckle without black", "speckle": "speckle with black"}.get(kind, kind)
