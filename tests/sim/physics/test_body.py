"""Modes of the body: their reflection is that of the admittance, it is passive, and what cannot be is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scalar_string import BodySide

from bow_sim.physics.body import SETS, Mode, modes, modes_of, read_modes, resonators
from bow_sim.physics.cells import cells
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import Ends, ends


def reflection(e: Ends, samples: int) -> np.ndarray:
    """Impulse response of the bridge with its modes, after the way to the bridge."""
    assert e.body is not None
    side = BodySide(e.bridge, body=e.body)
    lag = e.bridge.first
    out = np.empty(samples)
    for t in range(samples + lag):
        side.out.append(1.0 if t == 0 else 0.0)
        if t >= lag:
            out[t - lag] = side.arriving(t)
        else:
            assert side.arriving(t) == 0.0
    return out


def bilinear(w: np.ndarray, f: float, sample_rate: float) -> np.ndarray:
    """s/w_k at a frequency w (radians a sample): the transform is exact at the mode's own frequency."""
    own = 2 * np.pi * f / sample_rate
    return 1j * np.tan(w / 2) / math.tan(own / 2) * own


def formula(p: Parameters, e: Ends, w: np.ndarray) -> np.ndarray:
    """(Z_0 Y - 1)/(Z_0 Y + 1) with the admittance of Cremer's part and the modes in series (PHYSICS.md section 11)."""
    assert e.body is not None
    z = np.exp(1j * w)
    cremer = -e.body.rho - e.body.gain / (z - e.body.pole)  # of x': -rho x' - gain tail
    y = (1 + cremer) / (1 - cremer)  # of velocity over force, times Z_0
    for f, q, kappa in e.body.modes:
        s, own = bilinear(w, f, p.sample_rate), 2 * np.pi * f / p.sample_rate
        y = y + kappa * own * s / (s * s + s * own / q + own * own)
    return (y - 1) / (y + 1)


CASES = {
    "one": {"body_modes": "440/10/k0.05", "bridge": "rigid"},
    "with Cremer": {"body_modes": "440/10/k0.05, 900/8/k0.01, 5000/12/k0.3"},
    "set": {"body": "signature", "z_0": 0.35},
    "rigid end": {"model": "friedlander", "body_modes": "440/10/k0.05"},
}


@pytest.mark.parametrize("case", CASES)
def test_the_recursion_reflects_as_the_admittance_says(case: str) -> None:
    p = Parameters.from_mapping({"sample_rate": 12000, **CASES[case]})
    e = ends(p)
    h = reflection(e, 1 << 15)
    assert abs(h[-1]) < 1e-13  # it has decayed, so that the transform is that of the whole response
    w = 2 * np.pi * np.arange(1, 1 << 14) / (1 << 15)
    got = np.fft.rfft(h)[1:-1]
    assert np.abs(got - formula(p, e, w)).max() < 1e-10
    assert np.abs(got).max() <= 1 + 1e-12
    at_rest = -1.0 if p.bridge_w_c else -(p.bridge_r - 1) / (p.bridge_r + 1)  # a rigid end; a dashpot without spring
    assert h.sum() == pytest.approx(at_rest, abs=1e-10)


@given(
    st.lists(st.tuples(st.floats(20, 30000), st.floats(0.1, 200), st.floats(1e-6, 10)), min_size=1, max_size=5),
    st.floats(1.001, 1e4),
    st.floats(0, 50),
)
def test_no_set_of_modes_gives_energy(own: list[tuple[float, float, float]], r: float, w_c: float) -> None:
    text = ", ".join(f"{f}/{q}/k{kappa}" for f, q, kappa in own)
    p = Parameters(body_modes=text, bridge_r=r, bridge_w_c=w_c)
    w = np.linspace(1e-4, math.pi - 1e-4, 2001)
    assert np.abs(formula(p, ends(p), w)).max() <= 1 + 1e-9


def test_a_free_string_and_a_mode_of_its_frequency_have_two_peaks() -> None:
    """f_0 (1 +- sqrt(kappa/2 pi - 1/(16 Q^2))) (PHYSICS.md section 16)."""
    n, kappa, q = 139, 0.01, 30
    rate = 139 * 440.0
    p = Parameters.from_mapping({"model": "friedlander", "sample_rate": rate, "body_modes": f"440/{q}/k{kappa}"})
    f = np.linspace(400, 480, 80001)
    w = 2 * np.pi * f / rate
    around = 1 / np.abs(1 + formula(p, ends(p), w) * np.exp(-1j * w * n))
    peaks = f[1:-1][(around[1:-1] > around[:-2]) & (around[1:-1] > around[2:])]
    split = math.sqrt(kappa / (2 * math.pi) - 1 / (16 * q * q))
    assert peaks == pytest.approx([440 * (1 - split), 440 * (1 + split)], rel=1e-3)


def test_modes_of_mobility_zero_change_nothing() -> None:
    p = Parameters(model="delta_cremer", body_modes="440/30/k0.01, 700/20/k0.2", body_scale=0.0)
    plain = ends(p.replace(body_modes="")).bridge.impulse(400)
    assert reflection(ends(p), 400 - 15) == pytest.approx(plain[15:], abs=1e-15)


def test_named_sets_are_there() -> None:
    assert len(modes("stoppani", "", 61160.0, 139, 0.35)) == 76
    assert [round(m.f) for m in modes("signature", "", 61160.0, 139, 0.35)] == [272, 407, 462, 551]
    (wolf,) = modes("wolf_83", "", 61160.0, 139, 0.0)
    assert wolf == (64 / 65 * 440, 30, 0.01)
    assert len(modes("stoppani", "", 98.0 * 139, 139, 1.0)) < 76  # those above 0.45 of the sample rate are left out
    assert all(len(modes(name, "", 61160.0, 139, 0.35)) > 0 for name in SETS if name != "none")
    (mode,) = modes("none", "440/30/0.05", 61160.0, 139, 0.35)
    assert mode.kappa == pytest.approx(0.35 / (0.05 * 2 * math.pi * 440))


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"body_modes": "40000/30/k0.01"}, "half the sample rate, 30580 Hz"),
        ({"body_modes": "440/0/k0.01"}, "Q = '0': must be a number > 0"),
        ({"body_modes": "440/30/-0.1", "z_0": 0.3}, "m = '-0.1': must be a number > 0"),
        ({"body_modes": "440/30/k0"}, "kappa = '0'"),
        ({"body_modes": "440/30"}, "'440/30': must be f/Q/m"),
        ({"body_modes": "440/30/0.1"}, "needs string=NAME, or z_0=NUMBER in kg/s"),
        ({"body": "stoppani"}, "needs string=NAME, or z_0"),
        ({"body": "strad"}, "body = 'strad': must be one of none, wolf_83"),
        ({"body": "wolf_83", "body_modes": "440/30/k0.1"}, "must be empty with body = 'wolf_83'"),
        ({"body_modes": "440/30/k0.01, " * 1001}, "1001 modes: must be at most 1000"),
    ],
)
def test_a_body_that_cannot_be_is_refused(settings: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError, match="body") as error:
        Parameters.from_mapping(settings)
    assert text in str(error.value)


def test_modes_are_read_from_a_file(tmp_path) -> None:
    path = tmp_path / "modes.txt"
    path.write_text("f,Q,m\n272, 40, 1.33\n407.5, 27, 1.38  # CBR\n")
    assert read_modes(path) == "272/40/1.33, 407.5/27/1.38"
    path.write_text("# mine\n440/30/k0.01\n600/20/0.1\n")
    assert read_modes(path) == "440/30/k0.01, 600/20/0.1"
    path.write_text("272 40\n")
    with pytest.raises(ParameterError, match=r"line 1: '272 40': must be f in Hz, Q, and m in kg"):
        read_modes(path)
    with pytest.raises(ParameterError, match="cannot be read"):
        read_modes(tmp_path / "none.txt")


def test_the_filter_of_a_mode_peaks_at_its_frequency() -> None:
    (b0,), (a1,), (a2,) = resonators(modes("none", "440/30/k0.01", 61160.0, 139, 0.0), 61160.0)
    z = np.exp(2j * np.pi * 440 / 61160)
    assert abs(b0 * (1 - z**-2) / (1 + a1 / z + a2 / z**2)) == pytest.approx(0.01 * 30, rel=1e-9)


SIGNATURE = {"body": "signature", "string": "violin_g"}


def own_modes(**settings: object) -> tuple[Mode, ...]:
    return modes_of(Parameters.from_mapping(settings))


def test_a_single_mode_takes_another_frequency_q_and_mass() -> None:
    plain = own_modes(**SIGNATURE)
    made = own_modes(**SIGNATURE, body_1_f=300, body_2_q="50", body_3_m=0.24, body_4_k=0.02)
    w = 2 * math.pi * 300
    assert made[0] == (300, 40, pytest.approx(0.35 / (1.33 * w)))  # it keeps its mass
    assert made[1] == plain[1]._replace(q=50)
    assert made[2] == (462, 27, pytest.approx(plain[2].kappa / 2))
    assert made[3] == plain[3]._replace(kappa=0.02)
    assert own_modes(**SIGNATURE, body_4_k=0.02, body_scale=2)[3].kappa == 0.04


def test_a_ratio_follows_the_string() -> None:
    assert own_modes(body="wolf_83", body_1_ratio=1.1) == (Mode(pytest.approx(484), 30, 0.01),)
    higher = Parameters.from_mapping({"body": "wolf_83", "body_1_ratio": 1.1}).replace(sample_rate=139 * 880.0)
    assert modes_of(higher)[0].f == pytest.approx(968)
    other = higher.replace(body_1_f=500)  # the same property in another way
    assert modes_of(other)[0].f == 500
    assert other.body_changes == "body_1_f=500.0"


def test_changes_of_modes_come_back_from_their_settings() -> None:
    p = Parameters.from_mapping({**SIGNATURE, "body_2_f": 1 / 3 * 1000, "body_1_m": 0.7})
    assert Parameters.from_settings(p.settings()) == p
    assert p.replace(body_1_m=0.8).body_changes == "body_1_m=0.8 body_2_f=333.3333333333333"


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({**SIGNATURE, "body_5_f": 300}, "body_5_f = 300.0: the body has 4 modes, body_1_f ... body_4_f"),
        ({"body": "wolf_83", "body_2_q": 3}, "body_2_q = 3.0: the body has 1 mode, body_1_q"),
        ({"body_1_f": 300}, "body_1_f = 300.0: there is no body: body=NAME, or body_modes=f/Q/m, ..."),
        ({**SIGNATURE, "body_1_f": 0}, "body_1_f = 0: must be a number > 0 in Hz (frequency of mode 1)"),
        ({**SIGNATURE, "body_1_q": "high"}, "body_1_q = 'high': must be a number > 0 (Q factor of mode 1)"),
        ({**SIGNATURE, "body_1_m": math.nan}, "body_1_m = nan: must be a number > 0 in kg"),
        ({**SIGNATURE, "body_1_f": 99, "body_1_ratio": 1}, "body_1_ratio = 1: body_1_f is given too; give one of them"),
        ({**SIGNATURE, "body_1_f": 20000}, "body_1_f = 20000: f must be less than half the sample rate, 13622 Hz"),
        ({"body": "wolf_83", "body_1_m": 0.1}, "a mass needs string=NAME"),
        ({"body": "wolf_83", "body_1_w": 0.1}, "body_1_w = 0.1: unknown parameter; did you mean body_1"),
        ({"body": "wolf_83", "body_changes": "1_f=3"}, "body_changes: '1_f=3': must be body_NUMBER_KIND=VALUE"),
    ],
)
def test_a_change_of_a_mode_that_cannot_be_is_refused(settings: dict[str, object], text: str) -> None:
    with pytest.raises(ParameterError) as error:
        Parameters.from_mapping(settings, "my.yaml: ")
    assert text in str(error.value)
    assert str(error.value).startswith("my.yaml: body")


def test_cells_that_differ_in_a_mode_share_the_string_and_those_of_one_body_share_it() -> None:
    p = Parameters.from_mapping({"body": "signature", "z_0": 0.35})
    one = cells(p, {"body_1_ratio": [0.8, 1.25], "body_2_q": [20.0, 30.0]})
    assert (len(one.ends), len(one.bodies)) == (1, 2)
    assert [b.modes[0].f for b in one.bodies] == pytest.approx([352, 550])
    assert [b.modes[1].q for b in one.bodies] == [20, 30]
    two = cells(p, {"beta": [0.1, 0.2]})
    assert (len(two.ends), len(two.bodies)) == (2, 1)
    assert cells(Parameters(), {"beta": [0.1, 0.2]}).bodies == ()
    with pytest.raises(ParameterError, match=r"lanes.body_1_q\[1\] = 0.0: must be a number > 0"):
        cells(p, {"body_1_q": [1.0, 0.0]})
    with pytest.raises(ParameterError, match=r"lanes\[0\]: body_7_q = 1.0: the body has 4 modes"):
        cells(p, {"body_7_q": [1.0]})
