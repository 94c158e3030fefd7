"""A friction curve of one's own: one answer by the hysteresis rule, on the curve; others are refused with the place."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scalar_string import simulate

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.friction import curve, sliding_coefficient
from bow_sim.physics.friction_curve import parse, read_curve
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection_text import embed_files

WIDTH = st.floats(0.01, 2.0)


@st.composite
def curves(draw: st.DrawFn) -> str:
    """A curve whose falling pieces become flatter, perhaps with rising ones at the end."""
    falls = sorted(draw(st.lists(st.floats(0.0, 10.0), min_size=1, max_size=5)), reverse=True)
    slopes = [-x for x in falls] + draw(st.lists(st.floats(0.0, 1.0), max_size=2))
    speed, mu = [0.0], [0.0]
    for slope in slopes:
        width = draw(WIDTH)
        speed.append(speed[-1] + width)
        mu.append(mu[-1] + slope * width)
    lift = draw(st.floats(0.05, 1.0)) - min(mu)
    return ", ".join(f"{s!r}/{m + lift!r}" for s, m in zip(speed, mu, strict=True))


@given(curves(), st.floats(0.0, 20.0), st.floats(-30.0, 30.0), st.booleans(), st.sampled_from([1.0, 0.1]))
def test_the_answer_is_the_highest_slip_speed_on_line_and_curve_or_sticking(
    text: str, f_b: float, d: float, slipping: bool, unit: float
) -> None:
    y = 1.617
    points = parse(text)
    s, slips = curve(y * unit, unit, 1 / unit, points, d, f_b, slipping)
    most = y * f_b * float(points.mu[0])
    beyond = lambda speed: speed + y * f_b * points.at(speed * unit) - abs(d)
    grid = np.concatenate([[0.0], np.asarray(points.speed)[1:] / unit, np.linspace(1e-9, abs(d) + 1e-6, 4001)])
    if slips:
        assert slipping or abs(d) > most * (1 - 1e-12)
        assert s * d >= 0
        assert beyond(np.array([abs(s)]))[0] == pytest.approx(0, abs=1e-9 * (1 + abs(d)))
        assert (beyond(grid[grid > abs(s) * (1 + 1e-9) + 1e-9]) > -1e-9 * (1 + abs(d))).all()  # none is higher
    else:
        assert s == 0
        assert abs(d) <= most
        if slipping:
            assert (beyond(grid[grid > 0]) > -1e-9 * (1 + abs(d))).all()  # captured: line and curve do not meet


def hyperbola_of(points: int, a: float) -> str:
    """The paper's curve at as many points, closer where it bends, up to a slip speed of 20."""
    s = 20.0 * np.linspace(0, 1, points) ** 2
    return ", ".join(
        f"{x!r}/{m!r}" for x, m in zip(s.tolist(), sliding_coefficient(s, 0.8, 0.3, a).tolist(), strict=True)
    )


def test_waveforms_converge_to_those_of_the_hyperbola_with_the_number_of_points() -> None:
    own = Parameters(model="delta_cremer", v_mid=-2.0, f_asym=3.0, periods=10)
    want = simulate(own, 4 * 139)
    errors = []
    for points in (8, 32, 128):
        p = own.replace(friction="curve", friction_curve=hyperbola_of(points, 3.0))
        errors.append(np.abs(simulate(p, 4 * 139)["bridge_force"] - want["bridge_force"]).max())
    assert want["slipping"].any() and not want["slipping"].all()
    assert errors[1] < errors[0] / 8
    assert errors[2] < errors[1] / 8  # the error of straight pieces falls with the square of their length
    assert errors[2] < 5e-3


def test_speeds_of_the_curve_are_metres_per_second_where_there_is_a_unit() -> None:
    own = Parameters(model="raman", friction="curve", friction_curve="0/0.8, 0.5/0.4, 2/0.3", periods=5)
    slower = Parameters.from_mapping(
        {"model": "raman", "friction": "curve", "friction_curve": "0/0.8, 0.0625/0.4, 0.25/0.3", "v_unit": 0.125}
    )
    a, b = simulate(own, 300), simulate(slower, 300)
    assert a["slipping"].any() and not a["slipping"].all()
    assert a["bridge_force"] == pytest.approx(b["bridge_force"], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("0/0.8", "1 points: must be 2 ... 1000 of them"),
        ("0/0.8, 0.1", "'0.1': must be slip speed/coefficient, two numbers >= 0"),
        ("0/0.8, 0.1/-0.5", "'0.1/-0.5': must be slip speed/coefficient, two numbers >= 0"),
        ("0/0.8, nan/0.5", "'nan/0.5': must be"),
        ("0.1/0.8, 0.2/0.5", "'0.1/0.8': the first slip speed must be 0"),
        ("0/0, 0.2/0", "'0/0': the first coefficient must be > 0"),
        ("0/0.8, 0.2/0.5, 0.2/0.4", "'0.2/0.4' after '0.2/0.5': slip speeds must rise"),
        (
            "0/0.8, 0.1/0.7, 0.2/0.3",
            "'0.1/0.7' to '0.2/0.3': the coefficient falls more steeply than at a lower slip speed (slope -4 after -1)",
        ),
        ("0/0.8, 0.1/0.9, 0.2/0.3", "'0.1/0.9' to '0.2/0.3': the coefficient falls more steeply"),
        ("0/0.8, 1/0.3, 2/0.4, 3/0.3", "'2/0.4' to '3/0.3': the coefficient falls more steeply"),
    ],
)
def test_a_curve_that_cannot_be_is_refused_with_the_place(text: str, what: str) -> None:
    with pytest.raises(ParameterError) as error:
        Parameters.from_mapping({"friction": "curve", "friction_curve": text}, "my.yaml: ")
    assert str(error.value).startswith("my.yaml: friction_curve: ")
    assert what in str(error.value)


def test_the_coefficients_of_the_law_are_those_at_the_ends_of_the_curve() -> None:
    p = Parameters.from_mapping({"friction": "curve", "friction_curve": "0/0.7, 1/0.2, 2/0.9"})
    assert (p.mu_s, p.mu_d) == (0.7, 0.9)
    assert Parameters.from_settings(p.settings()) == p
    with pytest.raises(ParameterError, match=r"mu_s = 0\.8: is 0\.7 by friction_curve: leave it out"):
        p.replace(mu_s=0.8)


def test_law_and_curve_belong_together() -> None:
    with pytest.raises(ParameterError, match=r"friction = 'curve': needs friction_curve=0/0\.8"):
        Parameters(friction="curve")
    with pytest.raises(ParameterError, match="friction_curve: must be empty with friction = 'hyperbola'"):
        Parameters(friction_curve="0/0.8, 1/0.3")


def test_a_curve_is_read_from_a_file(tmp_path) -> None:
    path = tmp_path / "mu.txt"
    for content in ("slip speed m/s,mu\n0,0.8\n0.1,0.5 # rosin\n", "0 0.8\n0.1 0.5\n", "0/0.8\n0.1/0.5 % mine\n"):
        path.write_text(content)
        assert embed_files([f"friction_curve=@{path}"]) == ("friction_curve=0/0.8, 0.1/0.5",)
    path.write_text("0 0.8\n0.1 0.5 3\n")
    with pytest.raises(ParameterError) as error:
        read_curve(path)
    assert str(error.value) == f"{path}, line 2: '0.1 0.5 3': must be a slip speed and a coefficient"
    with pytest.raises(ParameterError, match="cannot be read"):
        read_curve(tmp_path / "none.txt")


def test_beyond_the_last_point_it_is_constant_and_a_piece_parallel_to_the_line_has_an_answer() -> None:
    points = parse("0/0.8, 1/0.3")
    assert points.at(np.array([0.0, 0.5, 1.0, 50.0])) == pytest.approx([0.8, 0.55, 0.3, 0.3])
    f_b = 2.0  # the slope of Y f_b mu is -1: the line lies on the piece
    s, slips = curve(1.0, 1.0, 1.0, points, 1.6000000001, f_b, True)
    assert slips and 0 < s <= 1.0000000002
    assert math.isfinite(s)
