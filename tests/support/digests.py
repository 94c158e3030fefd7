"""Hashes of what this Python computes of some small maps, part by part.

Run as a program it prints them: that is how other Pythons and libraries compute them, without ROS and pytest.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Iterable

import numpy as np

import bow_sim
from bow_sim.kernel.fingerprint import PARTS, _digest
from bow_sweep.maps.in_process import judged_chunks
from bow_sweep.plan.sweep import Sweep

SMALL = ("x.count=8", "y.count=4", "periods=30")

MAPS = {
    "stiff string": "",
    "Raman's string, martele": "model=raman bridge_gain=0.9 gesture=martele",
    "Coulomb friction, float32": "model=raman friction=coulomb dtype=float32",
}
"""Settings over the preset fig11d. Each kind of kernel has to be compiled, so there are three."""

FEW = 3
"""So few cells of a map are also computed by themselves."""


def digests(settings: Iterable[str]) -> dict[str, str]:
    """Return hashes of a map by what they are of: parts of its fingerprint, waveforms, fields of its verdicts."""
    sweep = Sweep.from_spec("fig11d", (*SMALL, *settings))
    cells = sweep.first_blocks.block(0)
    few, whole = (
        [*zip(*judged_chunks(sweep.parameters, sweep.lanes(some), sweep.thresholds), strict=True)]
        for some in (cells[:FEW], cells)
    )
    found = dict(zip(PARTS.values(), sweep.fingerprint.split(), strict=True))
    found |= {"waveforms": _digest(whole[0]), "waveforms of few cells": _digest(few[0])}
    fields = whole[1][0]._fields
    return found | {f"{field} of the verdicts": _digest([getattr(one, field) for one in whole[1]]) for field in fields}


def all_digests() -> dict[str, dict[str, str]]:
    """Return the hashes of all maps, by their names."""
    return {name: digests(settings.split()) for name, settings in MAPS.items()}


def main() -> None:
    """Print as JSON where the sources are, the versions, and the hashes."""
    versions = {"python": platform.python_version(), "numpy": np.__version__}
    print(json.dumps([bow_sim.__path__[0], versions, all_digests()]))


if __name__ == "__main__":
    main()
