"""Records of known regimes with the imperfections of real ones: jitter, drift, flattening, ripples, rounding, noise.

As in :mod:`kinematics`, nothing here is simulated or uses the classifier: a record is built from the definition of its
regime (:mod:`bow_classifier.verdict.regimes`), cycle by cycle, in Raman's manner. A cycle has corners, jumps of the
bridge force in units of v_b/beta, and slips, in units of v_b N; between corners the force is a ramp that returns to its
first value over a cycle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from kinematics import GEOMETRY, HEIGHT, N, Record
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

CHUNKS = 4
"""Chunks of a record: the last one is classified; long lags and slips across its start need those before."""

SAMPLES = CHUNKS * GEOMETRY.samples
D = GEOMETRY.bow_bridge
BETA = D / N


class Labelled(NamedTuple):
    """A record, the name of its regime, the number that belongs to it (0: none), and its period in samples."""

    record: Record
    regime: str
    count: int  # type: ignore[assignment]  # hides tuple.count, which nobody needs here
    period: float


@dataclass
class Cycle:
    """One period: its length, and the places of jumps and slips, samples from its start."""

    length: float
    jumps: list[tuple[float, float]]
    slips: list[tuple[float, float, float]]
    ripple: float = 0.0


@dataclass(frozen=True)
class Imperfections:
    """How a record differs from a perfect one.

    Attributes
    ----------
    jitter
        Standard deviation of every cycle's length, samples.
    drift
        Relative change of the period from the record's start to its end.
    flattening
        Relative excess of the period over the nominal one.
    ripple
        Amplitude of Schelleng ripples after a jump, in v_b/beta; it decays with a time constant of `decay` ripple
        periods.
    rounding
        Width of a corner, samples.
    noise
        R.m.s. of white noise, in v_b/beta.
    uneven
        Relative standard deviation of jumps and slips.
    """

    jitter: float = 0.0
    drift: float = 0.0
    flattening: float = 0.0
    ripple: float = 0.0
    decay: float = 3.0
    rounding: float = 0.5
    noise: float = 0.0
    uneven: float = 0.0

    @classmethod
    def draw(cls, rng: Generator) -> Imperfections:
        """Draw imperfections as real strings have them: usually small, sometimes large."""
        much = rng.random() ** 2
        flat = rng.uniform(-0.01, 0.03) if rng.random() < 0.2 else rng.uniform(-0.003, 0.003)
        return cls(
            jitter=2.0 * much * rng.random(),
            drift=0.01 * much * rng.uniform(-1, 1),
            flattening=flat,
            ripple=0.3 * rng.random(),
            decay=rng.uniform(2, 5),
            rounding=rng.uniform(0.3, 4.0),
            noise=0.06 * much * rng.random(),
            uneven=0.05 * much * rng.random(),
        )


def render(cycles: Sequence[Cycle], flaws: Imperfections, rng: Generator, samples: int = SAMPLES) -> Record:
    """Return a record of cycles, repeated until it is full; it begins at a random place within the first cycle."""
    t = np.arange(samples, dtype=float)
    starts, totals = [-rng.uniform(0, cycles[0].length)], [0.0]
    jumps: list[tuple[float, float]] = []
    slips: list[tuple[int, int, float]] = []
    force = np.zeros(samples)
    turn = 0
    while starts[-1] < samples:
        cycle, start = cycles[turn % len(cycles)], starts[-1]
        stretch = (1 + flaws.flattening) * (1 + flaws.drift * start / samples)
        uneven = 1 + flaws.uneven * rng.normal(size=len(cycle.jumps) + len(cycle.slips))
        mine = [(start + stretch * at, h * s) for (at, h), s in zip(cycle.jumps, uneven, strict=False)]
        jumps += mine
        for (at, duration, amount), s in zip(cycle.slips, uneven[len(mine) :], strict=True):
            onset, long = round(start + stretch * at), max(1, round(duration))
            if slips and onset <= slips[-1][0] + slips[-1][1]:
                onset = slips[-1][0] + slips[-1][1] + 1
            if onset > 0 and onset + long < samples:
                slips.append((onset, long, abs(amount * s) * N))
        begin = mine[0][0] if mine else start
        height = flaws.ripple if not cycle.ripple else cycle.ripple
        after = np.maximum(t - begin, 0.0)
        if height:
            force += height * HEIGHT * np.sin(2 * np.pi * after / D) * np.exp(-after / (flaws.decay * D))
        totals.append(totals[-1] + sum(h for _, h in mine))
        starts.append(start + stretch * cycle.length + flaws.jitter * rng.normal())
        turn += 1
    steps = np.zeros(samples + 2)
    base = 0.0
    for at, h in jumps:  # a jump between two samples is divided between them
        if at < 0:
            base += h
        elif at < samples:
            whole = int(at)
            steps[whole] += h * (1 - at + whole)
            steps[whole + 1] += h * (at - whole)
    sawtooth = base + np.cumsum(steps)[:samples] - np.interp(t, starts, totals)
    force += HEIGHT * gaussian_filter1d(sawtooth, flaws.rounding, mode="nearest")
    return Record(force + flaws.noise * HEIGHT * rng.normal(size=samples), slips)


# ---- the regimes, each a list of cycles that repeats


def _helmholtz() -> Cycle:
    return Cycle(N, [(14.0, -1.0)], [(8.0, 14, 1.0)])


def _regular(make: Callable[[Generator], tuple[Sequence[Cycle], int]]) -> Callable[[Generator], Labelled]:
    """Return what draws a record, from what draws the cycles of a regime and the number that belongs to it."""

    def draw(rng: Generator) -> Labelled:
        flaws = Imperfections.draw(rng)
        cycles, count = make(rng)
        period = sum(cycle.length for cycle in cycles) * (1 + flaws.flattening)
        return Labelled(render(cycles, flaws, rng), make.__name__, count, period)

    return draw


def helmholtz(rng: Generator) -> tuple[Sequence[Cycle], int]:
    return [_helmholtz()], 1


def helmholtz_extra_slips(rng: Generator) -> tuple[Sequence[Cycle], int]:
    cycle = _helmholtz()
    places = np.sort(rng.choice(np.arange(34, 130, 12), rng.integers(1, 5), replace=False))
    cycle.slips += [(float(at), 4, float(rng.uniform(0.003, 0.10))) for at in places]
    return [cycle], 1


def multiple_slip(rng: Generator) -> tuple[Sequence[Cycle], int]:
    count = int(rng.integers(2, 6))
    apart = rng.dirichlet(np.full(count, 12.0)) * N
    shares = 0.1 + (1 - 0.1 * count) * rng.dirichlet(np.full(count, 6.0))
    places = np.concatenate([[4.0], 4.0 + np.cumsum(apart)[:-1]])
    jumps = [(float(at + 5), -float(share)) for at, share in zip(places, shares, strict=True)]
    slips = [(float(at), max(4.0, 14 * share), float(share)) for at, share in zip(places, shares, strict=True)]
    return [Cycle(N, jumps, slips)], count


def multiple_flyback(rng: Generator) -> tuple[Sequence[Cycle], int]:
    count = int(rng.choice([3, 5, 7], p=[0.5, 0.35, 0.15]))
    apart = rng.uniform(14.5, max(15.5, min(22.0, 80 / (count - 1))))
    heights = rng.uniform(0.75, 1.05, count) * (-1.0) ** np.arange(1, count + 1)
    heights[0] -= 1 + heights.sum()
    jumps = [(12.0 + i * apart, float(h)) for i, h in enumerate(heights)]
    if rng.random() < 0.5:
        return [Cycle(N, jumps, [(6.0, 10 + apart * (count - 1), 1.0)])], count
    flybacks = count // 2 + 1  # the string sticks between the flybacks
    return [Cycle(N, jumps, [(6.0 + 2 * i * apart, 9, 1.0 / flybacks) for i in range(flybacks)])], count


def raman_higher(rng: Generator) -> tuple[Sequence[Cycle], int]:
    cycle = _helmholtz()
    kind = rng.random()
    if kind < 0.6:  # S-motion
        cycle.ripple = rng.uniform(0.65, 1.1)
        return [cycle], 0
    if kind < 0.9:
        share = rng.uniform(0.45, 0.55)
        cycle.jumps = [(14.0, -share), (14.0 + rng.uniform(50, 80), share - 1)]
        return [cycle], 2
    back = rng.uniform(0.5, 0.8)
    cycle.jumps = [(14.0, -0.8), (58.0 + rng.uniform(-6, 6), back), (104.0 + rng.uniform(-6, 6), -0.2 - back)]
    return [cycle], 3


def anomalous_low_frequency(rng: Generator) -> tuple[Sequence[Cycle], int]:
    order = int(rng.integers(1, 3))
    length = N * (1 + order * (1 - BETA))
    passes = [(14.0 + N * (1 - BETA) * (i + 1), float(rng.uniform(-0.2, 0.2))) for i in range(order)]
    rest = -1.0 - sum(h for _, h in passes)
    return [Cycle(length, [(14.0, rest), *passes], [(8.0, 14, length / N)])], order


def subharmonic(rng: Generator) -> tuple[Sequence[Cycle], int]:
    count = int(rng.integers(2, 4))
    depth, shift = rng.uniform(0.1, 0.35), rng.uniform(4, 12)
    pattern = np.array([1.0, -1.0]) if count == 2 else np.array([1.0, 0.0, -1.0])
    cycles = []
    for sign in rng.permutation(pattern):
        size = 1 + depth * sign
        cycle = Cycle(N + shift * sign, [(14.0, -size)], [(8.0, 14 * size, size)], rng.uniform(0.02, 0.3))
        cycles.append(cycle)
    return cycles, count


def aperiodic(rng: Generator) -> Labelled:
    """Raucous motion: corners and slips of random heights at random times."""
    flaws = Imperfections.draw(rng)
    if rng.random() < 0.5:
        lengths = N * rng.uniform(0.35, 1.6, 60)
        sizes = rng.uniform(0.3, 1.3, 60)
    else:
        lengths = np.maximum(40.0, N + rng.uniform(12, 30) * rng.normal(size=60))
        sizes = np.maximum(0.2, 1 + rng.uniform(0.2, 0.5) * rng.normal(size=60))
    cycles = [
        Cycle(float(a), [(14.0, -float(s))], [(8.0, 12, float(s))], float(rng.uniform(0.05, 0.5)))
        for a, s in zip(lengths, sizes, strict=True)
    ]
    return Labelled(render(cycles, flaws, rng), "aperiodic", 0, np.nan)


def no_oscillation(rng: Generator) -> Labelled:
    """Silence, free vibration that decays while the string sticks, or sliding without end."""
    t = np.arange(SAMPLES)
    force = np.full(SAMPLES, rng.uniform(-5, 30)) + rng.uniform(0, 0.012) * HEIGHT * rng.normal(size=SAMPLES)
    kind, slips = rng.random(), []
    if kind > 0.35:
        decay, loud = rng.uniform(3, 30) * N, rng.uniform(0.05, 0.6)
        for k in range(1, 12):
            phase, shift = rng.uniform(0, 2 * np.pi), rng.uniform(0.995, 1.005)
            force += loud / k * HEIGHT * np.sin(2 * np.pi * k * shift * t / N + phase) * np.exp(-t * k**0.5 / decay)
    if kind > 0.7:
        slips = [(30, SAMPLES - 30, (SAMPLES - 30) * rng.uniform(0.2, 1.2))]
    return Labelled(Record(force, slips), "no_oscillation", 0, np.nan)


_PERIODIC = (
    helmholtz,
    helmholtz_extra_slips,
    multiple_slip,
    multiple_flyback,
    raman_higher,
    anomalous_low_frequency,
    subharmonic,
)
DRAW: dict[str, Callable[[Generator], Labelled]] = {
    "no_oscillation": no_oscillation,
    "aperiodic": aperiodic,
    **{make.__name__: _regular(make) for make in _PERIODIC},
}
"""What draws a record of each regime. `other_periodic` is what no definition fits; it cannot be drawn."""


def mixture(number: int, seed: int) -> Iterator[Labelled]:
    """Yield records of all regimes in turn."""
    names = list(DRAW)
    for i in range(number):
        yield DRAW[names[i % len(names)]](np.random.default_rng([seed, i]))


def waveform(record: Record) -> NDArray[np.float64]:
    """Return the bridge force in units of v_b/beta, for pictures."""
    return record.bridge_force / HEIGHT
