"""Several sweeps run as one, with one report. A campaign is a file in config/campaigns."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from bow_sim.atomic_files import replacing
from bow_sim.config_files import find_config
from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import REPORT, RunError

FILE = "campaign.json"
"""File in the directory of a campaign, with its name and the settings over its presets."""

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
"""Entries of each run's report that the report of the campaign repeats."""


@dataclass(frozen=True)
class Campaign:
    """Several sweeps that belong together.

    Attributes
    ----------
    name, title
        Of the campaign.
    presets
        Of its sweeps; the run directory of each has the name of its preset.
    settings
        "name=value" over every preset.
    figure
        The figure of the paper that the maps make up; 0 for none.
    """

    name: str
    title: str
    presets: tuple[str, ...]
    settings: tuple[str, ...] = ()
    figure: int = 0

    def sweeps(self) -> dict[str, Sweep]:
        """Return the sweeps by preset.

        Raises
        ------
        ParameterError
            If the settings are not valid for one of them.
        """
        return {preset: Sweep.from_spec(preset, self.settings) for preset in self.presets}

    def begin(self, directory: Path) -> None:
        """Write name and settings of this campaign to a file in its directory, so that it can be resumed."""
        with replacing(directory / FILE) as file:
            file.write(json.dumps({"campaign": self.name, "settings": list(self.settings)}).encode() + b"\n")

    @classmethod
    def of(cls, name: str, settings: Iterable[str] = ()) -> Campaign:
        """Return a campaign of config/campaigns, with settings over its presets.

        Raises
        ------
        ParameterError
            If there is none of this name.
        """
        if name not in campaigns():  # a name from a list, never a path
            raise ParameterError(f"campaign {name!r}: no such campaign; one of {', '.join(campaigns())}")
        content = yaml.safe_load((_directory() / f"{name}.yaml").read_text())
        return cls(name, content["title"], tuple(content["sweeps"]), tuple(settings), content.get("figure", 0))

    @classmethod
    def in_directory(cls, directory: Path) -> Campaign:
        """Return the campaign that was begun in a directory.

        Raises
        ------
        RunError
            If its file cannot be read.
        """
        path = directory / FILE
        try:
            content = json.loads(path.read_text())
            return cls.of(content["campaign"], [str(line) for line in content["settings"]])
        except (OSError, ValueError, KeyError, TypeError, ParameterError) as error:
            raise RunError(f"{path}: does not say which campaign this is: {error}") from None


def campaigns() -> dict[str, str]:
    """Return {name: title} of all campaigns, sorted by name."""
    files = sorted(_directory().glob("*.yaml"))
    return {path.stem: str(yaml.safe_load(path.read_text())["title"]) for path in files}


def _directory() -> Path:
    found = find_config("campaigns")
    if found is None:
        raise FileNotFoundError(f"no config/campaigns or share/bow/config/campaigns in any folder above {__file__}")
    return found


def report(directory: Path, campaign: Campaign) -> dict[str, Any]:
    """Write the report on all runs of a finished campaign and return it, see `OF_A_RUN`."""
    runs: dict[str, Mapping[str, Any]] = {
        preset: json.loads((directory / preset / REPORT).read_text()) for preset in campaign.presets
    }
    accounts = ("planned", "done", "quarantined", "outstanding")
    content = {
        "campaign": campaign.name,
        "settings": list(campaign.settings),
        "cells": {name: sum(run["cells"][name] for run in runs.values()) for name in accounts},
        "samples": sum(run["samples"] for run in runs.values()),
        "wall_seconds": sum(run["wall_seconds"] for run in runs.values()),
        "runs": {preset: _of_a_run(run) for preset, run in runs.items()},
    }
    with replacing(directory / REPORT) as file:
        file.write(json.dumps(content, indent=2).encode() + b"\n")
    return content


def _of_a_run(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the report of a campaign has of the report of a run; `repeats` only where there are some."""
    return {name: report.get(name) for name in OF_A_RUN} | {k: report[k] for k in ("repeats",) if k in report}
