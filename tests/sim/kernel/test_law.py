"""A friction law with internal state runs in the kernel, whose source does not change for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scalar_string import Side

from bow_sim.kernel import time_loop
from bow_sim.kernel.block import Block
from bow_sim.physics.friction import hyperbola, solve
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sim.simd.jit import INLINE, njit, overload
from bow_sim.simd.lanes import absolute, load, store


class Melting(NamedTuple):
    """Friction that falls as the contact warms: each slipping step adds heat, and heat decays."""

    a: Any
    limit: Any
    slide: Any
    heat: Any


WARMING, LEAK = 0.01, 0.99

melt = njit(**INLINE)(hyperbola)


@overload(solve, strict=False, jit_options=INLINE)
def _solve_melting(law, lane, d, f_b, slipping):
    if getattr(law, "instance_class", None) is not Melting:
        return None

    def compiled(law, lane, d, f_b, slipping):
        heat = load(law.heat, lane)
        softer = 1.0 / (1.0 + heat)
        s, slips = melt(load(law.a, lane), load(law.limit, lane), load(law.slide, lane), d, f_b * softer, slipping)
        store(law.heat, lane, LEAK * heat + WARMING * absolute(s))
        return s, slips

    return compiled


class MeltingBlock(Block):
    _kernel = staticmethod(time_loop.build(0))

    def _make_law(self, described):
        cold = super()._make_law(described)
        return Melting(*cold, heat=np.zeros(described.count))


def melting_string(p, samples):
    """The scalar string with that law: bridge force."""
    e = ends(p)
    b, n, rb, rn = Side(e.bridge), Side(e.nut), Side(e.torsion_bridge), Side(e.torsion_nut)
    slipping, heat = False, 0.0
    c_t, c_r = e.y_t / 2 / e.y, e.y_r / 2 / e.y
    for t in range(samples):
        in_b, in_n, in_rb, in_rn = b.arriving(t), n.arriving(t), rb.arriving(t), rn.arriving(t)
        d = p.v_b - (in_b + in_n + in_rn + in_rb)
        softer = 1.0 / (1.0 + heat)
        s, slips = hyperbola(p.v_b - p.v_mid, e.y * p.mu_s, e.y * p.mu_d, d, p.f_asym * softer, slipping)
        s, slipping = float(s), bool(slips)
        heat = LEAK * heat + WARMING * abs(s)
        b.out.append(in_n + c_t * (d - s))
        n.out.append(in_b + c_t * (d - s))
        rb.out.append(in_rn + c_r * (d - s))
        rn.out.append(in_rb + c_r * (d - s))
    return np.array(b.out, np.float32)


def test_a_law_with_internal_state_runs_in_the_same_kernel():
    p = Parameters(model="delta_cremer", f_asym=3.0, periods=10)
    block = MeltingBlock(p, {"f_asym": [2.0, 3.0, 9.0]})
    got = np.concatenate([block.advance().bridge_force[1] for _ in range(2)])
    assert got.tobytes() == melting_string(p, p.samples).tobytes()
    cold = Block(p, {"f_asym": [3.0]})
    assert got[:695].tobytes() != cold.advance().bridge_force[0].tobytes()
