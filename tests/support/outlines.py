"""Outlines of sweeps whose plan is not at hand."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bow_sim.protocol.sweep_outline import SweepOutline


def outline(
    run_id: str, sweep_id: str, settings: Iterable[str], rounds: np.ndarray | None = None, classifier: str = ""
) -> SweepOutline:
    """The outline that a plan with these settings and rounds announces; None: one round of all cells."""
    return SweepOutline.of(
        {
            "run_id": run_id,
            "sweep_id": sweep_id,
            "classifier": classifier,
            "spec.preset": "",
            "spec.settings": settings,
            "rounds": np.zeros(0, np.uint8) if rounds is None else rounds,
        }
    )
