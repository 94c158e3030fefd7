"""A study: a family of maps over further parameters, each a sweep with a run directory of its own."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.fields import as_number
from bow_sim.physics.parameters import parse_settings
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import STUDY
from bow_sweep.study.asked import read_asked, write_asked
from bow_sweep.study.over import LISTED, PRESET, SCALES, Over

FORMAT = 1
"""Of the file of a study."""

MOST_MAPS = 2000
"""Maps of one study."""

LONGEST = 120
"""Characters of the name of a run directory; file systems take 255 bytes."""


@dataclass(frozen=True)
class Member:
    """One map of a study.

    Attributes
    ----------
    name
        Of its run directory, in that of the study.
    values
        Parameter -> value, for the parameters that the study goes through.
    """

    name: str
    values: Mapping[str, str]
    sweep: Sweep


@dataclass(frozen=True)
class Study:
    """A family of maps: the product of the values that further parameters take.

    Attributes
    ----------
    preset
        Of the package, that the maps begin from; "" for none.
    settings
        "name=value" over it, for all maps.
    overs
        The further parameters and their values; the last changes fastest.
    title
        For people; "" for none.
    figure
        The figure of the paper that the maps make up; 0 for none.
    """

    preset: str
    settings: tuple[str, ...]
    overs: tuple[Over, ...]
    title: str = ""
    figure: int = 0

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each further parameter."""
        return tuple(len(over.values) for over in self.overs)

    @cached_property
    def members(self) -> tuple[Member, ...]:
        """The maps, in order.

        Raises
        ------
        ParameterError
            Where a map cannot be; names its values, and what would be right.
        """
        self._check()
        combinations = list(itertools.product(*(over.values for over in self.overs)))
        digits = len(str(len(combinations) - 1))
        found = []
        for number, values in enumerate(combinations):
            of = {over.name: value for over, value in zip(self.overs, values, strict=True)}
            name = values[0] if self._of_presets else run_name(number, digits, of)
            found.append(Member(name, of, self._sweep(of)))
        return tuple(found)

    @property
    def _of_presets(self) -> bool:
        """Whether the maps are presets and nothing else; these are the names of the runs then."""
        return len(self.overs) == 1 and self.overs[0].name == PRESET

    def _check(self) -> None:
        given = list(parse_settings(self.settings)) + ([PRESET] if self.preset else [])
        if not self.overs:
            raise ParameterError("a study goes over a parameter: --over NAME=FIRST:LAST:COUNT, or --over NAME=A,B,...")
        for over in self.overs:
            over.check(given)
        names = [over.name for over in self.overs]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ParameterError(f"--over {min(twice)}: is given twice; should be once")
        if (maps := math.prod(self.shape)) > MOST_MAPS:
            raise ParameterError(f"a study of {maps} maps; should have at most {MOST_MAPS}: fewer values of --over")

    def _sweep(self, values: Mapping[str, str]) -> Sweep:
        preset = values.get(PRESET, self.preset)
        settings = [*self.settings, *(f"{name}={value}" for name, value in values.items() if name != PRESET)]
        try:
            return Sweep.from_spec(preset, settings)
        except ParameterError as error:
            at = ", ".join(f"{name} = {short(value)}" for name, value in values.items())
            raise ParameterError(f"at {at}: {error}") from None

    # ---- its file

    def begin(self, directory: Path) -> None:
        """Write what is asked into the directory of the study, so that it can be resumed."""
        content: dict[str, Any] = {
            "study": FORMAT,
            "title": self.title,
            "preset": self.preset,
            "settings": list(self.settings),
            "over": [{"name": o.name, "scale": o.scale, "values": list(o.values)} for o in self.overs],
            **({"figure": self.figure} if self.figure else {}),
        }
        write_asked(directory / STUDY, content)

    @classmethod
    def in_directory(cls, directory: Path) -> Study:
        """Return the study that was begun in a directory.

        Raises
        ------
        RunError
            Where there is none, or its file cannot be read, or is of a later version.
        """

        def build(content: Any) -> Study:
            overs = tuple(_over(entry) for entry in content["over"])
            settings = tuple(str(line) for line in content["settings"])
            study = cls(str(content["preset"]), settings, overs, str(content["title"]), int(content.get("figure", 0)))
            _ = study.members
            return study

        return read_asked(directory / STUDY, "study", "study", FORMAT, build)


def _over(entry: Mapping[str, Any]) -> Over:
    scale = entry["scale"]
    if scale not in (*SCALES, LISTED):
        raise ValueError(f"scale {scale!r}: should be one of {', '.join((*SCALES, LISTED))}")
    return Over(str(entry["name"]), tuple(str(value) for value in entry["values"]), scale)


def run_name(number: int, digits: int, values: Mapping[str, str]) -> str:
    """Return the name of a run directory: its number, so that names sort, and the values of its map.

    Characters that shells or file systems treat in a special way are left out.
    """
    parts = [f"{number:0{digits}d}", *(f"{name}={short(value)}" for name, value in values.items())]
    return re.sub(r"[^A-Za-z0-9._+=-]", "-", "_".join(parts))[:LONGEST]


def short(value: str) -> str:
    """Return a value with at most four digits, for people; a text as it is."""
    number = as_number(value)
    return value if number is None else f"{number:.4g}"
