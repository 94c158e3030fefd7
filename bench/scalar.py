"""The same work as the kernel's by a plain scalar loop: one cell after the other, one number at a time, by Numba.

It is PHYSICS.md sections 2 to 5 as one writes them down, and as the string of the tests (tests/sim/scalar_string.py)
has them: loops over taps, a branch for stick and slip, waves in arrays. Its results are the kernel's to the last bit.
It is compiled without reference counts, as the kernel is; with Numba's defaults it takes twice as long.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_sim.kernel.arguments import SIDES
from bow_sim.kernel.block import Block, ChunkResult
from bow_sim.physics import friction, gesture
from bow_sim.physics.cells import cells
from bow_sim.physics.parameters import Parameters
from bow_sim.simd.jit import INLINE, njit


@njit(**INLINE)
def arriving(side: Any, number: Any, state: Any, out: Any, now: Any) -> Any:
    """Return what arrives from a side: taps over what left it, and its exponential tail, if there is one."""
    taps, first, (gain, pole, tail_first), total = side
    for k in range(len(taps) - 1, -1, -1):
        total += taps[k] * out[now - first - k]
    if gain != 0:
        state[number] = pole * state[number] + gain * out[now - tail_first]
        total += state[number]
    return total


@njit(nogil=True, _nrt=False, error_model="numpy", cache=True)
def simulate_cell(
    sides: Any, law: Any, force: Any, speed: Any, share: Any, half: Any, chunk: Any, rest: Any, waves: Any, state: Any,
    bridge_force: Any, count: Any, onset: Any, duration: Any, slip: Any,
) -> None:  # fmt: skip
    """Simulate one cell.

    Parameters
    ----------
    sides : tuple of (taps, first, (tail, pole, tail_first), 0), bridge, nut, torsion at bridge and nut
    law : tuple of float
        a, Y mu_s, Y mu_d.
    force, speed : ndarray, shape (samples,)
        f_b(t) and v_b(t).
    share : tuple of float
        Of transverse and of torsional waves in the string's answer to a push.
    half : float
        One half in the type of the waves.
    chunk : int
        Samples between two borders at which slips are cut.
    rest : int
        Samples at rest before the first.
    waves : tuple of four ndarrays, shape (rest + samples,)
        Outgoing waves: rest, then what this writes.
    state : ndarray, shape (4,)
        Of the exponential tails.
    bridge_force : ndarray of float32, shape (samples,)
    count, onset, duration, slip : ndarray, shapes (chunks,) and (chunks, most)
        Slips of each chunk.
    """
    bridge, nut, torsion_bridge, torsion_nut = sides
    to_bridge, to_nut, to_torsion_bridge, to_torsion_nut = waves
    a, limit, slide = law
    c_t, c_r = share
    nothing = half - half
    total = nothing
    slipping = False
    number = place = 0
    for t in range(len(force)):
        now = rest + t
        in_b = arriving(bridge, 0, state, to_bridge, now)
        in_n = arriving(nut, 1, state, to_nut, now)
        in_rb = arriving(torsion_bridge, 2, state, to_torsion_bridge, now)
        in_rn = arriving(torsion_nut, 3, state, to_torsion_nut, now)
        v_h = in_b + in_n + in_rn + in_rb
        d = speed[t] - v_h
        x = abs(d)
        most = force[t] * limit
        s = nothing
        slips = x > most
        if slips or slipping:
            h = (a + force[t] * slide - x) * half
            under = h * h - a * (most - x)
            s = math.sqrt(under) - h if under >= 0 else nothing
            slips = slips or s > 0
            s = (-s if d < 0 else s) if slips else nothing
        push = d - s
        to_bridge[now] = in_n + c_t * push
        to_nut[now] = in_b + c_t * push
        to_torsion_bridge[now] = in_rn + c_r * push
        to_torsion_nut[now] = in_rb + c_r * push
        bridge_force[t] = to_bridge[now]

        k = count[number]
        if slips:
            if place == 0 or not slipping:
                onset[number, k] = place
                total = nothing
            total += s
            if place == chunk - 1:
                duration[number, k] = chunk - onset[number, k]
                slip[number, k] = total
                count[number] = k + 1
        elif slipping and place:
            duration[number, k] = place - onset[number, k]
            slip[number, k] = total
            count[number] = k + 1
        slipping = slips
        place += 1
        if place == chunk:
            place = 0
            number += 1


class PlainLoop:
    """Cells as in `bow_sim.kernel.block.Block`, whole simulations, one at a time.

    Only what all cells share decides the reflections: ``lanes`` may name bow force and its ratio, no more.
    """

    def __init__(self, parameters: Parameters, lanes: dict[str, NDArray[Any]]) -> None:
        if not lanes.keys() <= {"f_asym", "f_init_ratio"}:
            raise ValueError(f"{sorted(lanes)}: the plain loop takes f_asym and f_init_ratio only")
        p = self.parameters = parameters
        described = cells(p, lanes)
        self.cells = described.count
        kind = np.dtype(p.dtype).type
        (ends,) = described.ends
        functions = [getattr(ends, side) for side in SIDES]
        self._sides = tuple(
            (np.array(r.taps, kind), r.first, (kind(r.tail), kind(r.pole), r.tail_first), kind(0)) for r in functions
        )
        level = gesture.levels(p.gesture, *(described.value(name) for name in ("f_asym", "f_init_ratio", "v_b")))
        shape_f, shape_v = (shape.astype(kind) for shape in gesture.shapes(p, 0, p.samples))
        f_end, f_step, v_0, v_1 = (np.broadcast_to(x, self.cells).astype(kind) for x in level)
        self._force = f_end[:, None] + f_step[:, None] * shape_f
        self._speed = v_0[:, None] + v_1[:, None] * shape_v
        self._law = [np.broadcast_to(x, self.cells).astype(kind) for x in friction.law_of(described)]
        self._share = (kind(ends.y_t / 2 / ends.y), kind(ends.y_r / 2 / ends.y))
        self._half = kind(0.5)
        self._rest = max(r.last for r in functions) + 1
        self._waves = tuple(np.zeros(self._rest + p.samples, kind) for _ in SIDES)
        self._state = np.zeros(len(SIDES), kind)
        most = p.chunk_samples // 2 + 1
        self._slips = tuple(np.empty((p.chunks, most), dtype) for dtype in (np.uint32, np.uint32, np.float64))
        self._count = np.zeros(p.chunks, np.int64)
        self.bridge_force = np.empty((self.cells, p.samples), np.float32)

    def simulate(self, cell: int) -> None:
        """Simulate a cell: its bridge force stays in `bridge_force`, its slips until the next one."""
        self._count[:] = self._state[:] = 0
        law = tuple(column[cell] for column in self._law)
        simulate_cell(
            self._sides, law, self._force[cell], self._speed[cell], self._share, self._half,
            self.parameters.chunk_samples, self._rest, self._waves, self._state,
            self.bridge_force[cell], self._count, *self._slips,
        )  # fmt: skip

    def slips(self) -> list[tuple[int, int, int, float]]:
        """Return the slips of the latest cell: (chunk, onset, duration, slip)."""
        onset, duration, slip = self._slips
        return [
            (number, int(onset[number, k]), int(duration[number, k]), float(slip[number, k]))
            for number, count in enumerate(self._count)
            for k in range(count)
        ]


def check(parameters: Parameters, lanes: dict[str, NDArray[Any]]) -> None:
    """Compare all cells with the kernel's.

    Raises
    ------
    ArithmeticError
        Where a bit differs.
    """
    block, plain = Block(parameters, lanes), PlainLoop(parameters, lanes)
    chunks = [block.advance() for _ in range(parameters.chunks)]
    force = np.concatenate([chunk.bridge_force for chunk in chunks], axis=1)
    for cell in range(plain.cells):
        plain.simulate(cell)
        same = force[cell].tobytes() == plain.bridge_force[cell].tobytes()
        if not same or _slips(chunks, cell) != plain.slips():
            raise ArithmeticError(
                f"{parameters.model}, {parameters.dtype}, cell {cell}: the kernel and the plain loop differ"
            )


def _slips(chunks: list[ChunkResult], cell: int) -> list[tuple[int, int, int, float]]:
    return [
        (number, int(r.onset[k]), int(r.duration[k]), float(r.slip[k]))
        for number, r in enumerate(chunks)
        for k in range(r.offsets[cell], r.offsets[cell + 1])
    ]
