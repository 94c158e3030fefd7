"""The paper's claims about terrain, and about which model is easier to play (sections IV.A and IV.B)."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from bow_sweep.maps.map_file import MapFile
from bow_sweep.maps.playability import playability
from bow_sweep.maps.streaks import CLOSE, alignment, contour_directions
from bow_sweep.maps.terrain import BLACK, SAFE_SPECKLE, SMOOTH, SPECKLE, STREAKY, TERRAINS, terrain
from bow_sweep.paper.claim import Claims, Finding, Maps
from bow_sweep.paper.claims_maps import percent

CLAIMS = Claims()
claim = CLAIMS.claim

PAIRS = (("a", "b"), ("c", "d"), ("e", "f"))
"""The maps of delta and stiff at each v_mid."""

MARGIN = 0.1
"""Relative difference up to which areas are alike. Thresholds changed by a tenth change areas by less."""


@functools.lru_cache(maxsize=16)
def codes_of(plane: MapFile) -> np.ndarray:
    """Return the terrain of a map, (ny, nx) uint8."""
    return terrain(plane.transient_periods)


@functools.lru_cache(maxsize=16)
def playability_of(plane: MapFile) -> dict[str, Any]:
    """Return the playability of a map."""
    return playability(plane.transient_periods, plane.regime, plane.regime_names)


def mix(codes: np.ndarray) -> dict[str, float]:
    """Return the terrain of a region: kind -> share of the cells whose terrain is not black."""
    counts = np.bincount(codes.ravel(), minlength=len(TERRAINS))[: len(TERRAINS)]
    rest = max(int(counts[BLACK + 1 :].sum()), 1)
    return {name: float(counts[code] / rest) for code, name in enumerate(TERRAINS) if code != BLACK}


def words(shares: dict[str, float]) -> str:
    """Return shares of terrain as text, the largest first."""
    ranked = sorted(shares.items(), key=lambda item: -item[1])
    return ", ".join(f"{name.replace('_', ' ')} {percent(share)}" for name, share in ranked if share >= 0.005)


def left(plane: MapFile) -> slice:
    """Return the columns left of the middle of the logarithmic axis of force."""
    return slice(0, plane.shape[1] // 2)


@claim(
    "terrain-black",
    "uniform areas of black",
    "IV.B",
    "unambiguous: cannot be played",
    "the first kind of terrain is in each of the six maps, on a fifth of the plane or more",
    "abcdef",
)
def _black(maps: Maps) -> Finding:
    shares = {k: float(np.mean(codes_of(maps[k]) == BLACK)) for k in "abcdef"}
    return Finding(", ".join(f"({k}) {percent(v)}" for k, v in shares.items()), min(shares.values()) >= 0.2, shares)


@claim(
    "terrain-smooth",
    "(e, f) smooth areas to the left of centre",
    "Fig 11(e, f), IV.B",
    "coloured areas where the transient length is smoothly-varying",
    "of the terrain left of the centre that is not black at least half is smooth",
    "ef",
)
def _smooth(maps: Maps) -> Finding:
    found = {k: mix(codes_of(maps[k])[:, left(maps[k])]) for k in "ef"}
    holds = all(shares[TERRAINS[SMOOTH]] >= 0.5 for shares in found.values())
    return Finding("; ".join(f"({k}) {words(shares)}" for k, shares in found.items()), holds, found)


@claim(
    "terrain-safe",
    "(b) the stripe is speckled without black: moderately safe, but rather uneven",
    "Fig 11(b), IV.B",
    "only a low density of black spots, colours not smoothly-varying",
    "of the terrain that is not black at least 60 % is safe speckle, at most 10 % smooth",
    "b",
)
def _safe(maps: Maps) -> Finding:
    shares = mix(codes_of(maps["b"]))
    return Finding(words(shares), shares[TERRAINS[SAFE_SPECKLE]] >= 0.6 and shares[TERRAINS[SMOOTH]] <= 0.1, shares)


@claim(
    "terrain-speckle",
    "(d) towards the right-hand side an example, of sorts, of speckle with black",
    "Fig 11(d), IV.B",
    "coloured pixels interleaved, apparently randomly, with a sprinkling of black; not well represented",
    "in the right-hand quarter there is some, 2 % or more of what is not black, and more of it than streaks",
    "d",
)
def _speckle(maps: Maps) -> Finding:
    nx = maps["d"].shape[1]
    shares = mix(codes_of(maps["d"])[:, nx - nx // 4 :])
    speckle = shares[TERRAINS[SPECKLE]]
    return Finding(words(shares), speckle >= 0.02 and speckle > shares[TERRAINS[STREAKY]], shares)


@claim(
    "terrain-streaky",
    "(c) streaky left of centre in the top half",
    "Fig 11(c), IV.B",
    "coloured pixels interleaved with black regions, with some structure",
    "of the terrain there that is not black at least 40 % is streaky, and half as much again as in the rest of (c)",
    "c",
)
def _streaky(maps: Maps) -> Finding:
    plane = maps["c"]
    there = np.zeros(plane.shape, bool)
    there[plane.shape[0] // 2 :, left(plane)] = True
    shares, rest = mix(codes_of(plane)[there]), mix(codes_of(plane)[~there])[TERRAINS[STREAKY]]
    found = f"{words(shares)}; streaky in the rest {percent(rest)}"
    return Finding(found, shares[TERRAINS[STREAKY]] >= max(0.4, 1.5 * rest), {**shares, "rest": rest})


@claim(
    "terrain-cut",
    "delta is cut by streaks at v_mid 0.2 and -2, stiff far less",
    "Fig 11(c-f), IV.A",
    "a pattern of curving black patches in (c), again in (e)",
    "a twentieth of the plane or more is streaky in (c) and (e), at most half as much in (d) and (f)",
    "cdef",
)
def _cut(maps: Maps) -> Finding:
    share = {k: float(np.mean(codes_of(maps[k]) == STREAKY)) for k in "cdef"}
    holds = all(share[k] >= 0.05 and share[other] <= share[k] / 2 for k, other in ("cd", "ef"))
    return Finding(", ".join(f"({k}) {percent(v, digits=1)}" for k, v in share.items()), holds, share)


@claim(
    "terrain-flyback",
    "the black in the streaks of (c) and (e) is multiple flyback",
    "Fig 11(c, e), IV.A",
    "christened multiple flyback motion",
    "at the last test multiple flyback is what most black cells in streaky terrain are, and at least 40 % of them",
    "ce",
)
def _flyback(maps: Maps) -> Finding:
    is_what = {k: playability_of(maps[k])["black_is"].get("streaky", {}) for k in "ce"}
    share = [is_what[k].get("multiple_flyback", 0.0) for k in "ce"]
    holds = all(mine >= max([0.4, *is_what[k].values()]) for k, mine in zip("ce", share, strict=True))
    return Finding("; ".join(f"({k}) {words(is_what[k])}" for k in "ce"), holds, is_what)


@claim(
    "terrain-fig12",
    "the streaks of (c) and (e) run as the contours of initial force do",
    "Figs 11(c, e), 12, IV.B",
    "very reminiscent of Fig 12; at later times vertical",
    f"within {CLOSE:g} degrees of Fig 12 in at least three quarters of the streaky cells, which a thousandth of "
    "maps with streaks turned at random would be; and closer to Fig 12 than to the vertical; of streaks that are a "
    "twentieth of the plane at least",
    "ce",
)
def _fig12(maps: Maps) -> Finding:
    texts, holds, values = [], True, {}
    for k in "ce":
        plane = maps[k]
        contours, vertical = (
            alignment(plane.transient_periods, contour_directions(plane.x, plane.y, left)) for left in (1.0, 0.0)
        )
        if contours is None or vertical is None:
            return Finding(f"({k}) has no streaks", False, {})
        holds &= float((codes_of(plane) == STREAKY).mean()) >= 0.05
        holds &= contours.close >= 0.75 and contours.turned_p <= 0.001 and vertical.close < contours.close
        texts.append(
            f"({k}) {percent(contours.close)} within {CLOSE:g}°, chance {percent(contours.turned)}; "
            f"{contours.mean:.1f}° ± {contours.error:.1f}° off, spread {contours.spread:.1f}°"
        )
        values[k] = vars(contours)
    return Finding("; ".join(texts), holds, values)


@claim(
    "easier",
    "stiff is easier to play than delta: generally larger contiguous areas of colour",
    "Fig 11, IV.A",
    "generally larger contiguous areas",
    f"the largest contiguous area is greater by more than {percent(MARGIN)} in two pairs of maps at least, by more "
    "than three errors of the interleaved grids too, and smaller in none",
    "abcdef",
)
def _easier(maps: Maps) -> Finding:
    texts, steps, values = [], [], {}
    for pair in PAIRS:
        area = [playability_of(maps[k])["largest_area"] for k in pair]
        delta, stiff = (each["value"] for each in area)
        e1, e2 = (each["error"] for each in area)
        error = float(np.hypot(e1 or 0.0, e2 or 0.0))
        texts.append(f"({pair[0]}, {pair[1]}) {percent(delta, stiff, digits=1)}")
        margin = max(MARGIN * max(delta, stiff), 3 * error)
        steps.append(0 if abs(stiff - delta) <= margin else 1 if stiff > delta else -1)
        values["".join(pair)] = {"delta": delta, "stiff": stiff, "error": error}
    holds = steps.count(1) >= 2 and -1 not in steps
    return Finding("; ".join(texts), holds, values)


@claim(
    "interspersed",
    "stiff is easier to play than delta: less interspersed with black",
    "Fig 11, IV.A",
    "less interspersed with black",
    "of the terrain that is not black a share is streaky or speckled with black that is smaller by a fifth or more in "
    "two pairs of maps at least, and greater by that in none",
    "abcdef",
)
def _interspersed(maps: Maps) -> Finding:
    share = {}
    for k in "abcdef":
        shares = mix(codes_of(maps[k]))
        share[k] = shares[TERRAINS[SPECKLE]] + shares[TERRAINS[STREAKY]]
    text = "; ".join(f"({delta}, {stiff}) {percent(share[delta], share[stiff])}" for delta, stiff in PAIRS)
    ratios = [share[stiff] / max(share[delta], 1e-9) for delta, stiff in PAIRS]
    holds = sum(ratio <= 0.8 for ratio in ratios) >= 2 and max(ratios) <= 1.2
    return Finding(text, holds, share)
