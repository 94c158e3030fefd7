"""The exponent of a motion, and the linearised motion that it is measured on."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import scalar_string

from bow_sim.kernel.tangent import follow, slope
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sweep.cli import main
from bow_sweep.edges.exponent import LEFT_OUT, exponent

SLIDING = Parameters(model="raman", period=40, bow_bridge=7, v_mid=0, f_asym=0.1, bridge_gain=1, nut_gain=1)
"""Two deltas; the bow slides on the string all the time."""


def steady_slope(bridge: float, nut: float) -> float:
    """dv/dv_h where the string under the bow has a constant speed."""
    s, d = 1.0, 1.0
    for _ in range(100):
        push = 0.1 * (0.3 + 0.5 / (1 + s))  # Y = 1, a = 1
        out = np.linalg.solve([[1, nut], [bridge, 1]], [push, push]) if bridge * nut < 1 else (push / 2, push / 2)
        d = 1 + bridge * out[0] + nut * out[1]
        s = d - push
    return float(slope(1.0, 0.3, s, d, 0.1, True))


def loop_root(bridge: float, nut: float, k: float) -> float:
    """Logarithm per period of the largest root of the loop of two deltas, 7 and 33 samples, and the bow."""
    polynomial = np.zeros(41)
    polynomial[[0, 7, 33, 40]] = 1, (k - 1) * bridge, (k - 1) * nut, -(2 * k - 1) * bridge * nut
    return 40 * math.log(np.abs(np.roots(polynomial)).max())


@pytest.mark.parametrize(("gains", "expected"), [((1, 1), 0.050), ((0.99, 0.98), 0.020), ((0.9, 0.7), -0.412)])
def test_steady_sliding_of_two_deltas_grows_as_the_roots_of_the_loop_say(
    gains: tuple[float, float], expected: float
) -> None:
    k = steady_slope(*gains)
    root = loop_root(*gains, k)
    assert root == pytest.approx(expected, abs=5e-4)
    string = ends(SLIDING.replace(bridge_gain=gains[0], nut_gain=gains[1]))
    kick = np.random.default_rng(1).uniform(-1, 1, 40)
    found = follow(string, 40, np.full(40 * 401, k), kick)
    assert np.mean(found.growth[1 + LEFT_OUT :]) == pytest.approx(root, abs=0.004)


def test_the_exponent_of_steady_sliding_is_that_of_the_loop() -> None:
    p = SLIDING.replace(bridge_gain=0.9, nut_gain=0.7)
    found = exponent(p, fallen=1000)
    assert found.sliding == 1.0
    assert len(found.growth) == 395
    assert found.value == pytest.approx(loop_root(0.9, 0.7, steady_slope(0.9, 0.7)), abs=0.004)
    short = exponent(p)
    assert short.stopped == "the norm has fallen by e^23"
    assert -23.5 < short.growth.sum() + LEFT_OUT * short.value < -21


@pytest.mark.parametrize(
    "p",
    [
        Parameters(model="delta_cremer", v_mid=0.2, f_asym=4.0),
        Parameters(
            model="stiff_cremer", v_mid=-2, f_asym=3.0, f_init_ratio=0.5, body_modes="430/30/k0.01, 900/20/k0.02"
        ),
    ],
    ids=["delta", "stiff with two modes of a body"],
)
def test_the_linearised_motion_is_that_of_two_motions_a_little_apart(
    p: Parameters, monkeypatch: pytest.MonkeyPatch
) -> None:
    n, skip, apart, contact = p.period, 10, 1e-7, scalar_string.Contact
    kick = np.random.default_rng(3).uniform(-1, 1, n)

    def kicked(size: float) -> dict[str, np.ndarray]:
        class Kicked(contact):
            step = -skip * n

            def solve(self, d: float, f_b: float) -> float:
                self.step += 1
                s = super().solve(d, f_b)
                return s - self.y * size * kick[self.step - 1] if 0 < self.step <= n else s

        monkeypatch.setattr(scalar_string, "Contact", Kicked)
        return scalar_string.simulate(p, (skip + 20) * n)

    plain, up, down = kicked(0.0), kicked(apart), kicked(-apart)
    np.testing.assert_array_equal(up["slipping"], plain["slipping"])  # no decision lies between
    np.testing.assert_array_equal(down["slipping"], plain["slipping"])
    real = (up["bridge_force"] - down["bridge_force"])[skip * n :] / (2 * apart)

    f_b = np.array([scalar_string.gesture(p, t)[0] for t in range((skip + 20) * n)])
    string = ends(p)
    d = p.v_b - plain["v_h"]
    slopes = slope(p.v_b - p.v_mid, string.y * p.mu_d, plain["s"], d, f_b, plain["slipping"])
    assert 0.05 < np.mean(slopes != 0) < 0.95
    found = follow(string, n, slopes[skip * n :], kick)
    scale = np.exp(np.concatenate([[0.0], np.cumsum(found.growth)[:-1]]))
    ours = (found.force.reshape(-1, n) * scale[:, None]).ravel()
    assert len(ours) == 20 * n
    np.testing.assert_allclose(ours, real, rtol=0, atol=1e-6 * np.abs(real).max())


@pytest.mark.full
@pytest.mark.parametrize(
    ("model", "v_mid", "f_asym", "expected"),
    [
        ("delta_cremer", 0.9, 5.5, -0.044),
        ("delta_cremer", 0.9, 18, -0.092),
        ("stiff_cremer", 0.2, 5.5, -0.047),
        ("stiff_cremer", 0.2, 25, -0.080),
        ("stiff_cremer", 0.9, 14, -0.089),
        ("stiff_cremer", -2, 8, -0.045),
    ],
)
def test_a_small_change_decays_in_helmholtz_and_in_raucous_motion(
    model: str, v_mid: float, f_asym: float, expected: float
) -> None:
    found = exponent(Parameters(model=model, v_mid=v_mid, f_asym=f_asym))
    assert found.value == pytest.approx(expected, abs=0.006)
    assert found.value < 0


def test_an_exponent_is_printed_in_words_and_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["exponent", "--model", "delta_cremer", "--v-mid", "0.9", "--skip", "20", "--periods", "30"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "per period of 139 samples" in out
    assert "25 periods from period 26 on; all 30 periods are followed" in out
    assert main([*words, "--json"]) == 0
    read = json.loads(capsys.readouterr().out)
    assert f"exponent {read['exponent']:+.4f}" in out
    assert len(read["growth"]) == read["periods"] == 25
    assert read["exponent"] == pytest.approx(np.mean(read["growth"]), rel=1e-12)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--set", "friction=coulomb"], "friction = 'coulomb': an exponent needs friction=hyperbola"),
        (["--set", "string=violin_g", "--set", "hair=hair_soft"], "an exponent needs a rigid bow: hair_r=0"),
        (["--set", "dtype=float32"], "an exponent needs dtype=float64"),
        (["--periods", "5"], "periods = 5: must be at least 6"),
        (["--skip", "-1"], "skip = -1: must be at least 0"),
        (["--fall", "0"], "fall = 0: must be above 0"),
        (["--set", "periods=100"], "give --skip N, the periods before the kick, and --periods N after it"),
        (["--skip", "1000000"], "must be at most 71941 with period = 139"),
    ],
)
def test_what_has_no_exponent_is_refused_in_one_line(
    words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["exponent", *words]) == 2
    captured = capsys.readouterr()
    assert named in captured.err
    assert captured.err.count("\n") == 1
    assert not captured.out


def test_where_nothing_is_left_there_is_no_exponent() -> None:
    dead = SLIDING.replace(bridge_gain=0.0, nut_gain=0.0)
    with pytest.raises(ParameterError, match="nothing is left of the kick"):
        exponent(dead, skip=1, periods=10)
