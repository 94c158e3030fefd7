"""Small maps with known cells, as messages and as files."""

from __future__ import annotations

from typing import Any

import numpy as np

from bow_sim.protocol import cdr
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.maps.map_file import MapFile

RUN, SWEEP = "0123456789abcdef", "fedcba9876543210"
REGIMES = ("no_oscillation", "helmholtz", "multiple_slip", "multiple_flyback", "other_periodic", "aperiodic")
HELMHOLTZ, SLIP, FLYBACK, APERIODIC = (
    REGIMES.index(n) for n in ("helmholtz", "multiple_slip", "multiple_flyback", "aperiodic")
)


def settings(nx: int = 8, ny: int = 4, periods: int = 100, block_cells: int = 8) -> list[str]:
    """The settings of a plan that pictures read; the others have their defaults."""
    return [
        f"block_cells={block_cells}",
        "bow_bridge=15",
        "model=stiff_cremer",
        "mu_d=0.3",
        "mu_s=0.8",
        "period=139",
        f"periods={periods}",
        "tau_f=400.0",
        "v_b=1.0",
        "v_mid=0.2",
        f"x.count={nx}",
        "x.first=0.5",
        "x.last=20.0",
        "x.name=f_asym",
        "x.scale=log",
        "y_t=2.0",
        f"y.count={ny}",
        "y.first=0.0",
        "y.last=2.0",
        "y.name=f_init_ratio",
        "y.scale=linear",
    ]


def plan(state: int = 1, epoch: int = 1, run: str = RUN, nx: int = 8, ny: int = 4, done: int = 0) -> dict[str, Any]:
    """The fields of a Plan whose first `done` blocks of eight cells are done."""
    states = np.zeros(-(-nx * ny // 8), np.uint8)
    states[:done] = 1
    return {
        "run_id": run,
        "sweep_id": SWEEP,
        "epoch": epoch,
        "state": state,
        "spec.preset": "fig11d",
        "spec.settings": settings(nx, ny),
        "fingerprint": "none",
        "classifier": "none",
        "block_states": states,
        "rounds": np.zeros(0, np.uint8),
        "incarnation": "c" * 16,
    }


def outline(run: str = RUN) -> SweepOutline:
    """The outline that :func:`plan` describes."""
    return SweepOutline.of(plan(run=run))


def basin_map(nx: int = 8, ny: int = 4, computed: int | None = None, run: str = RUN) -> dict[str, Any]:
    """The fields of a BasinMap; cells from index `computed` on are pending.

    Row 0: cell (ix, 0) has transient length 5 * (ix + 1), at most 100. Row 1: never, multiple slip. Others: 50.
    """
    cells = nx * ny
    computed = cells if computed is None else computed
    iy, ix = np.divmod(np.arange(cells), nx)
    length = np.where(iy == 0, np.minimum(5 * (ix + 1), 100), np.where(iy == 1, 0, 50)).astype(np.float32)
    regime = np.where(iy == 1, SLIP, HELMHOLTZ).astype(np.uint8)
    pending = np.arange(cells) >= computed
    length[pending], regime[pending] = np.nan, PENDING
    return {
        "run_id": run,
        "sweep_id": SWEEP,
        "x_name": "f_asym",
        "y_name": "f_init_ratio",
        "x": np.geomspace(0.5, 20, nx),
        "y": np.linspace(0, 2, ny),
        "transient_periods": length,
        "regime": regime,
        "tests": np.where(pending, 0, 20).astype(np.uint16),
        "correlation": np.where(pending, np.nan, 0.9 + 0.001 * np.arange(cells)).astype(np.float32),
        "slips": np.where(pending, 0, np.where(iy == 1, 10, 5)).astype(np.uint16),
        "corners": np.where(pending, 0, 5).astype(np.uint16),
        "regime_names": list(REGIMES),
        "cells_done": int(computed // 8 * 8),
        "cells_quarantined": 0,
        "cells_outstanding": cells - int(computed // 8 * 8),
    }


def inspection(cell: int, chunk: int, samples: int = 695, run: str = RUN) -> bytes:
    """An InspectedCell: a sawtooth whose height says which cell it is."""
    t = chunk * samples + np.arange(samples)
    identity = {"run_id": run, "sweep_id": SWEEP, "block": 0, "chunk": chunk, "attempt": 1, "incarnation": "0" * 16}
    fields = {"cell": cell, "name": f"cell {cell}", "first_sample": chunk * samples, "sample_rate": 61160.0}
    force = (cell + 1) * (t % 139 / 139 - 0.5)
    return cdr.encode("InspectedCell", {**identity, **fields, "periods": t / 139, "bridge_force": force})


def map_file(nx: int = 8, ny: int = 4, tests: int = 20, computed: int | None = None) -> MapFile:
    """The finished map of the same sweep."""
    values = basin_map(nx, ny, computed)
    shape = (ny, nx)
    length = values["transient_periods"].reshape(shape)
    made = 5 * np.arange(1, tests + 1)
    over = {
        name: np.broadcast_to(values[name].reshape(shape), (tests, ny, nx))
        for name in ("correlation", "slips", "corners")
    }
    return MapFile(
        **{name: values[name] for name in ("run_id", "sweep_id", "x_name", "y_name", "x", "y")},
        transient_periods=length,
        regime=values["regime"].reshape(shape),
        regime_names=REGIMES,
        settings=tuple(settings(nx, ny, 5 * tests)),
        preset="fig11d",
        test_periods=made,
        period=np.full((tests, ny, nx), 139.2, np.float32),
        helmholtz=(length > 0) & (made[:, None, None] >= length),
        **over,
    )
