"""Terrain and playability of the six maps of Fig 11; run it with `python -m studies.terrain`.

Writes into docs/terrain.md (between two marks; the text around them stays), with its pictures: how often the terrain of
synthetic maps is found, how the paper's statements come out, what becomes of them when every threshold is moved by a
tenth, how the streaks run against Fig 12, and the playability of stiff and delta. `--data` writes tests/data/fig11.npz
instead, the maps that tests of terrain read.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from bow_sim.figures.control import CONTOURS
from bow_sim.figures.page import save, style
from bow_sim.kernel.sources import program
from bow_sim.physics.parameters import Parameters
from bow_sweep.figures.colours import transient_colours
from bow_sweep.figures.layout import Layout
from bow_sweep.figures.panel import paint
from bow_sweep.figures.terrain import comparison, terrain_figure
from bow_sweep.maps import playability as play
from bow_sweep.maps import terrain as ground
from bow_sweep.maps.compare import value_and_error
from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.streaks import Alignment, alignment, contour_directions, streaks
from bow_sweep.paper import claims_terrain
from bow_sweep.paper.claim import Maps
from bow_sweep.paper.maps import LAYOUT
from studies.terrain_maps import DATA, compute, write_data
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent
HELD_OUT = range(1000, 1040)
"""Seeds of synthetic maps that no limit was tuned on (those were 0 ... 23)."""

# ---- what is found


def confusion(shape: tuple[int, int]) -> np.ndarray:
    """Cells of the held-out synthetic maps: (truth, found)."""
    sys.path.insert(0, str(ROOT / "tests" / "support"))
    from terrains import example

    counts = np.zeros((len(ground.TERRAINS), len(ground.TERRAINS)), int)
    for seed in HELD_OUT:
        lengths, truth = example(seed, shape)
        np.add.at(counts, (truth.ravel(), ground.terrain(lengths).ravel()), 1)
    return counts


def verdicts(maps: Maps) -> dict[str, str]:
    """Claim -> verdict on a set of maps."""
    return {claim.key: claim.judge(maps).verdict for claim in claims_terrain.CLAIMS.all}


def moved_textures(maps: Maps) -> dict[str, dict[str, str]]:
    """Claims on the default maps when a scale or limit of terrain is moved: "name × by" -> claim -> verdict."""
    usual, found = ground.Texture(), {}
    claims: Any = claims_terrain  # its functions are exchanged
    original = claims.terrain, claims.playability, claims.alignment
    try:
        for entry in fields(usual):
            for by in (0.9, 1.1):
                texture = replace(usual, **{entry.name: getattr(usual, entry.name) * by})
                claims.terrain = lambda t, texture=texture: original[0](t, texture)
                claims.playability = lambda t, r, n, texture=texture: original[1](t, r, n, texture)
                claims.alignment = lambda t, lines, texture=texture: original[2](t, lines, texture)
                claims_terrain.codes_of.cache_clear()
                claims_terrain.playability_of.cache_clear()
                found[f"{entry.name} × {by:g}"] = verdicts(maps)
    finally:
        claims.terrain, claims.playability, claims.alignment = original
        claims_terrain.codes_of.cache_clear()
        claims_terrain.playability_of.cache_clear()
    return found


def best_time(plane: MapFile, error: float) -> tuple[float, float]:
    """Samples after the start when the contours of bow force have no mean difference from the streaks.

    With its uncertainty, half the time in which the difference goes from minus to plus its own error, in degrees.
    """
    times = np.arange(0, 801)
    found = ground.features(plane.transient_periods)
    chosen = streaks(found, ground.Texture())
    off = []
    for left in np.exp(-times / Parameters().tau_f):
        doubled = np.exp(2j * (found.direction - contour_directions(plane.x, plane.y, left))[chosen])
        off.append(np.degrees(np.angle(doubled.sum())) / 2)
    early, best, late = np.interp((-error, 0.0, error), off, times)  # contours turn steadily
    return float(best), float(late - early) / 2


def bias(plane: MapFile) -> tuple[float, float]:
    """Mean and standard deviation, degrees, of what the method finds for streaks that do run along Fig 12.

    Bands of initial force of six widths and four places, measured at the cells that are streaky in a map.
    """
    chosen = streaks(ground.features(plane.transient_periods), ground.Texture())
    lines, off = contour_directions(plane.x, plane.y), []
    for wide in (0.2, 0.25, 0.3, 0.35, 0.4, 0.5):
        for start in (0, 0.25, 0.5, 0.75):
            force = np.maximum(plane.x[None] * plane.y[:, None], 1e-3)
            bands = np.where((np.log(force) / wide + start) % 1 < 0.5, 40.0, 0.0)
            doubled = np.exp(2j * (ground.features(bands).direction - lines)[chosen])
            off.append(np.degrees(np.angle(doubled.sum())) / 2)
    return float(np.mean(off)), float(np.std(off))


# ---- the page


def row(*cells: object) -> str:
    return "| " + " | ".join(str(cell).replace("|", r"\|") for cell in cells) + " |"


def head(*cells: str) -> list[str]:
    return [row(*cells), "|---" * len(cells) + "|"]


def synthetic_part() -> list[str]:
    lines = []
    for shape in ((64, 128), (32, 64)):
        counts = confusion(shape)
        share = 100 * counts / counts.sum(axis=1, keepdims=True)
        right = 100 * np.trace(counts) / counts.sum()
        lines += [
            "",
            f"{shape[1]} × {shape[0]} cells: **{right:.1f} % of {counts.sum()} cells right**, "
            f"{len(HELD_OUT)} maps that no limit was tuned on. Down the truth, across what is found, % of the truth:",
            "",
            *head("", *ground.TERRAINS),
            *(
                row(name, *(f"{value:.1f}" for value in values))
                for name, values in zip(ground.TERRAINS, share, strict=True)
            ),
        ]
    return lines


def statement_part(found: Mapping[str, Mapping[str, MapFile]]) -> list[str]:
    lines = head("statement", "where", "asked", "ours", "verdict")
    for claim in claims_terrain.CLAIMS.all:
        judged_row = claim.judge(found["default"])
        lines.append(row(claim.claim, claim.where, claim.reason, judged_row.measured, f"**{judged_row.verdict}**"))
    return lines


def robust_part(found: Mapping[str, Mapping[str, MapFile]]) -> list[str]:
    usual = verdicts(found["default"])
    lines = head("moved", "cells whose terrain changes", "statements that change")
    for name, maps in found.items():
        if name == "default":
            continue
        if "shifted" in name:
            changed = "other cells"
        else:
            parts = [claims_terrain.codes_of(maps[k]) != claims_terrain.codes_of(found["default"][k]) for k in LAYOUT]
            changed = f"{100 * np.mean(parts):.1f} %"
        other = [key for key, verdict in verdicts(maps).items() if verdict != usual[key]]
        lines.append(row(name, changed, ", ".join(other) or "none"))
    textures = moved_textures(found["default"])
    moved = {name: [key for key in usual if result[key] != usual[key]] for name, result in textures.items()}
    worst = {name: keys for name, keys in moved.items() if keys}
    said = "; ".join(f"{name}: {', '.join(keys)}" for name, keys in worst.items()) or "none"
    lines.append(row(f"each of terrain's {len(textures) // 2} scales and limits × 0.9, × 1.1", "", said))
    return lines


def streak_part(maps: Mapping[str, MapFile]) -> list[str]:
    lines = head(
        "map", "streaky cells", "lines", "mean difference", "spread", "within 15°", "turned at random", "shuffled"
    )
    for k, plane in maps.items():
        for name, left in (("Fig 12", 1.0), ("vertical", 0.0)):
            a = alignment(plane.transient_periods, contour_directions(plane.x, plane.y, left))
            if a is not None and a.cells >= 100:
                lines.append(row(f"({k})", a.cells, name, *angles(a)))
    p = Parameters()
    best = []
    for k in "ce":
        first = alignment(maps[k].transient_periods, contour_directions(maps[k].x, maps[k].y))
        assert first is not None
        late, error = best_time(maps[k], first.error)
        a = alignment(maps[k].transient_periods, contour_directions(maps[k].x, maps[k].y, np.exp(-late / p.tau_f)))
        assert a is not None
        best.append(
            f"({k}) at {late:.0f} ± {error:.0f} samples, {late / p.period:.1f} periods: spread {a.spread:.1f}°, "
            f"{100 * a.close:.0f} % within 15°"
        )
    text = "The contours of bow force at a later time that have no mean difference from the streaks: "
    own = "; ".join(f"({k}) {mean:.1f}° ± {spread:.1f}°" for k, (mean, spread) in ((k, bias(maps[k])) for k in "ce"))
    method = f"Bands that do run along Fig 12, measured at the same cells, come out at {own}: the method's own error."
    return [*lines, "", text + "; ".join(best) + ".", "", method.replace("-", "−")]


def angles(a: Alignment) -> list[str]:
    turned = f"{100 * a.turned:.0f} % (p {'≤' if a.turned_p <= 0.001 else '='} {a.turned_p:.3f})"
    shuffled = f"{100 * a.shuffled:.0f} % (p {'≤' if a.shuffled_p <= 0.001 else '='} {a.shuffled_p:.3f})"
    return [
        f"{a.mean:.1f}° ± {a.error:.1f}°".replace("-", "−"),
        f"{a.spread:.1f}°",
        f"{100 * a.close:.0f} %",
        turned,
        shuffled,
    ]


def number(measure: play.Measure, value: float | None, error: float | None, signed: bool = False) -> str:
    return measure.text(value, error, signed).replace("-", "−")


def playability_part(found: Mapping[str, Mapping[str, MapFile]]) -> list[str]:
    every = {k: claims_terrain.playability_of(found["default"][k]) for k in LAYOUT}
    lines = head("measure", *(f"({k}) {LAYOUT[k][0].replace('_cremer', '')}, {LAYOUT[k][1]:g}" for k in LAYOUT))
    for measure in play.MEASURES:
        unit = f", {measure.unit}" if measure.unit else ""
        cells = [number(measure, *value_and_error(every[k], measure.name)) for k in LAYOUT]
        lines.append(row(measure.title + unit, *cells))
    lines += ["", "Stiff less delta; in brackets, how many errors that is:", ""]
    lines += head("measure", "v_mid 0.9", "0.2", "−2")
    for measure in play.MEASURES:
        cells = []
        for delta, stiff in claims_terrain.PAIRS:
            numbers = [value for k in (delta, stiff) for value in value_and_error(every[k], measure.name)]
            v1, e1, v2, e2 = (np.nan if value is None else value for value in numbers)
            error = float(np.hypot(e1, e2))
            times = f" ({abs(v2 - v1) / error:.0f})" if error else ""
            cells.append(number(measure, v2 - v1, error, signed=True) + times)
        lines.append(row(measure.title, *cells))
    jitter = [name for name in found if "shifted" in name] + ["default"]
    lines += ["", "Standard deviation over the grid as it is and shifted three ways, each a map computed anew:", ""]
    lines += head("measure", *(f"({k})" for k in LAYOUT))
    for measure in play.MEASURES:
        scale, digits = (100, 1) if measure.unit == "%" else (1, 3 if not measure.unit else 1)
        cells = []
        for k in LAYOUT:
            values = [claims_terrain.playability_of(found[name][k])[measure.name]["value"] for name in jitter]
            cells.append(f"{np.std(values, ddof=1) * scale:.{digits}f}")
        lines.append(row(measure.title, *cells))
    return lines


def draw(maps: Mapping[str, MapFile], out: Path) -> None:
    """The pictures of the page."""
    titles = {
        k: rf"({k})  {m.replace('_cremer', '')}/Cremer, $v_\mathrm{{mid}}$ = {v:g}".replace("-", "−")
        for k, (m, v) in LAYOUT.items()
    }
    panels = [(titles[k], maps[k], claims_terrain.codes_of(maps[k])) for k in LAYOUT]
    save(terrain_figure(panels), out / "terrain-fig11.png")
    pair = [panels[2], panels[3]]
    numbers = [claims_terrain.playability_of(maps[k]) for k in "cd"]
    save(comparison(pair, ["fig11c", "fig11d"], numbers), out / "terrain-compare.png")
    save(streak_figure(maps), out / "terrain-streaks.png")


def streak_figure(maps: Mapping[str, MapFile]) -> Figure:
    """(c) and (e) with the contours of Fig 12, and strokes along the streaks."""
    with style():
        layout = Layout(2 * 900 + 60, 520, 200)
        for number_, k in enumerate("ce"):
            plane = maps[k]
            ny, nx = plane.shape
            ax = layout.axes(60 + number_ * 900, 70, 840, 420)
            paint(ax, plane, transient_colours(plane.transient_periods, plane.periods))
            column = np.arange(nx) + 0.5
            for force in (*CONTOURS, *np.sqrt(np.array(CONTOURS[1:]) * np.array(CONTOURS[:-1]))):
                height = (force / plane.x) / plane.y[-1] * (ny - 1) + 0.5
                ax.plot(column[height <= ny], height[height <= ny], color="white", lw=0.7, alpha=0.8)
            found = ground.features(plane.transient_periods)
            chosen = streaks(found, ground.Texture())
            rows, columns = np.nonzero(chosen)
            some = (rows % 4 == 1) & (columns % 4 == 1)
            rows, columns = rows[some], columns[some]
            along = found.direction[rows, columns]
            dx, dy = 1.7 * np.cos(along), 1.7 * np.sin(along)
            ax.plot(
                [columns + 0.5 - dx, columns + 0.5 + dx], [rows + 0.5 - dy, rows + 0.5 + dy], color="#e8380d", lw=1.3
            )
            ax.set(xlim=(0, nx), ylim=(0, ny), xticks=[], yticks=[])
            ax.minorticks_off()
            ax.set_title(f"({k})  white: contours of initial force (Fig 12); red: streaks", loc="left", fontsize=8.5)
    return layout.figure


def page(found: Mapping[str, Mapping[str, MapFile]], nx: int, ny: int, seconds: float) -> str:
    """The part of the page that this script writes."""
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    return "\n".join(
        [
            f"{len(found) * len(LAYOUT)} maps of {nx} × {ny} cells in {seconds:.0f} s ({machine}); kernel "
            f"`{program()}`.",
            "\n## Synthetic maps\n",
            *synthetic_part(),
            "\n## What the paper says, and what our maps show\n",
            *statement_part(found),
            "\n![terrain](terrain-fig11.png)",
            "\n## Thresholds moved by a tenth\n",
            *robust_part(found),
            "\n## Streaks against Fig 12\n",
            *streak_part(found["default"]),
            "\n![streaks](terrain-streaks.png)",
            "\n## Playability\n",
            *playability_part(found),
            "\n![compare](terrain-compare.png)",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nx", type=int, default=128, help="cells along f_asym (default: the paper's 128)")
    parser.add_argument("--ny", type=int, default=64, help="cells along f_init/f_asym (default: the paper's 64)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of terrain.md and its pictures")
    parser.add_argument("--data", action="store_true", help="write tests/data/fig11.npz instead")
    args = parser.parse_args()
    if args.data:
        write_data()
        print(f"wrote {DATA}")
        return
    began = time.monotonic()
    found = compute(args.nx, args.ny)
    draw(found["default"], args.out)
    put(page(found, args.nx, args.ny, time.monotonic() - began), args.out / "terrain.md", "studies/terrain.py")
    print(f"wrote {args.out / 'terrain.md'}")


if __name__ == "__main__":
    main()
