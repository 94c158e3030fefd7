"""Cells that nobody chose: body, hair and friction laws agree with the scalar string over ten periods."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scalar_string import simulate

from bow_sim.kernel.block import transient
from bow_sim.physics.body import STOPPANI
from bow_sim.physics.instruments import STRINGS
from bow_sim.physics.parameters import Parameters

PERIODS = 10
EXAMPLES = 6

BODY = {
    "body_modes": st.just(", ".join(STOPPANI.split(", ")[:20])),
    "body_scale": st.floats(0.2, 3),
    "body_7_f": st.floats(150, 1500),
    "body_8_q": st.floats(5, 80),
    "body_9_m": st.floats(0.02, 2),
}
WHOLE_BODY = {"body": st.just("stoppani"), "body_8_ratio": st.floats(0.8, 1.3)}
HAIR = {"hair_k": st.floats(100, 1e5), "hair_r": st.floats(0.5, 20)}
COULOMB = {"friction": st.just("coulomb"), "mu_s": st.floats(0.5, 1.2), "mu_d": st.floats(0.1, 0.4)}
THERMAL = {"friction": st.just("thermal"), "rosin_t_g": st.floats(15, 40), "ribbon_width": st.floats(0.004, 0.012)}
CURVE = {
    "friction": st.just("curve"),
    "friction_curve": st.floats(0.05, 0.4).map(lambda v: f"0/0.9, {v}/0.6, {3 * v}/0.4, {9 * v}/0.35"),
}
ALWAYS = {
    "string": st.sampled_from(sorted(STRINGS)),
    "v_unit": st.floats(0.05, 0.4),
    "force": st.floats(0.1, 2.0),
    "f_init_ratio": st.floats(0.3, 3.0),
    "beta": st.floats(0.05, 0.3),
    "bridge": st.sampled_from(["rigid", "monochord", "surrogate"]),
    "model": st.sampled_from(["delta_cremer", "stiff_cremer"]),
    "period": st.sampled_from([139, 150, 201]),
    "gesture": st.sampled_from(["exponential", "martele", "accelerate_to", "guettler"]),
}
DRAWN: dict[str, dict[str, Any]] = {
    "20 modes": BODY,
    "76 modes": WHOLE_BODY,
    "hair": HAIR,
    "Coulomb": COULOMB,
    "thermal": THERMAL,
    "curve": CURVE,
    "all together": WHOLE_BODY | HAIR | THERMAL,
}


@pytest.mark.full
@pytest.mark.parametrize("what", DRAWN)
def test_a_drawn_cell_agrees_with_the_scalar_string(what: str) -> None:
    slipped = []

    # no shrinking: Hypothesis then traces every line, also those of the compiler
    @settings(max_examples=EXAMPLES, deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
    @given(st.fixed_dictionaries(ALWAYS | DRAWN[what]))
    def agree(drawn: dict[str, Any]) -> None:
        p = Parameters.from_mapping({"periods": PERIODS, **drawn})
        got, want = transient(p), simulate(p, p.samples)
        for name, values in got.items():
            if name == "slipping":
                assert (values == want[name]).all()
            else:
                assert values == pytest.approx(want[name], abs=1e-9, rel=1e-9), name
        slipped.append(bool(got["slipping"].any()))

    agree()
    assert any(slipped)
