"""The paper's claims about linear modes and friction (section III.A, Figs 3, 4 and 9, Appendix)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from bow_sim.figures.linear import models, transverse
from bow_sim.physics.friction import ambiguous_force, sliding_coefficient
from bow_sim.physics.modes import gaussian_q, torsional_modes
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sweep.paper.claim import Claims, Finding, Maps

TORSIONAL_Q = (25.0, 43.0, 45.0, 45.0, 40.0, 37.0, 33.0, 29.0)
"""The paper's list, modes 1 to 8 (section III.A)."""

GAUSSIAN_Q = (27.5, 42.2, 45.7, 43.8, 40.2, 36.4, 32.9, 29.9)
"""Q factors of the continuous Gaussian (PHYSICS.md section 8)."""

TORSIONAL_HZ = 1056.0
"""2.4 times 440 Hz (section III.A)."""

SCHELLENG, SCHELLENG_EXACT = 12.0, 11.46
"""Maximum bow force: "approximately 12" (Appendix), and by the formula (PHYSICS.md section 8)."""

DISCRETE_Q = {1: 617, 4: 288, 7: 333, 13: 510}
"""Mode -> Q of transverse modes of delta/Cremer: roots of the discrete loop (PHYSICS.md section 3)."""

AMBIGUOUS = {-2.0: 3.71, 0.2: 0.99, 0.9: 0.124}
"""v_mid -> bow force above which friction is ambiguous (PHYSICS.md section 4)."""

CLAIMS = Claims()
claim = CLAIMS.claim


def listed(values: Iterable[float], digits: int = 1) -> str:
    """Return numbers as text, separated by commas, with `digits` digits after the point."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def _furthest(values: np.ndarray, target: object) -> float:
    return float(np.max(np.abs(values / np.asarray(target) - 1)))


@claim(
    "torsional-q",
    "Q factors of torsional modes 1 to 8",
    "III.A",
    "25, 43, 45, 45, 40, 37, 33, 29",
    "within 12 %: whole numbers read off the discrete model; for mode 1 its Gaussian has 27.5 in theory, not 25",
)
def _torsional_q(_maps: Maps) -> Finding:
    q = torsional_modes(models()[0]).q
    worst = _furthest(q, TORSIONAL_Q)
    return Finding(f"{listed(q)}: within {100 * worst:.1f} %", worst <= 0.12, {"q": q})


@claim(
    "torsional-q-theory",
    "the same, by the theory of the Gaussian",
    "PHYSICS.md 8",
    "27.5, 42.2, 45.7, 43.8, 40.2, 36.4, 32.9, 29.9",
    "within 2 %: the taps sample the Gaussian, and cut it off",
)
def _torsional_q_theory(_maps: Maps) -> Finding:
    found = torsional_modes(models()[0])
    worst = _furthest(found.q, GAUSSIAN_Q)
    theory = gaussian_q(found.number, models()[0])
    return Finding(f"{listed(found.q)}: within {100 * worst:.2f} %", worst <= 0.02, {"q": found.q, "theory": theory})


@claim(
    "torsional-frequency",
    "torsional modes 1 to 8 are harmonics of 1056 Hz",
    "III.A",
    "n × 1056 Hz",
    "within 0.5 %, for “quite accurate harmonics”",
)
def _torsional_frequency(_maps: Maps) -> Finding:
    found = torsional_modes(models()[0])
    ratio = found.frequency / found.number
    worst = _furthest(ratio, TORSIONAL_HZ)
    words = f"n × {ratio.min():.1f} ... {ratio.max():.1f} Hz: within {100 * worst:.2f} %"
    return Finding(words, worst <= 0.005, {"frequency": found.frequency})


@claim(
    "torsional-damping",
    "torsional modes are much more highly damped than transverse ones",
    "III.A",
    "much",
    "at least 3 times, for “much”, in either model and in each of the first 8 modes",
)
def _torsional_damping(_maps: Maps) -> Finding:
    delta, stiff = transverse()
    ratio = np.minimum(delta.q[:8], stiff.q[:8]) / torsional_modes(models()[0]).q
    return Finding(f"at least {ratio.min():.1f} times, mode by mode", bool(ratio.min() >= 3), {"ratio": ratio})


@claim(
    "fig3-delta",
    "delta/Cremer: mode frequency over n is flat",
    "Fig 3",
    "within 0.33 %",
    "0.33 % over 30 modes: the bridge's tail adds 0.48 sample of 139 at low frequency and none at high (PHYSICS.md 3)",
)
def _fig3_delta(_maps: Maps) -> Finding:
    delta, _ = transverse()
    ratio = delta.frequency / delta.number
    spread = float(np.ptp(ratio) / ratio.mean())
    words = f"{ratio.min():.2f} ... {ratio.max():.2f} Hz: within {100 * spread:.2f} %"
    return Finding(words, len(ratio) == 30 and spread <= 0.0033, {"frequency_over_n": ratio})


def sharpening() -> tuple[np.ndarray, np.ndarray]:
    """Return n and the excess of the stiff model's mode frequencies over the delta model's, (30,) each."""
    delta, stiff = transverse()
    return stiff.number, stiff.frequency / delta.frequency - 1


@claim(
    "fig3-stiff",
    "stiff/Cremer: higher modes sharpen with the square of n",
    "Fig 3, III.A",
    "approximately quadratic",
    "exponent 2 ± 0.1, by a straight line through modes 5 to 30 in logarithms; below, filter and bridge weigh as much",
)
def _fig3_stiff(_maps: Maps) -> Finding:
    n, excess = sharpening()
    if (excess[4:] <= 0).any():
        return Finding("no sharpening", False, {"excess": excess})
    power = float(np.polyfit(np.log(n[4:]), np.log(excess[4:]), 1)[0])
    return Finding(f"as n to the {power:.2f}", abs(power - 2) <= 0.1, {"excess": excess, "power": power})


@claim(
    "fig3-size",
    "its size is 124/139 of that of a string that is stiff all along",
    "PHYSICS.md 3",
    "1.99 % at n = 30",
    "within 2 % of it: mode 30 is sharper than 30 × 440 Hz, where the formula is taken",
)
def _fig3_size(_maps: Maps) -> Finding:
    n, excess = sharpening()
    p = models()[1]
    whole = (1 - p.beta) * (np.sqrt(1 + p.stiffness_b * n[-1] ** 2) - 1)
    close = abs(excess[-1] / whole - 1) <= 0.02
    return Finding(f"{100 * excess[-1]:.2f} %", bool(close), {"excess": excess[-1], "formula": whole})


@claim(
    "fig4-values",
    "delta/Cremer: Q of modes 1, 4, 7 and 13",
    "PHYSICS.md 3",
    "617, 288, 333, 510",
    "as printed, to the nearest whole number",
)
def _fig4_values(_maps: Maps) -> Finding:
    delta, _ = transverse()
    q = [float(delta.q[n - 1]) for n in DISCRETE_Q]
    close = all(abs(ours - theirs) <= 0.5 for ours, theirs in zip(q, DISCRETE_Q.values(), strict=True))
    return Finding(listed(q), close, {"q": delta.q})


@claim(
    "fig4-order",
    "Q factors of both models are of the same order",
    "Fig 4, III.A",
    "right order of magnitude",
    "medians of 30 modes within a factor of 3, half an order of magnitude",
)
def _fig4_order(_maps: Maps) -> Finding:
    medians = [float(np.median(m.q)) for m in transverse()]
    words = f"medians {medians[0]:.0f} (delta) and {medians[1]:.0f} (stiff)"
    return Finding(words, 1 / 3 <= medians[0] / medians[1] <= 3, {"medians": medians})


@claim(
    "fig4-low",
    "low modes have approximately the same Q in both",
    "Fig 4, III.A",
    "equal",
    "within 2 % for modes 1 to 5: the anti-alias filter is to leave them alone",
)
def _fig4_low(_maps: Maps) -> Finding:
    delta, stiff = transverse()
    worst = _furthest(stiff.q[:5], delta.q[:5])
    return Finding(f"within {100 * worst:.1f} % for modes 1 to 5", worst <= 0.02, {"greatest": worst})


@claim(
    "fig4-high",
    "high modes have lower Q in stiff/Cremer, from its filter",
    "Fig 4, III.A",
    "lower",
    "by more than a tenth at mode 15, and from there the more the higher",
)
def _fig4_high(_maps: Maps) -> Finding:
    delta, stiff = transverse()
    ratio = stiff.q[14:] / delta.q[14:]
    words = f"{ratio[0]:.2f} times at mode 15, {ratio[-1]:.2f} times at mode 30"
    return Finding(words, bool((np.diff(ratio) < 0).all() and ratio[0] < 0.9), {"ratio": ratio})


@claim(
    "schelleng",
    "Schelleng's maximum bow force",
    "Appendix",
    "approximately 12 (formula: 11.46)",
    "within 0.1 % of the formula's four digits, and 5 % of “approximately 12”",
)
def _schelleng(_maps: Maps) -> Finding:
    p = Parameters()
    force = p.v_b / (ends(p).y * p.beta * (p.mu_s - p.mu_d))
    close = abs(force / SCHELLENG_EXACT - 1) <= 0.001 and abs(force / SCHELLENG - 1) <= 0.05
    return Finding(f"{force:.2f}", close, {"force": force})


@claim(
    "fig9-midway",
    "friction is 0.8 on the point of sticking and midway to 0.3 at v_mid",
    "Appendix, Fig 9",
    "0.80 and 0.55",
    "exact but for rounding",
)
def _fig9_midway(_maps: Maps) -> Finding:
    p = Parameters()
    slip = np.array([[0.0, p.v_b - v_mid] for v_mid in AMBIGUOUS])
    mu = np.array([sliding_coefficient(s, p.mu_s, p.mu_d, s[1]) for s in slip])
    exact = bool(np.allclose(mu, [0.8, 0.55], rtol=0, atol=1e-12))
    return Finding(f"{listed(mu.min(axis=0), 2)} for all three v_mid", exact, {"mu": mu})


@claim(
    "fig9-hysteresis",
    "hysteresis grows from v_mid = -2 to 0.2 to 0.9: the bow force at which it begins",
    "IV.A, PHYSICS.md 4",
    "3.71, 0.99, 0.124",
    "to half a unit of the last digit printed",
)
def _fig9_hysteresis(_maps: Maps) -> Finding:
    p = Parameters()
    force = [ambiguous_force(ends(p).y, p.mu_s, p.mu_d, p.v_b - v_mid) for v_mid in AMBIGUOUS]
    close = np.abs(np.array(force) - list(AMBIGUOUS.values())) <= (0.005, 0.005, 0.0005)
    return Finding(listed(force, 3), bool(close.all()), {"force": force})
