"""A map, and the waveform of a cell, as xarray.Dataset with names, units and settings (CF conventions)."""

from __future__ import annotations

import dataclasses
import json
from importlib import metadata
from typing import TYPE_CHECKING, Any

import numpy as np

from bow.found import Found
from bow.optional import library
from bow_sim.physics.kinds import labels
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.cell.cell_record import CellRecord
from bow_sweep.maps.held_fixed import subject, unit_of
from bow_sweep.maps.map_file import DERIVED, MapFile
from bow_sweep.maps.terrain import TERRAINS, UNKNOWN

if TYPE_CHECKING:
    import xarray


TEST = "test"
"""Dimension of the tests; its coordinate is their time in periods."""

ABOUT: dict[str, tuple[str, str]] = {
    "transient_periods": ("periods until the tests first passed; 0 = never, NaN = not computed", "periods"),
    "regime": ("regime at the last test", ""),
    "regimes": ("regime", ""),
    "correlation": ("autocorrelation at its best lag; NaN = no interior maximum", "1"),
    "period": ("the lag of that correlation", "samples"),
    "slips": ("significant slips in the five periods before the test", "1"),
    "corners": ("travelling corners in the five periods before the test", "1"),
    "helmholtz": ("all three tests passed", ""),
    "confidence": ("probability that the regime is right", "1"),
    "beat": ("beat of a wolf; NaN = the regime is another one", "periods"),
    "transient": ("Guettler's transient, from the first slip, known by then; 0 = none yet", "periods"),
    "simulated": ("cell was simulated; the others are predicted", ""),
    "regressions": ("how often a test failed after the test before had passed", "1"),
    "flattening": ("how far Helmholtz motion at the last test is below nominal pitch; NaN elsewhere", "cents"),
    "count": ("number that belongs to the name of the regime at the last test", "1"),
    "terrain": ("terrain around the cell", ""),
    "reliability": ("share of the repeats that end in the regime of the cell; NaN = not known", "1"),
    "same_transient": ("share of the repeats that have the transient length of the cell; NaN = not known", "1"),
    "repeats_done": ("repeats that are done", "1"),
    "transient_low": ("10th percentile of the repeats' transient lengths; 0 = never", "periods"),
    "transient_high": ("90th percentile of the repeats' transient lengths; 0 = never", "periods"),
}
"""Long name and unit of each layer. A layer that is not listed has its own name."""

AXES = ("x", "y", "test_periods")


def dataset(of: Found) -> xarray.Dataset:
    """Return a map as a dataset; :attr:`bow.Map.ds` is this."""
    xr = library("xarray", "m.ds")
    found = of.file
    layers = _layers(found) | {"terrain": of.terrain_codes}
    x_name, y_name = (f"axis_{name}" if name in layers else name for name in (found.x_name, found.y_name))
    plane = (y_name, x_name)
    codes = {"regime": found.regime_names, "regimes": found.regime_names, "terrain": TERRAINS}
    variables = {}
    for name, values in layers.items():
        long_name, unit = ABOUT.get(name, (name.replace("_", " "), ""))
        attributes: dict[str, Any] = {"long_name": long_name} | ({"units": unit} if unit else {})
        if name in codes:
            attributes |= _flags(codes[name], "unknown" if name == "terrain" else "pending")
        dimensions = plane if values.ndim == 2 else (TEST, *plane)
        variables[name] = (dimensions, values, attributes)
    named = zip((x_name, y_name), found.axes, strict=True)
    coordinates: dict[str, Any] = {
        name: (name, labels(axis.name, axis.values), _axis_attributes(axis, found)) for name, axis in named
    }
    about = {"long_name": "time of the test", "units": "periods"}
    coordinates[TEST] = (TEST, np.asarray(found.test_periods, np.int64), about)
    return xr.Dataset(variables, coordinates, _attributes(of))


def _layers(found: MapFile) -> dict[str, np.ndarray]:
    """Return every array of a map that has a value for each cell, or for each test of each cell."""
    plane = found.shape
    shapes = (plane, (len(found.test_periods), *plane))
    names = [field.name for field in dataclasses.fields(found) if field.name not in AXES]
    values = {name: getattr(found, name) for name in (*names, *DERIVED)}
    known = {name: each for name, each in values.items() if isinstance(each, np.ndarray) and each.shape in shapes}
    return known | (found.reliability.of_cells() if found.reliability is not None else {})


def _flags(names: tuple[str, ...], rest: str) -> dict[str, Any]:
    """Return the attributes by which CF names the codes of a variable."""
    return {
        "flag_values": np.array([*range(len(names)), PENDING], np.uint8),
        "flag_meanings": " ".join([*names, rest]),
    }


def _axis_attributes(axis: Any, found: MapFile) -> dict[str, Any]:
    title = axis.title(found.settings).partition("  ")[0]
    return {"long_name": title, "units": unit_of(axis.name) or "1", "scale": axis.scale}


def _attributes(of: Found) -> dict[str, Any]:
    """Return what is the same in all cells: every setting by its name, and what made the map."""
    found = of.file
    own: dict[str, Any] = {
        "Conventions": "CF-1.11",
        "title": f"{subject(found)}: basin map of the bowed string",
        "source": f"bow {metadata.version('bow')}",
        "references": "R. T. Schumacher and J. Woodhouse, Chaos 5, 509-523 (1995)",
        "run_id": found.run_id,
        "sweep_id": found.sweep_id,
        "preset": found.preset,
    }
    return own | _made_with(of) | {name: value for name, value in of.settings.items() if value != ""}


def _made_with(of: Found) -> dict[str, Any]:
    """Return the identity of kernel and classifier that made a map."""
    if of.directory is None:
        from bow_sweep.plan.sweep import Sweep

        return {"kernel": Sweep.from_spec("", of.file.settings).fingerprint} if not of.file.run_id else {}
    try:
        report = json.loads((of.directory / "report.json").read_text())
        if report["run_id"] != of.file.run_id:
            return {}
        return {name: report[key] for name, key in (("kernel", "fingerprint"), ("classifier", "classifier"))}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def waveform(record: CellRecord) -> xarray.Dataset:
    """Return the waveform of a cell as a dataset; :attr:`bow.Cell.ds` is this."""
    xr = library("xarray", "c.ds")
    force = {"long_name": "bridge force, final bow speed = 1", "units": "1"}
    variables = {
        "bridge_force": ("time", record.bridge_force, force),
        "slipping": ("time", record.slipping, {"long_name": "the string slips"}),
    }
    seconds = np.arange(len(record.bridge_force)) / record.sample_rate
    coordinates = {"time": ("time", seconds, {"long_name": "time", "units": "s"})}
    settings = dict(text.partition("=")[::2] for text in record.settings)
    about = {"run_id": record.run_id, "cell": record.cell, "origin": record.source, "checked": record.why}
    return xr.Dataset(variables, coordinates, about | {name: value for name, value in settings.items() if value})


assert UNKNOWN == PENDING  # _flags has one code for both
