"""A plain scalar string: PHYSICS.md sections 2 to 5 step by step, in Python numbers, one cell.

The kernel must agree with it bit for bit; so each convolution is summed from the greatest lag to the least, starting at
0, and the four waves are added in the kernel's order. The rest follows the text.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import Ends, Reflection, ends


@dataclass
class Side:
    """Outgoing wave and reflection function of one side; before t = 0 the string is at rest."""

    function: Reflection
    out: list[float] = field(default_factory=list)
    tail: float = 0.0

    def past(self, t: int) -> float:
        return self.out[t] if t >= 0 else 0.0

    def arriving(self, t: int) -> float:
        r = self.function
        total = 0.0
        for k in reversed(range(len(r.taps))):
            total += r.taps[k] * self.past(t - r.first - k)
        if r.tail:
            self.tail = r.pole * self.tail + r.tail * self.past(t - r.tail_first)
            total += self.tail
        return total


def friction(d: float, f_b: float, y: float, p: Parameters, slipping: bool) -> tuple[float, bool]:
    """Slip speed and state (PHYSICS.md section 4)."""
    a, x = p.v_b - p.v_mid, abs(d)
    limit, slide = f_b * (y * p.mu_s), f_b * (y * p.mu_d)
    half = (a + slide - x) * 0.5
    under = half * half - a * (limit - x)
    s = math.sqrt(under) - half if under >= 0 else -1.0
    if x > limit or (slipping and s > 0):
        return math.copysign(s, d), True
    return 0.0, False


def gesture(p: Parameters, t: int) -> tuple[float, float]:
    """Bow force and bow speed (PHYSICS.md section 5)."""
    f_init = (0.0 if p.gesture == "string_crossing" else p.f_init_ratio) * p.f_asym
    f_b = p.f_asym + (f_init - p.f_asym) * math.exp(-t / p.tau_f)
    v_b = p.v_b
    if p.gesture == "martele":
        v_b = p.v_b + -p.v_b * math.exp(-t / p.tau_v)
    if p.gesture == "constant_acceleration":
        v_b = p.v_b * min(1.0, p.acceleration / p.period * t)
    return f_b, v_b


def simulate(p: Parameters, samples: int, e: Ends | None = None) -> dict[str, np.ndarray]:
    """Waveforms of one cell, arrays of shape (samples,): as ``kernel.transient``, and slip speed s."""
    e = e or ends(p)
    b, n, rb, rn = Side(e.bridge), Side(e.nut), Side(e.torsion_bridge), Side(e.torsion_nut)
    c_t, c_r = e.y_t / 2 / e.y, e.y_r / 2 / e.y
    slipping = False
    rows = []
    for t in range(samples):
        in_b, in_n, in_rb, in_rn = b.arriving(t), n.arriving(t), rb.arriving(t), rn.arriving(t)
        v_h = in_b + in_n + in_rn + in_rb
        f_b, v_b = gesture(p, t)
        d = v_b - v_h
        s, slipping = friction(d, f_b, e.y, p, slipping)
        push = d - s
        b.out.append(in_n + c_t * push)
        n.out.append(in_b + c_t * push)
        rb.out.append(in_rn + c_r * push)
        rn.out.append(in_rb + c_r * push)
        rows.append((b.out[-1], v_b - s, v_h, in_b + in_n + c_t * push, push / e.y, slipping, s))
    names = ("bridge_force", "v", "v_h", "v_centre", "friction_force", "slipping", "s")
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def intervals(slipping: np.ndarray, s: np.ndarray, chunk: int) -> list[tuple[int, int, int, float]]:
    """Slips cut at the borders of chunks: (chunk, onset in it, duration, sum of s)."""
    found = []
    for number in range(len(s) // chunk):
        onset, total = None, 0.0
        for u in range(chunk + 1):
            slips = u < chunk and slipping[number * chunk + u]
            if slips:
                onset = u if onset is None else onset
                total += s[number * chunk + u]
            elif onset is not None:
                found.append((number, onset, u - onset, total))
                onset, total = None, 0.0
    return found
