"""Whether small differences grow: repeats, edges of maps, and exponents (section 15)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.block import Block
from bow_sim.kernel.tangent import follow, slope
from bow_sim.physics.friction import sliding_coefficient
from bow_sim.physics.gesture import force_and_speed
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sweep.beyond.claim import Claims, Finding, Maps, Point
from bow_sweep.beyond.drawing import BLUE, MUTED, ORANGE
from bow_sweep.beyond.sweeps import EDGES, JITTERS
from bow_sweep.edges.bisection import bisect
from bow_sweep.edges.boundary import edges_of
from bow_sweep.edges.exponent import LEFT_OUT, exponent
from bow_sweep.edges.parting import KINDS
from bow_sweep.plan.sweep import Sweep

CLAIMS = Claims()
claim = CLAIMS.claim

TRIAL = {1e-6: (0.0, 0.0), 1e-4: (0.0, 2.0), 1e-3: (7.0, 25.0), 1e-2: (17.0, 50.0)}
"""Jitter of both forces -> share of repeats with another verdict, and with another transient length, percent."""


@claim(
    "repeats",
    "stiff, v_mid 0.2: repeats with forces a little off end otherwise in the more cells the greater the jitter",
    "PHYSICS.md 15; trial of 40 cells",
    "trial",
    "another verdict at a jitter of 1e-6, 1e-4, 1e-3, 1e-2 in 0, 0, about 7, about 17 %; another transient length in "
    "0, 2, 25, 50 %",
    "half of it for “about”, at least 2 points; transients of the cells with Helmholtz motion",
    *JITTERS,
)
def _repeats(maps: Maps) -> Finding:
    verdicts, transients, points = [], [], []
    for (jitter, (verdict, transient)), name in zip(TRIAL.items(), JITTERS, strict=True):
        plane = maps[name]
        assert plane.reliability is not None
        played = plane.transient_periods > 0
        verdicts.append(100 * (1 - float(np.nanmean(plane.reliability.reliability))))
        transients.append(100 * (1 - float(np.nanmean(plane.reliability.same_transient[played]))))
        points += [
            Point.about(f"another verdict at {jitter:g}, %", verdicts[-1], verdict, max(verdict / 2, 2)),
            Point.about(f"another transient at {jitter:g}, %", transients[-1], transient, max(transient / 2, 2)),
        ]
    words = f"another verdict {', '.join(f'{share:.1f}' for share in verdicts)} %; another transient length "
    words += f"{', '.join(f'{share:.0f}' for share in transients)} %"

    def draw(axes: Any) -> None:
        for i, (found, name, colour) in enumerate(((verdicts, "verdict", BLUE), (transients, "transient", ORANGE))):
            axes.semilogx(list(TRIAL), [pair[i] for pair in TRIAL.values()], "o", color=colour, mfc="none", ms=9)
            axes.semilogx(list(TRIAL), found, ".-", color=colour, label=f"another {name} (circles: trial)")
        axes.set(xlabel="jitter of the bow forces", ylabel="share of repeats, %")
        axes.legend(loc="upper left")

    return Finding(words, tuple(points), draw)


KIND = {"edge_1": "decision", "edge_2": "decision", "edge_3": "grain", "edge_4": "grain", "edge_5": "unstable"}
PARTING = {"edge_1": 10, "edge_2": 7, "edge_3": 11, "edge_4": 14}
GROWTH = 0.2
"""Sweep -> kind of its first edge, and period of parting; growth of the unstable one, per period."""

NEVER_HELMHOLTZ = "edge_1"
"""In it no cell ends in Helmholtz motion; the outcome is the name of the motion."""


@claim(
    "edges",
    "first edges along the ratio of the forces, 24 values 0.02 to 2: decision, grain of samples, or unstable",
    "PHYSICS.md 15",
    "trial",
    "stiff -2, f 8: decision in period 10; stiff 0.9, 3.7: decision in period 6; stiff 0.2, 1.2: grain, parting in 11; "
    "delta 0.2, 2: grain, parting in 14; delta -2, 3: unstable, growing by about 0.2 a period",
    "the kinds as claimed; partings exact (of the second decision at most two periods later); growth within 0.1",
    *EDGES,
)
def _edges(maps: Maps) -> Finding:
    points, said, curves = [], [], {}
    for name, title in EDGES.items():
        plane = maps[name]
        outcome = "regime" if name == NEVER_HELMHOLTZ else "helmholtz"
        found = edges_of(plane, outcome).only(np.array([0]))
        edges = bisect(Sweep.from_spec("", plane.settings), found, outcome)
        kind, parting = KINDS[int(edges.kind[0])], int(edges.parting[0, -1])
        curves[f"{title}: {kind}"] = edges.parting[0]
        points.append(Point.true(f"{title}: {KIND[name]}", kind == KIND[name]))
        if name in PARTING:
            points.append(Point(f"{title}: parting", parting, PARTING[name], PARTING[name], 1))
            said.append(f"{kind} {parting}")
        else:
            points.append(Point.about(f"{title}: growth", float(edges.growth[0]), GROWTH, 0.1))
            said.append(f"{kind}, growing by {float(edges.growth[0]):.2f} a period")

    def draw(axes: Any) -> None:
        for name, parting in curves.items():
            axes.plot(
                np.arange(1, len(parting) + 1), np.where(parting < 0, np.nan, parting), ".-", ms=3, lw=0.8, label=name
            )
        axes.set(xlabel="halvings of the bracket", ylabel="parting, periods")
        axes.legend(fontsize=7)

    return Finding("; ".join(said), tuple(points), draw)


ROOTS = {(1.0, 1.0): 0.050, (0.99, 0.98): 0.020, (0.9, 0.7): -0.41}
"""Reflections at bridge and nut -> exponent of steady sliding: the roots of the loop."""


SLIDING_PERIODS = 401
"""Periods in which the linearised motion is followed, the kick included."""


def _steady_slope(p: Parameters) -> float:
    """Return dv/dv_h under a bow that slides at a constant speed on a string with two delta reflections."""
    y, slip, arriving = float(ends(p).y), p.v_b, p.v_b
    rigid = p.bridge_gain * p.nut_gain >= 1  # then the waves that go out are those that come back, turned
    for _ in range(200):  # until the speed agrees with the force, and with what comes back of it from both ends
        push = y * p.f_asym * float(sliding_coefficient(np.array([slip]), p.mu_s, p.mu_d, p.v_b - p.v_mid)[0])
        ways = [[1, p.nut_gain], [p.bridge_gain, 1]]
        out = np.full(2, push / 2) if rigid else np.linalg.solve(ways, [push, push])
        arriving = p.v_b + p.bridge_gain * float(out[0]) + p.nut_gain * float(out[1])
        slip = arriving - push
    return float(slope(p.v_b - p.v_mid, y * p.mu_d, slip, arriving, p.f_asym, True))


@claim(
    "exponent-sliding",
    "steady sliding of a string with two deltas: the exponent is that of the loop's roots; without losses unstable",
    "PHYSICS.md 15",
    "theory",
    "+0.050 without losses, +0.020 at gains 0.99 and 0.98, -0.41 at 0.9 and 0.7, per period",
    "within 0.004, and half a unit of the last digit",
)
def _exponent_sliding(maps: Maps) -> Finding:
    found = {}
    for gains in ROOTS:
        p = Parameters(
            model="raman", bridge_gain=gains[0], nut_gain=gains[1], period=40, bow_bridge=7, v_mid=0.0, f_asym=0.1
        )
        kick = np.random.default_rng(1).uniform(-1, 1, p.period)
        growth = follow(ends(p), p.period, np.full(p.period * SLIDING_PERIODS, _steady_slope(p)), kick).growth
        found[gains] = float(np.mean(growth[1 + LEFT_OUT :]))
    points = tuple(
        Point.about(
            f"gains {bridge:g}, {nut:g}", found[bridge, nut], wanted, 0.004 + (0.005 if wanted < -0.1 else 0.0005)
        )
        for (bridge, nut), wanted in ROOTS.items()
    )

    def draw(axes: Any) -> None:
        axes.plot(range(3), list(ROOTS.values()), "o", color=ORANGE, ms=9, label="roots of the loop")
        axes.plot(range(3), list(found.values()), ".", color=BLUE, ms=8, label="ours")
        axes.axhline(0, color=MUTED, lw=0.7)
        axes.set_xticks(range(3), [f"gains {bridge:g}, {nut:g}" for bridge, nut in ROOTS])
        axes.set(ylabel="exponent per period", xlim=(-0.5, 2.5))
        axes.legend()

    return Finding(", ".join(f"{value:+.4f}" for value in found.values()), points, draw)


APART = 1e-7
"""Relative difference of the bow forces of two motions that are compared with the linearised one."""

ALIKE = 20
"""Periods over which they are compared."""

LINEARISED = {
    "delta, v_mid 0.2, f 4": {"model": "delta_cremer", "v_mid": 0.2, "f_asym": 4.0},
    "stiff, -2, f 3, two modes": {
        "model": "stiff_cremer",
        "v_mid": -2.0,
        "f_asym": 3.0,
        "f_init_ratio": 0.5,
        "body_modes": "430/30/k0.01, 900/20/k0.02",
    },
}


def _linearised(p: Parameters) -> tuple[NDArray[Any], NDArray[Any], bool]:
    """Return the derivative of the bridge force over the logarithm of bow force: of two motions, and linearised.

    Under the bow a change of force df_b adds ``(mu_d s + mu_s a)/(2 s + a + A - |D|) df_b`` to friction where the
    string slips; the rest is the linearised motion of PHYSICS.md section 15.

    Returns
    -------
    real, linear : ndarray, shape (samples,)
    decided : bool
        Whether the two motions stick and slip alike.
    """
    block = Block(p, {"f_asym": p.f_asym * np.array([1.0, 1 + APART, 1 - APART])}, trace=True)
    y, a = float(block.admittance[0]), p.v_b - p.v_mid
    parts = []
    for _ in range(p.chunks):
        block.advance()
        assert block.traces is not None
        parts.append(block.traces[:, :, :3].copy())
    trace = dict(zip(block.trace_names, np.concatenate(parts, axis=1), strict=True))
    f_b, v_b = force_and_speed(p, 0, p.samples)
    s, d, slips = v_b - trace["v"][:, 0], v_b - trace["v_h"][:, 0], trace["slipping"] != 0
    slopes = slope(a, y * p.mu_d, s, d, f_b, slips[:, 0])
    size = np.abs(s)
    with np.errstate(divide="ignore", invalid="ignore"):
        force = np.sign(s) * (p.mu_d * size + p.mu_s * a) / (2 * size + a + y * f_b * p.mu_d - np.abs(d))
    kick = np.where(slips[:, 0], force * f_b, 0.0)
    found = follow(ends(p), p.samples, slopes, kick)  # one period that is as long as the motion: nothing is rescaled
    real = (trace["bridge_force"][:, 1] - trace["bridge_force"][:, 2]) / (2 * APART)
    return real, found.force, bool((slips[:, 1] == slips[:, 0]).all() and (slips[:, 2] == slips[:, 0]).all())


@claim(
    "linearised",
    "the linearised motion is that of two motions a little apart, as long as both stick and slip alike",
    "PHYSICS.md 15",
    "identity",
    "the same within 1e-6 over 20 periods, for motions 1e-7 apart",
    "1e-6 of the greatest difference, over 20 periods without a decision between; the bow forces are 1e-7 apart",
)
def _two_motions(maps: Maps) -> Finding:
    points, off, shown = [], [], {}
    for name, settings in LINEARISED.items():
        real, linear, alike = _linearised(Parameters.from_mapping(settings | {"periods": ALIKE}))
        off.append(float(np.abs(real - linear).max() / np.abs(real).max()))
        points += [Point(f"{name}: difference", off[-1], 0.0, 1e-6), Point.true(f"{name}: no decision between", alike)]
        shown[name] = real, linear
    words = f"within {' and '.join(f'{x:.1e}' for x in off)} of the greatest difference"

    def draw(axes: Any) -> None:
        for (name, (real, linear)), colour in zip(shown.items(), (BLUE, ORANGE), strict=True):
            periods = np.arange(len(real)) / Parameters().period
            axes.plot(periods, real, color=colour, lw=3, alpha=0.3, label=f"{name}: two motions")
            axes.plot(periods, linear, color=colour, lw=0.7, label="linearised")
        axes.set(xlabel="periods", ylabel="d bridge force/d ln bow force")
        axes.legend(loc="upper right", ncols=2, fontsize=7)

    return Finding(words, tuple(points), draw)


EXPONENTS = {
    ("delta_cremer", 0.9, 5.5): -0.044,
    ("delta_cremer", 0.9, 18.0): -0.092,
    ("stiff_cremer", 0.2, 5.5): -0.047,
    ("stiff_cremer", 0.2, 25.0): -0.080,
    ("stiff_cremer", 0.9, 14.0): -0.089,
    ("stiff_cremer", -2.0, 8.0): -0.045,
}
"""Model, v_mid and force -> exponent per period."""


@claim(
    "exponent-motion",
    "the paper's strings in Helmholtz and in raucous motion: between decisions a small change decays",
    "PHYSICS.md 15",
    "trial",
    "-0.044, -0.092, -0.047, -0.080, -0.089, -0.045 per period",
    "within 0.006, and negative",
)
def _exponent_motion(maps: Maps) -> Finding:
    found = {
        key: exponent(Parameters(model=key[0], v_mid=key[1], f_asym=key[2])).value  # of the paper's other settings
        for key in EXPONENTS
    }
    names = {key: f"{key[0].partition('_')[0]} {key[1]:g}, f {key[2]:g}" for key in EXPONENTS}
    points = tuple(
        Point(names[key], found[key], wanted - 0.006, min(wanted + 0.006, 0), 0.006)
        for key, wanted in EXPONENTS.items()
    )

    def draw(axes: Any) -> None:
        axes.plot(range(len(found)), list(EXPONENTS.values()), "o", color=ORANGE, ms=9, label="trial")
        axes.plot(range(len(found)), list(found.values()), ".", color=BLUE, ms=8, label="ours")
        axes.axhline(0, color=MUTED, lw=0.7)
        axes.set_xticks(range(len(found)), names.values(), fontsize=7)
        axes.set(ylabel="exponent per period")
        axes.legend(loc="center right")

    return Finding(", ".join(f"{value:+.3f}" for value in found.values()), points, draw)
