"""study.json: what the maps of a study say together, as plain numbers and as a table."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bow_sim.atomic_files import replacing
from bow_sim.physics.fields import as_number
from bow_sweep.maps.playability import MEASURES, Measure
from bow_sweep.run.directory import REPORT, RunError
from bow_sweep.study.plan import Study, short
from bow_sweep.study.statistics import TEST, Difference, Measured, differences

STUDY_REPORT = "study.json"
STUDY_FORMAT = 1

OF_A_RUN = (
    "run_id",
    "sweep_id",
    "cells",
    "helmholtz_fraction",
    "median_transient_periods",
    "regimes",
    "playability",
    "wall_seconds",
)
"""Entries of each run's report that the report of the study repeats."""

ACCOUNTS = ("planned", "done", "quarantined", "outstanding")

BY_NAME = {measure.name: measure for measure in MEASURES}

SHOWN = ("helmholtz", "largest_area", "median_transient", "spread_transient", "boundary")
"""Measures of the printed table, unless others are asked for."""

Report = dict[str, Any]
"""The contents of study.json."""


def report(directory: Path, study: Study) -> Report:
    """Write study.json, what the finished runs of a study say together, and return it; see :func:`contents`.

    Raises
    ------
    RunError
        Where the report of a run is missing or cannot be read.
    OSError
        Where it cannot be written.
    """
    content = contents(study, read_runs(directory, study))
    with replacing(directory / STUDY_REPORT) as file:
        file.write(json.dumps(content, indent=2).encode() + b"\n")
    return content


def read_runs(directory: Path, study: Study) -> dict[str, dict[str, Any]]:
    """Return the reports of the runs of a study, by name.

    Raises
    ------
    RunError
        Where one is missing or cannot be read.
    """
    return {each.name: read_run(directory / each.name) for each in study.members}


def contents(study: Study, runs: Mapping[str, Mapping[str, Any]]) -> Report:
    """Return what the runs of a study say together.

    The entries: `asked` is the study; `maps` has a map each, with its `values` and the entries `OF_A_RUN` of its
    report; `differences` says how each map differs from the first and from its neighbour along each parameter, with
    the test in words in `test`; `cells`, `samples` and `wall_seconds` are sums.

    Parameters
    ----------
    runs
        Name of each run -> its report.json.

    Raises
    ------
    RunError
        Where a report has no playability, as those of the first versions.
    """
    for name, run in runs.items():
        if "playability" not in run:
            raise RunError(f"{name}/{REPORT}: has no playability, as reports of the first versions; sweep anew")
    numbers = [run["playability"] for run in runs.values()]
    return {
        "study": STUDY_FORMAT,
        "asked": {
            "title": study.title,
            "preset": study.preset,
            "settings": list(study.settings),
            "over": {over.name: [_plain(value) for value in over.values] for over in study.overs},
        },
        "cells": {name: sum(run["cells"][name] for run in runs.values()) for name in ACCOUNTS},
        "samples": sum(run["samples"] for run in runs.values()),
        "wall_seconds": sum(run["wall_seconds"] for run in runs.values()),
        "maps": [
            {"run": member.name, "values": {name: _plain(value) for name, value in member.values.items()}}
            | _of_a_run(runs[member.name])
            for member in study.members
        ],
        "test": TEST,
        "differences": [*_compared(study, numbers)],
    }


def read_run(run: Path) -> dict[str, Any]:
    """Return the report of a finished run.

    Raises
    ------
    RunError
        Where it is missing or cannot be read.
    """
    path = run / REPORT
    try:
        return dict(json.loads(path.read_text()))
    except OSError as error:
        raise RunError(f"{path}: {error.strerror}; is the run finished? --resume makes the rest") from None
    except (ValueError, TypeError) as error:
        raise RunError(f"{path}: cannot be read: {error}") from None


def _plain(value: str) -> float | str:
    number = as_number(value)
    return value if number is None else number


def _of_a_run(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the report of a study has of the report of a run; `repeats` only where there are some."""
    return {name: found.get(name) for name in OF_A_RUN} | {k: found[k] for k in ("repeats",) if k in found}


def measured(playability: Mapping[str, Any], name: str) -> Measured:
    """Return a measure of a map from its playability.

    Where the four grids agree exactly on another value than that of the map, as on terrain of which none fits into
    them, their spread says nothing about the map: error and mean are left out.
    """
    entry = playability[name]
    value, error, mean = entry["value"], entry["error"], entry["half_grid"]
    if error == 0 and mean != value:
        return Measured(value, None, None)
    return Measured(value, error, mean)


def neighbours(shape: Sequence[int], axis: int) -> list[tuple[int, int]]:
    """Return the pairs of maps that are neighbours along a parameter, as indices in the order of the maps."""
    every = list(itertools.product(*map(range, shape)))
    index = {place: number for number, place in enumerate(every)}
    return [
        (index[(*place[:axis], place[axis] - 1, *place[axis + 1 :])], number)
        for number, place in enumerate(every)
        if place[axis] > 0
    ]


def _compared(study: Study, numbers: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the differences from the first map, then those of neighbours along each parameter."""
    names = [member.name for member in study.members]
    families = [("first", "", [(0, number) for number in range(1, len(names))])]
    families += [
        ("neighbour", over.name, neighbours(study.shape, axis))
        for axis, over in enumerate(study.overs)
        if len(over.values) > 2 or len(study.overs) > 1
    ]
    found = []
    for kind, over_name, pairs in families:
        by_measure = {
            name: differences([(measured(numbers[a], name), measured(numbers[b], name)) for a, b in pairs])
            for name in BY_NAME
        }
        for row, (a, b) in enumerate(pairs):
            entry: dict[str, Any] = {"of": kind, **({"over": over_name} if over_name else {})}
            entry |= {"from": names[a], "to": names[b]}
            found.append(entry | {name: by_measure[name][row]._asdict() for name in BY_NAME})
    return found


def significant(content: Report, of: str, run: str) -> dict[str, Difference]:
    """Return how a run differs from the first (`of` "first") or from a neighbour: measure -> the surest difference."""
    result: dict[str, Difference] = {}
    for entry in content["differences"]:
        if entry["of"] == of and entry["to"] == run:
            for name in BY_NAME:
                found = Difference(**entry[name])
                if name not in result or (found.p or 1.0) < (result[name].p or 1.0):
                    result[name] = found
    return result


def table(content: Report, measures: Sequence[str] = SHOWN) -> list[list[str]]:
    """Return the report as rows of texts: a row of titles, then a row for each map.

    A value differs significantly from that of the first map where a * stands after it, and from that of a neighbour,
    the map before it along a parameter, where a + does.
    """
    overs = list(content["asked"]["over"])
    chosen = [BY_NAME[name] for name in measures]
    rows = [[*overs, *map(_title, chosen)]]
    for entry in content["maps"]:
        first, beside = (significant(content, of, entry["run"]) for of in ("first", "neighbour"))
        row = [short(str(entry["values"][name])) for name in overs]
        for measure in chosen:
            found = measured(entry["playability"], measure.name)
            marks = "".join(
                mark for mark, all_of in (("*", first), ("+", beside)) if _is_significant(all_of, measure.name)
            )
            row.append(f"{measure.text(found.value, found.error)} {marks:2}")
        rows.append(row)
    return rows


def _is_significant(found: Mapping[str, Difference], name: str) -> bool:
    return name in found and found[name].significant


def _title(measure: Measure) -> str:
    return measure.title + (f", {measure.unit}" if measure.unit else "")


def legend(content: Report) -> list[str]:
    """Return what the marks of the table mean, and what limits it, a line each."""
    lines = ["±: standard error, from the four interleaved grids of half the density"]
    if all(measured(entry["playability"], "helmholtz").error is None for entry in content["maps"]):
        return ["the maps are too small for uncertainties: --nx 16 --ny 16 at least"]
    if len(content["maps"]) > 1:
        what = "*: differs from the first map"
        if any(entry["of"] == "neighbour" for entry in content["differences"]):
            what += "; +: differs from the map before it along a parameter"
        lines += [what, f"test: {TEST}"]
    return lines


def text(content: Report, measures: Sequence[str] = SHOWN) -> list[str]:
    """Return table and legend as lines for people."""
    return [*aligned(table(content, measures)), "", *legend(content)]


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a table as lines: columns to the right, the first row as titles."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  " + "  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)) for row in rows]
