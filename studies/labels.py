"""Cells to be labelled by eye, drawn without their names; run it with `python -m studies.labels --out DIRECTORY`.

Chooses 32 cells of each map of Fig 11, simulates them, and draws pages of six in a shuffled order. Someone looks at the
pages and writes down what each cell does: a file with the columns `MARKS`. `--marks FILE` then joins the marks with the
cells and writes tests/data/labels.csv. Nothing here asks the classifier anything: what it is measured against must not
depend on it.
"""

from __future__ import annotations

import argparse
import csv
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.block import Block
from bow_sim.kernel.sources import program
from bow_sweep.plan.sweep import Sweep

ROOT = Path(__file__).resolve().parent.parent
LABELS = ROOT / "tests" / "data" / "labels.csv"
MAPS = ("fig11a", "fig11b", "fig11c", "fig11d", "fig11e", "fig11f")
SEED = 19951122
STRATA = (6, 4)  # columns and rows of the plane with a cell each
RARE = 8  # cells a map chosen because their waveforms are unlike all others
PER_PAGE = 6
SHOWN, CLOSE, TESTED = 12, 3, 5  # last nominal periods on a page, in its zoom, and that the label speaks of
MARKS = ("page", "row", "label", "count", "alternative", "sure", "note")
COLUMNS = ("map", "cell", "ix", "iy", "f_asym", "f_init_ratio", *MARKS, "half")
CODES = (
    "no_oscillation",
    "helmholtz",
    "helmholtz_extra_slips",
    "multiple_slip",
    "multiple_flyback",
    "raman_higher",
    "anomalous_low_frequency",
    "subharmonic",
    "aperiodic",
)


class Motion(NamedTuple):
    """What one cell did.

    Parameters
    ----------
    force : ndarray of float32, shape (samples,)
        Bridge force in units of v_b/beta: a Helmholtz sawtooth has height 1.
    slips : ndarray of float64, shape (slips, 3)
        Onset and end in samples, and integrated slip in parts of a whole Helmholtz slip.
    """

    force: NDArray[np.float32]
    slips: NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """Where a cell of a map is drawn; pages and rows count from 1."""

    page: int
    row: int
    map: str
    cell: int


def simulate(name: str, cells: NDArray[np.uint32]) -> list[Motion]:
    """Simulate `cells` of the map of preset `name`, as one block, to its end."""
    sweep = Sweep.from_spec(name)
    p = sweep.parameters
    block = Block(p, sweep.lanes(cells))
    force: list[NDArray[np.float32]] = []
    slips: list[list[list[float]]] = [[] for _ in cells]
    for chunk in range(p.chunks):
        result = block.advance()
        force.append(result.bridge_force)
        start = chunk * p.chunk_samples
        for i, mine in enumerate(slips):
            for k in range(result.offsets[i], result.offsets[i + 1]):
                onset, whole = float(start + result.onset[k]), float(result.slip[k] / p.period)
                if mine and mine[-1][1] == onset:  # goes on from the chunk before
                    mine[-1][1] += float(result.duration[k])
                    mine[-1][2] += whole
                else:
                    mine.append([onset, onset + float(result.duration[k]), whole])
    waves = np.concatenate(force, axis=1) * np.float32(p.bow_bridge / p.period)
    return [Motion(wave, np.array(mine).reshape(-1, 3)) for wave, mine in zip(waves, slips, strict=True)]


# ---- which cells


def choose(name: str) -> NDArray[np.uint32]:
    """Choose the cells of a map, sorted, shape (32,): one at random in each stratum, and the `RARE` ones."""
    sweep = Sweep.from_spec(name)
    random = np.random.default_rng([SEED, MAPS.index(name)])
    columns = np.linspace(0, sweep.x.count, STRATA[0] + 1).astype(int)
    rows = np.linspace(0, sweep.y.count, STRATA[1] + 1).astype(int)
    spread = [
        int(random.integers(bottom, top)) * sweep.x.count + int(random.integers(left, right))
        for bottom, top in itertools.pairwise(rows)
        for left, right in itertools.pairwise(columns)
    ]
    return np.array(sorted(spread + unlike(sweep, spread)), np.uint32)


def unlike(sweep: Sweep, known: Sequence[int]) -> list[int]:
    """Choose cells of a coarse grid, the farthest from `known` and each other by the spectra of their last periods."""
    grid = np.arange(sweep.cells).reshape(sweep.y.count, sweep.x.count)[1::2, 2::4].ravel()
    pool = np.array([*known, *np.setdiff1d(grid, known)], np.uint32)
    block = Block(sweep.parameters, sweep.lanes(pool))
    for _ in range(sweep.parameters.chunks):
        result = block.advance()
    period, beta = sweep.parameters.period, sweep.parameters.bow_bridge / sweep.parameters.period
    last = beta * result.bridge_force[:, -TESTED * period :].astype(float)
    spectra = np.abs(np.fft.rfft(last - last.mean(axis=1, keepdims=True), axis=1)) / (TESTED * period)
    features = np.sqrt(spectra[:, : 25 * TESTED])  # 25 harmonics; the root lets the weak ones count
    distance = np.min([np.linalg.norm(features - features[i], axis=1) for i in range(len(known))], axis=0)
    chosen: list[int] = []
    for _ in range(RARE):
        farthest = int(np.argmax(distance))
        chosen.append(int(pool[farthest]))
        distance = np.minimum(distance, np.linalg.norm(features - features[farthest], axis=1))
    return chosen


def places() -> list[Place]:
    """Say where each cell is drawn, the maps shuffled; the order is always the same."""
    everything = [(name, int(cell)) for name in MAPS for cell in choose(name)]
    order = np.random.default_rng(SEED).permutation(len(everything))
    return [Place(1 + k // PER_PAGE, 1 + k % PER_PAGE, *everything[i]) for k, i in enumerate(order)]


def motions(wanted: Iterable[Place]) -> dict[Place, Motion]:
    """Simulate the cells drawn at the places, each map as one block."""
    found: dict[Place, Motion] = {}
    wanted = list(wanted)
    for name in MAPS:
        here = [place for place in wanted if place.map == name]
        if here:
            found |= zip(here, simulate(name, np.array([p.cell for p in here], np.uint32)), strict=True)
    return found


# ---- pages


def draw(titled: Sequence[tuple[str, Motion]], period: int, path: Path, row_height: float) -> None:
    """Draw a page, a row a motion: all periods as a raster, the last twelve, the last three."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(20, row_height * len(titled)), dpi=100)
    grid = figure.add_gridspec(
        2 * len(titled), 3, width_ratios=(2.2, 12, 6.6), height_ratios=(5, 1) * len(titled),
        left=0.02, right=0.995, top=1 - 0.25 / (row_height * len(titled)), bottom=0.01, wspace=0.05, hspace=0.12,
    )  # fmt: skip
    for row, (title, motion) in enumerate(titled):
        whole = figure.add_subplot(grid[2 * row : 2 * row + 2, 0])
        wave = motion.force[: len(motion.force) // period * period].reshape(-1, period)
        whole.imshow(wave, aspect="auto", cmap="RdBu", vmin=-1, vmax=1, interpolation="nearest")
        whole.set(xticks=[], yticks=[])
        tested = motion.force[-TESTED * period :]
        span = f"{title}: span of the last {TESTED} periods {np.ptp(tested):.3f}"
        whole.text(0, -0.02, span, transform=whole.transAxes, fontsize=8, va="top")
        for column, periods in ((1, SHOWN), (2, CLOSE)):
            top, strip = (figure.add_subplot(grid[2 * row + k, column]) for k in (0, 1))
            _wave(top, motion, period, periods)
            _strip(strip, motion, period, periods)
            if column == 1:
                top.set_title(title, fontsize=11, loc="left", pad=2)
    figure.savefig(path)
    pyplot.close(figure)


def _wave(axes: Any, motion: Motion, period: int, periods: int) -> None:
    samples = len(motion.force)
    shown = np.arange(samples - periods * period, samples)
    axes.plot(shown, motion.force[shown], color="black", linewidth=0.9)
    for k in range(periods + 1):
        axes.axvline(samples - k * period, color="tab:red" if k == TESTED else "tab:gray", linewidth=0.6)
    low, high = float(motion.force[shown].min()), float(motion.force[shown].max())
    middle, half = (low + high) / 2, max(0.6, 0.53 * (high - low))  # weak motion looks weak
    axes.set(xlim=(shown[0], samples), ylim=(middle - half, middle + half), xticks=[])
    axes.tick_params(labelsize=7, pad=1)
    axes.grid(axis="y", linewidth=0.3)


def _strip(axes: Any, motion: Motion, period: int, periods: int) -> None:
    """Draw slips: light for how long, dark as high as the fourth root of how far; a Helmholtz slip is 1 high."""
    samples = len(motion.force)
    onset, end, far = motion.slips.T
    axes.bar(onset, 1.2, end - onset, align="edge", color="moccasin")
    axes.bar(onset, np.minimum(1.2, far**0.25), end - onset, align="edge", color="saddlebrown")
    for level in (0.01, 0.1):
        axes.axhline(level**0.25, color="tab:gray", linewidth=0.3)
    for k in range(periods + 1):
        axes.axvline(samples - k * period, color="tab:gray", linewidth=0.6)
    axes.set(xlim=(samples - periods * period, samples), ylim=(0, 1.2), xticks=[], yticks=[])


# ---- the file of labels


def write(marks: Path, signed: str, path: Path) -> None:
    """Join marks with cells and write the file of labels, half of each map's cells of a label held out.

    Raises
    ------
    ValueError
        For a cell without a mark, a mark without a cell, or a label that is none of `CODES`.
    """
    with open(marks, newline="") as file:
        given = {(int(row["page"]), int(row["row"])): row for row in csv.DictReader(file)}
    drawn = {(place.page, place.row): place for place in places()}
    if given.keys() != drawn.keys():
        raise ValueError(f"{marks}: page and row without a mark or without a cell: {sorted(given.keys() ^ drawn)}")
    rows = []
    seen: dict[tuple[str, str], int] = {}
    for where, place in sorted(drawn.items(), key=lambda item: (item[1].map, item[1].cell)):
        mark = given[where]
        if mark["label"] not in CODES:
            raise ValueError(f"{marks}: page and row {where}: {mark['label']!r} should be one of {', '.join(CODES)}")
        sweep, cell = Sweep.from_spec(place.map), np.array([place.cell], np.uint32)
        force, ratio = (float(values[0]) for values in sweep.lanes(cell).values())
        iy, ix = divmod(place.cell, sweep.x.count)
        group = (place.map, mark["label"])
        half = ("tune", "held_out")[seen.setdefault(group, 0) % 2]
        seen[group] += 1
        rows.append(
            [place.map, place.cell, ix, iy, f"{force:.6g}", f"{ratio:.6g}", *(mark[name] for name in MARKS), half]
        )
    path.parent.mkdir(exist_ok=True)
    with open(path, "w", newline="") as file:
        file.writelines(f"# {line}\n".replace("# \n", "#\n") for line in signed.strip().splitlines())
        file.write(f"# kernel: {program()}\n")
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="directory of the pages")
    parser.add_argument("--large", nargs="*", metavar="PAGE.ROW", help="draw these cells only, large, three a page")
    parser.add_argument("--again", type=int, default=0, help="draw this many cells, shuffled anew, for a second look")
    parser.add_argument("--marks", type=Path, help="marks made by eye: write the file of labels")
    parser.add_argument("--signed", type=Path, help="text for the top of the file of labels: who, when, by which rules")
    args = parser.parse_args()
    if args.marks:
        write(args.marks, args.signed.read_text() if args.signed else "", LABELS)
    if not args.out:
        return
    args.out.mkdir(parents=True, exist_ok=True)
    drawn, kind, per_page, height = places(), "page", PER_PAGE, 2.85
    if args.large is not None:
        drawn = [place for place in drawn if f"{place.page}.{place.row}" in args.large]
        kind, per_page, height = "large", 3, 5.5
    elif args.again:
        order = np.random.default_rng(SEED + 1).permutation(len(drawn))[: args.again]
        drawn, kind = [drawn[i] for i in order], "again"
    found, period = motions(drawn), Sweep.from_spec(MAPS[0]).parameters.period
    for start in range(0, len(drawn), per_page):
        number = 1 + start // per_page
        here = drawn[start : start + per_page]
        titled = [
            (f"{number}.{k}" if kind == "again" else f"{place.page}.{place.row}", found[place])
            for k, place in enumerate(here, 1)
        ]
        draw(titled, period, args.out / f"{kind}{number:02}.png", height)


if __name__ == "__main__":
    main()
