"""Presets: named sweeps in config/presets, one YAML file each."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from bow_sim.config_files import find_config
from bow_sim.physics.errors import ParameterError

_QUICK: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""Reads our own files in a tenth of the time. Deeply nested ones could be too much for it."""

MAX_BYTES, MAX_BRACKETS, MAX_KEYS = 1 << 16, 200, 1000
"""Limits of a preset file. PyYAML takes time with the square of nested brackets, and aliases can multiply names."""


def preset_directory() -> Path:
    """Return the folder of the preset files.

    Raises
    ------
    FileNotFoundError
        Where there is none.
    """
    found = find_config("presets")
    if found is None:
        raise FileNotFoundError(f"no config/presets or share/bow/config/presets in any folder above {__file__}")
    return found


def presets() -> dict[str, str]:
    """Return {name: title} of all presets, sorted; for a file that cannot be read the error stands as its title."""
    titles = {}
    for name, path in _files().items():
        try:
            titles[name] = str(_read(path, _QUICK).get("title", ""))
        except ParameterError as error:
            titles[name] = str(error)
    return titles


def load_preset(name: str) -> dict[str, Any]:
    """Return the settings of a preset, without its title; groups such as ``x: {count: 8}`` become ``x.count``.

    Raises
    ------
    ParameterError
        Where there is no such preset, or its file cannot be read.
    """
    files = _files()
    if name not in files:  # never a path: the name may come over the network
        raise ParameterError(f"preset {name!r}: no such preset; one of {', '.join(files)}")
    settings = read_preset(files[name])
    settings.pop("title", None)
    return settings


def read_preset(path: Path) -> dict[str, Any]:
    """Return the settings of a preset file and its title; groups such as ``x: {count: 8}`` become ``x.count``.

    Raises
    ------
    ParameterError
        Where it cannot be read.
    """
    return _flatten(_read(path))


def _files() -> dict[str, Path]:
    return {path.stem: path for path in sorted(preset_directory().glob("*.yaml"))}


def _read(path: Path, loader: Any = yaml.SafeLoader) -> dict[str, Any]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"has more than {MAX_BYTES} bytes")
        text = path.read_text(encoding="utf-8")
        if text.count("[") + text.count("{") > MAX_BRACKETS:
            raise ValueError(f"has more than {MAX_BRACKETS} brackets")
        content = yaml.load(text, loader)
    except (yaml.YAMLError, ValueError, OSError, RecursionError) as error:
        raise ParameterError(f"{path}: cannot be read: {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ParameterError(f"{path}: should hold names and values")
    return content


def _flatten(mapping: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    todo = [("", mapping)]
    for prefix, group in todo:
        for key, value in group.items():
            if isinstance(value, Mapping):
                todo.append((f"{prefix}{key}.", value))
            else:
                flat[f"{prefix}{key}"] = value
        if len(flat) + len(todo) > MAX_KEYS:
            raise ParameterError(f"a preset with more than {MAX_KEYS} names: should have each once")
    return flat
