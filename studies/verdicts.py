"""How good the verdicts are: `python -m studies.verdicts` measures it, for docs/verdicts.md and docs/reliability.png.

Against records of known truth (tests/classifier/generator.py) and against simulated cells labelled by eye
(tests/data/labels.csv), of which one half was for tuning; the other is only counted here. `--fit` fits the coefficients
of the confidence to other records of the generator, writes them into
bow_classifier/verdict/confidence.py, and does no more.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.block_classifier import BlockClassifier, Geometry
from bow_classifier.verdict.confidence import COEFFICIENTS, MARGINS
from bow_classifier.verdict.decision import history
from bow_classifier.verdict.regimes import REGIMES, count, is_helmholtz
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.block import Block
from bow_sweep.maps.in_process import compute, intervals_of
from bow_sweep.maps.map_file import MapFile
from bow_sweep.paper.claims_maps import CLAIMS
from bow_sweep.plan.sweep import Sweep
from studies import verdicts_page as pages

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "tests" / "support"))  # the generator is a test's, and measured with here

LABELS = ROOT / "tests" / "data" / "labels.csv"
MAPS = tuple(f"fig11{letter}" for letter in "abcdef")
FIT, TESTED = 4500, 2700
"""Generated records to fit the confidence to, and others to report it on."""
SEEDS = {"fit": 20261122, "tested": 19951122}
REPEATS = 5
"""Times each cost is measured; the least counts, as others use the machine too."""
RIDGE = 2.0
"""Weight of the squared coefficients beside the likelihood of some 500 verdicts a regime."""
MOVED = (
    "correlation",
    "slip",
    "corner",
    "silence",
    "cluster",
    "flyback_cluster",
    "s_motion",
    "flyback_ripple",
    "anomaly",
)
"""Thresholds moved by a tenth, both ways; the lags are limits of a search."""


class Found(NamedTuple):
    """Verdicts on cells of known truth; arrays and lists of the same length.

    Attributes
    ----------
    truth, regime
        Names: what they are, and what they are called.
    number, counted
        The number that belongs to the name: true (-1 = not known) and found.
    confidence, margins
        (cells,) and (cells, margins).
    """

    truth: list[str]
    regime: list[str]
    number: NDArray[np.int64]
    counted: NDArray[np.int64]
    confidence: NDArray[np.float64]
    margins: NDArray[np.float64]

    @property
    def right(self) -> NDArray[np.bool_]:
        return np.array(self.truth) == np.array(self.regime)


def generated(number: int, seed: int, thresholds: Thresholds | None = None) -> Found:
    """Judge records of the generator."""
    from generator import mixture
    from kinematics import GEOMETRY, chunks

    records = list(mixture(number, seed))
    parts = []
    for start in range(0, number, 150):
        part = records[start : start + 150]
        classifier = BlockClassifier(GEOMETRY, thresholds or Thresholds(), len(part))
        for chunk in chunks([one.record for one in part]):
            classifier.classify(*chunk)
        parts.append(_found([one.regime for one in part], [one.count or -1 for one in part], classifier, GEOMETRY))
    return _joined(parts)


def labelled(half: str, thresholds: Thresholds | None = None) -> Found:
    """Simulate and judge the cells labelled by eye of one half, "tune" or "held_out"."""
    with open(LABELS, newline="") as file:
        rows = [row for row in csv.DictReader(line for line in file if line[0] != "#") if row["half"] == half]
    parts = []
    for name in MAPS:
        mine = [row for row in rows if row["map"] == name]
        sweep = Sweep.from_spec(name)
        cells = np.array([int(row["cell"]) for row in mine], np.uint32)
        block, geometry = Block(sweep.parameters, sweep.lanes(cells)), Geometry.of(sweep.parameters)
        classifier = BlockClassifier(geometry, thresholds or Thresholds(), len(cells))
        for _ in range(sweep.chunks):
            chunk = block.advance()
            classifier.classify(chunk.bridge_force, intervals_of(chunk))
        parts.append(
            _found([row["label"] for row in mine], [int(row["count"] or -1) for row in mine], classifier, geometry)
        )
    return _joined(parts)


def _found(truth: list[str], number: Sequence[int], classifier: BlockClassifier, geometry: Geometry) -> Found:
    features, decision = classifier.features, classifier.decision
    assert features is not None and decision is not None
    regime = decision.regime
    counted = count(regime, features.period, features.slips, features.corners, geometry.period, features.beta)
    names = [REGIMES[code] for code in regime]
    return Found(
        truth, names, np.array(number), counted.astype(int), decision.confidence.astype(float), decision.margins
    )


def _joined(parts: Sequence[Found]) -> Found:
    truth, regime = ([name for part in parts for name in part[k]] for k in (0, 1))
    number, counted, confidence, margins = (np.concatenate([part[k] for part in parts]) for k in range(2, 6))
    return Found(truth, regime, number, counted, confidence, margins)


# ---- the confidence


def fit(found: Found) -> NDArray[np.float64]:
    """Fit a logistic curve to the margins of each regime's verdicts; no margin counts against a verdict.

    A ridge keeps coefficients of what hardly varies near zero; one right and one wrong verdict are added to each
    regime, so that no confidence is 0 or 1.
    """
    from scipy.optimize import minimize

    rows = []
    for name in REGIMES:
        mine = np.array(found.regime) == name
        if name == "wolf":  # no generated record is that long; see `bow_classifier.verdict.confidence`
            rows.append(COEFFICIENTS[REGIMES.index(name)])
            continue
        x, y = found.margins[mine], found.right[mine].astype(float)
        middle = x.mean(axis=0, keepdims=True) if len(x) else np.ones((1, len(MARGINS)))
        x, y = np.concatenate([x, middle, middle]), np.concatenate([y, [1.0, 0.0]])

        def loss(w: NDArray[np.float64], x: Any = x, y: Any = y) -> tuple[float, NDArray[np.float64]]:
            z = x @ w
            p = 1 / (1 + np.exp(-z))
            slope = x.T @ (p - y) + RIDGE * np.append(0.0, w[1:])
            return float(np.sum(np.logaddexp(0, z) - y * z) + RIDGE / 2 * np.sum(w[1:] ** 2)), slope

        bounds = [(None, None)] + [(0.0, None)] * (len(MARGINS) - 1)
        rows.append(minimize(loss, np.zeros(len(MARGINS)), jac=True, bounds=bounds, method="L-BFGS-B").x)
    return np.round(rows, 3) + 0.0  # no -0.0


def write_coefficients(table: NDArray[np.float64], path: Path) -> None:
    """Put the coefficients into the module that applies them."""
    text = path.read_text()
    head, rest = text.split("COEFFICIENTS = np.array(\n    [\n", 1)
    rows = [
        f"        [{', '.join(f'{x}' for x in row)}],  # {name}\n" for row, name in zip(table, REGIMES, strict=True)
    ]
    path.write_text(head + "COEFFICIENTS = np.array(\n    [\n" + "".join(rows) + rest[rest.index("    ]\n)") :])


# ---- what the thresholds move


def cost(name: str) -> tuple[float, float]:
    """Return the CPU seconds of simulating a map and of judging it, block by block as in a sweep."""
    sweep = Sweep.from_spec(name)
    simulated, judged = 0.0, 0.0
    for number in range(sweep.blocks):
        cells = sweep.block(number)
        block = Block(sweep.parameters, sweep.lanes(cells))
        classifier = BlockClassifier(Geometry.of(sweep.parameters), Thresholds(), len(cells))
        for _ in range(sweep.chunks):
            clock = time.process_time()
            chunk = block.advance()
            simulated += time.process_time() - clock
            slips = intervals_of(chunk)
            clock = time.process_time()
            classifier.classify(chunk.bridge_force, slips)
            judged += time.process_time() - clock
    return simulated, judged


def judge_map(name: str, sets: Sequence[Thresholds]) -> list[MapFile]:
    """Compute a map and judge it with each set of thresholds."""
    sweep = Sweep.from_spec(name)
    geometry = Geometry.of(sweep.parameters)
    regimes = np.empty((len(sets), sweep.chunks, sweep.cells), np.uint8)
    for number in range(sweep.blocks):
        cells = sweep.block(number)
        block = Block(sweep.parameters, sweep.lanes(cells))
        classifiers = [BlockClassifier(geometry, one, len(cells)) for one in sets]
        for test in range(sweep.chunks):
            chunk = block.advance()
            slips = intervals_of(chunk)
            for k, classifier in enumerate(classifiers):
                regimes[k, test, cells] = classifier.classify(chunk.bridge_force, slips).regime
    usual = MapFile.of(sweep, compute(sweep), "")
    maps = []
    for one in regimes:
        length = history(is_helmholtz(one))[0].reshape(usual.shape)
        maps.append(
            dataclasses.replace(
                usual,
                transient_periods=length,
                regime=one[-1].reshape(usual.shape),
                helmholtz=is_helmholtz(one).reshape(usual.helmholtz.shape),
            )
        )
    return maps


def moved() -> dict[str, Thresholds]:
    """Return the thresholds as they are, and with one of them moved by a tenth, by name."""
    usual = Thresholds()
    sets = {"as tuned": usual}
    for name in MOVED:
        for word, factor in (("- 10 %", 0.9), ("+ 10 %", 1.1)):
            value = getattr(usual, name)
            other = 1 - factor * (1 - value) if name == "correlation" else factor * value
            sets[f"1 - {name} {word}" if name == "correlation" else f"{name} {word}"] = dataclasses.replace(
                usual, **{name: other}
            )
    return sets


def robustness(say: Any) -> dict[str, Any]:
    """Judge all six maps with every set of thresholds; returns fractions, claims and CPU times."""
    sets = moved()
    maps: dict[str, dict[str, MapFile]] = {name: {} for name in sets}
    costs = {}
    for preset in MAPS:
        several = [cost(preset) for _ in range(REPEATS)]
        simulated, judged = costs[preset] = min(one[0] for one in several), min(one[1] for one in several)
        planes = judge_map(preset, list(sets.values()))
        for name, plane in zip(sets, planes, strict=True):
            maps[name][preset[-1]] = plane
        say(f"{preset}: simulated in {simulated:.2f} s of CPU, judged in {judged:.2f} s")
    claims = {name: {one.claim: one.judge(maps[name]) for one in CLAIMS.all} for name in sets}
    return {"sets": sets, "maps": maps, "costs": costs, "claims": claims}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fit", action="store_true", help="fit the confidence, write its coefficients, do no more")
    parser.add_argument("--tune", action="store_true", help="print the verdicts on the half for tuning, do no more")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of verdicts.md and reliability.png")
    args = parser.parse_args()
    if args.fit:
        table = fit(generated(FIT, SEEDS["fit"]))
        write_coefficients(table, ROOT / "bow_classifier" / "verdict" / "confidence.py")
        print(f"moved the largest coefficient by {np.abs(table - COEFFICIENTS).max():.2g}")
        return
    tuned = labelled("tune")
    if args.tune:
        print("\n".join(pages.confusion(tuned)))
        return
    began = time.monotonic()
    held, drawn = labelled("held_out"), generated(TESTED, SEEDS["tested"])
    pages.draw_reliability(drawn, held, args.out / "reliability.png")
    moves = robustness(lambda line: print(line, flush=True))
    machine = f"{platform.machine()}, Python {platform.python_version()}, {time.monotonic() - began:.0f} s"
    pages.write(args.out / "verdicts.md", tuned, held, drawn, moves, machine)
    print(f"wrote {args.out / 'verdicts.md'}")


if __name__ == "__main__":
    main()
