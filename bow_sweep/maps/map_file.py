"""The finished map as a file, ``map.npz``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bow_sim.atomic_files import read_arrays, replacing
from bow_sim.physics.parameters import CHUNK_PERIODS, FIELDS
from bow_sim.protocol.verdict_fields import PENDING, VERDICT_FIELDS
from bow_sweep.maps.limits import limit_arrays
from bow_sweep.maps.plane import Plane
from bow_sweep.maps.reliability import Reliability

if TYPE_CHECKING:
    from bow_sweep.maps.basin_map import Basin
    from bow_sweep.plan.sweep import Sweep

MAP = "map.npz"
"""Name of the file in a run directory."""

_KINDS: dict[str, Any] = {name: field.kind for name, field in VERDICT_FIELDS.items()}

HISTORY = {"regimes": _KINDS.pop("regime")} | {name: _KINDS.pop(name) for name in ("confidence", "beat", "transient")}
"""Name -> type of the arrays with a value for every test of every cell that older files do not have."""

RARE = ("beat", "transient")
"""Those of `HISTORY` that a file has only where a cell has a value: of a wolf, and of Guettler's gesture."""

TESTS = {**_KINDS, "helmholtz": np.bool_}
"""Name -> type of the arrays with a value for every test of every cell that every file has."""

DERIVED = ("regressions", "flattening", "count")
"""Names of the arrays with a value for every cell that are computed from the others. They are for other programs; they
are not read back."""

TEXTS = ("run_id", "sweep_id", "x_name", "y_name", "preset")
"""Names of the texts."""


class MapFileError(ValueError):
    """A file is not a map, or a map cannot be drawn as asked; names the file and the reason."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MapFile(Plane):
    """A map with every test of every cell: the contents of ``map.npz``.

    Attributes
    ----------
    test_periods
        (tests,) time of each test, periods.
    correlation, period
        (tests, ny, nx) float32, `period` in samples; NaN = no interior maximum, or not computed.
    slips, corners
        (tests, ny, nx) uint16, number in the five periods before each test.
    helmholtz
        (tests, ny, nx) bool: whether all three tests of section III.B passed. False after True is a regression.
    regimes
        (tests, ny, nx) uint8: `regime` at every test; None in older files.
    confidence
        (tests, ny, nx) float32: probability that the regime is right; NaN = no verdict; None in older files.
    beat
        (tests, ny, nx) float32, periods: the beat of wolves; NaN = none; None where there is none in the whole map.
    transient
        (tests, ny, nx) float32, periods: Guettler's transient so far, 0 = none yet; None for other gestures.
    simulated
        (ny, nx) bool: which cells of an adaptive sweep were simulated; in the others `transient_periods` is predicted,
        or NaN where a block was given up. None for an exhaustive sweep.
    reliability
        What the repeats of the cells end as; None for a sweep without repeats.
    """

    test_periods: np.ndarray
    correlation: np.ndarray
    period: np.ndarray
    slips: np.ndarray
    corners: np.ndarray
    helmholtz: np.ndarray
    simulated: np.ndarray | None = None
    regimes: np.ndarray | None = None
    confidence: np.ndarray | None = None
    reliability: Reliability | None = None
    beat: np.ndarray | None = None
    transient: np.ndarray | None = None

    @property
    def regressions(self) -> np.ndarray:
        """(ny, nx) uint16: how often a test failed after the test before had passed."""
        passed = np.asarray(self.helmholtz, bool)
        return np.asarray((passed[:-1] & ~passed[1:]).sum(axis=0), np.uint16)

    @property
    def flattening(self) -> np.ndarray:
        """(ny, nx) float32, cents: how far Helmholtz motion at the last test is below nominal pitch; NaN elsewhere."""
        with np.errstate(invalid="ignore"):
            cents = 1200 * np.log2(np.asarray(self.period[-1], float) / self._number("period"))
        return np.where(self.helmholtz[-1], cents, np.nan).astype(np.float32)

    @property
    def count(self) -> np.ndarray:
        """(ny, nx) uint8: the number in the name of the regime, see `bow_classifier.verdict.regimes.count`."""
        from bow_classifier.verdict.regimes import count

        bridge = np.full(self.shape, self._number("bow_bridge"))
        for name, along in ((self.x_name, self.x[None, :]), (self.y_name, self.y[:, None])):
            if name in ("bow_bridge", "beta"):
                bridge[:] = along if name == "bow_bridge" else along * self._number("period")
        nominal = self._number("period")
        return count(self.regime, self.period[-1], self.slips[-1], self.corners[-1], nominal, bridge / nominal)

    def _number(self, name: str) -> float:
        return float(self.values.get(name, FIELDS[name].default))  # type: ignore[arg-type]  # a number's text

    @classmethod
    def of(cls, sweep: Sweep, basin: Basin, run_id: str, not_computed: np.ndarray | None = None) -> MapFile:
        """Return the map of a sweep from its verdicts.

        Parameters
        ----------
        not_computed
            (cells,) bool: cells that are not done (quarantined or outstanding), even where some verdicts are known.
        """
        from bow_classifier.verdict.regimes import REGIMES, is_helmholtz

        regimes = basin.layers["regime"]
        layers = {**basin.layers, "helmholtz": is_helmholtz(regimes), "regimes": regimes}
        length, regime = basin.transient_periods.copy(), basin.latest("regime").copy()
        if not_computed is not None:
            length[not_computed], regime[not_computed] = np.nan, PENDING
        done = basin.tested == basin.tests if not_computed is None else ~not_computed
        return cls(
            run_id=run_id,
            sweep_id=sweep.sweep_id,
            x_name=sweep.x.name,
            y_name=sweep.y.name,
            x=sweep.x.values(),
            y=sweep.y.values(),
            transient_periods=basin.of_plane(length),
            regime=basin.of_plane(regime),
            regime_names=tuple(REGIMES),
            settings=sweep.settings(),
            preset=sweep.preset,
            test_periods=np.arange(1, basin.tests + 1) * CHUNK_PERIODS,
            **of_all_tests({name: basin.of_plane(layers[name]) for name in (*TESTS, *HISTORY)}),
            reliability=Reliability.of_basin(basin, done),
        )


def of_all_tests(layers: dict[str, Any]) -> dict[str, Any]:
    """Return the arrays of all tests without those of `RARE` in which no cell has a value: they are None."""
    return layers | {name: None for name in RARE if np.isnan(layers[name]).all()}


def map_arrays(result: MapFile) -> dict[str, np.ndarray]:
    """Return the arrays of ``map.npz``, by name.

    The axes are stored under the names of their parameters (``f_asym`` (nx), ``f_init_ratio`` (ny) by default); then
    `transient_periods`, `regime` and those of `DERIVED` (ny, nx), `regime_names`, those of `TESTS` and `HISTORY`
    (tests, ny, nx), `test_periods` (tests), `settings`, the names of `TEXTS`; for an adaptive sweep `simulated` (ny,
    nx); for one with repeats those of :class:`~bow_sweep.maps.reliability.Reliability`; and the curves of
    :func:`bow_sweep.maps.limits.limit_arrays`.

    Raises
    ------
    MapFileError
        Where the shapes do not fit each other.
    """
    ny, nx = result.shape
    tests = len(result.test_periods)
    arrays: dict[str, np.ndarray] = {
        "transient_periods": np.asarray(result.transient_periods, np.float32),
        "regime": np.asarray(result.regime, np.uint8),
        "regime_names": np.array(result.regime_names, dtype=np.str_),
        "test_periods": np.asarray(result.test_periods),
        "settings": np.array(result.settings, dtype=np.str_),
        **{name: np.array(getattr(result, name), dtype=np.str_) for name in TEXTS},
        **{name: np.asarray(getattr(result, name), kind) for name, kind in TESTS.items()},
    }
    shapes = {"transient_periods": (ny, nx), "regime": (ny, nx), **dict.fromkeys(TESTS, (tests, ny, nx))}
    if result.simulated is not None:
        arrays["simulated"], shapes["simulated"] = np.asarray(result.simulated, np.bool_), (ny, nx)
    for name, kind in HISTORY.items():
        if getattr(result, name) is not None:
            arrays[name], shapes[name] = np.asarray(getattr(result, name), kind), (tests, ny, nx)
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise MapFileError(f"{name}: shape {arrays[name].shape}, should be {shape}")
    arrays |= {name: getattr(result, name) for name in DERIVED}
    arrays |= result.reliability.arrays() if result.reliability is not None else {}
    for name, values in ((result.x_name, result.x), (result.y_name, result.y)):
        # `period` is both a parameter and a test; such an axis is stored as axis_period
        arrays[f"axis_{name}" if name in arrays else name] = np.asarray(values, float)
    return arrays | limit_arrays(result)


def write_map_npz(path: str | Path, result: MapFile) -> None:
    """Write a map; readers see the old file or the complete new one.

    Raises
    ------
    MapFileError
        Where the shapes do not fit each other.
    """
    arrays = map_arrays(result)
    with replacing(path) as file:
        np.savez(file, allow_pickle=False, **arrays)  # 3 MB; compression would take half as long as the kernel


def read_map_npz(path: str | Path) -> MapFile:
    """Return the map in a file that :func:`write_map_npz` wrote.

    Raises
    ------
    MapFileError
        Where there is no such file, or it is not a map.
    """
    try:
        arrays = read_arrays(path)
    except (OSError, ValueError) as error:
        raise MapFileError(f"{path}: cannot be read as a map: {error}") from None
    try:
        values: dict[str, Any] = {name: str(arrays[name]) for name in TEXTS}
        for key in ("x", "y"):
            name = values[f"{key}_name"]
            values[key] = arrays.get(f"axis_{name}", arrays[name])
        values |= {name: tuple(str(text) for text in np.ravel(arrays[name])) for name in ("regime_names", "settings")}
        values |= {name: arrays[name] for name in ("transient_periods", "regime", "test_periods", *TESTS)}
    except KeyError as error:
        raise MapFileError(f"{path}: not a map of `bow sweep`: it has no array {error}") from None
    values |= {name: arrays.get(name) for name in ("simulated", *HISTORY)}
    result = MapFile(**values)
    _check_arrays(path, result)
    try:
        return replace(result, reliability=Reliability.in_file(arrays, result.shape))
    except ValueError as error:
        raise MapFileError(f"{path}: {error}") from None


def _check_arrays(path: str | Path, result: MapFile) -> None:
    """Raise MapFileError where an array has another type or shape than it should have."""
    for name in ("x", "y", "test_periods"):
        if getattr(result, name).ndim != 1 or getattr(result, name).dtype.kind not in "iuf":
            raise MapFileError(f"{path}: {name} should be a row of numbers")
    ny, nx = result.shape
    tests = len(result.test_periods)
    shaped: dict[str, tuple[tuple[int, ...], Any]] = {"transient_periods": ((ny, nx), np.float32)}
    right = shaped | {"regime": ((ny, nx), np.uint8)}
    if result.simulated is not None:
        right["simulated"] = ((ny, nx), np.bool_)
    right |= {name: ((tests, ny, nx), kind) for name, kind in HISTORY.items() if getattr(result, name) is not None}
    for name, (shape, kind) in {**right, **{name: ((tests, ny, nx), kind) for name, kind in TESTS.items()}}.items():
        array = getattr(result, name)
        if array.shape != shape or array.dtype != kind:
            what = f"{name} is {array.dtype} with shape {array.shape}, should be {np.dtype(kind)} with {shape}"
            raise MapFileError(f"{path}: {what}")


def read_map(run: Path) -> MapFile:
    """Return the map of a run.

    Parameters
    ----------
    run
        Run directory, or a map.npz.

    Raises
    ------
    MapFileError
        Where there is no map.
    """
    return read_map_npz(run / MAP if run.is_dir() else run)
