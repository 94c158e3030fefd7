"""Schelleng's limits of bow force, and gestures that begin at a share of the maximum."""

from __future__ import annotations

import numpy as np
import pytest

from bow_sim.physics.cells import cells
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.friction import sliding_coefficient
from bow_sim.physics.gesture import force_and_speed
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sim.physics.schelleng import difference, force_for, greatest, slip_speed

STEEL = Parameters.from_mapping({"string": "violin_d_steel", "friction": "thermal", "v_unit": 0.1})


def newton(p: Parameters, force: float) -> float:
    return force * p.y_t * p.z_0 * p.v_unit


def test_the_maximum_is_that_of_the_paper() -> None:
    p = Parameters()
    assert greatest(p.friction, vars(p), ends(p).y) == pytest.approx(11.46, abs=0.005)


def test_the_difference_of_friction_is_that_of_the_curve_at_the_slip_speed() -> None:
    p = Parameters()
    slip = slip_speed(vars(p))
    assert slip == pytest.approx(139 / 15 - 1)
    mu = sliding_coefficient(np.array([slip]), p.mu_s, p.mu_d, p.v_b - p.v_mid)
    assert difference("hyperbola", vars(p)) == pytest.approx(p.mu_s - mu[0])
    assert difference("hyperbola", vars(p), whole=True) == difference("coulomb", vars(p)) == pytest.approx(0.5)


def test_a_curve_of_ones_own_is_read_at_the_slip_speed() -> None:
    paper, y = {"beta": 0.1, "friction": "curve", "friction_curve": "0/0.8, 2/0.5, 20/0.3"}, 1.617
    p = Parameters.from_mapping(paper)
    assert slip_speed(vars(p)) == pytest.approx(9)
    assert difference("curve", vars(p)) == pytest.approx(0.8 - (0.5 - 0.2 * 7 / 18))
    assert greatest("curve", vars(p), y) == pytest.approx(1 / (y * 0.1 * 0.5))
    si = Parameters.from_mapping({**paper, "v_unit": 0.2})  # the points are m/s
    assert difference("curve", vars(si)) == pytest.approx(0.3 * 1.8 / 2)


def steady_mu(p: Parameters, force: float, u: float) -> float:
    """Friction of steady sliding at a force in N and a speed in m/s, by iteration (PHYSICS.md section 13)."""
    t = 0.0
    for _ in range(2000):
        q = (t / p.rosin_t_g) ** 2
        mu = p.mu_s * (1 + p.rosin_hot * q) / (1 + q)
        t += 0.1 * (mu * u / (p.rosin_flow * (u * p.ribbon_width / force) ** 0.5 + p.rosin_rest) - t)
    return mu


@pytest.mark.parametrize(("u", "mu"), [(0.01, 1.030), (0.1, 0.916), (0.5, 0.749), (1.0, 0.673)])
def test_warm_rosin_has_the_friction_of_steady_sliding(u: float, mu: float) -> None:
    p = STEEL.replace(beta=0.1, speed=u / 9, v_mid=-1)
    assert slip_speed(vars(p)) * p.v_unit == pytest.approx(u)
    assert steady_mu(p, 1.0, u) == pytest.approx(mu, abs=0.001)
    k = (p.mu_s - mu) / (p.y_t * p.z_0 * p.v_unit)  # so that the force is about 1 N
    force = force_for("thermal", vars(p), k)
    assert p.mu_s - k / force == pytest.approx(steady_mu(p, newton(p, force), u), abs=1e-6)
    assert newton(p, force) == pytest.approx(1.0, rel=0.1)


def test_a_force_of_warm_rosin_has_the_same_bits_in_an_array_and_alone() -> None:
    beta = np.linspace(0.03, 0.3, 11)
    made = cells(STEEL, {"beta": beta, "sustained": np.full(11, 0.5)})
    for i, ratio in enumerate(made.value("f_init_ratio").tolist()):
        assert ratio == cells(STEEL, {"beta": beta[i : i + 1], "sustained": [0.5]}).value("f_init_ratio")[0]


def test_a_sustained_force_begins_at_its_share_of_each_cells_maximum() -> None:
    bridge, f_asym = np.array([5.0, 15.0, 36.0]), np.array([0.2, 5.5, 50.0])
    p = Parameters(sustained=0.6, tau_f=1500)
    made = cells(p, {"bow_bridge": bridge, "f_asym": f_asym})
    assert made.value("f_init_ratio") * f_asym == pytest.approx(0.6 * 139 / (1.617 * bridge * 0.5))
    f_b, _ = force_and_speed(p, 0, 2)
    assert f_b[0] == pytest.approx(0.6 * 11.46, rel=1e-3)
    assert f_b[1] < f_b[0]
    mixed = cells(Parameters(f_init_ratio=1.0), {"sustained": [0.0, 0.6]}).value("f_init_ratio")
    assert mixed[0] == 1.0
    assert mixed[1] * 5.5 == pytest.approx(0.6 * 11.46, rel=1e-3)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"sustained": 0.6, "f_init_ratio": 2}, "sustained = 0.6: f_init_ratio = 2 is given too; give one of them"),
        ({"sustained": 0.6, "gesture": "guettler"}, "gesture = 'guettler': gesture must be exponential or martele"),
        ({"sustained": -1}, "sustained = -1: must be a number >= 0"),
    ],
)
def test_two_initial_forces_are_refused(settings: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        Parameters.from_mapping(settings)
