"""Which parameters can be the axis of a map; why others cannot, and what would do."""

from __future__ import annotations

import difflib

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.instruments import PRESETS, SI
from bow_sim.physics.kinds import is_kind
from bow_sim.physics.parameters import FIELDS, SWEEPABLE, SWEEPABLE_NAMES, is_sweepable

_HOW = {"block_cells": "64,256", "adaptive": "0.25,0.5", "repeats": "2,8", "jitter": "0.001,0.01", "seed": "1,2"}
"""Settings of how a map is computed, and values of an example."""

WHY_NOT = {
    "period": (
        "all cells of a map have chunks of the same length, five periods. Sweep the note (semitone or f_0, with "
        "a body, bow hair or thermal friction), or",
        "80,139",
    ),
    "periods": (
        "all cells of a map are simulated for the same time. The map of the longest time has every five periods "
        "of the shorter ones; or",
        "50,100",
    ),
}
"""Why some numbers cannot be an axis, and values of an example."""


class StudyInsteadError(ParameterError):
    """A parameter cannot be an axis, but a study can have a map for each of its values; the text ends with `command`.

    Attributes
    ----------
    over
        What the study is over, with values of an example: "NAME=VALUE,VALUE".
    command
        The beginning of its command.
    """

    def __init__(self, why: str, over: str) -> None:
        self.over, self.command = over, f"bow study --over {over}"
        super().__init__(f"{why} make a map for each, as by {self.command}")


def check_name(key: str, name: str) -> None:
    """Raise ParameterError where a parameter cannot be the axis `key`; says why, and what would do.

    Raises
    ------
    StudyInsteadError
        Where a study would do.
    """
    if is_sweepable(name) or is_kind(name):
        return
    where = f"{key}.name = {name!r}: cannot be swept:"
    if name in WHY_NOT:
        why, values = WHY_NOT[name]
    elif name in FIELDS or name in PRESETS:
        choices = FIELDS[name].metadata.get("choices", ()) if name in FIELDS else tuple(PRESETS[name])
        why, values = "it is no number;", ",".join(choices[:2]) or "..."
    elif name in _HOW:
        why, values = "it says how a map is computed, not what of;", _HOW[name]
    else:
        close = difflib.get_close_matches(name, [*SWEEPABLE, *SI, *WHY_NOT], n=1)
        right = f"did you mean {close[0]}?" if close else f"one of {SWEEPABLE_NAMES}"
        raise ParameterError(f"{where} there is no such parameter; {right}")
    raise StudyInsteadError(f"{where} {why}", f"{name}={values}")
