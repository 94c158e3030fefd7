"""How little of a map must be simulated: `python -m studies.adaptive`, a minute and a half.

Computes the six maps of Fig 11 and other ones exhaustively, then plays adaptive sweeps over them, looking up what they
ask for instead of simulating it. Writes its part of docs/adaptive.md, and docs/adaptive.png.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bow_sim.figures.page import MUTED, style
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.figures.colours import transient_colours
from bow_sweep.figures.layout import Layout
from bow_sweep.maps.in_process import compute
from bow_sweep.paper.maps import LAYOUT
from bow_sweep.plan.adaptive import fill, next_round, within_budget
from bow_sweep.plan.sweep import Sweep
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent
PANELS = {f"({letter})": (f"fig11{letter}", ()) for letter in LAYOUT}
OTHERS: dict[str, tuple[str, tuple[str, ...]]] = {
    "Fig 10: as (d), 40 periods": ("fig10", ()),
    "delta, v_mid 0.7": ("fig11a", ("v_mid=0.7",)),
    "delta, v_mid 0.5": ("fig11c", ("v_mid=0.5",)),
    "stiff, v_mid 0.5": ("fig11d", ("v_mid=0.5",)),
    "stiff, v_mid -0.5": ("fig11f", ("v_mid=-0.5",)),
    "(a), 96 × 48 cells": ("fig11a", ("x.count=96", "y.count=48")),
    "(b), 96 × 48 cells": ("fig11b", ("x.count=96", "y.count=48")),
    "(d), 96 × 48 cells": ("fig11d", ("x.count=96", "y.count=48")),
    "(f), 96 × 48 cells": ("fig11f", ("x.count=96", "y.count=48")),
    "preset schelleng": ("schelleng", ()),
    "preset guettler": ("guettler", ()),
}
"""Maps that nothing was tuned on."""

FRACTIONS = (0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6)
CURVE = tuple(np.round(np.arange(0.05, 0.801, 0.025), 3).tolist())
SHOWN = ("(a)", "(f)", "(c)")
COLOURS = dict(zip(PANELS, ("#d55e00", "#e69f00", "#0072b2", "#56b4e9", "#009e73", "#66c2a5"), strict=True))
ENOUGH = 0.97


class Played(NamedTuple):
    """The end of an adaptive sweep. Shares are of all pixels but `guessed`, of those that were not simulated."""

    simulated: float
    rounds: int
    agree: float
    guessed: float
    within: float
    seen: np.ndarray


def score(truth: np.ndarray, seen: np.ndarray, rounds: int) -> Played:
    filled, known = fill(seen), ~np.isnan(seen)
    same = (filled > 0) == (truth > 0)
    near = same & (np.abs(filled - truth) <= CHUNK_PERIODS)
    guessed = float(same[~known].mean()) if not known.all() else 1.0
    return Played(float(known.mean()), rounds, float(same.mean()), guessed, float(near.mean()), seen)


def play(truth: np.ndarray, fraction: float) -> Played:
    """Sweep adaptively over a map, (ny, nx) periods, looking up what is asked for."""
    tried, seen, rounds = np.zeros(truth.shape, bool), np.full(truth.shape, np.nan, np.float32), 0
    budget = within_budget(fraction, truth.size)
    while len(cells := next_round(tried, seen, budget)):
        tried.ravel()[cells], seen.ravel()[cells] = True, truth.ravel()[cells]
        rounds += 1
    return score(truth, seen, rounds)


def by_chance(truth: np.ndarray, fraction: float) -> Played:
    """The same number of cells, anywhere, and the same prediction."""
    cells = np.random.default_rng(0).permutation(truth.size)[: within_budget(fraction, truth.size)]
    seen = np.full(truth.shape, np.nan, np.float32)
    seen.ravel()[cells] = truth.ravel()[cells]
    return score(truth, seen, 1)


def exhaustive(preset: str, settings: tuple[str, ...] = ()) -> np.ndarray:
    """Transient lengths of a whole map, (ny, nx) periods."""
    basin = compute(Sweep.from_spec(preset, settings))
    return basin.transient_periods.reshape(basin.ny, basin.nx)


# ---- the page


def number(share: float) -> str:
    return f"{np.floor(1000 * share + 1e-9) / 10:.1f}"  # down: 99.98 is not 100.0


def table(played: dict[str, dict[float, Played]], value: str) -> list[str]:
    lines = ["| map | " + " | ".join(f"{100 * f:.0f} %" for f in FRACTIONS) + " |", "|---" * (len(FRACTIONS) + 1) + "|"]
    for name, by_fraction in played.items():
        cells = []
        for fraction in FRACTIONS:
            p = by_fraction[fraction]
            stopped = f" ({100 * p.simulated:.0f} %)" if p.simulated < fraction - 0.01 else ""
            cells.append(number(getattr(p, value)) + stopped)
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def page(curves: dict[str, dict[float, Played]], others: dict[str, dict[float, Played]], seconds: float) -> str:
    lines = [
        f"Six maps of 128 × 64 cells and {len(others)} others, in {seconds:.0f} s "
        f"({platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}).",
        "",
        "## Half of the simulations",
        "",
        "| map | simulated | rounds | pixels that agree | of the predicted ones | and length within 5 periods "
        f"| as many cells by chance | {100 * ENOUGH:.0f} % agree from |",
        "|---" * 8 + "|",
    ]
    for name, curve in {**curves, **others}.items():
        half = curve[0.5]
        enough = next((f"{100 * p.simulated:.0f} %" for p in curve.values() if p.agree >= ENOUGH), "-")
        cells = (f"{number(half.simulated)} %", half.rounds, number(half.agree), number(half.guessed))
        rest = (number(half.within), number(curve[-1.0].agree), enough)
        lines.append(f"| {name} | {' | '.join(map(str, (*cells, *rest)))} |")
    lines += ["", "## Black or coloured as in the whole map, % of the pixels, by the share that may be simulated", ""]
    lines += table(curves, "agree")
    lines += ["", "## And coloured as in the whole map: the transient's length within 5 periods", ""]
    lines += table(curves, "within")
    return "\n".join(lines)


def draw(truths: dict[str, np.ndarray], curves: dict[str, dict[float, Played]], path: Path) -> None:
    """Three maps with what is simulated and what is made of it; below, agreement against simulations."""
    wide, high, across, down, left, top = 384, 192, 424, 246, 50, 50
    with style():
        layout = Layout(left + 3 * across, top + 3 * down + 540, 100)
        for row, name in enumerate(SHOWN):
            half, truth = curves[name][0.25], truths[name]
            titles = (
                f"{name} whole map, {truth.size} simulations",
                f"simulated: {100 * half.simulated:.0f} %",
                f"predicted from these: {100 * half.agree:.1f} % agree",
            )
            for column, (values, title) in enumerate(zip((truth, half.seen, fill(half.seen)), titles, strict=True)):
                place = (left + column * across, top + row * down)
                axes = layout.axes(*place, wide, high)
                colours = transient_colours(values, 100)
                axes.imshow(colours, origin="lower", aspect="auto", interpolation="nearest")
                axes.set(xticks=[], yticks=[])
                layout.text(place[0], place[1] - 10, title, fontsize=7)
        axes = layout.axes(left + 80, top + 3 * down + 20, 3 * across - 140, 440)
        for name, curve in curves.items():
            points = sorted((p.simulated, p.agree) for p in curve.values() if p is not curve[-1.0])
            axes.plot(*zip(*points, strict=True), color=COLOURS[name], label=name, lw=1.4)
            chance = [(f, by_chance(truths[name], f).agree) for f in CURVE]
            axes.plot(*zip(*chance, strict=True), color=COLOURS[name], lw=0.8, ls=":")
        axes.axhline(ENOUGH, color=MUTED, lw=0.6)
        axes.axvline(0.5, color=MUTED, lw=0.6)
        axes.set(xlim=(0, 0.8), ylim=(0.75, 1.002), xlabel="share of the cells that is simulated")
        axes.set_ylabel("share of the pixels that agree")
        axes.set_xticks(np.arange(0, 0.81, 0.1), [f"{p} %" for p in range(0, 81, 10)])
        axes.set_yticks(np.arange(0.75, 1.001, 0.05), [f"{p} %" for p in range(75, 101, 5)])
        axes.legend(title="Fig 11; dotted: by chance", title_fontsize=7, ncols=3, loc="lower right", frameon=False)
        layout.figure.savefig(path, dpi=140, metadata={"Software": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of adaptive.md and adaptive.png")
    out = parser.parse_args().out
    began = time.monotonic()
    truths = {name: exhaustive(*spec) for name, spec in {**PANELS, **OTHERS}.items()}
    played: dict[str, dict[float, Played]] = {}
    for name, truth in truths.items():
        played[name] = {f: play(truth, f) for f in sorted({*CURVE, *FRACTIONS})}
        played[name][-1.0] = by_chance(truth, played[name][0.5].simulated)
        half = played[name][0.5]
        print(f"{name}: {number(half.agree)} % with {number(half.simulated)} % of the simulations", flush=True)
    curves, others = ({name: played[name] for name in group} for group in (PANELS, OTHERS))
    put(page(curves, others, time.monotonic() - began), out / "adaptive.md", "studies/adaptive.py")
    draw(truths, curves, out / "adaptive.png")
    print(f"wrote {out / 'adaptive.md'} and adaptive.png")


if __name__ == "__main__":
    main()
