"""The page of the verdicts, docs/verdicts.md, and its picture: what :mod:`studies.verdicts` measured, in tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_classifier.verdict.regimes import DEFINITIONS, REGIMES
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.figures.page import METADATA, style
from tools.doc_page import put

EDGES = np.array([0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0 + 1e-9])
"""Bins of the confidence: finer where most of it lies."""

SHORT = {
    "no_oscillation": "none",
    "helmholtz": "Helmh.",
    "multiple_slip": "slips",
    "multiple_flyback": "flyback",
    "other_periodic": "other",
    "aperiodic": "aper.",
    "helmholtz_extra_slips": "H. extra",
    "raman_higher": "Raman",
    "anomalous_low_frequency": "ALF",
    "subharmonic": "subh.",
}


def wilson(right: float, of: float, z: float = 1.96) -> tuple[float, float]:
    """Return the 95 % interval of a share (Wilson 1927)."""
    if not of:
        return 0.0, 1.0
    share, room = right / of, z * z / of
    middle = (share + room / 2) / (1 + room)
    half = z / (1 + room) * np.sqrt(share * (1 - share) / of + room / (4 * of))
    return float(middle - half), float(middle + half)


def percent(right: float, of: float) -> str:
    """Return a share and its interval."""
    low, high = wilson(right, of)
    return f"{100 * right / max(of, 1):.0f} % ({100 * max(low, 0):.0f} ... {100 * high:.0f})"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table of Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    return lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows]


def confusion(found: Any) -> list[str]:
    """Return the table of what is what (rows) and what it is called (columns)."""
    seen = [name for name in REGIMES if name in found.truth]
    called = [name for name in REGIMES if name in found.regime or name in found.truth]
    truth, regime = np.array(found.truth), np.array(found.regime)
    rows = []
    for name in seen:
        mine = truth == name
        cells = [int(np.sum(regime[mine] == other)) for other in called]
        shown = [f"**{n}**" if other == name else str(n or "") for n, other in zip(cells, called, strict=True)]
        asked = mine & found.right & (found.number >= 0)
        numbers = f"{int(np.sum(found.number[asked] == found.counted[asked]))} of {int(asked.sum())}"
        recall = percent(cells[called.index(name)], mine.sum())
        named = int(np.sum(regime == name))
        precise = percent(cells[called.index(name)], named) if named else ""
        rows.append([name, *shown, recall, precise, numbers if asked.any() else ""])
    head = ["is / is called", *(SHORT[name] for name in called), "found", "right when so called", "count right"]
    return table(head, rows)


def accuracy(found: Any) -> str:
    """Return the share of right names in words."""
    n, right = len(found.truth), int(found.right.sum())
    h = np.char.startswith(np.array(found.truth), "helmholtz") == np.char.startswith(
        np.array(found.regime), "helmholtz"
    )
    return (
        f"{right} of {n} named rightly, {percent(right, n)}; Helmholtz motion or not, {int(h.sum())} of {n}, "
        f"{percent(int(h.sum()), n)}"
    )


def bins(found: Any) -> list[tuple[float, int, int]]:
    """Return mean confidence, right verdicts and verdicts of each bin."""
    place = np.digitize(found.confidence, EDGES) - 1
    result = []
    for k in range(len(EDGES) - 1):
        mine = place == k
        if mine.any():
            result.append((float(found.confidence[mine].mean()), int(found.right[mine].sum()), int(mine.sum())))
    return result


def calibration_error(found: Any) -> float:
    """Return the expected calibration error: mean distance of confidence and share of right ones, by weight of bins."""
    return sum(abs(mean - right / n) * n for mean, right, n in bins(found)) / len(found.truth)


def draw_reliability(drawn: Any, held: Any, path: Path) -> None:
    """Draw the share of right names against the confidence: generated records, and the held-out cells beside them."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    with style():
        figure, axes = pyplot.subplots(1, 2, figsize=(9.6, 4.6), sharey=True, layout="constrained")
        for ax, found, name in zip(axes, (drawn, held), ("generated records", "held-out cells, by eye"), strict=True):
            ax.plot([0, 1], [0, 1], color="0.6", linewidth=1, zorder=0)
            for mean, right, n in bins(found):
                low, high = wilson(right, n)
                ax.plot([mean, mean], [low, high], color="#0072b2", linewidth=1.6)
                ax.plot(mean, right / n, "o", color="#0072b2", markersize=5)
                above = mean < 0.75
                ax.annotate(
                    f"{n}", (mean, high if above else low), xytext=(0, 3 if above else -10),
                    textcoords="offset points", fontsize=7, color="0.35", ha="center",
                )  # fmt: skip
            ax.set(xlim=(-0.02, 1.03), ylim=(-0.06, 1.03), xlabel="confidence", aspect="equal")
            error = f"mean error {calibration_error(found):.3f}"
            ax.set_title(f"{len(found.truth)} {name}: {error}", fontsize=9, loc="left")
        axes[0].set_ylabel("share named rightly, with 95 % interval")
        figure.savefig(path, dpi=150, metadata=METADATA[".png"])
        pyplot.close(figure)


def definitions() -> list[str]:
    """Return the table of regimes."""
    return table(
        ("code", "regime", "definition", "source"),
        [(code, one.name, one.means, one.source) for code, one in enumerate(DEFINITIONS)],
    )


def thresholds() -> list[str]:
    """Return the table of thresholds."""
    return table(
        ("classifier.", "value", "unit", "why"),
        [
            (field.name, getattr(Thresholds(), field.name), field.metadata["unit"], field.metadata["doc"])
            for field in dataclasses.fields(Thresholds)
        ],
    )


def costs(moves: Any) -> list[str]:
    """Return the table of CPU times."""
    rows = [
        (name, f"{sim:.2f}", f"{judged:.2f}", f"{judged / sim:.2f}") for name, (sim, judged) in moves["costs"].items()
    ]
    total = [sum(pair[k] for pair in moves["costs"].values()) for k in (0, 1)]
    rows.append(("all six", f"{total[0]:.2f}", f"{total[1]:.2f}", f"**{total[1] / total[0]:.2f}**"))
    return table(("map", "simulating, s", "judging, s", "ratio"), rows)


def fractions(moves: Any) -> list[str]:
    """Return the table of regimes of the six maps at their last test, and how far a threshold's tenth moves each."""
    usual = moves["maps"]["as tuned"]
    rows: list[Sequence[object]] = []

    def entry(shares: NDArray[np.float64]) -> str:
        return f"{100 * shares[0]:.1f} ({100 * shares.min():.1f} ... {100 * shares.max():.1f})"

    ever = {k: np.array([maps[k].helmholtz_fraction() for maps in moves["maps"].values()]) for k in usual}
    rows.append(["Helmholtz motion ever came", *(entry(ever[k]) for k in usual)])
    for code, name in enumerate(REGIMES):
        shares = {k: np.array([np.mean(maps[k].regime == code) for maps in moves["maps"].values()]) for k in usual}
        rows.append([name, *(entry(shares[k]) for k in usual)])
    return table(["% of the plane", *(f"({k})" for k in usual)], rows)


def claims(moves: Any) -> tuple[list[str], list[str]]:
    """Return the table of the paper's statements and what a threshold's tenth does to them; and all changes."""
    usual = moves["claims"]["as tuned"]
    rows, changes = [], []
    for claim, row in usual.items():
        others = {name: found[claim] for name, found in moves["claims"].items() if found[claim].verdict != row.verdict}
        rows.append((claim, row.verdict, row.measured, ", ".join(others) or "no change"))
        changes += [f"{claim}: {name}: {one.verdict}, {one.measured}" for name, one in others.items()]
    return table(("statement", "verdict", "measured", "other verdict with"), rows), changes


def write(path: Path, tuned: Any, held: Any, drawn: Any, moves: Any, machine: str) -> None:
    """Write the part of the page that is measured."""
    rows, changes = claims(moves)
    reliability = [(f"{mean:.3f}", f"{right} of {n}", percent(right, n)) for mean, right, n in bins(drawn)]
    real = [(f"{mean:.3f}", f"{right} of {n}", percent(right, n)) for mean, right, n in bins(held)]
    head = ("mean confidence", "named rightly", "share, 95 % interval")
    lines = [
        f"Measured in one run: {machine}.",
        "", "## The regimes", "", *definitions(),
        "", "## The thresholds", "", *thresholds(),
        "", "## Cells labelled by eye", "",
        "**Held out**, not used for any decision: " + accuracy(held) + ".", "", *confusion(held),
        "", "The half that the thresholds were tuned on, for comparison: " + accuracy(tuned) + ".",
        "", *confusion(tuned),
        "", "## Generated records", "",
        f"{len(drawn.truth)} records, as many of each regime: " + accuracy(drawn) + ".", "", *confusion(drawn),
        "", "## Confidence", "", "![reliability](reliability.png)", "",
        f"Generated records (mean calibration error {calibration_error(drawn):.3f}):", "", *table(head, reliability),
        "", f"Held-out cells (mean calibration error {calibration_error(held):.3f}):", "", *table(head, real),
        "", "## Cost", "", "CPU seconds of a whole map in one process, the least of five.", "", *costs(moves),
        "", "## Thresholds moved by a tenth", "",
        "Each threshold alone, both ways (of the correlation, what is missing to 1). First the value as tuned, in "
        "brackets the least and the most of all.", "", *fractions(moves), "", *rows,
    ]  # fmt: skip
    if changes:
        lines += ["", *(f"- {change}" for change in changes)]
    put("\n".join(lines), path, "studies/verdicts.py")
