"""A plain scalar string: PHYSICS.md sections 2 to 5 step by step, in Python numbers, one cell.

The kernel must agree with it bit for bit; so each convolution is summed from the greatest lag to the least, starting at
0, and the four waves are added in the kernel's order. The rest follows the text.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from bow_sim.physics import exact
from bow_sim.physics.body import resonators
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import Body, Ends, Reflection, ends


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
            x = 0.0
            for j in reversed(range(len(r.tail_taps))):
                x += r.tail_taps[j] * self.past(t - r.tail_first - j)
            self.tail = r.pole * self.tail + r.tail * x
            total += self.tail
        return total


@dataclass
class BodySide(Side):
    """A bridge with modes of a body behind it (PHYSICS.md section 11)."""

    body: Body | None = None
    z1: list[float] = field(default_factory=list)
    z2: list[float] = field(default_factory=list)
    cremer: float = 0.0
    force: float = 0.0
    velocity: float = 0.0

    def arriving(self, t: int) -> float:
        x = super().arriving(t)
        if self.body is None:
            return x
        rho, gain, pole = self.body.rho, self.body.gain, self.body.pole
        filters = [tuple(map(float, f)) for f in zip(*resonators(self.body.modes, self.body.sample_rate), strict=True)]
        self.z1, self.z2 = self.z1 or [0.0] * len(filters), self.z2 or [0.0] * len(filters)
        total = math.fsum(b0 for b0, _, _ in filters)
        z = 0.0
        for value in self.z1:
            z += value
        force = ((rho + 1) * (x - z * 0.5) + gain * self.cremer) * (1 / (1 + (1 + rho) * total / 2))
        v_m = total * force + z
        left = x - v_m * 0.5
        back = v_m * 0.5 - rho * left - gain * self.cremer
        self.cremer = pole * self.cremer + left
        for k, (b0, a1, a2) in enumerate(filters):
            y = b0 * force + self.z1[k]
            self.z1[k], self.z2[k] = self.z2[k] - a1 * y, -(b0 * force) - a2 * y
        self.force, self.velocity = force, x + back
        return back


@dataclass
class Contact:
    """Bow and string at the contact: friction, with its memory, and the hair."""

    p: Parameters
    y: float
    slipping: bool = False
    temperature: float = 0.0
    hair: float = 0.0

    def solve(self, d: float, f_b: float) -> float:
        p = self.p
        if p.friction == "coulomb":
            s = abs(d) - f_b * (self.y * p.mu_d)
            self.slipping = abs(d) > f_b * (self.y * p.mu_s)
            return math.copysign(s, d) if self.slipping else 0.0
        if p.friction == "thermal":
            return self.warm(d, f_b)
        if p.friction == "curve":
            return self.on_curve(d, f_b)
        s, self.slipping = friction(d, f_b, self.y, p, self.slipping)
        return s

    def on_curve(self, d: float, f_b: float) -> float:
        """PHYSICS.md section 13: the highest slip speed at which string and friction agree."""
        p = self.p
        curve = [tuple(map(float, word.split("/"))) for word in p.friction_curve.replace(",", " ").split()]
        unit = p.v_unit or 1.0
        x, k = abs(d) * unit, f_b * (self.y * unit)
        s = 0.0
        for i in reversed(range(len(curve))):
            speed, mu = curve[i]
            if x >= k * mu + speed:
                end, low = curve[i + 1] if i + 1 < len(curve) else (math.inf, mu)
                slope = (low - mu) / (end - speed) if end < math.inf else 0.0
                s = max(min(speed + (x - (k * mu + speed)) / (k * slope + 1.0), end), speed)
                break
        self.slipping = x > k * curve[0][1] or (self.slipping and s > 0)
        return math.copysign(s * (1 / unit), d) if self.slipping else 0.0

    def warm(self, d: float, f_b: float) -> float:
        """PHYSICS.md section 13, in the order of its lines."""
        p = self.p
        f_w = 2 * p.z_0 * p.v_unit / p.ribbon_width * f_b
        s, after = 0.0, self.temperature
        for _ in range(2):
            q = (self.temperature + after) * 0.5 / p.rosin_t_g
            q = q * q  # a power of 2 may be rounded otherwise
            mu = p.mu_s * (1 + p.rosin_hot * q) / (1 + q)
            s = max(abs(d) - self.y * f_b * mu, 0.0)
            u = s * p.v_unit
            c = (p.rosin_flow * math.sqrt(u / f_w) if f_b > 0 else 0.0) + p.rosin_rest
            r = c * (1 / (p.sample_rate * p.rosin_heat))
            e = 1 / (1 + r * (1 + r * (0.5 + r * (1 / 6))))
            heated = mu * u / c if f_b > 0 else 0.0
            after = heated + (self.temperature - heated) * e
        self.temperature, self.slipping = after, s > 0
        return math.copysign(s, d)


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
    ratio = p.f_init_ratio
    if p.sustained:  # of Schelleng's maximum (PHYSICS.md section 14)
        ratio = p.sustained * (p.v_b / (ends(p).y * p.beta) / (p.mu_s - p.mu_d)) / p.f_asym
    f_init = (0.0 if p.gesture == "string_crossing" else ratio) * p.f_asym
    f_b = p.f_asym + (f_init - p.f_asym) * exact.exp(-t / p.tau_f)
    v_b = p.v_b
    if p.gesture == "martele":
        v_b = p.v_b + -p.v_b * exact.exp(-t / p.tau_v)
    if p.gesture == "guettler":
        v_b = p.v_b * (p.acceleration / p.period * t)
    if p.gesture == "accelerate_to":
        v_b = p.v_b * min(1.0, p.acceleration / p.period * t)
    return f_b, v_b


def simulate(p: Parameters, samples: int, e: Ends | None = None) -> dict[str, np.ndarray]:
    """Waveforms of one cell, arrays of shape (samples,): as ``kernel.transient``, and slip speed s."""
    e = e or ends(p)
    b, n, rb, rn = BodySide(e.bridge, body=e.body), Side(e.nut), Side(e.torsion_bridge), Side(e.torsion_nut)
    elastic = e.y_t * p.z_0 / p.hair_r if p.hair_r else 0.0
    decay = exact.exp(-p.hair_k / (p.hair_r * p.sample_rate)) if p.hair_r else 0.0
    y = e.y + elastic
    c_t, c_r = e.y_t / 2 / y, e.y_r / 2 / y
    contact = Contact(p, y)
    rows = []
    for t in range(samples):
        in_b, in_n, in_rb, in_rn = b.arriving(t), n.arriving(t), rb.arriving(t), rn.arriving(t)
        v_h = in_b + in_n + in_rn + in_rb
        f_b, v_b = gesture(p, t)
        v_b += contact.hair
        d = v_b - v_h
        s = contact.solve(d, f_b)
        push = d - s
        v = v_h + e.y / y * push if p.hair_r else v_b - s
        end = elastic / y * push
        contact.hair = end + (contact.hair - end) * decay
        b.out.append(in_n + c_t * push)
        n.out.append(in_b + c_t * push)
        rb.out.append(in_rn + c_r * push)
        rn.out.append(in_rb + c_r * push)
        row = (b.out[-1], v, v_h, in_b + in_n + c_t * push, push / y, contact.slipping, s)
        rows.append((*row, b.velocity, b.force, contact.temperature))
    names = ("bridge_force", "v", "v_h", "v_centre", "friction_force", "slipping", "s")
    names += ("bridge_velocity", "bridge_force_real", "temperature")
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
