"""Identities, the linear theory of string and body, and thermal friction without an oscillation: sections 11 to 13."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.block import Block, transient
from bow_sim.physics.body import Mode, resonators
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import Body, ends
from bow_sweep.beyond.claim import Claims, Finding, Maps, Point
from bow_sweep.beyond.drawing import BLUE, MUTED, ORANGE
from bow_sweep.beyond.formulas import split_frequencies

CLAIMS = Claims()
claim = CLAIMS.claim


@claim(
    "off",
    "with everything new off the waveforms are the old ones: a body with kappa = 0, and a bow hair without give",
    "PHYSICS.md 11, 12",
    "identity",
    "the same bits",
    "no sample differs in 20 periods of both models at three forces",
)
def _off(maps: Maps) -> Finding:
    forces = [2.0, 5.5, 12.0]
    different, shown, compared = {}, {}, 0
    for model in ("delta_cremer", "stiff_cremer"):
        p = Parameters(model=model, periods=20)
        old = _bridge_force(p, {"f_asym": forces})
        cases: dict[str, tuple[Parameters, dict[str, Any]]] = {
            "kappa = 0": (p.replace(body_modes="440/30/k0.01"), {"body_scale": [0.0] * 3}),
            "rigid hair": (p.replace(z_0=0.2), {"hair_r": [0.0, 0.0, 3.0]}),
        }
        for name, (changed, lanes) in cases.items():
            new = _bridge_force(changed, {"f_asym": forces, **lanes})
            cells = 3 if name == "kappa = 0" else 2  # the third bow of the second case has hair, for the same kernel
            bits, now = old[:cells].view(np.uint32), new[:cells].view(np.uint32)
            different[f"{model}, {name}"] = int(np.count_nonzero(bits != now))
            compared += bits.size
            shown[name] = new[1]
        shown["old"] = old[1]
    words = f"{sum(different.values())} of {compared} samples differ"
    points = tuple(Point(name, count, 0, 0) for name, count in different.items())
    return Finding(words, points, partial(_draw_off, shown))


def _bridge_force(p: Parameters, lanes: dict[str, Any]) -> NDArray[np.float32]:
    block = Block(p, lanes)
    return np.concatenate([block.advance().bridge_force for _ in range(p.chunks)], axis=1)


def _draw_off(shown: dict[str, NDArray[np.float32]], axes: Any) -> None:
    t = np.arange(len(shown["old"])) / 139
    axes.plot(t, shown["old"], color=BLUE, lw=2.2, label="stiff_cremer, f = 5.5")
    for name, colour in (("kappa = 0", ORANGE), ("rigid hair", "0.9")):
        axes.plot(t, shown[name], color=colour, lw=0.7, ls="--", label=f"with {name}")
    axes.set(xlabel="periods", ylabel="bridge force", xlim=(0, t[-1]))
    axes.legend(loc="upper right", ncols=3)


# The reflection at a bridge with a body


SIZE = 14
"""Logarithm to base 2 of the samples in which the response has decayed."""


def bridge_response(body: Body, samples: int) -> NDArray[np.float64]:
    """Return what the recursion of PHYSICS.md section 11 sends back of a unit impulse, (samples,)."""
    b0, a1, a2 = resonators(body.modes, body.sample_rate)
    sum_b = math.fsum(b0)
    den = 1 / (1 + (1 + body.rho) * sum_b / 2)
    z1, z2 = np.zeros_like(b0), np.zeros_like(b0)
    tail, out = 0.0, np.empty(samples)
    for t in range(samples):
        x, z = float(t == 0), float(z1.sum())
        force = ((1 + body.rho) * (x - z / 2) + body.gain * tail) * den
        velocity = sum_b * force + z
        rest = x - velocity / 2
        out[t] = velocity / 2 - body.rho * rest - body.gain * tail
        tail = body.pole * tail + rest
        y = b0 * force + z1
        z1, z2 = z2 - a1 * y, -b0 * force - a2 * y
    return out


def reflection(body: Body, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return ``(Z_0 Y - 1)/(Z_0 Y + 1)`` at points of the z plane, with the bilinear s of each mode."""
    cremer = -body.rho - body.gain / (z - body.pole)
    y = (1 + cremer) / (1 - cremer)
    for f, q, kappa in body.modes:
        own = 2 * np.pi * f / body.sample_rate
        s = own / math.tan(own / 2) * (z - 1) / (z + 1)
        y = y + kappa * own * s / (s * s + s * own / q + own * own)
    return (y - 1) / (y + 1)


@claim(
    "reflection",
    "reflection of the recursion at a bridge with Cremer's spring and dashpot and three modes; it gives no energy",
    "PHYSICS.md 11",
    "theory",
    "(Z_0 Y - 1)/(Z_0 Y + 1); at most 1; -1 at rest",
    "1e-10 at 8191 frequencies; 1 + 1e-12; and the kernel's waves follow the recursion within 1e-12",
)
def _reflection(maps: Maps) -> Finding:
    p = Parameters(sample_rate=12000.0, body_modes="440/10/k0.05, 900/8/k0.01, 5000/12/k0.3", periods=10)
    body = ends(p).body
    assert body is not None
    response = bridge_response(body, 1 << SIZE)
    w = 2 * np.pi * np.arange(1, 1 << (SIZE - 1)) / (1 << SIZE)
    got, wanted = np.fft.rfft(response)[1:-1], reflection(body, np.exp(1j * w))
    kernel = transient(p)
    arriving = (kernel["bridge_velocity"] + kernel["bridge_force_real"]) / 2
    sent_back = (kernel["bridge_velocity"] - kernel["bridge_force_real"]) / 2
    again = np.convolve(arriving, response[: len(arriving)])[: len(arriving)]
    points = (
        Point("largest difference", float(np.abs(got - wanted).max()), 0, 1e-10),
        Point("largest |r|", float(np.abs(got).max()), 0, 1 + 1e-12),
        Point("r at rest", float(response.sum()), -1 - 1e-10, -1 + 1e-10),
        Point("kernel against recursion", float(np.abs(again - sent_back).max()), 0, 1e-12),
    )
    words = (
        f"differs by {points[0].found:.1e}; |r| up to {points[1].found:.9f}; {points[2].found:.9f} at rest; "
        f"the kernel's waves within {points[3].found:.1e}"
    )
    return Finding(words, points, partial(_draw_reflection, w * p.sample_rate / (2 * np.pi), got, wanted))


def _draw_reflection(f: NDArray[np.float64], got: NDArray[Any], wanted: NDArray[Any], axes: Any) -> None:
    axes.semilogx(f, np.abs(wanted), color=ORANGE, lw=2.5, label="formula")
    axes.semilogx(f, np.abs(got), color=BLUE, lw=0.8, label="recursion")
    axes.set(xlabel="Hz", ylabel="|reflection|", xlim=(50, f[-1]))
    axes.legend(loc="lower left")


# A string and a mode of the body of the same frequency

F_0, PERIOD = 440.0, 139

STEPS = 20
"""Of Newton's method: it doubles the digits with each, but begins slowly where the two roots are nearly one."""


def loop_roots(q: float, kappa: float) -> tuple[float, float]:
    """Return the frequencies (Hz) of a free string whose bridge is one mode at its own frequency, nothing else lost."""
    rate = F_0 * PERIOD
    body = Body((Mode(F_0, q, kappa),), 1.0, 0.0, 0.0, rate)
    w_1 = 2 * np.pi / PERIOD
    apart = np.sqrt(complex(kappa / (2 * np.pi) - 1 / (16 * q * q)))
    out = []
    for sign in (-1, 1):
        w = w_1 * (1 + 1j / (4 * q) + sign * apart)  # a first guess; Newton's method by differences does the rest

        def loop(w: complex) -> complex:
            z = np.exp(1j * np.array([w]))
            return complex(1 + reflection(body, z)[0] * z[0] ** -PERIOD)

        for _ in range(STEPS):
            step = 1e-7 * w_1
            w = w - loop(w) * 2 * step / (loop(w + step) - loop(w - step))
        out.append(float(w.real) * rate / (2 * np.pi))
    return min(out), max(out)


@claim(
    "two-peaks",
    "a free string and a mode of equal frequency: two frequencies where kappa Q^2 is above 0.39, one below",
    "PHYSICS.md 11; the form is Gough's (1981)",
    "theory",
    "f_0 (1 +- sqrt(kappa/2 pi - 1/(16 Q^2))): 422.83 and 457.17 Hz at kappa 0.01, Q 30",
    "within 0.1 %; below the threshold less than 0.1 % apart",
)
def _two_peaks(maps: Maps) -> Finding:
    q, kappas = 30.0, np.geomspace(1e-4, 0.02, 30)
    roots = np.array([loop_roots(q, kappa) for kappa in kappas])
    low, high = loop_roots(q, 0.01)
    want_low, want_high = split_frequencies(F_0, q, 0.01)
    one_low, one_high = loop_roots(q, 0.3 / q**2)
    points = (
        Point.about("lower, Hz", low, want_low, 0.001 * want_low),
        Point.about("upper, Hz", high, want_high, 0.001 * want_high),
        Point("apart at kappa Q^2 = 0.3, Hz", one_high - one_low, 0, 0.001 * F_0),
    )
    words = f"{low:.2f} and {high:.2f} Hz; {one_high - one_low:.3f} Hz apart at kappa Q^2 = 0.3"
    return Finding(words, points, partial(_draw_peaks, q, kappas, roots))


def _draw_peaks(q: float, kappas: NDArray[np.float64], roots: NDArray[np.float64], axes: Any) -> None:
    wanted = np.array([split_frequencies(F_0, q, kappa) for kappa in kappas])
    for i in range(2):
        axes.semilogx(kappas * q * q, wanted[:, i], color=ORANGE, lw=2.5, label="formula" if not i else None)
        axes.semilogx(kappas * q * q, roots[:, i], ".", color=BLUE, ms=3, label="roots of the loop" if not i else None)
    axes.axvline(2 * np.pi / 16, color=MUTED, lw=0.7, ls=":")
    axes.set(xlabel=r"$\kappa Q^2$", ylabel="Hz")
    axes.legend(loc="upper left")


# Steady sliding with thermal friction

SLIDING = {0.01: (1.030, 4.5), 0.1: (0.916, 13.0), 0.5: (0.749, 23.9), 1.0: (0.673, 30.5)}
"""Slip speed (m/s) -> friction coefficient and temperature (K) of steady sliding under 1 N."""


def steady_sliding(speed: float) -> tuple[float, float]:
    """Return friction coefficient and temperature (K) of sliding under 1 N at a slip speed (m/s), by the kernel.

    The string reflects nothing and has a large impedance, so its speed hardly changes.
    """
    wanted, _ = SLIDING.get(speed, (0.8, 0.0))
    z_0 = 100.0
    force = 1 / (2 * z_0 * speed)
    p = Parameters.from_mapping(
        {
            "model": "torsion_absorbed",
            "torsion_admittance": 0.0,
            "bridge_function": "first=15 taps=0",
            "nut_function": "first=124 taps=0",
            "friction": "thermal",
            "rosin": "rosin",
            "z_0": z_0,
            "v_unit": speed,
            "f_asym": force,
            "v_b": 1 + force * wanted,
            "v_mid": -10.0,
            "periods": 100,
        }
    )
    motion = transient(p)
    return float(motion["friction_force"][-1] / force), float(motion["temperature"][-1])


@claim(
    "steady-sliding",
    "steady sliding with thermal friction under 1 N: friction falls as speed heats the rosin",
    "PHYSICS.md 13",
    "theory",
    "mu 1.030, 0.916, 0.749, 0.673 and T 4.5, 13.0, 23.9, 30.5 K at 0.01, 0.1, 0.5, 1 m/s",
    "half a unit of the last digit",
)
def _steady_sliding(maps: Maps) -> Finding:
    found = {speed: steady_sliding(speed) for speed in SLIDING}
    points = []
    for speed, (mu, kelvin) in found.items():
        points.append(Point.about(f"mu at {speed:g} m/s", mu, SLIDING[speed][0], 0.0006))
        points.append(Point.about(f"T at {speed:g} m/s, K", kelvin, SLIDING[speed][1], 0.06))
    mus, kelvins = (", ".join(f"{pair[i]:.{3 - 2 * i}f}" for pair in found.values()) for i in (0, 1))
    return Finding(f"mu {mus}; T {kelvins} K", tuple(points), partial(_draw_sliding, found))


def _draw_sliding(found: dict[float, tuple[float, float]], axes: Any) -> None:
    axes.semilogx(list(SLIDING), [mu for mu, _ in SLIDING.values()], "o", color=ORANGE, ms=9, label="expected")
    axes.semilogx(list(found), [mu for mu, _ in found.values()], ".-", color=BLUE, label="kernel")
    axes.set(xlabel="slip speed, m/s", ylabel="friction coefficient")
    axes.legend(loc="lower left")
