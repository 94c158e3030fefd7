"""The wolf, and least forces with a mode of the body near the note: section 11."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.regimes import is_helmholtz
from bow_sim.kernel.block import Block
from bow_sim.physics.parameters import Parameters
from bow_sweep.beyond.cells import compute
from bow_sweep.beyond.claim import Claims, Finding, Maps, Point
from bow_sweep.beyond.drawing import BLUE, GREEN, MUTED, ORANGE, rows_of_regimes
from bow_sweep.beyond.formulas import greatest_force, least_force
from bow_sweep.beyond.measures import beat, lower_limit, wolf_counts
from bow_sweep.beyond.sweeps import PAPER_F_0
from bow_sweep.maps.map_file import MapFile
from bow_sweep.plan.sweep import Sweep

CLAIMS = Claims()
claim = CLAIMS.claim

LOOKED_AT = 250
"""Periods at the end of a record in which the beat is measured."""

BEATS = {2.0: 10.6, 2.4: 11.0, 2.9: 12.0, 3.4: 13.5, 4.0: 16.5}
"""Bow force -> beat in periods, of the trial."""

ONE_SLIP, TWO_SLIPS, WOLF, OTHER = "one slip", "two slips", "wolf", "other"


def row_of_map(plane: MapFile, row: int) -> tuple[Parameters, dict[str, NDArray[np.float64]]]:
    """Return the string of a map and the lanes of one of its rows, to compute its cells again."""
    sweep = Sweep.from_spec("", plane.settings)
    nx = sweep.x.count
    return sweep.parameters, sweep.lanes(np.arange(row * nx, (row + 1) * nx, dtype=np.uint32))


def slips_a_period(plane: MapFile, row: int) -> list[str]:
    """Return what each cell of a row does at the end: a wolf, by its verdict; one slip a period, two, or other."""
    p, lanes = row_of_map(plane, row)
    slips = compute(p, lanes).slips
    out = []
    for cell, code in enumerate(plane.regime[row].tolist()):
        share, mean, _ = wolf_counts(slips.of(cell), p.period, p.periods)
        if plane.regime_names[code] == WOLF:
            out.append(WOLF)
        else:
            out.append(ONE_SLIP if share > 0.9 else TWO_SLIPS if 1.9 <= mean <= 2.1 else OTHER)
    return out


def beats(plane: MapFile, row: int, forces: list[float]) -> list[tuple[float, float]]:
    """Return the beat of the bridge's velocity (periods) and how clear it is, at some bow forces of a row."""
    p, lanes = row_of_map(plane, row)
    scale = lanes["body_scale"][0]
    block = Block(p, {"f_asym": np.array(forces), "body_scale": np.full(len(forces), scale)}, trace=True)
    place = block.trace_names.index("bridge_velocity")
    parts = []
    for chunk in range(p.chunks):
        block.advance()
        if chunk * 5 >= p.periods - LOOKED_AT:
            assert block.traces is not None
            parts.append(block.traces[place, :, : len(forces)].copy())
    velocity = np.concatenate(parts)
    return [beat(velocity[:, i], p.period) for i in range(len(forces))]


def _longest(forces: NDArray[np.float64], names: list[str]) -> NDArray[np.float64]:
    """Return the forces of the longest unbroken run of wolves: beyond it raucous motion may beat too."""
    wolf = np.array([False, *(name == WOLF for name in names), False])
    borders = np.flatnonzero(wolf[1:] != wolf[:-1])
    if not len(borders):
        return forces[:0]
    best = int(np.argmax(borders[1::2] - borders[::2]))
    return forces[borders[2 * best] : borders[2 * best + 1]]


def _at(plane: MapFile, names: list[str], low: float, high: float) -> set[str]:
    return {name for f, name in zip(plane.x, names, strict=True) if low - 1e-9 <= f <= high + 1e-9}


def _one_slip_from(plane: MapFile, names: list[str], high: float) -> float:
    """Return the lowest force from which every cell up to a higher one has one slip a period; NaN for none."""
    others = [f for f, name in zip(plane.x.tolist(), names, strict=True) if f <= high + 1e-9 and name != ONE_SLIP]
    above = plane.x[(plane.x > max(others, default=0.0)) & (plane.x <= high + 1e-9)]
    return float(above[0]) if len(above) else float("nan")


@claim(
    "wolf-regimes",
    "the wolf of 1983: with the mode two slips a period at small force, a wolf at a greater one, then Helmholtz motion",
    "McIntyre, Schumacher, Woodhouse 1983, Fig 14; numbers: trial",
    "secondary",
    "without the mode one slip a period; with it two slips at f = 1.6, wolf from 2.0 to 4.0, Helmholtz from 4.6",
    "every cell of the row there, and one slip up to 5.0 from 4.6 +- 0.1 on; without the mode, from 2.0 to 4.6",
    "wolf",
)
def _wolf_regimes(maps: Maps) -> Finding:
    plane = maps["wolf"]
    plain, mode = slips_a_period(plane, 0), slips_a_period(plane, 1)
    points = (
        Point.true("without the mode one slip", _at(plane, plain, 2.0, 4.6) == {ONE_SLIP}),
        Point.true("two slips at 1.6", _at(plane, mode, 1.6, 1.6) == {TWO_SLIPS}),
        Point.true("wolf from 2.0 to 4.0", _at(plane, mode, 2.0, 4.0) == {WOLF}),
        Point.true("one slip at 4.6", _at(plane, mode, 4.6, 4.6) == {ONE_SLIP}),
        Point.about("one slip from", _one_slip_from(plane, mode, 5.0), 4.6, 0.1 + 1e-9),
    )
    wolves = _longest(plane.x, mode)
    words = f"wolf from {wolves.min():.1f} to {wolves.max():.1f}" if len(wolves) else "no wolf"
    return Finding(words, points, partial(_draw_wolf_regimes, plane, {"without": plain, "with the mode": mode}))


def _draw_wolf_regimes(plane: MapFile, rows: dict[str, list[str]], axes: Any) -> None:
    colours = {TWO_SLIPS: MUTED, WOLF: ORANGE, ONE_SLIP: BLUE, OTHER: "0.8"}
    for i, (_, names) in enumerate(rows.items()):
        for name, colour in colours.items():
            here = plane.x[[x == name for x in names]]
            axes.plot(here, np.full(len(here), i), "s", ms=5, color=colour, label=name if i else None)
    axes.set_yticks([0, 1], list(rows))
    axes.set(xlabel="bow force", ylim=(-0.6, 1.9))
    axes.legend(loc="upper right", ncols=4)


@claim(
    "wolf-beat",
    "the beat of the wolf grows with bow force: by about 3/2 on doubling it, without a step back",
    "McIntyre, Schumacher, Woodhouse 1983, Fig 14; numbers: trial",
    "secondary",
    "10.6, 11.0, 12.0, 13.5, 16.5 periods at f = 2.0, 2.4, 2.9, 3.4, 4.0",
    "0.5 periods, rising throughout; 1.5 +- 0.1 on doubling, for “about 3/2”",
    "wolf",
)
def _wolf_beat(maps: Maps) -> Finding:
    found = beats(maps["wolf"], 1, list(BEATS))
    periods = [period for period, _ in found]
    plane = maps["wolf"]
    published = plane.beat[-1, 1] if plane.beat is not None else np.full(plane.x.shape, np.nan)
    by_verdict = [float(published[int(np.argmin(np.abs(plane.x - f)))]) for f in BEATS]
    points = (
        *(Point.about(f"beat at {f:g}", period, BEATS[f], 0.5) for f, period in zip(BEATS, periods, strict=True)),
        Point.true("rising", bool(np.all(np.diff(periods) > 0))),
        Point.about("on doubling the force", periods[-1] / periods[0], 1.5, 0.1),
    )
    words = f"{', '.join(f'{period:.1f}' for period in periods)} periods; {periods[-1] / periods[0]:.2f} on doubling; "
    words += f"verdicts say {', '.join(f'{period:.1f}' for period in by_verdict)}"
    return Finding(words, points, partial(_draw_beat, list(BEATS.items()), list(zip(BEATS, periods, strict=True))))


def _draw_beat(wanted: list[tuple[float, float]], found: list[tuple[float, float]], axes: Any) -> None:
    axes.plot(*zip(*wanted, strict=True), "o", color=ORANGE, ms=9, label="trial")
    axes.plot(*zip(*found, strict=True), ".-", color=BLUE, label="ours")
    axes.set(xlabel="bow force", ylabel="beat, periods", ylim=(0, None))
    axes.legend(loc="lower right")


@claim(
    "wolf-q50",
    "the same at kappa 0.01, Q 50",
    "PHYSICS.md 11",
    "trial",
    "wolf from about 1.4 to 3.3, beat from 14.4 to 22.5 periods",
    "limits of the longest run of wolves within 0.2; beats within a tenth, for “about”",
    "wolf_q50",
)
def _wolf_q50(maps: Maps) -> Finding:
    plane = maps["wolf_q50"]
    names = slips_a_period(plane, 1)
    wolves = _longest(plane.x, names)
    if not len(wolves):
        return Finding("no wolf", (Point.true("wolf", False),), partial(rows_of_regimes, plane=plane, names=("", "")))
    ends = [float(wolves.min()), float(wolves.max())]
    found = beats(plane, 1, wolves.tolist())
    first, last = found[0][0], found[-1][0]
    points = (
        Point.about("from f", ends[0], 1.4, 0.2),
        Point.about("to f", ends[1], 3.3, 0.2),
        Point.about("beat there", first, 14.4, 1.44),
        Point.about("beat at the end", last, 22.5, 2.25),
    )
    words = f"wolf from {ends[0]:.1f} to {ends[1]:.1f}, beat from {first:.1f} to {last:.1f} periods"
    measured = list(zip(wolves.tolist(), [period for period, _ in found], strict=True))
    return Finding(words, points, partial(_draw_beat, [(1.4, 14.4), (3.3, 22.5)], measured))


@claim(
    "mode-at-f0",
    "the paper's string, stiff, v_mid 0.2, with a mode of kappa 0.003 at its own frequency, constant force from rest",
    "PHYSICS.md 11",
    "trial",
    "double or triple slip up to f = 5, Helmholtz from 6.6; without the mode from about 2",
    "no Helmholtz motion up to 5; the limit within a quarter of 6.6 and, without the mode, a third of 2",
    "mode_at_f_0",
)
def _mode_at_f_0(maps: Maps) -> Finding:
    plane = maps["mode_at_f_0"]
    success = is_helmholtz(plane.regime)
    limits = [lower_limit(plane.x, row) for row in success]
    low = float(success[1][plane.x <= 5.0].mean())
    points = (
        Point("share of Helmholtz motion up to 5", low, 0, 0),
        Point.about("limit with the mode", limits[1], 6.6, 6.6 / 4),
        Point.about("limit without", limits[0], 2.0, 2.0 / 3),
    )
    words = f"Helmholtz from {limits[1]:.2f}, without the mode from {limits[0]:.2f}; {100 * low:.0f} % up to 5"

    def draw(axes: Any) -> None:
        rows_of_regimes(axes, plane, ("without", "with the mode"))
        axes.set(xscale="log", xlabel="bow force")
        axes.legend(loc="upper left", ncols=2)

    return Finding(words, points, draw)


# Sustained: the force sinks to its final value, so that the motion has begun as Helmholtz motion

LEAST = {0.8: 0.59, 0.9: 2.3, 1.05: 4.3, 1.1: 2.3, 1.25: 1.1}
"""Mode over string frequency -> least force of sustained Helmholtz motion, of the trial."""

FACTOR = 2.2
"""Between the formula and what is found."""


def _with_mode(ratio: float) -> Parameters:
    return Parameters.from_mapping({"v_mid": 0.2, "body_modes": f"{PAPER_F_0 * ratio!r}/30/k0.01"})


@claim(
    "least-force",
    "least force of sustained Helmholtz motion with a mode of kappa 0.01, Q 30 near the note",
    "PHYSICS.md 11; formula: Woodhouse 1993",
    "trial",
    "0.59, 2.3, 4.3, 2.3, 1.1 with the mode at 0.8, 0.9, 1.05, 1.1, 1.25 f_0; at f_0 none below 6",
    "within a factor of 2.2 of Schelleng's minimum with the admittance of the bridge; force sinking from 8, tau_f 2500",
    "least_force",
)
def _least_force(maps: Maps) -> Finding:
    plane = maps["least_force"]
    rows, forces = is_helmholtz(plane.regime), plane.x
    found, formula = {}, {}
    for ratio in (*LEAST, 1.0):
        p = _with_mode(ratio)
        row = rows[int(np.argmin(np.abs(plane.y - ratio)))]
        found[ratio], formula[ratio] = lower_limit(forces, row), least_force(p)
        if ratio == 1.0:
            below = float(row[forces < 6.0].sum())
    points = (
        *(Point.within_factor(f"at {ratio:g} f_0", found[ratio], formula[ratio], FACTOR) for ratio in LEAST),
        Point("cells at f_0 below 6", below, 0, 0),
    )
    words = (
        f"{', '.join(f'{found[ratio]:.2f}' for ratio in LEAST)} for F_min "
        f"{', '.join(f'{formula[ratio]:.2f}' for ratio in LEAST)}; at f_0 {below:.0f} cells below 6 "
        f"(F_min {formula[1.0]:.1f}, F_max {greatest_force(p):.1f})"
    )
    return Finding(words, points, partial(_draw_least, found))


def _draw_least(found: dict[float, float], axes: Any) -> None:
    ratios = np.linspace(0.75, 1.3, 221)
    curve = []
    for ratio in ratios.tolist():
        p = _with_mode(ratio)
        curve.append(least_force(p))
    axes.semilogy(ratios, curve, color=MUTED, label="formula")
    axes.plot(list(LEAST), list(LEAST.values()), "o", color=ORANGE, ms=8, label="trial")
    here = [ratio for ratio in found if ratio in LEAST]
    axes.plot(here, [found[ratio] for ratio in here], ".", color=BLUE, ms=9, label="ours")
    axes.axhline(greatest_force(p), color=GREEN, lw=0.8, ls="--", label="F_max")
    axes.set(xlabel="frequency of the mode / f_0", ylabel="least force")
    axes.legend(loc="upper right")
