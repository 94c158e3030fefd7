"""Kinematic records of a bowed string, built from Raman's description: bridge force and slips of known regimes.

The bridge force is a ramp with jumps: a corner that reaches the bridge is a jump of height v_b/beta (section III.B).
Nothing here is simulated, so the right verdict is known in advance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bow_classifier.block_classifier import Geometry
from bow_classifier.features.slips import Intervals

GEOMETRY = Geometry(period=139, bow_bridge=15, samples=695)
N = GEOMETRY.period
HEIGHT = N / GEOMETRY.bow_bridge
"""v_b/beta."""

SAMPLES_OF_STREAMS = 5 * GEOMETRY.samples
"""Length of the records that test_stream.py sends."""


class Record(NamedTuple):
    """One cell: bridge force (samples,) and its slips (onset, duration, integrated slip), in order."""

    bridge_force: NDArray[np.float64]
    slips: list[tuple[int, int, float]]


def motion(
    samples: int,
    *,
    jumps: Sequence[tuple[float, float]],
    slips: Sequence[tuple[float, int, float]],
    period: float = N,
    phase: float = 0.25,
) -> Record:
    """Return a strictly periodic motion.

    Parameters
    ----------
    samples
        Length.
    jumps
        Of one period: (place as a fraction of the period, height in v_b/beta).
    slips
        Of one period: (place of the onset, duration in samples, integrated slip in v_b N).
    period
        Samples.
    phase
        Where in the period t = 0 lies, 0 ... 1.
    """
    t = np.arange(samples)
    force = np.zeros(samples)
    drift = 0.0
    intervals: list[tuple[int, int, float]] = []
    for place, height in jumps:
        turns = np.round(
            t / period + phase - place, 9
        )  # without it, rounding would shift some of the jumps by a sample
        force += height * HEIGHT * np.floor(turns)
        drift += height
    force -= drift * HEIGHT * (t / period + phase)
    for place, duration, slip in slips:
        turn = np.arange(-2, samples / period + 2)
        for onset in np.ceil(np.round((turn + place - phase) * period, 6)).astype(int):
            if 0 < onset < samples:
                intervals.append((int(onset), duration, slip * N))
    return Record(force, sorted(intervals))


FLYBACK = (0.1, -1.0)
WHOLE_SLIP = (0.05, 15, 1.0)


def helmholtz(samples: int, **more: float) -> Record:
    """One corner, one slip a period."""
    return motion(samples, jumps=[FLYBACK], slips=[WHOLE_SLIP], **more)


def multiple_slip(samples: int, count: int = 2, **more: float) -> Record:
    """`count` equal slips and corners a period."""
    places = [(i + 0.3 * (i % 2)) / count for i in range(count)]
    return motion(
        samples,
        jumps=[(place + 0.05, -1.0 / count * 1.3) for place in places],
        slips=[(place, 12, 1.0 / count) for place in places],
        **more,
    )


def multiple_flyback(samples: int, corners: int, **more: float) -> Record:
    """One slip a period; the flyback is a cluster of an odd number of corners, of alternating sign."""
    apart = 20 / N
    return motion(
        samples,
        jumps=[(0.1 + i * apart, -1.0 if i % 2 == 0 else 1.0) for i in range(corners)],
        slips=[(0.05, 15 + 20 * (corners - 1), 1.0)],
        **more,
    )


def sticking_flybacks(samples: int, corners: int, **more: float) -> Record:
    """As `multiple_flyback`, but the string sticks shortly between the flybacks: a cluster of slips."""
    record = multiple_flyback(samples, corners, **more)
    slips = [
        (onset + 20 * i, 10, slip / corners)
        for onset, _, slip in record.slips
        for i in range(corners)
        if onset + 20 * i + 10 < samples
    ]
    return Record(record.bridge_force, slips)


def with_ripple_slips(record: Record, size: float = 0.02) -> Record:
    """Add a small slip, of `size` v_b N, some time after each one, as Schelleng ripples cause them."""
    extra = [(onset + duration + 20, 4, size * N) for onset, duration, _ in record.slips]
    inside = [slip for slip in extra if slip[0] + slip[1] < len(record.bridge_force)]
    return Record(record.bridge_force, sorted(record.slips + inside))


def aperiodic(samples: int, seed: int = 1) -> Record:
    """Noise below some kilohertz, slips at random times, five a chunk."""
    rng = np.random.default_rng(seed)
    force = np.convolve(rng.normal(size=samples + 9), np.ones(10), "valid") * HEIGHT / 10
    moments = [
        start + onset
        for start in range(0, samples, GEOMETRY.samples)
        for onset in sorted(rng.choice(np.arange(20, GEOMETRY.samples - 40, 40), 5, replace=False))
    ]
    return Record(force, [(int(onset), 10, float(rng.uniform(0.3, 1.5)) * N) for onset in moments])


def silence(samples: int, level: float = 3.0) -> Record:
    """The string sticks to the bow and does not move."""
    return Record(np.full(samples, level), [])


def chunks(records: Sequence[Record], samples: int = GEOMETRY.samples) -> list[tuple[NDArray[np.float32], Intervals]]:
    """Return a block of cells as the chunks of the two streams; the sum of a slip across a border is divided."""
    count = len(records[0].bridge_force) // samples
    force = np.array([record.bridge_force for record in records], dtype=np.float32)
    result = []
    for chunk in range(count):
        start, end = chunk * samples, (chunk + 1) * samples
        offsets, parts, slipping = [0], [], []
        for record in records:
            mine = []
            for onset, duration, slip in record.slips:
                begin, stop = max(onset, start), min(onset + duration, end)
                if begin < stop:
                    mine.append((begin - start, stop - begin, slip * (stop - begin) / duration))
            parts += mine
            offsets.append(len(parts))
            slipping.append(any(onset < start <= onset + duration for onset, duration, _ in record.slips))
        columns = list(zip(*parts, strict=True)) or [(), (), ()]
        result.append(
            (
                np.ascontiguousarray(force[:, start:end]),
                Intervals(
                    np.array(slipping, np.uint8),
                    np.array(offsets, np.uint32),
                    np.array(columns[0], np.uint32),
                    np.array(columns[1], np.uint32),
                    np.array(columns[2], np.float64),
                ),
            )
        )
    return result
