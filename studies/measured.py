"""How well `bow classify` judges bridge force alone; run it with `python -m studies.measured`.

Cells of four maps, one of them in SI units, are drawn at random, computed, resampled to the rate of a recording, turned
upside down, scaled, and given noise and a wrong pitch. They are judged without the stream of stick and slip, and held
against the verdicts of the map at every test. The numbers go into docs/desk.md (between two marks; the text around them
stays).
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import resample_poly

from bow.recordings import classify
from bow_classifier.verdict.regimes import HELMHOLTZ, REGIMES, is_helmholtz
from bow_sweep.cell.computed import compute, judged
from bow_sweep.maps.plane import regime_label
from bow_sweep.plan.sweep import Sweep
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent
PRESETS = ("fig11d", "fig11c", "schelleng", "schelleng_cello")
"""The last is a plane of bow position and newtons: a cello string with thermal friction."""

GRID = ("x.count=32", "y.count=16")
GAIN, OFFSET = -3e-3, 0.7
"""A sensor with the other polarity, and a constant voltage."""


@dataclass(frozen=True)
class Condition:
    """How a recording is made: sample rate in Hz, signal to noise in dB, by how much f0 and beta may be wrong."""

    name: str
    rate: float = 44100
    noise: float | None = None
    f0: float = 0.0
    beta: float = 0.0


CONDITIONS = (
    Condition("44.1 kHz, f0 and beta known"),
    Condition("48 kHz, f0 and beta known", rate=48000),
    Condition("44.1 kHz, f0 within 3 %", f0=0.03),
    Condition("the same, 40 dB of noise", noise=40, f0=0.03),
    Condition("the same, 20 dB of noise", noise=20, f0=0.03),
    Condition("f0 within 3 %, beta within 5 %", f0=0.03, beta=0.05),
    Condition("f0 within 3 %, beta within 20 %", f0=0.03, beta=0.2),
)
BY_REGIME = CONDITIONS[2]


@dataclass(frozen=True, eq=False)
class Truth:
    """A cell: its force, and the regime of the map at each test."""

    force: NDArray[np.float64]
    rate: float
    f0: float
    beta: float
    regime: NDArray[np.uint8]


def truths(preset: str, cells: int, seed: int) -> list[Truth]:
    """Return cells of a map, drawn at random."""
    sweep = Sweep.from_spec(preset, GRID)
    drawn = np.sort(np.random.default_rng(seed).choice(sweep.cells, cells, replace=False))

    def one(cell: int) -> Truth:
        wave, (tests, _) = compute(sweep, cell), judged(sweep, cell)
        own = {name: float(values[0]) for name, values in sweep.lanes(np.array([cell])).items()}
        p = sweep.parameters.replace(**own)
        return Truth(
            np.asarray(wave.bridge_force, float), p.sample_rate, p.sample_rate / p.period, p.beta, tests.regime
        )

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        return list(pool.map(one, drawn.tolist()))


def heard(truth: Truth, condition: Condition, seed: int) -> NDArray[np.uint8]:
    """Return the regimes that are found in a recording of a cell, one for each test of the map."""
    chance = np.random.default_rng(seed)
    share = Fraction(condition.rate / truth.rate).limit_denominator(1000)
    wave = resample_poly(truth.force - truth.force.mean(), share.numerator, share.denominator, padtype="line")
    if condition.noise is not None:
        wave = wave + chance.normal(size=len(wave)) * np.std(wave) * 10 ** (-condition.noise / 20)
    f0 = truth.f0 * (1 + condition.f0 * chance.uniform(-1, 1))
    beta = float(np.clip(truth.beta * (1 + condition.beta * chance.uniform(-1, 1)), 0.02, 0.35))
    found = classify(GAIN * wave + OFFSET, condition.rate, f0, beta=beta, f0_within=0.03 if condition.f0 else 0.0)
    tests = len(truth.regime)
    return np.pad(found.tests.regime, (0, tests), "edge")[:tests]  # a shorter period ends before the last test


def plain(regime: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return regimes with the two kinds of Helmholtz motion as one."""
    return np.where(is_helmholtz(regime), HELMHOLTZ, regime)


def agreement(found: NDArray[np.uint8], truth: NDArray[np.uint8]) -> tuple[float, float]:
    """Return the shares of the tests with the same answer to Helmholtz or not, and with the same regime."""
    return float(np.mean(is_helmholtz(found) == is_helmholtz(truth))), float(np.mean(plain(found) == plain(truth)))


def confusion(found: NDArray[np.uint8], truth: NDArray[np.uint8]) -> list[str]:
    """Return the rows of a table: for each regime of the map, what is found instead."""
    lines = ["| regime of the map | tests | found | most often instead |", "|---|---|---|---|"]
    for code, name in enumerate(REGIMES):
        there = found[truth == code]
        if not there.size or (is_helmholtz(code) and code != HELMHOLTZ):
            continue
        shares = np.bincount(there, minlength=len(REGIMES)) / there.size
        others = [other for other in np.argsort(-shares) if other != code and shares[other] >= 0.03][:2]
        instead = ", ".join(f"{regime_label(REGIMES[other])} {shares[other]:.0%}" for other in others)
        lines.append(f"| {regime_label(name)} | {there.size} | {shares[code]:.0%} | {instead} |")
    return lines


def page(results: dict[str, dict[str, tuple[float, float]]], rows: Sequence[str], cells: int) -> str:
    """Return the part of the page: the table of conditions, and that of regimes."""
    lines = [f"| recording, {cells} cells of each map | {' | '.join(PRESETS)} |", f"|---|{'---|' * len(PRESETS)}"]
    for condition in CONDITIONS:
        shares = [results[preset][condition.name] for preset in PRESETS]
        lines.append(f"| {condition.name} | {' | '.join(f'{one:.1%}, {all_:.1%}' for one, all_ in shares)} |")
    return "\n".join([*lines, "", f"By regime, {BY_REGIME.name}, all maps:", "", *rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=128, help="of each map (default 128)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "desk.md", help="page to write into")
    args = parser.parse_args()
    results: dict[str, dict[str, tuple[float, float]]] = {}
    found_all, truth_all = [], []
    for preset in PRESETS:
        cells = truths(preset, args.cells, seed=1)
        truth = np.concatenate([cell.regime for cell in cells])
        results[preset] = {}
        for condition in CONDITIONS:
            found = np.concatenate([heard(cell, condition, seed) for seed, cell in enumerate(cells)])
            results[preset][condition.name] = agreement(found, truth)
            print(f"{preset}, {condition.name}: {results[preset][condition.name]}", flush=True)
            if condition is BY_REGIME:
                found_all.append(plain(found))
                truth_all.append(plain(truth))
    rows = confusion(np.concatenate(found_all), np.concatenate(truth_all))
    put(page(results, rows, args.cells), args.out, "studies/measured.py")
    print(f"wrote {args.out}")


if __name__ == "__main__":
    main()
