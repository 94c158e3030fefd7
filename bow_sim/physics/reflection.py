"""Reflection functions: the response of each end of the string to a wave from the bow, as plain data.

A reflection function is a short list of taps at consecutive lags and, in some models, an exponential tail, which needs
one multiply-add a step instead of a long convolution. All are for velocity waves: a rigid end reflects with -1.

A new model needs, in this file, a function that returns its `Ends` and an entry in :data:`HIERARCHY`, and its name in
:data:`bow_sim.physics.parameters.MODELS`; CONTRIBUTING.md has the whole recipe.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from bow_sim.physics import exact
from bow_sim.physics.body import Mode, modes_of
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection_text import FUNCTIONS, Reflection, check, embed_files, parse

__all__ = [
    "ABSORBED",
    "Ends",
    "Reflection",
    "check",
    "cremer",
    "delta",
    "embed_files",
    "ends",
    "gaussian",
    "parse",
    "stiff",
]

NUT_FFT = 4096
"""Length of the inverse FFT that samples the stiff string's reflection (PHYSICS.md section 3)."""

NUT_PERIODS = 8
"""Least length of that FFT in nominal periods, for strings longer than the paper's."""

NUT_LEFT_OUT = 1e-7
"""Share of the energy of the stiff reflection that is cut off at each end (PHYSICS.md section 3)."""


class Body(NamedTuple):
    """Modes of the body in series with Cremer's spring and dashpot (PHYSICS.md section 11).

    Parameters
    ----------
    modes : tuple of Mode
    rho, gain, pole : float
        Cremer's reflection ``-rho x - gain tail`` with ``tail = pole tail + x``; ``1, 0, 0`` for a bridge of another
        kind.
    sample_rate : float
        Hz.
    """

    modes: tuple[Mode, ...]
    rho: float
    gain: float
    pole: float
    sample_rate: float


class Ends(NamedTuple):
    """The string as the bow meets it.

    Parameters
    ----------
    bridge, nut, torsion_bridge, torsion_nut : Reflection
        Of transverse and of torsional waves at each end.
    y_t, y_r : float
        Characteristic admittances of transverse and torsional waves.
    body : Body or None
        Modes behind the bridge; `bridge` is then what arrives there, and the body sends it back.
    """

    bridge: Reflection
    nut: Reflection
    torsion_bridge: Reflection
    torsion_nut: Reflection
    y_t: float
    y_r: float
    body: Body | None = None

    @property
    def y(self) -> float:
        """Driving-point admittance of the infinite string at the bow, ``(Y_T + Y_R)/2``."""
        return (self.y_t + self.y_r) / 2


ABSORBED = Reflection((0.0,), 1)
"""Nothing is reflected."""


def delta(lag: int, gain: float = 1.0) -> Reflection:
    """Return a reflection with ``-gain`` after ``lag`` samples: a rigid end of an ideal string (section II.B)."""
    return Reflection((-gain,), lag)


def delayed(delay: float, gain: float = 1.0) -> Reflection:
    """Return a rigid end after a delay that is no whole number of samples (PHYSICS.md section 10).

    Lagrange interpolation, of third order with the delay between the two taps in the middle: nowhere more than
    `gain`. A delay below 2 samples is interpolated linearly.

    Parameters
    ----------
    delay : float
        Samples, at least 1; a whole number gives :func:`delta`.
    gain : float
        Minus the sum of the taps.
    """
    whole = math.floor(delay)
    d = delay - whole
    if not d:
        return delta(whole, gain)
    if whole < 2:
        return Reflection((-gain * (1 - d), -gain * d), whole)
    # the delay is 1 + d samples after the first tap
    taps = (
        -d * (d - 1) * (d - 2) / 6,
        (d + 1) * (d - 1) * (d - 2) / 2,
        -(d + 1) * d * (d - 2) / 2,
        (d + 1) * d * (d - 1) / 6,
    )
    return Reflection(tuple(-gain * x for x in taps), whole - 1)


def cremer_rho(r: float) -> float:
    """Return how much of a wave Cremer's bridge reflects at once, from its dashpot in units of the impedance."""
    return (r - 1) / (r + 1)


def cremer(delay: float, r: float, w_c: float, period: int) -> Reflection:
    """Return Cremer's bridge: a spring parallel to a dashpot (section III.A; PHYSICS.md section 3).

    Parameters
    ----------
    delay : float
        Round trip of the bow and the bridge, samples.
    r : float
        Dashpot, in units of the string's impedance.
    w_c : float
        Corner frequency K/R over the angular frequency of the nominal fundamental.
    period : int
        Nominal period, samples.
    """
    k = w_c * (2 * math.pi / period) * r
    rho = cremer_rho(r)
    p = exact.exp(-k / (r + 1))
    arrives = delayed(delay, -1.0)
    return Reflection(
        tuple(-rho * x for x in arrives.taps),
        arrives.first,
        tail=-(1 - rho) * (1 - p),
        pole=p,
        tail_first=arrives.first + 1,
        tail_taps=arrives.taps,
    )


@functools.lru_cache(maxsize=512)
def stiff(lag: float, period: int, b: float, cutoff: float, power: float) -> Reflection:
    """Return the reflection of the long side of a string with bending stiffness (III.A; PHYSICS.md section 3).

    Parameters
    ----------
    lag : float
        Round trip of the bow and the nut for long waves, samples.
    period : int
        Nominal period, samples.
    b : float
        Bending stiffness B: a wholly stiff string has ``f_n = n f_1 sqrt(1 + B n**2)``.
    cutoff, power : float
        The anti-alias filter ``exp(-2 (w/(cutoff pi))**power)``, w in radians a sample.

    Raises
    ------
    ParameterError
        If the function would be longer than its delay allows.
    """
    size = NUT_FFT
    while size < NUT_PERIODS * period:
        size *= 2
    w = 2 * np.pi * np.arange(size // 2 + 1) / size
    x2 = (w * period / (2 * np.pi)) ** 2
    n = np.sqrt(2 * x2 / (1 + np.sqrt(1 + 4 * b * x2)))
    waves = np.array([exact.turn(x) for x in (-2 * np.pi * n * lag / period).tolist()])
    parts = (w / (cutoff * np.pi)).tolist()
    passes = np.array([exact.exp(-2 * exact.power(x, power)) for x in parts])
    h = exact.inverse_real_fft(-passes * waves[:, 0], -passes * waves[:, 1])
    energy = np.cumsum(h * h)
    share = energy / energy[-1]
    first = int(np.argmax(share >= NUT_LEFT_OUT))
    last = int(np.argmax(share >= 1 - NUT_LEFT_OUT))
    if first < 1 or last >= size // 2:  # lags below 0 are at the end of the inverse FFT
        raise ParameterError(
            f"stiffness_b = {b!r} with nut_cutoff = {cutoff!r}, nut_power = {power!r} and the nut {lag} samples away: "
            "the reflection would begin before it was sent; stiffness or cutoff must be less, or the nut farther"
        )
    taps = h[first : last + 1]
    taps = -taps / math.fsum(taps)
    return Reflection(tuple(taps.tolist()), first)


@functools.lru_cache(maxsize=512)
def gaussian(delay: float, width: float, gain: float, half: int) -> Reflection:
    """Return a Gaussian ``exp(-((t - c)/width)**2)`` of sum ``-gain`` and first moment ``delay`` (Appendix).

    Parameters
    ----------
    delay : float
        Round trip, samples; the centre c is moved until the discrete first moment is this.
    width : float
        tau, samples.
    gain : float
        Minus the sum of the taps.
    half : int
        The lags are floor(delay) + 1 - half ... floor(delay) + half, without those below 1.
    """
    near = math.floor(delay)
    lags = range(max(1, near + 1 - half), near + half + 1)

    def weights(centre: float) -> list[float]:
        least = min(
            abs(lag - centre) for lag in lags
        )  # so that the greatest weight is 1 even if the centre is far outside
        return [exact.exp((least * least - (lag - centre) ** 2) / width**2) for lag in lags]

    def moment(centre: float) -> float:
        w = weights(centre)
        return math.fsum(lag * x for lag, x in zip(lags, w, strict=True)) / math.fsum(w)

    reach = 4 * half + 40 * width
    low, high = delay - reach, delay + reach
    if not moment(low) <= delay <= moment(high):
        raise ParameterError(
            f"torsion_speed: the torsional round trip of {delay:.3g} samples is too short for a reflection function "
            "whose first lag is 1; it must be more than 1 sample"
        )
    while True:  # the moment grows with the centre: bisect to the last bit
        centre = (low + high) / 2
        if centre in (low, high):
            break
        low, high = (centre, high) if moment(centre) < delay else (low, centre)
    w = weights(centre)
    total = math.fsum(w)
    return Reflection(tuple(-gain * x / total for x in w), lags[0])


# The hierarchy of section II.B, from the simplest on


def friedlander(p: Parameters) -> Ends:
    """An ideal string between rigid ends, without losses (section II.B; Friedlander 1953, Keller 1953).

    Every periodic motion is unstable where the friction curve falls. Setting: ``model=friedlander``.
    """
    return Ends(delayed(p.bridge_delay), delayed(p.nut_delay), ABSORBED, ABSORBED, p.y_t, 0.0)


def raman(p: Parameters) -> Ends:
    """A string whose ends reflect ``bridge_gain`` and ``nut_gain`` of each wave (section II.B; Raman 1918).

    Waveforms are constant between jumps. Setting: ``model=raman``.
    """
    bridge, nut = delayed(p.bridge_delay, p.bridge_gain), delayed(p.nut_delay, p.nut_gain)
    return Ends(bridge, nut, ABSORBED, ABSORBED, p.y_t, 0.0)


def rounded_corner(p: Parameters) -> Ends:
    """Narrow reflections of finite width, Gaussians of ``corner_width`` (section II.B; Cremer's rounded corner).

    The Helmholtz corner has a finite extent, sharper at higher bow force. Setting: ``model=rounded_corner``.
    """
    bridge, nut = (gaussian(float(d), p.corner_width, 1.0, p.torsion_half) for d in (p.bridge_delay, p.nut_delay))
    return Ends(bridge, nut, ABSORBED, ABSORBED, p.y_t, 0.0)


def torsion_absorbed(p: Parameters) -> Ends:
    """Cremer's bridge, and torsional waves that are not reflected (section II.B, refs. 5 and 18).

    This is the same as a linear shear of the friction curve. Setting: ``model=torsion_absorbed``.
    """
    y_r = p.torsion_admittance * p.y_t
    return Ends(_cremer(p), delayed(p.nut_delay), ABSORBED, ABSORBED, p.y_t, y_r)


def delta_cremer(p: Parameters) -> Ends:
    """Cremer's bridge, a rigid nut, and torsional reflections (section III.A). Setting: ``model=delta_cremer``."""
    near, far = (
        gaussian(d / p.torsion_speed, p.torsion_width, p.torsion_gain, p.torsion_half)
        for d in (p.bridge_delay, p.nut_delay)
    )
    return Ends(_cremer(p), delayed(p.nut_delay), near, far, p.y_t, p.torsion_admittance * p.y_t)


def stiff_cremer(p: Parameters) -> Ends:
    """The same with a stiff string's dispersion on the long side (section III.A). Setting: ``model=stiff_cremer``."""
    nut = stiff(p.nut_delay, p.period, p.stiffness_b, p.nut_cutoff, p.nut_power)
    return delta_cremer(p)._replace(nut=nut)


def _cremer(p: Parameters) -> Reflection:
    return cremer(p.bridge_delay, p.bridge_r, p.bridge_w_c, p.period)


HIERARCHY: dict[str, Callable[[Parameters], Ends]] = {
    "friedlander": friedlander,
    "raman": raman,
    "rounded_corner": rounded_corner,
    "torsion_absorbed": torsion_absorbed,
    "delta_cremer": delta_cremer,
    "stiff_cremer": stiff_cremer,
}
"""The models by name, as in :data:`bow_sim.physics.parameters.MODELS`."""

CREMER = ("torsion_absorbed", "delta_cremer", "stiff_cremer")
"""The models with Cremer's spring and dashpot at the bridge."""


def ends(p: Parameters) -> Ends:
    """Return reflection functions and admittances of a model, with the user's own functions if they are given.

    Parameters
    ----------
    p : Parameters

    Returns
    -------
    Ends

    Raises
    ------
    ParameterError
        If a round trip is too short for a reflection function.
    """
    given: dict[str, Any] = {
        name.removesuffix("_function"): parse(text, name) for name in FUNCTIONS if (text := getattr(p, name))
    }
    made = HIERARCHY[p.model](p)._replace(**given)
    if p.body == "none" and not p.body_modes:
        return made
    found = modes_of(p)
    near = made.bridge
    if p.model in CREMER and "bridge" not in given:
        body = Body(found, cremer_rho(p.bridge_r), -near.tail, near.pole, p.sample_rate)
        return made._replace(bridge=delayed(p.bridge_delay, -1.0), body=body)
    arrives = Reflection(tuple(-x for x in near.taps), near.first, -near.tail, near.pole, near.tail_first)
    return made._replace(bridge=arrives, body=Body(found, 1.0, 0.0, 0.0, p.sample_rate))
