"""The plane of a preset, before anything is computed."""

from __future__ import annotations

import numpy as np

from bow_sweep.maps.plane import Plane
from bow_sweep.plan.sweep import Sweep


def plane_of(preset: str, *settings: str) -> Plane:
    """The map of a sweep in which no cell has Helmholtz motion."""
    sweep = Sweep.from_spec(preset, settings)
    shape = (sweep.y.count, sweep.x.count)
    return Plane(
        run_id="",
        sweep_id="",
        x_name=sweep.x.name,
        y_name=sweep.y.name,
        x=sweep.x.values(),
        y=sweep.y.values(),
        transient_periods=np.zeros(shape, np.float32),
        regime=np.zeros(shape, np.uint8),
        regime_names=("no_oscillation",),
        settings=sweep.settings(),
        preset=preset,
    )
