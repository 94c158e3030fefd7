"""In which settings several maps differ, and by which program they were made."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bow_sim.physics.body import mode_unit
from bow_sim.physics.instruments import SI
from bow_sim.physics.parameters import FIELDS

REPORT = "report.json"

PROGRAM = {"fingerprint": "kernel", "classifier": "classifier", "machine": "machine"}
"""What report.json says of the program, and its name here; versions of libraries follow."""


class Differing(NamedTuple):
    """A setting that is not the same in all maps.

    Attributes
    ----------
    name
        Of the setting.
    values
        In each map, as text; None where a map does not have it, or says nothing of it.
    unit
        "" for a number or a name.
    """

    name: str
    values: tuple[str | None, ...]
    unit: str = ""


def differing_settings(maps: Sequence[Mapping[str, str]], presets: Sequence[str] = ()) -> list[Differing]:
    """Return the settings that differ: presets, those of string and gesture, axes, those of the sweep.

    A parameter that an older map does not have had its default; of a map without settings nothing is known.

    Parameters
    ----------
    maps
        The settings of each map, by name.
    presets
        Its preset; () where they are unknown.
    """
    found = [Differing("preset", tuple(name or None for name in presets))] if len(set(presets)) > 1 else []
    given = [{**settings} for settings in maps]
    swept = [_swept(settings) for settings in maps]
    names = sorted({name for settings in given for name in settings}, key=_order)
    for name in names:
        values = tuple(
            _value(name, settings, moved) if settings else None for settings, moved in zip(given, swept, strict=True)
        )
        if len({_comparable(value) for value, settings in zip(values, given, strict=True) if settings}) > 1:
            found.append(Differing(name, values, _unit(name, given)))
    return found


def _swept(settings: Mapping[str, str]) -> set[str]:
    """Return the parameters that are axes of a map, in both systems of units."""
    axes = {settings.get("x.name", ""), settings.get("y.name", "")}
    return axes | {SI[name].same for name in axes & SI.keys()}


def _value(name: str, settings: Mapping[str, str], swept: set[str]) -> str | None:
    if name in swept:
        return "an axis"
    if name in settings:
        return settings[name]
    return str(FIELDS[name].default) if name in FIELDS else None


def _comparable(value: str | None) -> float | str | None:
    try:
        return float(value) if value is not None else None
    except ValueError:
        return value


def _order(name: str) -> tuple[int, int, str]:
    """Return the place of a setting: those of the string in their own order, then axes, the sweep, the classifier."""
    if name in FIELDS:
        return 0, list(FIELDS).index(name), ""
    if name.startswith(("x.", "y.")):
        return 1, _AXIS.index(name[2:]) if name[2:] in _AXIS else len(_AXIS), name
    return (3 if name.startswith("classifier.") else 2), 0, name


_AXIS = ("name", "scale", "first", "last", "count", "values")


def _unit(name: str, given: Sequence[Mapping[str, str]]) -> str:
    if name in ("x.first", "x.last", "y.first", "y.last"):
        axes = {settings.get(f"{name[0]}.name", "") for settings in given}
        return _unit_of(axes.pop()) if len(axes) == 1 else ""
    return _unit_of(name)


def _unit_of(name: str) -> str:
    if name in FIELDS:
        return str(FIELDS[name].metadata.get("unit", "") or "")
    if mode := mode_unit(name):
        return mode[0]
    return SI[name].unit if name in SI else ""


def program_of(run: Path | None) -> dict[str, str]:
    """Return by which program a run was made, from its report: kernel, classifier, machine, versions; {} if unknown."""
    if run is None:
        return {}
    try:
        report = json.loads(((run if run.is_dir() else run.parent) / REPORT).read_text())
        versions = {str(name): str(version) for name, version in dict(report.get("versions", {})).items()}
        return {say: str(report[name]) for name, say in PROGRAM.items() if name in report} | versions
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def differing_programs(programs: Sequence[Mapping[str, str]]) -> list[Differing]:
    """Return what of :func:`program_of` differs between maps; what is not known of a map is no difference."""
    names = dict.fromkeys(name for program in programs for name in program)
    found = []
    for name in names:
        values = tuple(program.get(name) for program in programs)
        if len({value for value in values if value is not None}) > 1:
            found.append(Differing(name, values))
    return found


def as_json(found: Sequence[Differing]) -> dict[str, Any]:
    """Return differences for JSON: name -> values in the order of the maps, numbers as numbers, and unit."""
    return {each.name: {"values": [typed(value) for value in each.values], "unit": each.unit} for each in found}


def typed(text: str | None) -> float | int | str | None:
    """Return the number in a text, or the text."""
    for kind in (int, float):
        try:
            return kind(text) if text is not None else None
        except ValueError:
            continue
    return text
