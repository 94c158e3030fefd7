"""The paper's claims about Figs 10 and 11, held against runs: which map is which, and what each must show."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bow_sim.model import FIELDS, Parameters

from .measures import (
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
from .results import MAP
from .validate import NEEDS_RUNS, Row, row
from .view.maps import MapFile, MapFileError, read_map_npz

LAYOUT: dict[str, tuple[str, float]] = {
    "a": ("delta_cremer", 0.9),
    "b": ("stiff_cremer", 0.9),
    "c": ("delta_cremer", 0.2),
    "d": ("stiff_cremer", 0.2),
    "e": ("delta_cremer", -2.0),
    "f": ("stiff_cremer", -2.0),
}
"""Model and v_mid of the six maps of Fig 11."""

CALIBRATION = frozenset(
    "bridge_r bridge_w_c stiffness_b nut_cutoff nut_power torsion_half dtype periods model v_mid".split()
)
"""Parameters that the paper does not give: a map of it may have any of them, and says so in the table."""

PERIODS = 100
"""Of Fig 11 (section IV.A)."""

FIG10_PERIODS = 40
"""Of Fig 10 (section IV.A)."""

LOW_FORCE = 5.0
"""f_asym below which (e) and (f) are docile: "to the left of centre" of the axis, which is at 3.2 (section IV.B)."""

TRIAL = {"c": 0.288, "d": 0.526}
"""Helmholtz fractions of the trial implementation (PHYSICS.md section 8)."""

Maps = Mapping[str, MapFile]


@dataclass(frozen=True)
class Found:
    """Maps by the letter of Fig 11, and what was found where."""

    maps: dict[str, MapFile]
    listed: tuple[tuple[str, str], ...]


def recognise(runs: Sequence[Path]) -> Found:
    """Read runs and find out which of the paper's maps each is.

    Raises
    ------
    MapFileError
        Where a run has no map, the map is none of the paper's, or two are the same one.
    """
    maps: dict[str, MapFile] = {}
    listed = []
    for run in runs:
        plane = read_map_npz(run / MAP if run.is_dir() else run)
        letter = letter_of(plane, str(run))
        if letter in maps:
            raise MapFileError(f"{run}: Fig 11({letter}) was given already; one run of each map")
        maps[letter] = plane
        listed.append((str(run), _title(letter, plane)))
    return Found(maps, tuple(listed))


def letter_of(plane: MapFile, where: str) -> str:
    """Return which map of Fig 11 this is, by its settings.

    Raises
    ------
    MapFileError
        Where it is none of them; says which setting is another than the paper's.
    """
    given, paper = plane.values, Parameters()
    if (plane.x_name, plane.y_name) != ("f_asym", "f_init_ratio"):
        raise MapFileError(f"{where}: a map over {plane.x_name} and {plane.y_name}; the paper's is over f_asym and "
                           "f_init_ratio")  # fmt: skip
    ends = (plane.x[0], plane.x[-1], plane.y[0], plane.y[-1])
    if not np.allclose(ends, (0.5, 20, 0, 2)):
        raise MapFileError(f"{where}: axes from {ends[0]:g} to {ends[1]:g} and {ends[2]:g} to {ends[3]:g}; the paper's "
                           "are 0.5 to 20 and 0 to 2")  # fmt: skip
    for name in sorted(FIELDS.keys() - CALIBRATION):
        if name in given and given[name] != str(getattr(paper, name)):
            raise MapFileError(f"{where}: {name} = {given[name]}, and {getattr(paper, name)!r} in the paper's maps")
    for letter, (model, v_mid) in LAYOUT.items():
        if given.get("model") == model and float(given.get("v_mid", "nan")) == v_mid:
            break
    else:
        raise MapFileError(f"{where}: {given.get('model')} with v_mid = {given.get('v_mid')} is none of the paper's six "
                           "maps: delta_cremer and stiff_cremer at 0.9, 0.2 and -2")  # fmt: skip
    missing = int(np.isnan(plane.transient_periods).sum())
    if missing:
        raise MapFileError(f"{where}: {missing} cells are not computed; finish the run with bow sweep --resume")
    return letter


def _title(letter: str, plane: MapFile) -> str:
    ny, nx = plane.shape
    own = [f"{name} = {plane.values[name]}" for name in sorted(CALIBRATION - {"model", "v_mid"})
           if plane.values.get(name, str(FIELDS[name].default)) != str(FIELDS[name].default)]  # fmt: skip
    return ", ".join([f"Fig 11({letter}), {nx} × {ny}", *own])


def at_paper_size(plane: MapFile) -> bool:
    """Whether a map is as fine and as long as the paper's: 128 by 64 cells, 100 periods."""
    return plane.shape[0] >= 64 and plane.shape[1] >= 128 and plane.periods >= PERIODS


class Claim(NamedTuple):
    """One claim about maps; `look` returns what was measured, whether it holds and the numbers."""

    key: str
    claim: str
    where: str
    expected: str
    reason: str
    needs: str
    look: Callable[[Maps], tuple[str, bool | None, dict[str, object]]]

    def __call__(self, maps: Maps) -> Row:
        """Return the row."""
        missing = [letter for letter in self.needs if letter not in maps]
        text = (self.key, self.claim, self.where, self.expected)
        if missing:
            runs = ", ".join(f"fig11{letter}" for letter in missing)
            return Row(*text, f"give a run of {runs}", NEEDS_RUNS, self.reason)
        measured, holds, values = self.look(maps)
        coarse = [letter for letter in self.needs if not at_paper_size(maps[letter])]
        if coarse and holds is not None:
            measured += f"; not judged: {', '.join(coarse)} coarser or shorter than the paper's map"
            holds = None
        return row(*text, measured, holds, self.reason, **values)


def _percent(*shares: float, digits: int = 0) -> str:
    return " and ".join(f"{100 * share:.{digits}f} %" for share in shares)


def _fractions(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    ours = {letter: maps[letter].helmholtz_fraction() for letter in TRIAL}
    default = all(
        maps[letter].values.get(name, str(FIELDS[name].default)) == str(FIELDS[name].default)
        for letter in TRIAL for name in CALIBRATION - {"model", "v_mid"}
    )  # fmt: skip
    close = all(abs(ours[letter] - TRIAL[letter]) <= 0.02 for letter in TRIAL)
    return f"{ours['c']:.3f} and {ours['d']:.3f}", close if default else None, {"fractions": ours}


def _stripe(maps: Maps, letter: str) -> tuple[str, bool | None, dict[str, object]]:
    mask = coloured(maps[letter])
    x, y = explained(mask, "x"), explained(mask, "y")
    region = maps[letter].x[columns(mask, 0.5)]
    where = f", stripe from {region[0]:.1f} to {region[-1]:.1f}" if len(region) else ""
    return f"{_percent(x, y)} of the variance{where}", x >= 0.75 and y <= 0.03, {"x": x, "y": y}


def _restricted(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    wide = {k: np.mean(coloured(maps[k]).mean(axis=0) >= 0.1) for k in "abcd"}
    words = ", ".join(f"({k}) {_percent(share)}" for k, share in wide.items())
    return words, min(wide["c"], wide["d"]) > 1.25 * max(wide["a"], wide["b"]), {"share": wide}


def _uneven(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    black, rough = black_share(coloured(maps["b"])), unevenness(maps["b"].transient_periods)
    words = f"{_percent(black)} of the stripe is black; {_percent(rough)} of neighbours differ by more than 5 periods"
    return words, black <= 0.2 and rough >= 0.5, {"black": black, "uneven": rough}


def _specks(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    mask = coloured(maps["d"])
    black, whole = black_share(mask), largest_area(mask) / max(mask.mean(), 1e-9)
    words = f"{_percent(black)} of its region is black; {_percent(whole)} of the coloured cells hang together"
    return words, black <= 0.2 and whole >= 0.9, {"black": black, "contiguous": whole}


def _cut(maps: Maps, one: str, other: str) -> tuple[str, bool | None, dict[str, object]]:
    region = columns(coloured(maps[other]), 0.1)
    filled = [float(coloured(maps[k])[:, region].mean()) for k in (one, other)]
    many = [float(flyback(maps[k]).mean()) for k in (one, other)]
    words = (f"of ({other})'s range of force {_percent(*filled)} are coloured in ({one}) and ({other}); multiple flyback "
             f"on {_percent(*many, digits=1)} of the plane")  # fmt: skip
    return words, filled[0] <= 0.75 * filled[1] and many[0] >= 0.1 and many[1] <= many[0] / 10, {
        "coloured": filled, "flyback": many,
    }  # fmt: skip


EXPONENTS = tuple(round(0.1 * i, 1) for i in range(11))


def _curved(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    shares = {k: curvature(maps[k], flyback(maps[k]), (1.5, 10.0), EXPONENTS) for k in "ce"}
    best = {k: EXPONENTS[int(np.argmax(x))] for k, x in shares.items()}
    gain = {k: max(x) / max(x[0], 1e-9) for k, x in shares.items()}
    words = ", ".join(f"({k}) best p = {best[k]:g}, {gain[k]:.1f} times p = 0" for k in "ce")
    return words, all(best[k] >= 0.2 and gain[k] >= 1.2 for k in "ce"), {"explained": shares}


def _docile(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    areas, rough, late = [], [], []
    for k in "ef":
        low = maps[k].x < LOW_FORCE
        lengths = np.where(low, maps[k].transient_periods, 0)
        areas.append(largest_area(lengths > 0))
        rough.append(unevenness(lengths))
        late.append(float(np.mean(lengths[lengths > 0] > PERIODS / 3)))
    words = (f"largest area {_percent(*areas)} of the plane; {_percent(*rough)} of neighbours differ by more than 5 "
             f"periods; {_percent(*late)} of its transients take more than a third of the run")  # fmt: skip
    holds = min(areas) >= 0.15 and max(rough) <= 0.25 and min(late) >= 0.5
    return words, holds, {"area": areas, "uneven": rough, "late": late}


def _lower_limit(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    limit = {k: force_limit(maps[k]) for k in "df"}
    fuzz = {k: (force_limit(maps[k], 0.9), force_limit(maps[k], 0.1)) for k in "df"}
    words = f"{limit['f']:.1f} in (f), {limit['d']:.1f} in (d); (f) goes from 90 to 10 % over {fuzz['f'][0]:.1f} ... " \
            f"{fuzz['f'][1]:.1f}"  # fmt: skip
    return words, limit["f"] <= 0.9 * limit["d"], {"limit": limit, "fuzz": fuzz}


def _easier(maps: Maps, delta: str, stiff: str, judged: bool) -> tuple[str, bool | None, dict[str, object]]:
    areas = [largest_area(coloured(maps[k])) for k in (delta, stiff)]
    words = f"largest contiguous area {_percent(*areas, digits=1)} of the plane in ({delta}) and ({stiff})"
    return words, areas[1] >= 1.5 * areas[0] if judged else None, {"area": areas}


def _fig10(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    plane = maps["d"]
    correlation = np.nan_to_num(plane.correlation[list(plane.test_periods).index(FIG10_PERIODS)], nan=-1.0)
    high = plane.x > 11.46
    low_share, high_share = (float(np.mean(correlation[:, part] > 0.9)) for part in (~high, high))
    words = f"correlation above 0.9 in {_percent(low_share)} of the cells below f_asym = 11.46, {_percent(high_share)} above"
    return words, low_share >= 0.95 and high_share <= 0.6, {"below": low_share, "above": high_share}


def _period(maps: Maps) -> tuple[str, bool | None, dict[str, object]]:
    slopes = {}
    for k in maps:
        good = maps[k].helmholtz[-1]
        x = np.broadcast_to(np.log2(maps[k].x), good.shape)[good]
        slopes[k] = float(np.polyfit(x, maps[k].period[-1][good], 1)[0]) if good.sum() > 2 else float("nan")
    return ", ".join(f"({k}) {slope:+.2f}" for k, slope in sorted(slopes.items())) + " samples an octave", None, {
        "slope": slopes,
    }  # fmt: skip


CHECKS: tuple[Claim, ...] = (
    Claim("fig10a", "stiff/Cremer, v_mid 0.2, after 40 periods: nearly periodic except at high force", "Fig 10(a), IV.A",
          "everywhere, exception at high bow force", "high force begins at Schelleng's maximum: at least 95 % of the cells "
          "below it, at most 60 % above it correlate by more than 0.9, \"nearly\"", "d", _fig10),
    Claim("fraction", "share of Helmholtz motion, delta and stiff at v_mid 0.2", "PHYSICS.md 8", "0.288 and 0.526",
          "± 0.02, 3.6 standard deviations of 8192 independent cells; not judged with another calibration", "cd",
          _fractions),
    *(
        Claim(f"stripe-{k}", f"({k}) {name}, v_mid 0.9: a vertical stripe, f_asym decides and the transient's shape hardly",
              "Fig 11(a, b), IV.A", "f_asym decides", "of the variance of success f_asym alone explains at least 75 % and "
              "f_init/f_asym alone at most 3 % (the noise of 128 columns is 1 %)", k, lambda maps, k=k: _stripe(maps, k))
        for k, name in (("a", "delta"), ("b", "stiff"))
    ),
    Claim("restricted", "the range of force is restricted at v_mid 0.9 and wider at 0.2", "IV.A", "(c, d) wider than (a, b)",
          "share of the force axis where a tenth of the gestures succeed: at least 1.25 times, as the axis is logarithmic",
          "abcd", _restricted),
    Claim("uneven-b", "(b) few black specks, but colours not smooth: safe but uneven", "Fig 11(b), IV.B", "few; not smooth",
          "at most one cell in five of the stripe black; most neighbours differ by more than the interval of the tests",
          "b", _uneven),
    Claim("specks-d", "(d) a wide region with few black specks", "Fig 11(d), IV.A", "a sprinkling",
          "at most one cell in five black; nine tenths of the colour in one contiguous area", "d", _specks),
    Claim("cut-c", "(c) the same region cut up by black streaks that are multiple flyback", "Fig 11(c, d), IV.A",
          "a great deal of the region is black", "at most 3/4 as much colour as in (d) over the same forces; multiple "
          "flyback on at least a tenth of the plane, and ten times what (d) has", "cd",
          lambda maps: _cut(maps, "c", "d")),
    Claim("cut-e", "(e) delta again cut by multiple-flyback streaks", "Fig 11(e), IV.A", "a significant area",
          "as for (c), against (f)", "ef", lambda maps: _cut(maps, "e", "f")),
    Claim("curved", "the streaks curve as contours of initial force do", "Figs 11(c, e), 12, IV.B", "reminiscent of Fig 12",
          "lines f_asym (f_init/f_asym)^p = const explain the multiple flyback at f_asym 1.5 ... 10 best for a p of 0.2 or "
          "more, 1.2 times as well as vertical ones (p = 0; Fig 12 has p = 1)", "ce", _curved),
    Claim("docile", "(e, f) large smooth area at low force, often with long transients", "Fig 11(e, f), IV.A, IV.B",
          "large, smooth, rather long", "below f_asym = 5: a contiguous 15 % of the plane or more; at most a quarter of "
          "neighbours differ by more than the interval of the tests; half of the transients take a third of the run",
          "ef", _docile),
    Claim("limit-f", "(f) a fuzzy vertical limit at lower force than in (d)", "Fig 11(d, f), IV.A", "(f) below (d)",
          "force up to which half of the gestures succeed: at least 10 % lower, four columns of the map", "df",
          _lower_limit),
    *(
        Claim(f"easier-{one}{two}", f"stiff is easier than delta at v_mid {v}: larger contiguous coloured areas", "IV.A",
              "larger" if judged else "generally larger; the two are similar",
              "at least 1.5 times" if judged else "reported: the paper calls the two stripes alike", one + two,
              lambda maps, one=one, two=two, judged=judged: _easier(maps, one, two, judged))
        for one, two, v, judged in (("a", "b", 0.9, False), ("c", "d", 0.2, True), ("e", "f", -2, True))
    ),
    Claim("flattening-maps", "bow force up: the period of Helmholtz motion lengthens", "III.B, PHYSICS.md 8", "flattening",
          "reported: seen in (b); elsewhere slip jumps lock to the sample grid", "b", _period),
)  # fmt: skip
"""All of them, in the order of the table."""
