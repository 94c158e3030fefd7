"""Guettler's plane: transients under a bow that speeds up, against his bounds and against measurements (section 14)."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.physics.parameters import Parameters
from bow_sweep.beyond.cells import compute
from bow_sweep.beyond.claim import Claims, Finding, Maps, Point
from bow_sweep.beyond.drawing import BLUE, MUTED, ORANGE, shade_map
from bow_sweep.beyond.measures import right_edge
from bow_sweep.maps.limits import guettler_bounds
from bow_sweep.maps.map_file import MapFile
from bow_sweep.plan.sweep import Sweep

CLAIMS = Claims()
claim = CLAIMS.claim

LONG, PERFECT = 20.0, 1.0
"""Transients that count as success in the measurements, and as perfect, periods."""

# The ideal string, without a map: each cell is one acceleration, and only its ratio to the force matters

INVERSE_BETAS = (6, 8, 10, 12)
FRICTIONS = ((0.8, 0.3), (1.2, 0.35))
NUT_GAINS = (1.0, 0.97)

IDEAL_N = 360
"""Period, samples: the bow is on a whole sample for each of `INVERSE_BETAS`."""

REACH = {6: (0.98, 1.02), 8: (0.88, 0.91), 10: (0.82, 0.85), 12: (0.79, 0.82)}
"""1/beta -> how far the region reaches, over a_high: the ranges of the trial; "within 2 %" for 6."""


def _bounds(p: Parameters) -> tuple[float, float]:
    """Return Guettler's bounds of acceleration for a bow force of 1, v_b a period (PHYSICS.md section 9)."""
    found = guettler_bounds(p)
    assert found is not None, "strings of these claims have mu_d, and a bow near the bridge"
    return found


class _Region:
    """Accelerations of one string, and which begin with two regular periods."""

    def __init__(self, inverse: int, friction: tuple[float, float], gain: float) -> None:
        p = Parameters.from_mapping(
            {
                "model": "raman",
                "bridge_gain": 1.0,
                "nut_gain": gain,
                "friction": "coulomb",
                "mu_s": friction[0],
                "mu_d": friction[1],
                "period": IDEAL_N,
                "bow_bridge": IDEAL_N // inverse,
                "gesture": "guettler",
                "f_asym": 1.0,
                "periods": 30,
            }
        )
        low, high = _bounds(p)
        self.a = np.concatenate([np.linspace(0.9, 1.1, 81) * low, np.linspace(1.1 * low, 1.1 * high, 241)[1:]])
        slips = compute(p, {"acceleration": self.a}).slips
        self.perfect = np.array([_two_periods(slips.of(i).start, IDEAL_N) for i in range(len(self.a))])
        good = self.a[self.perfect]
        self.begins = float(good[0] / low) if len(good) else np.nan
        self.reaches = float(good[-1] / high) if len(good) else np.nan
        self.name = f"1/beta {inverse}, mu {friction[0]:g}/{friction[1]:g}, nut gain {gain:g}"
        self.inverse, self.low, self.high = inverse, low, high


def _two_periods(onsets: NDArray[np.int64], period: int) -> bool:
    """Return whether the first two intervals between slips are one period, within 2 %. Every slip counts."""
    onsets = onsets[:3]
    return len(onsets) == 3 and bool(np.all(np.abs(np.diff(onsets) - period) <= 0.02 * period))


@claim(
    "guettler-ideal",
    "ideal string, Coulomb friction: the first two intervals are one period between Guettler's bounds of acceleration",
    "Guettler 2002; shares of a_high: trial",
    "secondary",
    "region from a_low; never beyond 1.02 a_high; to a_high at 1/beta = 6, 0.91-0.88 of it at 8, 0.85-0.82 at 10, "
    "0.82-0.79 at 12",
    "from a_low within 3 %; at most 1.02 a_high; 2 % of a_high at 1/beta = 6, the trial's ranges +- 0.01 at the "
    "others; every slip counts, however small",
)
def _guettler_ideal(maps: Maps) -> Finding:
    regions = [_Region(i, mu, gain) for i in INVERSE_BETAS for mu in FRICTIONS for gain in NUT_GAINS]
    points = []
    for r in regions:
        points.append(Point.about(f"begins, of a_low: {r.name}", r.begins, 1.0, 0.03))
        low, high = REACH[r.inverse]
        more = 0.01 if r.inverse > 6 else 0.0
        points.append(Point(f"reaches, of a_high: {r.name}", r.reaches, low - more, high + more, 0.02))
    reach = {i: [r.reaches for r in regions if r.inverse == i] for i in INVERSE_BETAS}
    begins = [r.begins for r in regions]
    words = f"begins at {min(begins):.3f} ... {max(begins):.3f} of a_low; reaches " + ", ".join(
        f"{min(part):.2f}-{max(part):.2f} of a_high at {i}" for i, part in reach.items()
    )
    return Finding(words, tuple(points), partial(_draw_ideal, regions))


def _draw_ideal(regions: list[_Region], axes: Any) -> None:
    for i, r in enumerate(regions):
        axes.plot([r.low / r.low, r.high / r.low], [i, i], color=ORANGE, lw=5, alpha=0.5, label=None if i else "bounds")
        good = r.a[r.perfect] / r.low
        axes.plot(good, np.full(len(good), i), ".", color=BLUE, ms=3, label=None if i else "two regular periods")
    axes.set_yticks(range(len(regions)), [r.name for r in regions], fontsize=5)
    axes.set(xlabel="acceleration / a_low")
    axes.legend(loc="upper right", fontsize=7)


# The cello


def transients(plane: MapFile) -> NDArray[np.float64]:
    """Return Guettler's transient of every cell of a map, (ny, nx) periods; infinite for none."""
    lengths = np.asarray(plane.transient_periods, float)
    return np.where(lengths > 0, lengths, np.inf)


STRINGS = {"a": 22.0, "b": 40.0, "c": 43.0, "d": 30.0}
"""Cello string -> measured share of transients below 20 periods, percent."""

EDGES = {"a": (1.63, 0.92), "b": (0.97, 1.0), "c": (1.06, 0.38), "d": (0.91, 1.28)}
"""Cello string -> m and c of the measured right edge F = m a + c, N and m/s^2."""

CELLO = tuple(f"guettler_{letter}" for letter in STRINGS)


@claim(
    "guettler-area",
    "cello, strings A to D: share of Guettler's plane with transients below 20 periods",
    "Lampis et al. 2024 by way of another's evaluation",
    "secondary",
    "measured 22, 40, 43, 30 %; C the greatest",
    "within 15 points of the measured; C the greatest",
    *CELLO,
)
def _guettler_area(maps: Maps) -> Finding:
    found = {letter: transients(maps[f"guettler_{letter}"]) for letter in STRINGS}
    share = {letter: 100 * float(np.mean(lengths < LONG)) for letter, lengths in found.items()}
    points = (
        *(Point.about(f"string {letter.upper()}, %", share[letter], STRINGS[letter], 15) for letter in STRINGS),
        Point.true("C is the greatest", max(share, key=lambda letter: share[letter]) == "c"),
    )
    words = f"{', '.join(f'{part:.0f}' for part in share.values())} %"
    return Finding(words, points, partial(_draw_plane, maps["guettler_c"], found["c"], EDGES["c"]))


def _draw_plane(plane: MapFile, lengths: NDArray[np.float64], edge: tuple[float, float] | None, axes: Any) -> None:
    shade_map(axes, plane, lengths, (PERFECT, LONG))
    p = Sweep.from_spec("", plane.settings).parameters
    unit = p.v_unit * p.sample_rate / p.period  # m/s^2 of one v_b a period
    newton = p.y_t * p.z_0 * p.v_unit
    for i, bound in enumerate(guettler_bounds(p) or ()):  # thermal friction has none
        axes.plot(
            plane.x,
            plane.x / unit / bound * newton,
            color=MUTED,
            lw=0.9,
            ls="--",
            label="" if i else "Guettler's bounds",
        )
    if edge is not None:
        axes.plot(plane.x, edge[0] * plane.x + edge[1], color=ORANGE, lw=1.5, label="measured right edge")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right")
    axes.set(xlabel="acceleration, m/s²", ylabel="bow force, N", ylim=(plane.y[0], plane.y[-1]))


@claim(
    "guettler-edge",
    "cello, strings A to D: right edge of that region, F = m a + c (N, m/s^2)",
    "Lampis et al. 2024 by way of another's evaluation",
    "secondary",
    "measured 1.63 a + 0.92, 0.97 a + 1.0, 1.06 a + 0.38, 0.91 a + 1.28",
    "force on the edge at 2 m/s^2 within 30 %, as for other limits measured there; the trial, with 1.36 a + 0.55, "
    "1.33 a + 0.49, 1.16 a + 0.27 and 1.36 a + 0.46, is within 22 %",
    *CELLO,
)
def _guettler_edge(maps: Maps) -> Finding:
    lines, points = {}, []
    for letter, (m, c) in EDGES.items():
        plane = maps[f"guettler_{letter}"]
        lines[letter] = right_edge(plane.x, plane.y, transients(plane) < LONG)
        wanted, found = (slope * 2.0 + offset for slope, offset in ((m, c), lines[letter]))
        points.append(Point.about(f"string {letter.upper()}, N at 2 m/s^2", found, wanted, 0.3 * wanted))
    words = ", ".join(f"{m:.2f} a {c:+.2f}" for m, c in lines.values())

    def draw(axes: Any) -> None:
        a = np.array([0.2, 3.0])
        for letter, (m, c) in EDGES.items():
            (line,) = axes.plot(a, m * a + c, lw=2.5, alpha=0.4, label=f"{letter.upper()}, measured")
            slope, offset = lines[letter]
            axes.plot(a, slope * a + offset, lw=1, color=line.get_color(), label=f"{letter.upper()}, ours")
        axes.set(xlabel="acceleration, m/s²", ylabel="bow force, N")
        axes.legend(ncols=2, fontsize=7)

    return Finding(words, tuple(points), draw)


@claim(
    "guettler-hair",
    "cello string B: a rigid bow leaves tatters; soft hair makes a solid wedge with a perfect zone",
    "PHYSICS.md 14; others found the same",
    "trial",
    "8 to 12 % of the plane with a rigid bow, hardly any of it perfect; with hair_soft about 11 % perfect",
    "rigid 8 to 12 %, less than 1 % perfect; hair_soft 11 +- 3 % perfect, and three times the area or more",
    "guettler_b",
    "guettler_rigid",
)
def _guettler_hair(maps: Maps) -> Finding:
    soft, rigid = (transients(maps[name]) for name in ("guettler_b", "guettler_rigid"))
    share = [100 * float(np.mean(part < LONG)) for part in (rigid, soft)]
    perfect = [100 * float(np.mean(part < PERFECT)) for part in (rigid, soft)]
    points = (
        Point("rigid, %", share[0], 8, 12, 2),
        Point("rigid, perfect, %", perfect[0], 0, 1, 1),
        Point.about("soft, perfect, %", perfect[1], 11, 3),
        Point("soft over rigid", share[1] / max(share[0], 1e-9), 3, np.inf, 0.5),
    )
    words = (
        f"rigid {share[0]:.0f} %, {perfect[0]:.1f} % perfect; hair_soft {share[1]:.0f} %, {perfect[1]:.1f} % perfect"
    )
    return Finding(words, points, partial(_draw_plane, maps["guettler_rigid"], rigid, None))


@claim(
    "guettler-thermal",
    "thermal friction against the hyperbola, rigid bow, string B: a larger region, and shorter transients in it",
    "direction: Woodhouse; numbers: trial",
    "trial",
    "14 % against 8 %, mean of the successful 7.5 against 10.7 periods",
    "larger by a quarter or more, and shorter; the numbers within 4 points and 2 periods",
    "guettler_rigid",
    "guettler_thermal",
)
def _guettler_thermal(maps: Maps) -> Finding:
    hyperbola, thermal = (transients(maps[name]) for name in ("guettler_rigid", "guettler_thermal"))
    share = [100 * float(np.mean(part < LONG)) for part in (thermal, hyperbola)]
    mean = [float(part[part < LONG].mean()) if (part < LONG).any() else np.nan for part in (thermal, hyperbola)]
    points = (
        Point("thermal over hyperbola, area", share[0] / max(share[1], 1e-9), 1.25, np.inf, 0.25),
        Point.true("shorter", mean[0] < mean[1]),
        Point.about("thermal, %", share[0], 14, 4),
        Point.about("hyperbola, %", share[1], 8, 4),
        Point.about("thermal, periods", mean[0], 7.5, 2),
        Point.about("hyperbola, periods", mean[1], 10.7, 2),
    )
    words = f"{share[0]:.0f} % against {share[1]:.0f} %, {mean[0]:.1f} against {mean[1]:.1f} periods"
    return Finding(words, points, partial(_draw_plane, maps["guettler_thermal"], thermal, None))
