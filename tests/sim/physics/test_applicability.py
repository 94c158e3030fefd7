"""A map over what has no effect is refused; what is allowed but perhaps not meant is noted."""

from __future__ import annotations

import pytest

from bow_sim.physics.applicability import CONDITIONS, check_axes, notes, notes_of_map
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import SWEEPABLE, Parameters
from bow_sweep.plan.presets import presets
from bow_sweep.plan.sweep import Sweep

VIOLIN = {"string": "violin_g", "v_unit": 0.1}


@pytest.mark.parametrize(
    ("settings", "name", "needs"),
    [
        ({}, "hair_k", "bow hair: hair=NAME, or hair_r=NUMBER in kg/s"),
        ({}, "rosin_t_g", "friction=thermal"),
        ({}, "ribbon_width", "friction=thermal"),
        ({}, "body_scale", "a body: body=NAME"),
        ({}, "body_1_f", "a body: body=NAME"),
        ({"model": "raman"}, "torsion_admittance", "model=torsion_absorbed or delta_cremer or stiff_cremer"),
        ({"model": "torsion_absorbed"}, "torsion_gain", "model=delta_cremer or stiff_cremer"),
        ({"model": "friedlander"}, "bridge_r", "model=torsion_absorbed or delta_cremer or stiff_cremer"),
        ({"model": "delta_cremer"}, "stiffness_b", "model=stiff_cremer"),
        ({"nut_function": "first=120 taps=-1"}, "nut_cutoff", "model=stiff_cremer, without a nut_function"),
        ({}, "corner_width", "model=rounded_corner"),
        ({}, "nut_gain", "model=raman"),
        ({}, "tau_v", "gesture=martele"),
        (VIOLIN, "bow_acceleration", "gesture=guettler or accelerate_to"),
        ({**VIOLIN, "friction": "coulomb"}, "v_0", "friction=hyperbola"),
        ({**VIOLIN, "friction": "thermal"}, "mu_d", "friction=hyperbola or coulomb"),
        ({"friction": "curve", "friction_curve": "0/0.8,1/0.3"}, "mu_s", "a friction law without a curve of its own"),
    ],
)
def test_an_axis_without_effect_is_refused(settings: dict[str, object], name: str, needs: str) -> None:
    p = Parameters.from_mapping(settings)
    with pytest.raises(ParameterError) as error:
        check_axes(p, ("f_asym", name))
    assert str(error.value).startswith(f"y.name = {name!r}: has no effect here; it needs {needs}")


def test_an_axis_with_effect_is_taken() -> None:
    everything = {**VIOLIN, "hair": "hair_soft", "friction": "thermal", "body": "signature", "gesture": "guettler"}
    p = Parameters.from_mapping(everything)
    for name in ("hair_k", "rosin_hot", "body_scale", "body_4_q", "bow_acceleration", "stiffness_b", "torsion_gain"):
        check_axes(p, (name, "force"))
    check_axes(Parameters(z_0=0.3), ("hair_k", "hair_r"))  # the other axis gives the hair
    for condition in CONDITIONS:
        assert set(condition.names) <= SWEEPABLE
    for name in presets():
        Sweep.from_spec(name)


def test_a_sweep_is_refused_before_anything_starts() -> None:
    axis = ["x.name=hair_k", "x.first=1", "x.last=1000"]
    with pytest.raises(ParameterError, match=r"x\.name = 'hair_k': has no effect here"):
        Sweep.from_spec("", axis)
    mode = ["y.name=body_5_f", "y.first=100", "y.last=300", "body=signature", "string=violin_g"]
    with pytest.raises(ParameterError, match=r"at x\.first and y\.first: body_5_f = 100\.0: the body has 4 modes"):
        Sweep.from_spec("", mode)


def test_a_string_that_cannot_be_computed_at_a_corner_is_refused_before_anything_starts() -> None:
    near = ["string=cello_g_a", "x.name=beta", "x.first=0.03", "x.last=0.2"]
    with pytest.raises(ParameterError, match=r"at x\.first and y\.first: torsion_speed: .* too short"):
        Sweep.from_spec("", near)
    Sweep.from_spec("", [*near, "period=278"])


def test_what_is_perhaps_not_meant_is_noted() -> None:
    assert notes(Parameters()) == ()
    twice = Parameters.from_mapping({**VIOLIN, "body": "stoppani"})
    assert [note.partition(":")[0] for note in notes(twice)] == ["body"]
    assert "the body counts twice; bridge=rigid" in notes(twice)[0]
    assert notes(Parameters.from_mapping({**VIOLIN, "body": "stoppani", "bridge": "rigid"})) == ()
    low = Parameters.from_mapping({"string": "cello_g_a", "body": "stoppani", "bridge": "rigid"})
    assert notes(low) == ("body: 9 modes above 0.45 of the sample rate (6130 Hz): left out",)
    coarse = Parameters.from_mapping({"string": "cello_g_a", "v_unit": 0.1, "friction": "thermal"})
    assert "73 us between two samples: should be at most 40" in notes(coarse)[0]
    assert "period=256 for 98 Hz" in notes(coarse)[0]
    assert notes(coarse.replace(period=256, sample_rate=256 * 98.0)) == ()
    assert notes(Parameters(hair_k=1000.0)) == (
        "hair_k = 1000: has no effect here; it needs bow hair: hair=NAME, or hair_r=NUMBER in kg/s",
    )


def test_the_notes_of_a_map_are_those_of_its_corners_each_once() -> None:
    axes = ["x.name=f_0", "x.first=98", "x.last=440", "x.scale=linear", "body=stoppani", "bridge=rigid", "z_0=1"]
    sweep = Sweep.from_spec("", [*axes, "periods=10"])
    assert sweep.notes == ("body: 9 modes above 0.45 of the sample rate (6130 Hz): left out",)
    assert notes_of_map(sweep.parameters, sweep.x, sweep.y) == sweep.notes
