"""The paper's claims about the transients of Figs 5 to 8 (sections III.B and III.C)."""

from __future__ import annotations

import functools

import numpy as np

from bow_sim.figures.motion import BOX, CYCLES, OTHER_FORCE, Motion, motion, parting, slips, steady
from bow_sim.kernel.block import Block
from bow_sim.physics.motion import regular_from
from bow_sim.physics.parameters import CHUNK_PERIODS, DTYPES, Parameters
from bow_sweep.maps.in_process import verdicts
from bow_sweep.paper.claim import Claims, Finding, Maps

ONSETS = {5.5: 2224, 5.3: 2922}
"""Bow force -> sample from which the slips are regular in the trial implementation (PHYSICS.md section 8)."""

APART = 0.1
"""Two motions have separated where their bridge forces differ by this times the bow speed; rounding gives 1e-6."""

CLAIMS = Claims()
claim = CLAIMS.claim


@functools.cache
def passed(force: float) -> list[bool]:
    """Return whether the three tests of section III.B pass after every five periods of a transient."""
    p = motion(force).parameters
    return [bool(verdict.passed[0]) for verdict in verdicts(p, {"f_asym": [p.f_asym]})]


@claim(
    "fig5-length",
    "delta/Cremer, f_b = 5.5, v_mid = 0.7: Helmholtz motion after some 16 periods",
    "Fig 5, III.B",
    "some 16 periods; being established by sample 2400",
    "16 ± 1 periods for “some 16”, by sample 2400, and one slip a period (139 ± 5 samples) from there to the end",
)
def _fig5_length(_maps: Maps) -> Finding:
    m = motion()
    onset = regular_from(m.slipping, m.parameters.period)
    if onset is None:
        return Finding("no regular motion within 100 periods", False, {"onset": None})
    periods = onset / m.parameters.period
    words = f"one slip a period from sample {onset} on, {periods:.1f} periods"
    return Finding(words, 15 <= periods <= 17 and onset <= 2 * BOX, {"onset": onset, "periods": periods})


@claim(
    "fig5-onset",
    "the same, to the sample",
    "PHYSICS.md 8",
    "onset 2224",
    "exact: float64 implementations agree to 1e-10 over 30 periods, so every stick/slip decision is the same",
)
def _fig5_onset(_maps: Maps) -> Finding:
    onset = regular_from(motion().slipping, motion().parameters.period)
    return Finding(f"onset {onset}", onset == ONSETS[5.5], {"onset": onset})


@claim(
    "fig6-helmholtz",
    "the periodic motion is Helmholtz motion, and stable",
    "Fig 6, III.B",
    "periodic, one slip and one corner a period",
    "the classifier's three tests pass by period 25 and every five periods from then to the end",
)
def _fig6_helmholtz(_maps: Maps) -> Finding:
    tests = passed(5.5)
    first = next((n for n in range(len(tests)) if all(tests[n:])), len(tests))
    periods = CHUNK_PERIODS * (first + 1)
    words = (
        f"all three tests pass from period {periods} to {CHUNK_PERIODS * len(tests)}"
        if tests[-1]
        else "a test fails at the end"
    )
    return Finding(words, periods <= 25, {"passed": tests})


@claim(
    "fig6-flyback",
    "bridge force is a sawtooth with one sharp flyback a cycle",
    "Fig 6(c)",
    "one fall of v_b/β = 9.27",
    "within a ripple period of 15 samples; its height within 10 %, as the corner is rounded and ripples ride on it",
)
def _fig6_flyback(_maps: Maps) -> Finding:
    _, m = steady()
    ripple, height = m.parameters.bow_bridge, m.parameters.v_b / m.parameters.beta
    fall = m.bridge_force[:-ripple] - m.bridge_force[ripple:]
    number = int(np.sum(np.diff((fall > height / 2).astype(int), prepend=0) == 1))
    words = f"{number} falls in {CYCLES} cycles, of {fall.max():.2f}"
    holds = number == CYCLES and bool(abs(fall.max() / height - 1) <= 0.1)
    return Finding(words, holds, {"falls": number, "height": fall.max()})


def ramp_slope(m: Motion) -> np.ndarray:
    """Return the slope of the bridge force between the first two slips of a motion, (samples,), per sample."""
    (_, first), (last, _) = slips(m.slipping)[:2].tolist()
    return np.diff(m.bridge_force[first + 1 : max(first + 2, last - 1)])


@claim(
    "fig6-ripples",
    "Schelleng's ripples on the ramp have the period of the round trip bow-bridge-bow",
    "Fig 6(c), III.B",
    "15 samples",
    "the ramp's slope is most like itself after 15 of 5 to 25 samples, and by a correlation of more than 0.5",
)
def _fig6_ripples(_maps: Maps) -> Finding:
    _, m = steady()
    slope = ramp_slope(m)
    lags = np.arange(5, 26)
    if len(slope) < 2 * lags[-1]:
        return Finding(f"no ramp: {len(slope)} samples between two slips", False, {"samples": len(slope)})
    likeness = np.array([np.corrcoef(slope[:-lag], slope[lag:])[0, 1] for lag in lags])
    best, most = int(lags[likeness.argmax()]), float(likeness.max())
    words = f"{best} samples (correlation of the slope {most:.2f})"
    return Finding(words, best == m.parameters.bow_bridge and most > 0.5, {"lag": best, "correlation": most})


@claim(
    "fig6-torsion",
    "surface and centre of the string differ, by torsion",
    "Fig 6(a, b), III.B",
    "v = v_b while sticking, v_c not",
    "v exact but for rounding; v_c off, r.m.s., by at least 1 % of the bow speed",
)
def _fig6_torsion(_maps: Maps) -> Finding:
    _, m = steady()
    stuck, v_b = ~m.slipping, m.parameters.v_b
    surface = float(np.abs(m.v[stuck] - v_b).max())
    centre = float(np.sqrt(np.mean((m.v_centre[stuck] - v_b) ** 2)))
    words = f"while sticking v differs from v_b by {surface:g} at most, v_c by {centre:.2f} r.m.s."
    return Finding(words, surface <= 1e-12 and centre >= 0.01, {"surface": surface, "centre": centre})


@claim(
    "fig7-rule",
    "sticking until v_h falls to v_1, slipping until it rises to v_2",
    "III.C, Fig 7",
    "no exception",
    "exact: it is the rule; v_h must also have been between the limits",
)
def _fig7_rule(_maps: Maps) -> Finding:
    m = motion()
    now, before, v_h = m.slipping[1:], m.slipping[:-1], m.v_h[1:]
    released, caught = now & ~before, ~now & before
    broken = np.where(before, now != (v_h <= m.v_2), now != (v_h < m.v_1))
    between = float(np.mean((m.v_h > m.v_1) & (m.v_h < m.v_2)))
    words = (
        f"{broken.sum()} exceptions in {released.sum()} releases and {caught.sum()} captures; "
        f"v_1 = {m.v_1:.2f}, v_2 = {m.v_2:.2f}"
    )
    return Finding(words, not broken.any() and between > 0 and m.v_1 < m.v_2, {"exceptions": broken.sum()})


@claim(
    "fig8-parting",
    "f_b = 5.3 follows 5.5, then parts from it: one slips where the other sticks",
    "Fig 8, III.C",
    "very similar until then; 5.5 slips, 5.3 sticks",
    "the first slip of the one during all of which the other sticks comes after a period and within the figure; "
    "correlation of v above 0.8 before it, and below 0.5 over as long after",
)
def _fig8_parting(_maps: Maps) -> Finding:
    one, other = motion(), motion(OTHER_FORCE)
    at = parting(one.slipping, other.slipping)
    if at is None:
        return Finding("they never part", False, {"sample": None})
    before, after = (float(np.corrcoef(one.v[s], other.v[s])[0, 1]) for s in (slice(at), slice(at, 2 * at)))
    slipping = 5.5 if one.slipping[at] else 5.3
    words = (
        f"{slipping} slips at sample {at}, {at / one.parameters.period:.1f} periods; correlation of v "
        f"{before:.2f} before, {after:.2f} after"
    )
    placed = one.parameters.period < at < 2 * BOX and slipping == 5.5
    return Finding(words, placed and before > 0.8 and after < 0.5, {"index": at, "correlation": [before, after]})


@claim(
    "fig8-length",
    "5.3 also ends in Helmholtz motion, after a transient of another length",
    "Fig 8, III.C",
    "another length",
    "the classifier's three tests pass at period 100 for both; the onsets of regular motion differ",
)
def _fig8_length(_maps: Maps) -> Finding:
    onsets = [regular_from(m.slipping, m.parameters.period) for m in (motion(), motion(OTHER_FORCE))]
    well = passed(5.5)[-1] and passed(OTHER_FORCE)[-1]
    words = f"one slip a period from sample {onsets[1]} on; {onsets[0]} for 5.5"
    return Finding(words, well and None not in onsets and onsets[0] != onsets[1], {"onsets": onsets})


@claim("fig8-onset", "the same, to the sample", "PHYSICS.md 8", "onset 2922", "exact, as for Fig 5")
def _fig8_onset(_maps: Maps) -> Finding:
    onset = regular_from(motion(OTHER_FORCE).slipping, motion().parameters.period)
    return Finding(f"onset {onset}", onset == ONSETS[5.3], {"onset": onset})


@claim(
    "flattening",
    "bow force up: the period lengthens (stiff/Cremer, v_mid = 0.9)",
    "III.B, PHYSICS.md 8",
    "flattening by hysteresis",
    "reported: the trial saw it here, and elsewhere slip jumps lock to the sample grid",
)
def _flattening(_maps: Maps) -> Finding:
    forces = np.geomspace(4, 10, 60)
    *_, last = verdicts(Parameters(model="stiff_cremer", v_mid=0.9), {"f_asym": forces})
    force, period = forces[last.passed], last.period[last.passed]
    if len(force) < 3:
        return Finding("too few Helmholtz motions to say", None, {"periods": period})
    slope = float(np.polyfit(np.log2(force), period, 1)[0])
    words = (
        f"{slope:+.2f} samples an octave of force over {len(force)} Helmholtz motions at f_asym 4 ... 10: "
        f"{period.min():.1f} ... {period.max():.1f} samples"
    )
    return Finding(words, None, {"slope": slope, "force": force, "period": period})


@claim(
    "float32",
    "float32 parts from float64 by a stick/slip decision that rounding tips",
    "PHYSICS.md 8",
    "within a few periods",
    "reported: between decisions errors do not grow, so it takes one within some 1e-6 of its limit; "
    "docs/calibration.md compares the maps",
)
def _float32(_maps: Maps) -> Finding:
    force, ratio = (grid.ravel() for grid in np.meshgrid(np.geomspace(0.5, 20, 32), np.linspace(0, 2, 16)))
    p = Parameters(model="stiff_cremer", v_mid=0.2)
    blocks = [Block(p.replace(dtype=dtype), {"f_asym": force, "f_init_ratio": ratio}) for dtype in DTYPES]
    parted = np.full(len(force), np.inf)
    for chunk in range(1, p.chunks + 1):
        one, other = (block.advance().bridge_force for block in blocks)
        apart = np.abs(one - other).max(axis=1) > APART * p.v_b
        parted[apart & np.isinf(parted)] = chunk * CHUNK_PERIODS
    many = np.isfinite(parted)
    words = f"{many.sum()} of {len(force)} gestures over the plane of Fig 11(d) part within {p.periods} periods"
    if many.any():
        words += f", the first by period {parted.min():.0f}"
    return Finding(words, None, {"periods": parted[many]})
