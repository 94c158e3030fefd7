"""A map as a file for other programs: netCDF, CSV, Parquet."""

from __future__ import annotations

import csv
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from bow.dataset import dataset
from bow.found import Found
from bow.optional import library
from bow_sim.atomic_files import replacing, sync_directory
from bow_sim.physics.kinds import labels
from bow_sweep.maps.terrain import TERRAINS

PACKED: dict[str, Any] = {"zlib": True, "complevel": 4, "shuffle": True}
"""How netCDF files are compressed."""


class FormatError(ValueError):
    """A map cannot be written as asked; the message lists the right formats."""


def to_netcdf(of: Found, path: str | Path) -> Path:
    """Write a map as a netCDF 4 file: :meth:`bow.Map.to_netcdf` is this."""
    library("h5netcdf", "a netCDF file")
    place = Path(path)
    ds = dataset(of)
    aside = place.with_name(f".{place.name}.part")
    try:
        ds.to_netcdf(aside, engine="h5netcdf", encoding=dict.fromkeys(ds.data_vars, PACKED))
        os.replace(aside, place)
        sync_directory(place.parent)
    finally:
        aside.unlink(missing_ok=True)
    return place


def columns(of: Found) -> dict[str, np.ndarray]:
    """Return a map as a table with a row for each cell, in the order of their numbers: name -> (cells,).

    The values of both axes, then `transient_periods`, `regime` and `terrain` by name, and the results of the last
    test; for a sweep with repeats what these say.
    """
    found = of.file
    ny, nx = of.shape
    out: dict[str, np.ndarray] = {
        "cell": np.arange(nx * ny),
        found.x_name: np.tile(labels(found.x_name, of.x), ny),
        found.y_name: np.repeat(labels(found.y_name, of.y), nx),
        "transient_periods": found.transient_periods.ravel(),
        "regime": of.regime.ravel(),
        "count": found.count.ravel(),
        "terrain": of.terrain.ravel(),
    }
    for name in ("confidence", "correlation", "period", "slips", "corners", "helmholtz", "beat"):
        layer = getattr(found, name)
        if layer is not None and len(layer):
            out[f"last_{name}"] = layer[-1].ravel()
    for name in ("flattening", "regressions", "simulated"):
        if getattr(found, name) is not None:
            out[name] = getattr(found, name).ravel()
    if found.reliability is not None:
        out |= {name: values.ravel() for name, values in found.reliability.of_cells().items()}
    return out


def to_csv(of: Found, path: str | Path) -> Path:
    """Write :func:`columns` as CSV with a line of names; NaN is an empty field. Return the path."""
    table = columns(of)
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*(_texts(values) for values in table.values()), strict=True))
    with replacing(path) as file:
        file.write(text.getvalue().encode())
    return Path(path)


def _texts(values: np.ndarray) -> list[str]:
    if values.dtype.kind == "f":  # the shortest text that gives the same number again
        return ["" if np.isnan(value) else np.format_float_positional(value, trim="-") for value in values]
    return [str(value) for value in values.tolist()]


def to_parquet(of: Found, path: str | Path) -> Path:
    """Write :func:`columns` as Parquet, with the settings as metadata of the schema; return the path."""
    arrow, parquet = library("pyarrow", "a Parquet file"), library("pyarrow.parquet", "a Parquet file")
    table = columns(of)
    names = {"regime": [*of.file.regime_names, "pending"], "terrain": [*TERRAINS, "unknown"]}
    arrays = []
    for name, values in table.items():
        array = arrow.array(values)
        arrays.append(array.dictionary_encode() if name in names else array)
    about = {"run_id": of.file.run_id, "sweep_id": of.file.sweep_id, "settings": json.dumps(of.settings)}
    made = arrow.table(arrays, names=list(table)).replace_schema_metadata(about)
    with replacing(path) as file:
        parquet.write_table(made, file)
    return Path(path)


WRITERS: dict[str, Callable[[Found, str | Path], Path]] = {".nc": to_netcdf, ".csv": to_csv, ".parquet": to_parquet}
"""What writes a file, by its suffix."""


def check_format(path: Path) -> None:
    """Raise FormatError for a suffix that is none of `WRITERS`."""
    if path.suffix.lower() not in WRITERS:
        what = f"as {path.suffix}" if path.suffix else "without a suffix"
        raise FormatError(f"{path}: cannot write a map {what}; should end in {', '.join(WRITERS)}")


def export(of: Found, path: Path) -> Path:
    """Write a map as a file whose suffix sets the format; return its path.

    Raises
    ------
    FormatError
        For a suffix that is none of `WRITERS`.
    MissingLibrary
        Where a library that writes the format is not installed; names it.
    OSError
        Where the file cannot be written.
    """
    check_format(path)
    return WRITERS[path.suffix.lower()](of, path)
