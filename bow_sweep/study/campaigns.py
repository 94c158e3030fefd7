"""The studies of config/campaigns, and directories of campaigns from before there were studies."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import yaml

from bow_sim.config_files import find_config
from bow_sim.physics.errors import ParameterError
from bow_sweep.run.directory import CAMPAIGN, RunError
from bow_sweep.study.over import PRESET, Over
from bow_sweep.study.plan import Study


def campaigns() -> dict[str, str]:
    """Return {name: title} of all campaigns, sorted by name."""
    files = sorted(_directory().glob("*.yaml"))
    return {path.stem: str(yaml.safe_load(path.read_text())["title"]) for path in files}


def campaign(name: str, settings: Iterable[str] = ()) -> Study:
    """Return a campaign of config/campaigns as a study over its presets, with settings for all of them.

    Raises
    ------
    ParameterError
        If there is none of this name.
    """
    if name not in campaigns():  # a name from a list, never a path
        raise ParameterError(f"campaign {name!r}: no such campaign; one of {', '.join(campaigns())}")
    content = yaml.safe_load((_directory() / f"{name}.yaml").read_text())
    over = Over(PRESET, tuple(content["sweeps"]))
    return Study("", tuple(settings), (over,), content["title"], content.get("figure", 0))


def study_in(directory: Path) -> Study:
    """Return the study, or the campaign of before there were studies, that was begun in a directory.

    Raises
    ------
    RunError
        Where there is none, or its file cannot be read.
    """
    if not (directory / CAMPAIGN).exists():
        return Study.in_directory(directory)
    path = directory / CAMPAIGN
    try:
        content = json.loads(path.read_text())
        return campaign(content["campaign"], [str(line) for line in content["settings"]])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RunError(f"{path}: does not say which campaign this is: {error}") from None


def _directory() -> Path:
    found = find_config("campaigns")
    if found is None:
        raise FileNotFoundError(f"no config/campaigns or share/bow/config/campaigns in any folder above {__file__}")
    return found
