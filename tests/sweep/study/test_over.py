"""Values that a study gives a parameter, as they are written on the command line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.physics.errors import ParameterError
from bow_sweep.study.over import LISTED, Over, Range, over_of, range_of

positive = st.floats(1e-9, 1e9)


@given(positive, positive, st.integers(2, 40))
def test_a_logarithmic_range_has_both_ends_exactly_and_constant_ratios(first, last, count):
    if not max(first, last) / min(first, last) > 1.001:
        return
    over = over_of(f"stiffness_b={first!r}:{last!r}:{count}:log")
    numbers = over.numbers
    assert (numbers[0], numbers[-1], len(numbers)) == (first, last, count)
    ratios = numbers[1:] / numbers[:-1]
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-9)
    assert over.is_log


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=8, unique=True))
def test_listed_values_keep_all_their_bits(values):
    over = over_of("v_mid=" + ",".join(map(repr, values)))
    assert over.scale == LISTED
    assert over.numbers.tolist() == values


def test_a_range_has_the_usual_scale_of_its_parameter():
    assert over_of("f_asym=1:100:3").numbers == pytest.approx([1, 10, 100])
    assert over_of("mu_s=0.6:1.2:3").numbers == pytest.approx([0.6, 0.9, 1.2])
    assert over_of("force=0.1:10:3").numbers == pytest.approx([0.1, 1, 10])
    assert over_of("stiffness_b=0:2e-4:3").numbers == pytest.approx([0, 1e-4, 2e-4])
    assert over_of("mu_s=0.5:2:3:log").numbers == pytest.approx([0.5, 1, 2])


def test_whole_numbers_are_written_as_such():
    assert over_of("period=40:160:4").values == ("40", "80", "120", "160")


def test_texts_are_values_too():
    over = over_of("model=raman,stiff_cremer")
    assert over.values == ("raman", "stiff_cremer")
    assert over.numbers is None
    assert not over.is_log


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("stiffness_b", "NAME=FIRST:LAST:COUNT"),
        ("=1,2", "NAME=FIRST:LAST:COUNT"),
        ("mu_s=", "NAME=FIRST:LAST:COUNT"),
        ("mu_s=1,,2", "NAME=FIRST:LAST:COUNT"),
        ("mu_s=1:2", "COUNT is 1"),
        ("mu_s=1:2:0", "COUNT is 1"),
        ("mu_s=1:2:3:4", "COUNT is 1"),
        ("mu_s=1:2:1", "COUNT should be 2 at least"),
        ("mu_s=a:2:3", "FIRST and LAST are numbers"),
        ("mu_s=nan:2:3", "FIRST and LAST are numbers"),
        ("f_asym=0:2:3:log", "above 0"),
        ("period=40:50:4", "whole numbers"),
        ("mu_s=1,1.0", "twice"),
        ("model=raman,raman", "twice"),
        ("mu_s=1:2:1001", "1000"),
    ],
)
def test_what_cannot_be_values_is_refused_with_what_would_be_right(text, right):
    with pytest.raises(ParameterError, match=right) as refused:
        over_of(text)
    assert "--over" in str(refused.value)


def test_a_range_to_search_has_two_ends():
    assert range_of("mu_s=0.6:1.2") == Range("mu_s", 0.6, 1.2, "linear")
    assert range_of("f_asym=1:30") == Range("f_asym", 1.0, 30.0, "log")
    assert range_of("mu_s=0.6:1.2:log").scale == "log"
    assert range_of("period=40:80").text(52.0) == "52"


@pytest.mark.parametrize(
    "text", ["mu_s", "mu_s=1", "mu_s=2:1", "mu_s=1:1", "mu_s=1:2:5", "mu_s=0:1:log", "period=40.5:80", "=1:2"]
)
def test_what_cannot_be_a_range_to_search_is_refused(text):
    with pytest.raises(ParameterError, match="--over"):
        range_of(text)


def test_a_value_for_one_map_and_for_all_is_refused():
    with pytest.raises(ParameterError, match="mu_s"):
        Over("mu_s", ("1",)).check(["mu_s"])
