"""Values of a parameter of which only the name is said."""

import pytest

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import MODEL_NAMES
from bow_sweep.study.over import Range, over_of
from bow_sweep.study.plan import Study
from bow_sweep.study.usual import COUNT, overs_of, ranges_of

SMALL = ("x.count=4", "y.count=2", "periods=10")


def test_a_name_alone_has_values_along_its_usual_axis():
    (over,) = overs_of("fig11d", SMALL, ["bridge_r"])
    assert (over.name, over.scale, len(over.values)) == ("bridge_r", "log", COUNT)
    numbers = over.numbers
    assert (numbers[0], numbers[-1]) == (5, 200)
    assert numbers[1:] / numbers[:-1] == pytest.approx(40 ** (1 / (COUNT - 1)))


def test_values_that_are_given_stay_and_the_order_is_kept():
    asked = ["mu_s=0.6,1", "bridge_r", "v_mid=-2:0.8:3"]
    overs = overs_of("fig11d", SMALL, asked)
    assert [over.name for over in overs] == ["mu_s", "bridge_r", "v_mid"]
    assert (overs[0], overs[2]) == (over_of(asked[0]), over_of(asked[2]))


def test_the_usual_axis_is_that_of_the_other_settings():
    (short,) = overs_of("fig11d", (*SMALL, "period=80"), ["bow_bridge"])
    (long,) = overs_of("fig11d", SMALL, ["period=160,200", "bow_bridge"])[1:]
    assert short.numbers.tolist() != long.numbers.tolist()
    assert (long.numbers.min(), long.numbers.max()) == (round(0.036 * 160), round(0.26 * 160))
    assert all("." not in value for value in long.values), "a whole number of samples"
    (softer,) = overs_of("fig11d", (*SMALL, "string=cello_g_a", "v_unit=0.1", "beta=0.1"), ["force"])
    (harder,) = overs_of("fig11d", (*SMALL, "string=cello_g_a", "v_unit=0.2", "beta=0.1"), ["force"])
    assert harder.numbers == pytest.approx(2 * softer.numbers, rel=1e-3)


def test_models_and_thresholds_have_usual_values_too():
    assert overs_of("", SMALL, ["model"])[0].values == MODEL_NAMES
    (correlation,) = overs_of("fig11d", SMALL, ["classifier.correlation"])
    assert (correlation.numbers.min(), correlation.numbers.max()) == (0.8, 0.99)


@pytest.mark.parametrize("name", ["model", "bridge_r", "bow_bridge", "beta", "classifier.correlation", "v_b"])
def test_every_map_of_usual_values_can_be_made(name):
    preset = "" if name == "model" else "fig11d"
    study = Study(preset, SMALL, overs_of(preset, SMALL, [name]))
    assert len(study.members) == len(study.overs[0].values)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("bridge_q", "no such parameter"),
        ("classifier.corr", "one of correlation"),
        ("period", "chunks of the same length"),
        ("preset", "NAME=VALUE"),
        ("force", "needs string=NAME"),
        ("body_3_f", "the body has 0 modes"),
    ],
)
def test_a_name_that_has_no_usual_values_is_refused_with_what_would_be_right(name, why):
    with pytest.raises(ParameterError, match=why) as refused:
        overs_of("fig11d", SMALL, [name])
    assert str(refused.value).startswith(f"--over {name}: ")


def test_a_search_takes_the_ends_of_the_usual_axis():
    assert ranges_of("fig11d", SMALL, ["mu_s=0.6:1.1", "bridge_r"]) == (
        Range("mu_s", 0.6, 1.1, "linear"),
        Range("bridge_r", 5.0, 200.0, "log"),
    )
