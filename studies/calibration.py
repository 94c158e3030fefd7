"""How what the paper leaves open moves its maps; run it with `python -m studies.calibration`.

Cremer's constants, the bending stiffness, the precision of the arithmetic and the rounding of delays are not in the
paper. This computes the maps of Fig 11 with each of them changed, in this process, and writes what changes into
docs/calibration.md (between two marks; the text around them stays) and docs/figures/calibration.png.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bow_classifier.verdict.regimes import is_helmholtz
from bow_sim.figures.page import MUTED, style
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import gaussian
from bow_sweep.figures.colours import transient_colours
from bow_sweep.figures.layout import Layout, percent
from bow_sweep.figures.panel import paint
from bow_sweep.maps.in_process import compute
from bow_sweep.maps.map_file import MapFile
from bow_sweep.paper.claim import REPORT
from bow_sweep.paper.claims_maps import CLAIMS
from bow_sweep.paper.maps import LAYOUT
from bow_sweep.plan.sweep import Sweep
from tools.doc_page import put

ROOT = Path(__file__).resolve().parent.parent
STIFFNESS = (1e-5, 2e-5, 5e-5, 1e-4, 2e-4, 5e-4, 1e-3)
V_MIDS = (0.9, 0.2, -2.0)
DELTA, STIFF = "delta_cremer", "stiff_cremer"
MEASURES = ("Helmholtz", "median", "mean", "flyback")


@dataclass(frozen=True)
class Variant:
    """A map with something changed: of `model` at `v_mid`, `settings` over the defaults; `shift` in cells."""

    group: str
    name: str
    model: str
    v_mid: float
    settings: tuple[str, ...] = ()
    shift: float = 0.0


def rounded_torsion() -> tuple[str, ...]:
    """Settings that put the torsional reflections at whole samples: 6.25 -> 6 and 51.667 -> 52."""
    p = Parameters()
    texts = []
    for name, delay in (("bridge", p.bow_bridge), ("nut", p.period - p.bow_bridge)):
        whole = float(round(delay / p.torsion_speed))
        texts.append(
            f"torsion_{name}_function={gaussian(whole, p.torsion_width, p.torsion_gain, p.torsion_half).text()}"
        )
    return tuple(texts)


def variants() -> list[Variant]:
    """All maps, the most telling first: a time limit cuts off the end."""
    everywhere = [(model, v_mid) for v_mid in (0.2, -2.0, 0.9) for model in (DELTA, STIFF)]
    middle = everywhere[:2]
    plans = [("default", "default", everywhere, (), 0.0), ("bridge", "t60", middle, ("bridge=t60",), 0.0)]
    plans += [("stiffness", f"{b:g}", [(STIFF, 0.2)], (f"stiffness_b={b}",), 0.0) for b in STIFFNESS]
    plans += [
        ("numerics", "float32", middle, ("dtype=float32",), 0.0),
        ("numerics", "torsional delays rounded", middle, rounded_torsion(), 0.0),
        ("numerics", "grid shifted by half a cell", middle, (), 0.5),
        ("bridge", "t60", everywhere[2:], ("bridge=t60",), 0.0),
        ("numerics", "float32", everywhere[2:], ("dtype=float32",), 0.0),
        ("numerics", "torsional delays rounded", everywhere[2:], rounded_torsion(), 0.0),
    ]
    plans += [("stiffness", f"{b:g}", [(STIFF, -2.0)], (f"stiffness_b={b}",), 0.0) for b in STIFFNESS]
    return [
        Variant(group, name, *where, settings, shift)
        for group, name, cells, settings, shift in plans
        for where in cells
    ]


def compute_map(variant: Variant, nx: int, ny: int) -> MapFile:
    """The map of a variant on a grid of nx by ny."""
    settings = [f"model={variant.model}", f"v_mid={variant.v_mid}", f"x.count={nx}", f"y.count={ny}", *variant.settings]
    sweep = Sweep.from_spec("", settings)
    if variant.shift:
        x, y = sweep.x, sweep.y
        ratio, step = (x.last / x.first) ** (variant.shift / (nx - 1)), variant.shift * (y.last - y.first) / (ny - 1)
        x = replace(x, first=x.first * ratio, last=x.last * ratio)
        y = replace(y, first=y.first + step, last=y.last + step)
        sweep = replace(sweep, x=x, y=y)
    return MapFile.of(sweep, compute(sweep), "calibration")


def measures(plane: MapFile) -> dict[str, tuple[float, float]]:
    """Each of `MEASURES` with its sampling error: the four interleaved grids of half the density, as independent."""
    quarters = [_measure(plane, (slice(i, None, 2), slice(j, None, 2))) for i in (0, 1) for j in (0, 1)]
    whole = _measure(plane, (slice(None), slice(None)))
    return {
        name: (whole[name], float(np.std([q[name] for q in quarters], ddof=1) / np.sqrt(len(quarters))))
        for name in MEASURES
    }


def _measure(plane: MapFile, part: tuple[slice, slice]) -> dict[str, float]:
    lengths, regime = plane.transient_periods[part], plane.regime[part]
    came = lengths > 0
    return {
        "Helmholtz": float(came.mean()),
        "median": float(np.median(lengths[came])) if came.any() else float("nan"),
        "mean": float(np.mean(lengths[came])) if came.any() else float("nan"),
        "flyback": float(np.mean(regime == plane.regime_names.index("multiple_flyback"))),
    }


def changed(plane: MapFile, usual: MapFile) -> float:
    """Share of cells whose last verdict, Helmholtz or not, is another."""
    return float(np.mean(is_helmholtz(plane.regime) != is_helmholtz(usual.regime)))


# ---- the page


def table(found: Mapping[Variant, MapFile], group: str) -> list[str]:
    """Rows of a group of variants, each beside the default map of its model and v_mid."""
    usual = {(v.model, v.v_mid): plane for v, plane in found.items() if v.group == "default"}
    lines = [
        "| map | variant | Helmholtz | transient: median | mean (periods) | multiple flyback | cells changed |",
        "|---|---|---|---|---|---|---|",
    ]
    shown = [v for v in found if v.group == group]
    for v in sorted(shown, key=lambda v: (V_MIDS.index(v.v_mid), v.model)):
        m = measures(found[v])
        same = not v.shift and v.group != "default"
        cells = [
            f"{_letter(v)} {v.model.replace('_cremer', '')}, v_mid {v.v_mid:g}",
            v.name,
            f"{100 * m['Helmholtz'][0]:.1f} ± {100 * m['Helmholtz'][1]:.1f} %",
            f"{m['median'][0]:g}",
            f"{m['mean'][0]:.1f} ± {m['mean'][1]:.1f}",
            f"{100 * m['flyback'][0]:.1f} ± {100 * m['flyback'][1]:.1f} %",
            f"{100 * changed(found[v], usual[v.model, v.v_mid]):.2f} %" if same else "",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def claims_table(found: Mapping[Variant, MapFile]) -> list[str]:
    """The claims of `bow validate` about maps, for each variant of which all six maps are there."""
    sets: dict[str, dict[str, MapFile]] = {}
    for v, plane in found.items():
        sets.setdefault(v.name, {})[_letter(v)[1]] = plane
    names = [name for name, maps in sets.items() if len(maps) == len(LAYOUT)]
    lines = ["| claim | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for claim in CLAIMS.all:
        rows = [claim.judge(sets[name]) for name in names]
        if any(row.verdict != REPORT for row in rows):
            cells = [f"{row.verdict}: {row.measured}" for row in rows]
            lines.append("| " + " | ".join([claim.claim, *cells]) + " |")
    return lines


def _letter(v: Variant) -> str:
    return next(f"({letter})" for letter, where in LAYOUT.items() if where == (v.model, v.v_mid))


def page(found: Mapping[Variant, MapFile], left_out: int, nx: int, ny: int, seconds: float) -> str:
    """The part of the page that this script writes."""
    titles = {"default": "Default", "bridge": "Cremer's bridge: R = 63.5, w_c = 1.4 w_1 (t60)",
              "stiffness": "Bending stiffness B", "numerics": "Numerics"}  # fmt: skip
    lines = [
        f"{len(found)} maps of {nx} × {ny} cells, 100 periods each, in {seconds:.0f} s "
        f"({platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()})"
        + (f"; {left_out} left out for want of time." if left_out else "."),
    ]
    for group, title in titles.items():
        if any(v.group == group for v in found):
            lines += ["", f"## {title}", "", *table(found, group)]
    lines += ["", "## What the paper claims of the maps, with each", "", *claims_table(found)]
    return "\n".join([*lines, "", "## Maps", "", "![maps](figures/calibration.png)"])


def draw(found: Mapping[Variant, MapFile], path: Path) -> None:
    """Small maps of v_mid 0.2, in the colours of the main picture."""
    order = ("default", "t60", "float32", "torsional delays rounded", "grid shifted by half a cell")
    usual = f"{Parameters().stiffness_b:g}"
    shown = [v for v in found if v.v_mid == 0.2 and v.name != usual]
    shown.sort(key=lambda v: (order.index(v.name), v.model) if v.name in order else (len(order), ""))
    columns, wide, high, across, down = 4, 256, 128, 292, 196
    rows = -(-len(shown) // columns)
    with style():
        layout = Layout(40 + columns * across, 70 + rows * down, 100)
        layout.text(30, 34, r"Transient length at $v_\mathrm{mid}$ = 0.2, axes as in Fig 11; black: never", fontsize=10)
        for number, v in enumerate(shown):
            row, column = divmod(number, columns)
            left, top = 30 + column * across, 90 + row * down
            axes = layout.axes(left, top, wide, high)
            paint(axes, found[v], transient_colours(found[v].transient_periods, found[v].periods))
            axes.set(xticks=[], yticks=[])
            axes.minorticks_off()
            name = f"B = {v.name}" if v.group == "stiffness" else v.name
            layout.text(left, top - 8, f"{v.model.replace('_cremer', '')}, {name}", fontsize=6.2)
            layout.text(left, top + high + 16, percent(found[v].helmholtz_fraction()), fontsize=5.5, color=MUTED)
        layout.figure.savefig(path, dpi=200, metadata={"Software": None})


def run(minutes: float, nx: int, ny: int, say: Callable[[str], None]) -> tuple[dict[Variant, MapFile], int]:
    """Compute the maps, until the time is up; returns them and how many are left out."""
    began, plan = time.monotonic(), variants()
    found: dict[Variant, MapFile] = {}
    for number, variant in enumerate(plan):
        if time.monotonic() - began > 60 * minutes:
            return found, len(plan) - number
        found[variant] = compute_map(variant, nx, ny)
        passed = percent(found[variant].helmholtz_fraction())
        say(f"{number + 1}/{len(plan)}  {variant.model} {variant.v_mid:g} {variant.group}: {variant.name}  {passed}")
    return found, 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5, help="begin no map after this (default 5)")
    parser.add_argument("--nx", type=int, default=128, help="cells along f_asym (default: the paper's 128)")
    parser.add_argument("--ny", type=int, default=64, help="cells along f_init/f_asym (default: the paper's 64)")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="directory of calibration.md and figures/")
    args = parser.parse_args()
    began = time.monotonic()
    found, left_out = run(args.minutes, args.nx, args.ny, lambda line: print(line, flush=True))
    (args.out / "figures").mkdir(parents=True, exist_ok=True)
    draw(found, args.out / "figures" / "calibration.png")
    put(
        page(found, left_out, args.nx, args.ny, time.monotonic() - began),
        args.out / "calibration.md",
        "studies/calibration.py",
    )
    print(f"wrote {args.out / 'calibration.md'}")


if __name__ == "__main__":
    main()
