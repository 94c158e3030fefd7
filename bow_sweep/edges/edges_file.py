"""Bisected edges as files: ``edges.npz`` for programs, ``edges.json`` for reading."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.atomic_files import replacing
from bow_sweep.edges.bisection import Edges
from bow_sweep.edges.boundary import ALONG
from bow_sweep.edges.parting import KINDS
from bow_sweep.maps.map_file import MapFile

ARRAYS, REPORT, PICTURE = "edges.npz", "edges.json", "edges.png"
"""Names of the files."""


def arrays_of(edges: Edges, found: MapFile) -> dict[str, np.ndarray]:
    """Return the arrays of ``edges.npz``, by name.

    `along` (0: x, 1: y), `ix`, `iy`, `low`, `high`, `low_regime`, `high_regime`, `kind`, `slope`, `growth`, `settled`
    (edges,); `width`, `step`, `release`, `parting` (edges, halvings + 1); `kind_names`, `regime_names`; `outcome`,
    `run_id`, `x_name`, `y_name`, `settings`, and `period`, the nominal one in samples.
    """
    rows = {name: getattr(edges.boundary, name) for name in ("along", "ix", "iy")}
    rows |= {name: getattr(edges, name) for name in ("low", "high", "low_regime", "high_regime", "kind", "slope")}
    rows |= {name: getattr(edges, name) for name in ("growth", "settled", "width", "step", "release", "parting")}
    texts = {"outcome": edges.outcome, "run_id": found.run_id, "x_name": found.x_name, "y_name": found.y_name}
    rows |= {name: np.array(text, np.str_) for name, text in texts.items()}
    lists = {"kind_names": KINDS, "regime_names": found.regime_names, "settings": found.settings}
    rows |= {name: np.array(words, np.str_) for name, words in lists.items()}
    return rows | {"period": np.array(edges.period)}


def entries(edges: Edges, found: MapFile) -> list[dict[str, Any]]:
    """Return each edge in words and numbers; None stands for what an edge does not have."""
    out = []
    names = dict(enumerate(found.regime_names))
    for i in range(len(edges)):
        along = int(edges.boundary.along[i])
        ix, iy = int(edges.boundary.ix[i]), int(edges.boundary.iy[i])
        step, parting = int(edges.step[i, -1]), int(edges.parting[i, -1])
        other = (found.y_name, float(found.y[iy])) if along == 0 else (found.x_name, float(found.x[ix]))
        out.append(
            {
                "along": (found.x_name, found.y_name)[along],
                "axis": ALONG[along],
                "cell": [ix, iy],
                "low": float(edges.low[i]),
                "high": float(edges.high[i]),
                "width": float(edges.width[i, -1]),
                "fixed": {other[0]: other[1]},
                "regimes": [names.get(int(r), str(r)) for r in (edges.low_regime[i], edges.high_regime[i])],
                "kind": KINDS[edges.kind[i]],
                "step": step if step >= 0 else None,
                "step_periods": step / edges.period if step >= 0 else None,
                "event": ("release" if edges.release[i, -1] else "capture") if step >= 0 else None,
                "settled": _number(float(edges.settled[i])),
                "parting": parting if parting >= 0 else None,
                "slope": float(edges.slope[i]),
                "growth": _number(float(edges.growth[i])),
            }
        )
    return out


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def summary(edges: Edges, found: MapFile) -> dict[str, Any]:
    """Return the contents of ``edges.json``."""
    return {
        "run_id": found.run_id,
        "outcome": edges.outcome,
        "halvings": edges.width.shape[1] - 1,
        "edges": len(edges),
        "unlike": edges.unlike,
        "kinds": edges.counts(),
        "each": entries(edges, found),
    }


def write(directory: Path, edges: Edges, found: MapFile) -> None:
    """Write both files; readers see the old ones or the complete new ones.

    Raises
    ------
    OSError
        Where one cannot be written.
    """
    with replacing(directory / ARRAYS) as file:
        np.savez_compressed(file, allow_pickle=False, **arrays_of(edges, found))
    with replacing(directory / REPORT) as file:
        file.write((json.dumps(summary(edges, found), indent=1) + "\n").encode())
