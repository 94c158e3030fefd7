"""The paper's claims about the maps of Figs 10 and 11 (section IV)."""

from __future__ import annotations

import numpy as np

from bow_classifier.verdict.thresholds import THRESHOLD_PRESETS
from bow_sweep.maps.map_file import MapFile
from bow_sweep.paper.claim import Claims, Finding, Maps
from bow_sweep.paper.map_measures import (
    black_share,
    coloured,
    columns,
    curvature,
    explained,
    flyback,
    force_limit,
    largest_area,
    unevenness,
)
from bow_sweep.paper.maps import FIG10_PERIODS, PERIODS, other_settings

TRIAL = {"c": 0.288, "d": 0.526}
"""Shares of Helmholtz motion in the trial implementation (PHYSICS.md section 8)."""

SCHELLENG = 11.46
"""Schelleng's maximum bow force (PHYSICS.md section 8): bow force above it is called high."""

LOW_FORCE = 5.0
"""f_asym below which (e) and (f) should be docile. The middle of the axis is 3.2, and the limit of (f) twice that."""

STREAKS = (1.0, 10.0)
"""Range of f_asym with the streaks of (c) and (e): a decade around the middle of the axis."""

EXPONENTS = tuple(round(0.1 * i, 1) for i in range(11))
"""p of the lines ``f_asym (f_init/f_asym)**p = const``: 0 = vertical lines, 1 = contours of Fig 12."""

CLAIMS = Claims()
claim = CLAIMS.claim


def percent(*shares: float, digits: int = 0) -> str:
    """Return shares as text, in percent."""
    return " and ".join(f"{100 * share:.{digits}f} %" for share in shares)


@claim(
    "fig10a",
    "stiff/Cremer, v_mid 0.2, after 40 periods: nearly periodic except at high force",
    "Fig 10(a), IV.A",
    "in most of the region, the exception being at high bow force",
    "correlation above 0.9, “nearly”, in at least 95 % of the cells below Schelleng's maximum, at most 60 % above it",
    "d",
)
def _fig10a(maps: Maps) -> Finding:
    plane = maps["d"]
    if FIG10_PERIODS not in plane.test_periods:
        return Finding(f"no test after {FIG10_PERIODS} periods", None, {})
    correlation = np.nan_to_num(plane.correlation[list(plane.test_periods).index(FIG10_PERIODS)], nan=-1.0)
    high = plane.x > SCHELLENG
    below, above = (float(np.mean(correlation[:, part] > 0.9)) for part in (~high, high))
    words = f"correlation above 0.9 in {percent(below)} of the cells below f_asym = {SCHELLENG}, {percent(above)} above"
    return Finding(words, below >= 0.95 and above <= 0.6, {"below": below, "above": above})


@claim(
    "fractions",
    "share of Helmholtz motion at v_mid 0.2, delta and stiff",
    "PHYSICS.md 8",
    "0.288 and 0.526",
    "within 0.02, 3.6 standard deviations of 8192 independent cells; not judged with another calibration, or with "
    "other thresholds than the trial's (classifier.preset=trial)",
    "cd",
)
def _fractions(maps: Maps) -> Finding:
    ours = {letter: maps[letter].helmholtz_fraction() for letter in TRIAL}
    close = all(abs(ours[letter] - TRIAL[letter]) <= 0.02 for letter in TRIAL)
    usual = not any(other_settings(maps[letter]) or not _as_in_the_trial(maps[letter]) for letter in TRIAL)
    return Finding(f"{ours['c']:.3f} and {ours['d']:.3f}", close if usual else None, {"fractions": ours})


def _as_in_the_trial(plane: MapFile) -> bool:
    trial = dict(setting.split("=") for setting in THRESHOLD_PRESETS["trial"].settings())
    return all(plane.values.get(f"classifier.{name}", value) == value for name, value in trial.items())


def _stripe(maps: Maps, letter: str) -> Finding:
    mask = coloured(maps[letter])
    x, y = explained(mask, "x"), explained(mask, "y")
    region = maps[letter].x[columns(mask, 0.5)]
    words = f"{percent(x)} and {percent(y, digits=1)} of the variance"
    if len(region):
        words += f"; at least half succeed from {region[0]:.1f} to {region[-1]:.1f}"
    return Finding(words, x >= 0.75 and y <= 0.03, {"f_asym": x, "f_init_ratio": y})


for _letter, _name in (("a", "delta"), ("b", "stiff")):
    claim(
        f"stripe-{_letter}",
        f"({_letter}) {_name}, v_mid 0.9: a vertical stripe; f_asym decides, the transient's shape hardly",
        "Fig 11(a, b), IV.A",
        "mostly governed by f_asym",
        "of the variance of success f_asym alone explains at least 75 %, f_init/f_asym alone at most 3 % (chance: 1 %)",
        _letter,
    )(lambda maps, letter=_letter: _stripe(maps, letter))  # type: ignore[misc]


@claim(
    "restricted",
    "the range of force is restricted at v_mid 0.9 and wider at 0.2",
    "IV.A",
    "(c, d) wider than (a, b)",
    "share of the logarithmic axis of force where at least a tenth of the gestures succeed: a tenth of the axis in (a, "
    "b), and 1.25 times as much or more in (c, d)",
    "abcd",
)
def _restricted(maps: Maps) -> Finding:
    share = {k: float(np.mean(coloured(maps[k]).mean(axis=0) >= 0.1)) for k in "abcd"}
    words = ", ".join(f"({k}) {percent(part)}" for k, part in share.items())
    holds = min(share["c"], share["d"]) >= 1.25 * max(share["a"], share["b"]) and min(share.values()) >= 0.1
    return Finding(words, holds, {"share": share})


@claim(
    "uneven-b",
    "(b) few black specks, but colours not smooth: safe but uneven",
    "Fig 11(b), IV.B",
    "low density of black spots; not smoothly varying",
    "at most one cell in five of the stripe black; most neighbours differ by more than the interval of the tests",
    "b",
)
def _uneven_b(maps: Maps) -> Finding:
    black, rough = black_share(coloured(maps["b"])), unevenness(maps["b"].transient_periods)
    words = f"{percent(black)} of the stripe is black; {percent(rough)} of neighbours differ by more than 5 periods"
    return Finding(words, black <= 0.2 and rough >= 0.5, {"black": black, "uneven": rough})


@claim(
    "specks-d",
    "(d) a wide region with few black specks",
    "Fig 11(d), IV.A",
    "a sprinkling of black spots",
    "at most one cell in five black; nine tenths of the colour in one contiguous area",
    "d",
)
def _specks_d(maps: Maps) -> Finding:
    mask = coloured(maps["d"])
    black, whole = black_share(mask), largest_area(mask) / max(float(mask.mean()), 1e-9)
    words = f"{percent(black)} of the region is black; {percent(whole)} of the coloured cells hang together"
    return Finding(words, black <= 0.2 and whole >= 0.9, {"black": black, "contiguous": whole})


def _cut(maps: Maps, delta: str, stiff: str) -> Finding:
    region = columns(coloured(maps[stiff]), 0.1)
    filled = [float(coloured(maps[k])[:, region].mean()) if region.stop else 0.0 for k in (delta, stiff)]
    many = [float(flyback(maps[k]).mean()) for k in (delta, stiff)]
    words = (
        f"over ({stiff})'s range of force {percent(*filled)} are coloured; "
        f"multiple flyback on {percent(*many, digits=1)} of the plane"
    )
    holds = filled[0] <= 0.75 * filled[1] and many[0] >= 0.1 and many[1] <= many[0] / 10
    return Finding(words, holds, {"coloured": filled, "flyback": many})


@claim(
    "cut-c",
    "(c) the region of (d) cut up by black streaks that are multiple flyback; delta and stiff",
    "Fig 11(c, d), IV.A",
    "a great deal of this region is black",
    "at most 3/4 as much colour as in (d) over the same forces; multiple flyback at its last test on at least a "
    "tenth of the plane and ten times as much as in (d)",
    "cd",
)
def _cut_c(maps: Maps) -> Finding:
    return _cut(maps, "c", "d")


@claim(
    "region-c",
    "(c) Helmholtz motion is confined within the region of (d)",
    "Fig 11(c, d), IV.A",
    "the same general region",
    "reported: the paper gives no number; with our surrogate for Cremer's bridge (c) goes on beyond (d)'s limit",
    "cd",
)
def _region_c(maps: Maps) -> Finding:
    mask, region = coloured(maps["c"]), columns(coloured(maps["d"]), 0.1)
    inside = float(mask[:, region].sum() / max(mask.sum(), 1))
    forces = maps["d"].x[region]
    where = f"{forces[0]:.1f} ... {forces[-1]:.1f}" if len(forces) else "no range"
    return Finding(f"{percent(inside)} of (c)'s colour is within (d)'s {where}", None, {"inside": inside})


@claim(
    "cut-e",
    "(e) delta again cut by multiple-flyback streaks, (f) not; delta and stiff",
    "Fig 11(e), IV.A",
    "a significant area of black",
    "as for (c), against (f)",
    "ef",
)
def _cut_e(maps: Maps) -> Finding:
    return _cut(maps, "e", "f")


@claim(
    "curved",
    "the streaks of (c) and (e) curve as contours of initial force do",
    "Figs 11(c, e), 12, IV.B",
    "very reminiscent of Fig 12",
    "at f_asym 1 ... 10 the lines f_asym (f_init/f_asym)^p = const that explain black and colour best have p > 0 "
    "(Fig 12: 1, vertical: 0); they explain 5 % (chance: 1.3 %), and 1.5 times as much as their mirror images",
    "ce",
)
def _curved(maps: Maps) -> Finding:
    best, lean, share = {}, {}, {}
    for k in "ce":
        shares = curvature(maps[k], coloured(maps[k]), STREAKS, EXPONENTS)
        best[k] = EXPONENTS[int(np.argmax(shares))]
        (mirrored,) = curvature(maps[k], coloured(maps[k]), STREAKS, [-best[k]])
        share[k], lean[k] = max(shares), max(shares) / max(mirrored, 1e-9)
    words = ", ".join(f"({k}) p = {best[k]:g}, {percent(share[k])}, {lean[k]:.1f} times the mirror image" for k in "ce")
    holds = all(best[k] > 0 and share[k] >= 0.05 and lean[k] >= 1.5 for k in "ce")
    return Finding(words, holds, {"p": best, "explained": share, "lean": lean})


@claim(
    "docile",
    "(e, f) a large smooth area at low force, often with long transients",
    "Fig 11(e, f), IV.A, IV.B",
    "large; smoothly varying; often rather long",
    "below f_asym = 5: one area of 15 % of the plane or more; at most a quarter of neighbours differ by more than the "
    "interval of the tests; at least half of the transients take more than a third of the 100 periods",
    "ef",
)
def _docile(maps: Maps) -> Finding:
    areas, rough, late = [], [], []
    for k in "ef":
        lengths = np.where(maps[k].x < LOW_FORCE, np.nan_to_num(maps[k].transient_periods), 0)
        areas.append(largest_area(lengths > 0))
        rough.append(unevenness(lengths))
        late.append(float(np.mean(lengths[lengths > 0] > PERIODS / 3)) if lengths.any() else 0.0)
    words = (
        f"area of {percent(*areas)} of the plane; {percent(*rough)} of neighbours differ by more than 5 periods; "
        f"{percent(*late)} take more than a third of the run"
    )
    holds = min(areas) >= 0.15 and max(rough) <= 0.25 and min(late) >= 0.5
    return Finding(words, holds, {"area": areas, "uneven": rough, "late": late})


@claim(
    "limit-f",
    "(f) a fuzzy vertical limit of force, lower than in (d)",
    "Fig 11(d, f), IV.A",
    "(f) below (d)",
    "force up to which half of the gestures succeed: at least 10 % lower, four columns of the map",
    "df",
)
def _limit_f(maps: Maps) -> Finding:
    limit = {k: force_limit(maps[k]) for k in "df"}
    fuzz = [force_limit(maps["f"], share) for share in (0.9, 0.1)]
    words = f"{limit['f']:.1f} in (f), {limit['d']:.1f} in (d); (f) falls from 90 to 10 % over "
    words += " ... ".join(f"{force:.1f}" for force in fuzz)
    return Finding(words, limit["f"] <= 0.9 * limit["d"], {"limit": limit, "fuzz": fuzz})


def _areas(maps: Maps, delta: str, stiff: str) -> tuple[str, list[float]]:
    areas = [largest_area(coloured(maps[k])) for k in (delta, stiff)]
    return f"largest contiguous area {percent(*areas, digits=1)} of the plane", areas


@claim(
    "easier-0.9",
    "stiff is easier than delta at v_mid 0.9: larger contiguous coloured areas",
    "Fig 11(a, b), IV.A",
    "generally larger; the stripes are alike",
    "reported: the paper says “generally”, and of these two that both have a restricted range",
    "ab",
)
def _easier_ab(maps: Maps) -> Finding:
    words, areas = _areas(maps, "a", "b")
    return Finding(words, None, {"area": areas})


def _easier(maps: Maps, delta: str, stiff: str) -> Finding:
    words, areas = _areas(maps, delta, stiff)
    return Finding(words, areas[1] >= 1.5 * areas[0], {"area": areas})


for _delta, _stiff, _v_mid in (("c", "d", "0.2"), ("e", "f", "-2")):
    claim(
        f"easier-{_v_mid}",
        f"stiff is easier than delta at v_mid {_v_mid}: larger contiguous coloured areas",
        f"Fig 11({_delta}, {_stiff}), IV.A",
        "larger",
        "1.5 times as large or more: neighbours of a speck or two can join or part areas",
        _delta + _stiff,
    )(lambda maps, delta=_delta, stiff=_stiff: _easier(maps, delta, stiff))  # type: ignore[misc]


@claim(
    "flattening-maps",
    "bow force up: the period of Helmholtz motion lengthens",
    "III.B, PHYSICS.md 8",
    "flattening by hysteresis",
    "reported: the trial saw it in (b); elsewhere slip jumps lock to the sample grid",
    "abcdef",
)
def _flattening(maps: Maps) -> Finding:
    slope = {}
    for k in sorted(maps):
        good = maps[k].helmholtz[-1]
        force = np.broadcast_to(np.log2(maps[k].x), good.shape)[good]
        slope[k] = float(np.polyfit(force, maps[k].period[-1][good], 1)[0]) if good.sum() > 2 else float("nan")
    words = ", ".join(f"({k}) {part:+.2f}" for k, part in slope.items()) + " samples an octave of force"
    return Finding(words, None, {"slope": slope})
