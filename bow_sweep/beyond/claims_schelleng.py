"""Limits of bow force in Schelleng's plane, and note by note: sections 8, 11 and 14."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from bow_classifier.verdict.regimes import is_helmholtz
from bow_sim.physics.parameters import Parameters
from bow_sweep.beyond.claim import Claims, Finding, Maps, Point
from bow_sweep.beyond.drawing import BLUE, GREEN, MUTED, ORANGE
from bow_sweep.beyond.formulas import greatest_force, least_force
from bow_sweep.beyond.measures import lower_limit, rank_correlation, upper_limit
from bow_sweep.beyond.sweeps import SPEEDS
from bow_sweep.maps.map_file import MapFile
from bow_sweep.plan.sweep import Sweep

CLAIMS = Claims()
claim = CLAIMS.claim

MEASURED = {0.05: 0.21, 0.1: 0.31, 0.2: 0.76}
"""Bow speed (m/s) -> measured lower limit of force at beta = 0.1, N."""

HYPERBOLA = {0.05: 0.21, 0.1: 0.57, 0.2: 1.87}
"""The same with the hyperbola 0.8/0.3, v_0 = 0.1 m/s, of the trial."""

UPPER = 1.89
"""Measured upper limit at beta = 0.1 and 0.1 m/s, N."""

BETA = 0.1


def limits_at(plane: MapFile, beta: float) -> tuple[float, float]:
    """Return lower and upper limit of force, N, in the row of a map that is nearest to a bow position."""
    row = is_helmholtz(plane.regime)[int(np.argmin(np.abs(plane.y - beta)))]
    return lower_limit(plane.x, row), upper_limit(plane.x, row)


THERMAL_MAPS = tuple(f"schelleng_thermal_{speed:g}" for speed in SPEEDS)
HYPERBOLA_MAPS = tuple(f"schelleng_hyperbola_{speed:g}" for speed in SPEEDS)


@claim(
    "schelleng-lower",
    "cello G string from rest at beta 0.1, thermal friction: lower limit of force at 0.05, 0.1, 0.2 m/s",
    "Lampis et al. by way of another's evaluation",
    "secondary",
    "measured 0.21, 0.31, 0.76 N (trial 0.26, 0.32, 0.57)",
    "within 30 % of the measured",
    *THERMAL_MAPS,
)
def _schelleng_lower(maps: Maps) -> Finding:
    found = [limits_at(maps[name], BETA)[0] for name in THERMAL_MAPS]
    points = tuple(
        Point.about(f"at {speed:g} m/s, N", low, MEASURED[speed], 0.3 * MEASURED[speed])
        for speed, low in zip(SPEEDS, found, strict=True)
    )
    return Finding(
        f"{', '.join(f'{low:.2f}' for low in found)} N", points, partial(_draw_lower, {"thermal, ours": found})
    )


def _draw_lower(found: dict[str, list[float]], axes: Any) -> None:
    axes.loglog(SPEEDS, list(MEASURED.values()), "o-", color=ORANGE, ms=8, label="measured")
    for (name, values), colour in zip(found.items(), (BLUE, GREEN), strict=False):
        axes.loglog(SPEEDS, values, ".-", color=colour, ms=8, label=name)
    axes.set_xticks(SPEEDS, [f"{speed:g}" for speed in SPEEDS])
    axes.minorticks_off()
    axes.set(xlabel="bow speed, m/s", ylabel="lower limit of force, N")
    axes.legend(loc="upper left")


@claim(
    "schelleng-hyperbola",
    "the same with a hyperbola of 0.8/0.3: the limit grows too fast with speed",
    "PHYSICS.md 14",
    "trial",
    "0.21, 0.57, 1.87 N; nine times in a factor of 4, measured 3.6",
    "30 % each; grows by more than with thermal friction, and by more than twice the measured",
    *THERMAL_MAPS,
    *HYPERBOLA_MAPS,
)
def _schelleng_hyperbola(maps: Maps) -> Finding:
    thermal = [limits_at(maps[name], BETA)[0] for name in THERMAL_MAPS]
    found = [limits_at(maps[name], BETA)[0] for name in HYPERBOLA_MAPS]
    growth, slower = found[-1] / found[0], thermal[-1] / thermal[0]
    measured = MEASURED[0.2] / MEASURED[0.05]
    points = (
        *(
            Point.about(f"at {speed:g} m/s, N", low, HYPERBOLA[speed], 0.3 * HYPERBOLA[speed])
            for speed, low in zip(SPEEDS, found, strict=True)
        ),
        Point.true("grows by more than with thermal friction", growth > slower),
        Point("growth, of the measured", growth / measured, 2.0),
    )
    words = f"{', '.join(f'{low:.2f}' for low in found)} N: {growth:.1f} times; thermal {slower:.1f} times"
    return Finding(words, points, partial(_draw_lower, {"thermal, ours": thermal, "hyperbola, ours": found}))


@claim(
    "schelleng-upper",
    "cello G string from rest at beta 0.1 and 0.1 m/s, thermal friction: upper limit of force",
    "Lampis et al. by way of another's evaluation",
    "secondary",
    "measured 1.89 N (trial 3.4: too high, for a bow of one point)",
    "reported: the model has one point of contact",
    THERMAL_MAPS[1],
)
def _schelleng_upper(maps: Maps) -> Finding:
    plane = maps[THERMAL_MAPS[1]]
    _, high = limits_at(plane, BETA)

    def draw(axes: Any) -> None:
        success = is_helmholtz(plane.regime)
        x, y = np.meshgrid(plane.x, plane.y)
        axes.plot(x[success], y[success], "o", color=BLUE, ms=2.5, label="Helmholtz")
        axes.plot(x[~success], y[~success], "o", color=ORANGE, ms=2.5, mfc="none", mew=0.4, label="other")
        axes.plot([MEASURED[0.1], UPPER], [BETA] * 2, "D", color="black", ms=5, mfc="none", label="measured limits")
        axes.set(xscale="log", yscale="log", xlabel="bow force, N", ylabel="beta")
        axes.minorticks_off()
        axes.set_yticks([0.02, 0.05, 0.1, 0.2], ["0.02", "0.05", "0.1", "0.2"])
        axes.set_xticks([0.1, 0.2, 0.5, 1, 2, 5], ["0.1", "0.2", "0.5", "1", "2", "5"])
        axes.legend(loc="lower left", ncols=3)

    return Finding(f"{high:.2f} N", (), draw)


# Sustained


@claim(
    "f-max",
    "greatest force of sustained Helmholtz motion of the paper's string, bow_bridge 5 to 10 (stiff, v_mid 0.2)",
    "PHYSICS.md 8; trial 0.83-1.02",
    "theory",
    "v_b/(Y beta (mu_s - mu_d)); slope of its logarithm over that of beta near -0.9",
    "20 %; slope within 0.15, as much as 20 % at one end make over this range",
    "f_max",
)
def _f_max(maps: Maps) -> Finding:
    plane = maps["f_max"]
    found, formula = {}, {}
    for bridge, row in zip(plane.y.astype(int).tolist(), is_helmholtz(plane.regime), strict=True):
        formula[bridge] = greatest_force(Parameters(bow_bridge=bridge))
        found[bridge] = upper_limit(plane.x, row)
    ratio = {bridge: found[bridge] / formula[bridge] for bridge in found}
    slope = float(np.polyfit(np.log(list(found)), np.log(list(found.values())), 1)[0])
    points = (
        *(Point.about(f"bow_bridge {bridge}, of the formula", ratio[bridge], 1.0, 0.2) for bridge in found),
        Point.about("slope", slope, -0.9, 0.15),
    )
    words = f"{min(ratio.values()):.2f} to {max(ratio.values()):.2f} of the formula; slope {slope:.2f}"

    def draw(axes: Any) -> None:
        axes.loglog(list(formula), list(formula.values()), color=ORANGE, lw=2.5, label="formula")
        axes.loglog(list(found), list(found.values()), "o-", color=BLUE, ms=5, lw=0.8, label="ours")
        axes.set_xticks(list(found), [str(bridge) for bridge in found])
        axes.minorticks_off()
        axes.set(xlabel="round trip bow-bridge-bow, samples", ylabel="greatest force")
        axes.legend()

    return Finding(words, points, draw)


STEEL_MAPS = tuple(f"steel_{speed:g}" for speed in SPEEDS)
STEEL_UPPER = {0.05: 1.0, 0.1: 0.73, 0.2: 0.75}
"""Bow speed (m/s) -> measured F_max beta/v of the steel D string, kg/s."""


@claim(
    "steel-d",
    "violin_d_steel, thermal friction, beta 0.06 to 0.16, sustained: F_max beta/v, and how F_min depends on speed",
    "Schoonderwaldt, Guettler, Askenfelt 2008",
    "secondary",
    "F_max beta/v = 0.8 to 1.25 kg/s (measured 1.0, 0.73, 0.75 at 0.05, 0.1, 0.2 m/s); F_min by less than 3 in a "
    "factor 4 of speed (measured: not at all; Schelleng: 4)",
    "mean over beta at each speed 0.8 to 1.25, near within 0.2 of that; ratio of F_min at 0.2 and 0.05 m/s, mean over "
    "beta, below 3",
    *STEEL_MAPS,
)
def _steel_d(maps: Maps) -> Finding:
    betas = maps[STEEL_MAPS[0]].y / Parameters().period
    lower, upper = np.full((3, len(betas)), np.nan), np.full((3, len(betas)), np.nan)
    for i, (speed, name) in enumerate(zip(SPEEDS, STEEL_MAPS, strict=True)):
        plane = maps[name]
        for j, row in enumerate(is_helmholtz(plane.regime)):
            lower[i, j] = lower_limit(plane.x, row)
            upper[i, j] = upper_limit(plane.x, row) * betas[j] / speed
    means = np.nanmean(upper, axis=1)
    ratio = float(np.exp(np.nanmean(np.log(lower[2] / lower[0]))))
    points = (
        *(
            Point(f"F_max beta/v at {v:g} m/s, kg/s", float(m), 0.8, 1.25, 0.2)
            for v, m in zip(SPEEDS, means, strict=True)
        ),
        Point("F_min at 0.2 over 0.05 m/s", ratio, 0.0, 3.0, 1.0),
    )
    words = f"F_max beta/v {', '.join(f'{m:.2f}' for m in means)} kg/s; F_min by {ratio:.1f}"

    def draw(axes: Any) -> None:
        for i, colour in enumerate((BLUE, GREEN, ORANGE)):
            axes.loglog(betas, lower[i], ".-", color=colour, label=f"{SPEEDS[i]:g} m/s")
            axes.loglog(betas, upper[i] * SPEEDS[i] / betas, ".-", color=colour)
            measured = STEEL_UPPER[SPEEDS[i]] * SPEEDS[i] / betas
            axes.loglog(betas, measured, ":", color=colour, label="measured F_max" if not i else None)
        axes.set_xticks(betas, [f"{beta:.3f}" for beta in betas])
        axes.minorticks_off()
        axes.set(xlabel="beta", ylabel="bow force, N")
        axes.legend(loc="lower left", ncols=2)

    return Finding(words, points, draw)


# Note by note

OPEN = 196.0
HARDEST = (14, 15, 17, 18)
"""Semitones above G: 440 and 466 Hz, 523 and 554 Hz."""

EASIEST = 8
"""311 Hz."""


@claim(
    "stoppani-notes",
    "violin G string with the 76 modes of a measured violin, 25 notes: which need the most force",
    "PHYSICS.md 11",
    "trial",
    "440-466 and 523-554 Hz the most, 311 Hz the least; rank correlation of the number of failing forces with "
    "Schelleng's minimum 0.81",
    "the correlation above 0.7; the four notes are the four with the most failing forces (near: three of them); none "
    "has fewer than 311 Hz (near: two fewer); the force sinks from 7, and the stiffness is the paper's",
    "stoppani",
    "stoppani_own",
)
def _stoppani_notes(maps: Maps) -> Finding:
    plane = maps["stoppani"]
    frequencies = OPEN * 2 ** (plane.y / 12)
    success = is_helmholtz(plane.regime)
    failing = (~success).sum(axis=1)
    p = Sweep.from_spec("", plane.settings).parameters
    formula = np.array([least_force(p.replace(f_0=f)) for f in frequencies.tolist()])
    own = rank_correlation((~is_helmholtz(maps["stoppani_own"].regime)).sum(axis=1), formula)
    correlation = rank_correlation(failing, formula)
    bar = np.sort(failing)[-len(HARDEST)]
    hard = sum(bool(failing[note] >= bar) for note in HARDEST)
    points = (
        Point("rank correlation", correlation, 0.7, 1.0, 0.1),
        Point("of the four hardest notes", hard, 4, 4, 1),
        Point("failing at 311 Hz beyond the least", float(failing[EASIEST] - failing.min()), 0, 0, 2),
    )
    worst = ", ".join(f"{frequencies[i]:.0f}" for i in np.argsort(-failing, kind="stable")[:4])
    words = (
        f"most: {worst} Hz; least: {frequencies[int(np.argmin(failing))]:.0f} Hz; rank correlation {correlation:.2f} "
    )
    words += f"({own:.2f} with the string's own stiffness)"

    def draw(axes: Any) -> None:
        x, y = np.meshgrid(plane.y, plane.x, indexing="ij")
        axes.plot(x[success], y[success], "o", color=BLUE, ms=2.8, label="Helmholtz")
        axes.plot(x[~success], y[~success], "o", color=ORANGE, ms=2.8, mfc="none", mew=0.5, label="other")
        axes.plot(plane.y, formula, color=MUTED, lw=1.2, label="minimum by the formula")
        axes.set(yscale="log", xlabel="semitones above G (196 Hz)", ylabel="bow force, v_b impedance", ylim=(0.06, 25))
        axes.legend(loc="upper left", ncols=3)

    return Finding(words, points, draw)
