"""Preset files of a user: where they are searched, how one is written, and the JSON Schema of all preset files.

A name is searched in the working directory, in the user's configuration folder, and then in the package; the first
found counts. Only the command line searches: a coordinator takes the names of the package alone, because they may come
over the network.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.atomic_files import replacing
from bow_sim.physics.body import MODE_SETTING
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import as_number
from bow_sim.physics.instruments import PRESETS, SI
from bow_sim.physics.kinds import MODEL, THRESHOLD
from bow_sim.physics.parameters import SWEEPABLE, TYPES, Parameters
from bow_sim.protocol.recording import RECORD
from bow_sim.protocol.repeats import MAX_SEED
from bow_sim.protocol.sweep_spec import VALUES
from bow_sweep.plan.presets import presets, read_preset
from bow_sweep.plan.sweep import Sweep, default_block_cells

ENDINGS = (".yaml", ".yml")


@dataclass(frozen=True)
class Chosen:
    """What a name on the command line stands for.

    Attributes
    ----------
    label
        Name for the run directory; "" where no preset was named.
    preset
        Name of a preset of the package; "" for none.
    settings
        The "name=value" settings of a user's file.
    path
        That file; None for a preset of the package.
    """

    label: str = ""
    preset: str = ""
    settings: tuple[str, ...] = ()
    path: Path | None = None


def user_folder() -> Path:
    """Return the folder of a user's presets: ``bow/presets`` in $XDG_CONFIG_HOME, or in ~/.config."""
    return Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / "bow" / "presets"


def choose(name: str, others: Mapping[str, str] | None = None) -> Chosen:
    """Return the preset that a name, or the path of a file, stands for.

    Parameters
    ----------
    name
        As given on the command line.
    others
        Further names that are known, such as those of campaigns; they are returned as they are.

    Raises
    ------
    ParameterError
        Where there is none, naming the nearest; or where its file cannot be read.
    """
    if not name:
        return Chosen()
    if name.endswith(ENDINGS) or os.sep in name:
        return _of_file(Path(name))
    for folder in (Path(), user_folder()):
        for ending in ENDINGS:
            if (folder / f"{name}{ending}").is_file():
                return _of_file(folder / f"{name}{ending}")
    known = {**presets(), **(others or {})}
    if name in known:
        return Chosen(name, name)
    mine = {path.stem for folder in (Path(), user_folder()) for path in folder.glob("*.y*ml")}
    close = difflib.get_close_matches(name, [*known, *sorted(mine)], n=1)
    right = f"did you mean {close[0]}?" if close else f"one of {', '.join(known)}, or the path of a .yaml file"
    raise ParameterError(f"preset {name!r}: no such preset; {right}")


def _of_file(path: Path) -> Chosen:
    settings = read_preset(path)
    settings.pop("title", None)
    return Chosen(path.stem, settings=tuple(f"{key}={value}" for key, value in settings.items()), path=path)


def save(path: Path, sweep: Sweep, title: str) -> None:
    """Write a sweep as a preset file: its axes, and what differs from the defaults of the package.

    Raises
    ------
    ParameterError
        Where the file does not end in .yaml or .yml: it would not be found again.
    OSError
        Where it cannot be written; then what was there before is still there.
    """
    if path.suffix not in ENDINGS:
        raise ParameterError(f"{path}: a preset file should end in .yaml")
    usual = set(Sweep.from_spec().settings())
    blocks = default_block_cells(sweep.cells, sweep.adaptive, sweep.parameters.chunk_samples)
    usual.add(f"block_cells={blocks}")
    content: dict[str, Any] = {"title": title}
    for line in sweep.settings():
        name, _, text = line.partition("=")
        group, dot, rest = name.partition(".")
        if line in usual and group not in ("x", "y"):
            continue
        value = [*map(_value, text.strip("[]").split(", "))] if name in ("x.values", "y.values") else _value(text)
        (content.setdefault(group, {}) if dot else content)[rest if dot else name] = value
    with replacing(path) as file:
        file.write(yaml.safe_dump(content, sort_keys=False, allow_unicode=True).encode())


def _value(text: str) -> float | int | str:
    number = as_number(text)
    if number is None:
        return text
    return int(number) if number == int(number) and "." not in text and "e" not in text else number


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of preset files, with which editors complete and check them."""
    properties: dict[str, Any] = {"title": {"type": "string", "description": "what the preset is, in a line"}}
    for name, field in sorted(Parameters.__dataclass_fields__.items()):
        properties[name] = _entry(field)
    for name, quantity in SI.items():
        unit = f" [{quantity.unit}]" if quantity.unit else ""
        properties[name] = {**_number(), "description": f"{quantity.doc}{unit}; sets {quantity.same}"}
    for name, known in PRESETS.items():
        properties[name] = {"enum": list(known), "description": f"{name} by name"}
    thresholds = {name: _entry(field) for name, field in sorted(Thresholds.__dataclass_fields__.items())}
    properties |= {"x": _axis("x"), "y": _axis("y"), "classifier": _group(thresholds)}
    whole = {"type": "integer", "minimum": 1}
    properties["block_cells"] = {**whole, "description": "cells that one simulator runs together"}
    none = {"type": "integer", "minimum": 0}
    properties["repeats"] = {**none, "description": "further simulations of each cell with slightly other forces"}
    properties["jitter"] = {**_number(), "description": "largest relative deviation of a force in a repeat"}
    properties["seed"] = {**none, "description": "other deviations of the repeats"}
    properties["adaptive"] = {**_number(), "description": "share of the cells to simulate at most"}
    properties["repeats"] = {"type": "integer", "minimum": 0, "description": "further simulations of each cell"}
    properties["jitter"] = {**_number(), "description": "largest relative deviation of the forces in a repeat"}
    properties["seed"] = {"type": "integer", "minimum": 0, "maximum": MAX_SEED, "description": "of the deviations"}
    properties["record"] = {"enum": list(RECORD), "description": "what the bag holds beside the verdicts"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "preset of bow sweep",
        **_group(properties),
        **_MODE,
    }


def _group(properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": dict(properties), "additionalProperties": False}


_MODE = {"patternProperties": {f"^{MODE_SETTING.pattern}$": {"description": "a single mode of the body"}}}


def _number() -> dict[str, Any]:
    return {"type": ["number", "string"]}  # YAML reads 1e-6 as text


def _axis(key: str) -> dict[str, Any]:
    known = SWEEPABLE | SI.keys() | {MODEL} | {f"{THRESHOLD}{name}" for name in Thresholds.__dataclass_fields__}
    modes = {"type": "string", "pattern": f"^{MODE_SETTING.pattern}$"}
    names: dict[str, Any] = {"anyOf": [{"enum": sorted(known)}, modes]}
    whole = {
        **_group(
            {
                "name": {
                    **names,
                    "description": "the parameter along this axis; what else is not given suits it",
                },
                "scale": {"enum": ["log", "linear", VALUES]},
                "first": {**_number(), "description": "first value"},
                "last": {**_number(), "description": "last value"},
                "count": {"type": "integer", "minimum": 1, "description": "number of values"},
                "values": {
                    "anyOf": [{"type": "array", "items": _number(), "minItems": 1}, {"type": "string"}],
                    "description": "all values, rising or falling, in place of scale, first, last and count",
                },
            }
        ),
        "description": f"the {key} axis of the map",
    }
    return {"anyOf": [names, whole], "description": whole["description"]}


def _entry(field: Any) -> dict[str, Any]:
    meta = field.metadata
    unit = f" [{meta['unit']}]" if meta["unit"] else ""
    entry: dict[str, Any] = {"description": f"{meta['doc']}{unit}; default {field.default!r}"}
    if "choices" in meta:
        return {"enum": list(meta["choices"]), **entry}
    kind = TYPES.get(field.name, float)
    if kind is str:
        return {"type": "string", **entry}
    limits = meta["range"]
    entry["exclusiveMinimum" if limits.low_open else "minimum"] = limits.low
    entry["exclusiveMaximum" if limits.high_open else "maximum"] = limits.high
    return {**({"type": "integer"} if kind is int else _number()), **entry}
