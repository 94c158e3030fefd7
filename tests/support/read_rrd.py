"""Reads .rrd files, for assertions."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader


def rows(path: Path, entity: str, component: str) -> list[tuple[dict[str, int], Any]]:
    """All values of a component in the order of logging, each with its times (none for static data)."""
    found = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a file without a footer warns
        for chunk in RrdReader(path).stream():
            if str(chunk.entity_path).strip("/") != entity:
                continue
            batch = chunk.to_record_batch()
            names = set(batch.schema.names)
            if component not in names:
                continue
            lines = ("log_time", "sweep", "sample", "test", "periods")
            times = {name: batch.column(name).cast("int64") for name in lines if name in names}
            for row, value in enumerate(batch.column(component)):
                found.append(({name: column[row].as_py() for name, column in times.items()}, value.as_py()))
    return sorted(found, key=lambda entry: entry[0].get("log_time", 0))


def entities(path: Path) -> set[str]:
    """The paths of all entities."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {str(chunk.entity_path).strip("/") for chunk in RrdReader(path).stream()}


def image(path: Path, entity: str, kind: str, dtype: str, row: int = -1) -> np.ndarray:
    """The values of an image, as (height, width)."""
    (layout,) = rows(path, entity, f"{kind}:format")[row][1]
    (buffer,) = rows(path, entity, f"{kind}:buffer")[row][1]
    return np.array(buffer, np.uint8).view(dtype).reshape(layout["height"], layout["width"])


def names_of(path: Path, place: str) -> dict[int, str]:
    """What the codes of a picture of a map mean."""
    _, (meanings,) = rows(path, place, "AnnotationContext:context")[-1]  # as static data and on the timelines, the same
    return {entry["class_id"]: entry["class_description"]["info"]["label"] for entry in meanings}


def colours(path: Path, place: str, row: int = -1) -> np.ndarray:
    """The colours of a picture of a map, (ny, nx, 3), the lowest row of the map first."""
    (layout,) = rows(path, f"{place}/picture", "Image:format")[row][1]
    (buffer,) = rows(path, f"{place}/picture", "Image:buffer")[row][1]
    return np.array(buffer, np.uint8).reshape(layout["height"], layout["width"], 3)[::-1]


def named(path: Path, place: str, row: int = -1) -> list[list[str]]:
    """What a picture of a map says of each cell, the lowest row of the map first. Its colours mean the same."""
    _, (meanings,) = rows(path, place, "AnnotationContext:context")[-1]
    names, paint = {}, {}
    for entry in meanings:
        info = entry["class_description"]["info"]
        names[entry["class_id"]], paint[entry["class_id"]] = info["label"], info["color"] >> 8
    codes = rows(path, f"{place}/cells", "LineStrips2D:class_ids")[row][1]
    shown = colours(path, place, row)
    packed = (shown.astype(int) * [1 << 16, 1 << 8, 1]).sum(axis=-1).ravel().tolist()
    assert packed == [paint[code] for code in codes]
    width = shown.shape[1]
    return [[names[code] for code in codes[first : first + width]] for first in range(0, len(codes), width)]


def pending(path: Path) -> list[int]:
    """How many cells were pending at each map."""
    return [int(value[-1]) for _, value in rows(path, "counts", "Scalars:scalars")]


def verify(path: Path) -> str:
    """The output of `rerun rrd verify` for a bad file; "" for a good one."""
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)], capture_output=True, text=True, check=False
    )
    return "" if done.returncode == 0 else done.stdout + done.stderr
