"""What pictures of a map are made of: its plane, the layers to draw and their colours. Plain arrays throughout.

The colours say how good a gesture is: the brighter a cell, the sooner Helmholtz motion came; black is never (as in the
paper's Fig 11) and grey is a cell that was not computed. Viridis is perceptually uniform and safe for the colour-blind;
run backwards and stopped short of its dark end, the latest success stays apart from black.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS
from bow_sweep.maps.axes import Axis

CLEAR, NEVER, NOT_COMPUTED = 0, 1, 2
"""What the mask over the transient lengths says of a cell."""


MODEL_NAMES = {
    "stiff_cremer": "Stiff/Cremer",
    "delta_cremer": "Delta/Cremer",
    "raman": "Raman",
    "friedlander": "Friedlander",
    "rounded_corner": "Rounded-corner",
    "torsion_absorbed": "Torsion-absorbed",
}
"""The models of the hierarchy as the paper calls them."""

TEST_LAYERS = ("correlation", "slips", "corners")
"""The three tests of section III.B."""

TEST_RANGES = {"correlation": (0.0, 1.0), "slips": (0.0, 15.0), "corners": (0.0, 25.0)}
"""Range of the colour scale of each test; what lies beyond takes the colour of the end."""

WANTED = {"correlation": 1.0, "slips": 5.0, "corners": 5.0}
"""What Helmholtz motion gives in five periods."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """What every map has. Arrays are (ny, nx), row 0 the lowest y.

    Attributes
    ----------
    x, y
        (nx,) and (ny,) values of the parameters `x_name` and `y_name`.
    transient_periods
        float32, periods until the tests first passed; 0 = never, NaN = pending or quarantined.
    regime
        uint8, index into `regime_names` at the latest test; 255 = no verdict.
    settings
        "name=value", every setting of the sweep; may be empty.
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
    def axes(self) -> tuple[Axis, Axis]:
        """The axes along x and y."""
        return Axis.of(self.x_name, self.x), Axis.of(self.y_name, self.y)

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
        """Length of a simulation, and so the longest transient that can be seen; a guess where no setting says."""
        try:
            return max(float(self.values["periods"]), CHUNK_PERIODS)
        except (KeyError, ValueError):
            found = np.nanmax(self.transient_periods, initial=0)
            return max(100.0, float(found))

    def mask(self) -> np.ndarray:
        """Return which cells have no transient length, (ny, nx) uint8: CLEAR, NEVER or NOT_COMPUTED."""
        length = self.transient_periods
        return np.where(np.isnan(length), NOT_COMPUTED, np.where(length > 0, CLEAR, NEVER)).astype(np.uint8)

    def regime_counts(self) -> np.ndarray:
        """Return how many cells are in each of `regime_names`, and last how many in none, (regimes + 1,)."""
        counts = np.bincount(np.asarray(self.regime).ravel(), minlength=PENDING + 1)
        named = counts[: len(self.regime_names)]
        return np.append(named, self.regime.size - named.sum())

    def helmholtz_fraction(self) -> float:
        """Return the fraction of all cells in which Helmholtz motion ever came."""
        return float(np.mean(np.nan_to_num(self.transient_periods) > 0))

    def with_plan(self, settings: Iterable[str], preset: str = "") -> Any:
        """Return the same map knowing the settings of its sweep."""
        return replace(self, settings=tuple(settings), preset=preset)


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot(Plane):
    """The map as it stands in the middle of a sweep (BasinMap.msg).

    Attributes
    ----------
    tests, slips, corners
        (ny, nx) uint16: tests made so far; slips and corners at the latest.
    correlation
        (ny, nx) float32 at the latest test.
    done, quarantined, outstanding
        Cells, by the coordinator's account; planned is their sum.
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
        """Return the map in a BasinMap: the message, or its fields as ``wire.decode`` gives them.

        Raises
        ------
        ValueError
            Where arrays do not fit the axes, or an axis is none.
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
        _ = snapshot.axes  # refuse bad axes here, at the border
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
            regime_names=(),
            settings=outline.settings,
            preset=outline.preset,
            outstanding=outline.cells,
            **grids,
        )

    @property
    def planned(self) -> int:
        """Cells of the sweep."""
        return self.done + self.quarantined + self.outstanding


def upright(grid: np.ndarray) -> np.ndarray:
    """Return a layer as an image: the first row of an image is at the top, that of a map at the bottom."""
    return np.ascontiguousarray(np.asarray(grid)[::-1])


def image_of(plane: Plane) -> tuple[int, int, bytes]:
    """Return the transient lengths for a sensor_msgs/Image: height, width and data.

    Encoding "32FC1", little endian, step 4 * width; y points up, so the top row is the highest y. Values in periods;
    0 = never, NaN = not computed.
    """
    height, width = plane.shape
    return height, width, upright(plane.transient_periods).astype("<f4").tobytes()


def regime_label(name: str) -> str:
    """Return a regime's name for people."""
    label = name.replace("_", " ")
    return label.replace("helmholtz", "Helmholtz").replace("raman", "Raman")


def terrain_label(kind: str) -> str:
    """Return a kind of terrain in words."""
    return {"safe_speckle": "speckle without black", "speckle": "speckle with black"}.get(kind, kind)
