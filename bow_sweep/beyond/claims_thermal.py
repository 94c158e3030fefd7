"""Thermal friction under a bowed string: section 13."""

from __future__ import annotations

from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import REGIMES, is_helmholtz
from bow_sim.kernel.block import transient
from bow_sim.physics.parameters import Parameters
from bow_sweep.beyond.cells import compute
from bow_sweep.beyond.claim import Claims, Finding, Maps, Point
from bow_sweep.beyond.drawing import BLUE, GREEN, ORANGE

CLAIMS = Claims()
claim = CLAIMS.claim

TRIAL = {0.2: (9.6, 10.0, 1.0016), 0.3: (12.1, 11.5, 1.0008), 0.5: (12.2, 16.5, 1.023)}
"""Bow force (N) -> mean temperature (K), its swing (K) and the period (N samples) of Helmholtz motion."""

DOUBLE = 0.1
"""Bow force of double slip, N."""

LOW_FORCES = np.linspace(0.04, 0.2, 17)
"""Bow forces around it, N."""

STEADY = 30
"""Periods at the end in which temperature and period are measured."""


STIFFNESS = 5e-5
"""Of the paper's string, which the trial's had too: with it the figures agree; docs/validation.md has the string's own.
"""


def _violin(**more: float) -> Parameters:
    own = {"string": "violin_a", "v_unit": 0.1, "friction": "thermal", "rosin": "rosin"}
    return Parameters.from_mapping(own | more)


@claim(
    "thermal-violin",
    "violin A string, thermal friction, bow at 0.1 m/s and 15/139 of the length: temperature and period",
    "PHYSICS.md 13; others: swing 10 to 25 K",
    "trial",
    "Helmholtz at 0.2, 0.3, 0.5 N with mean 9.6, 12.1, 12.2 K, swing 10, 11.5, 16.5 K, period 1.0016, 1.0008, 1.023 N",
    "regimes as claimed; 1 K in the mean, 2 K in the swing, 0.002 N in the period",
)
def _thermal_violin(maps: Maps) -> Finding:
    base = _violin(stiffness_b=STIFFNESS)
    motion = compute(base, {"force": np.array(list(TRIAL))})
    regimes = dict(zip(TRIAL, motion.regime[-1].tolist(), strict=True))
    periods = dict(zip(TRIAL, motion.period[-6:].mean(axis=0) / base.period, strict=True))
    points: list[Point] = []
    traces, found = {}, {}
    for force, (mean, swing, period) in TRIAL.items():
        waves = transient(base.replace(force=force))
        kelvin = waves["temperature"][-STEADY * base.period :]
        rows = kelvin.reshape(STEADY, base.period)
        found[force] = (float(kelvin.mean()), float(np.mean(rows.max(axis=1) - rows.min(axis=1))))
        traces[force] = kelvin[: 3 * base.period]
        points += [
            Point.true(f"Helmholtz at {force:g} N", bool(is_helmholtz(regimes[force]))),
            Point.about(f"mean at {force:g} N, K", found[force][0], mean, 1.0),
            Point.about(f"swing at {force:g} N, K", found[force][1], swing, 2.0),
            Point.about(f"period at {force:g} N, N", float(periods[force]), period, 0.002),
        ]
    words = (
        f"mean {', '.join(f'{found[force][0]:.1f}' for force in TRIAL)} K, swing "
        f"{', '.join(f'{found[force][1]:.1f}' for force in TRIAL)} K, period "
        f"{', '.join(f'{periods[force]:.4f}' for force in TRIAL)} N"
    )

    def draw(axes: Any) -> None:
        for (force, kelvin), colour in zip(traces.items(), (BLUE, GREEN, ORANGE), strict=True):
            axes.plot(np.arange(len(kelvin)) / base.period, kelvin, color=colour, label=f"{force:g} N")
        axes.set(xlabel="periods", ylabel="temperature of the contact, K", ylim=(0, 32))
        axes.legend(loc="upper right", ncols=3)

    return Finding(words, tuple(points), draw)


@claim(
    "thermal-double-slip",
    "the same at 0.1 N",
    "PHYSICS.md 13",
    "trial",
    "double slip",
    "the verdict after 100 periods is multiple slip",
)
def _thermal_double_slip(maps: Maps) -> Finding:
    regimes = compute(_violin(stiffness_b=STIFFNESS), {"force": LOW_FORCES}).regime
    names = [REGIMES[code] for code in regimes[-1]]
    here = names[int(np.argmin(np.abs(LOW_FORCES - DOUBLE)))]
    doubles = LOW_FORCES[[name == "multiple_slip" for name in names]]
    span = (
        f"multiple slip at {doubles.min():.2f} to {doubles.max():.2f} N" if len(doubles) else "no multiple slip nearby"
    )
    words = f"{here.replace('_', ' ')}; of the forces 0.04, 0.05 ... 0.20 N {span}"

    def draw(axes: Any) -> None:
        shown = sorted(set(names))
        axes.plot(LOW_FORCES, [shown.index(name) for name in names], "o", color=BLUE, ms=5)
        axes.axvline(DOUBLE, color=ORANGE, lw=0.8)
        axes.set_yticks(range(len(shown)), [name.replace("_", " ") for name in shown])
        axes.set(xlabel="bow force, N", ylim=(-0.6, len(shown) - 0.4))

    return Finding(words, (Point.true("double slip", here == "multiple_slip"),), draw)
