import numpy as np
import pytest

from bow_sweep.maps.axes import PlotAxis

FORCE = PlotAxis.of("f_asym", np.geomspace(0.5, 20, 128))
RATIO = PlotAxis.of("f_init_ratio", np.linspace(0, 2, 64))


def labels(axis: PlotAxis) -> list[str]:
    return [tick.text for tick in axis.ticks() if tick.text]


def test_the_papers_axes_are_recognised():
    assert (FORCE.scale, RATIO.scale) == ("log", "linear")


@pytest.mark.parametrize("axis", [FORCE, RATIO, PlotAxis.of("v_mid", np.linspace(0.9, -2, 30))])
def test_a_value_lies_in_the_middle_of_its_cell(axis):
    places = [axis.position(value) for value in axis.values]
    assert places == pytest.approx(np.arange(axis.count) + 0.5)


def test_the_papers_axes_have_round_ticks():
    assert labels(FORCE) == ["0.5", "1", "2", "5", "10", "20"]
    assert labels(RATIO) == ["0", "0.5", "1", "1.5", "2"]


@pytest.mark.parametrize(
    "values",
    [
        np.geomspace(1e-3, 1e4, 50),
        np.geomspace(1e-8, 1e8, 20),
        np.geomspace(5, 6, 10),
        np.geomspace(20, 0.5, 4),
        np.linspace(-2, 0.9, 7),
        np.linspace(0.1, 0.11, 3),
        np.array([0.5, 20.0]),
        np.array([5.0]),
        np.linspace(1e6, 1e6 + 1, 9),
    ],
)
def test_every_axis_has_a_few_ticks_inside_it_in_order(values):
    ticks = PlotAxis.of("f_asym", values).ticks()
    places = [tick.position for tick in ticks]
    assert places == sorted(places)
    assert min(places) >= -1e-6
    assert max(places) <= len(values) + 1e-6
    assert 1 <= len([tick for tick in ticks if tick.text]) <= 12


def test_two_values_take_the_usual_scale_of_their_parameter():
    assert PlotAxis.of("f_asym", np.array([1.0, 2.0])).scale == "log"
    assert PlotAxis.of("v_mid", np.array([0.1, 0.2])).scale == "linear"


@pytest.mark.parametrize("values", [[], [1.0, np.nan], [1.0, 1.0], [1.0, 3.0, 2.0], [[1.0, 2.0]]])
def test_values_that_do_not_make_an_axis_are_refused(values):
    with pytest.raises(ValueError, match="axis f_asym"):
        PlotAxis.of("f_asym", np.array(values))


def test_titles_name_parameter_symbol_and_unit():
    assert FORCE.title() == "asymptotic bow force  f_asym  (units: v_b = 1, Y_T = 2)"
    assert "Y_T = 3" in FORCE.title(["y_t=3.0"])
    assert PlotAxis.of("bow_bridge", np.arange(10.0, 20.0)).title() == (
        "round trip from bow to bridge  bow_bridge  (samples)"
    )
    assert PlotAxis.of("unheard_of", np.arange(3.0)).title() == "unheard_of"


UNEVEN = [0.1, 0.2, 0.5, 0.6, 3.0]


@pytest.mark.parametrize("values", [UNEVEN, UNEVEN[::-1], [-2.0, 0.0, 0.5]])
def test_uneven_values_have_cells_of_one_size_and_ticks_of_their_own(values):
    axis = PlotAxis.of("f_asym", np.array(values))
    assert axis.scale == "values"
    assert [axis.position(value) for value in values] == pytest.approx(np.arange(len(values)) + 0.5)
    assert [tick.position for tick in axis.ticks()] == [index + 0.5 for index in range(len(values))]
    assert labels(axis) == [f"{value:g}" for value in values]


def test_between_and_beyond_uneven_values_positions_are_interpolated():
    axis = PlotAxis.of("f_asym", np.array(UNEVEN))
    for value, position in ((0.35, 2.0), (0.05, 0.0), (4.2, 5.0)):
        assert axis.position(value) == pytest.approx(position)
        assert PlotAxis.of("f_asym", np.array(UNEVEN[::-1])).position(value) == pytest.approx(5 - position)


def test_of_many_uneven_values_some_are_labelled():
    axis = PlotAxis.of("f_asym", np.arange(1.0, 41.0) ** 3)
    assert len(axis.ticks()) == 40
    assert labels(axis)[:2] == ["1", "125"]
    assert len(labels(axis)) == 10


def test_small_numbers_are_short():
    assert labels(PlotAxis.of("stiffness_b", np.array([1e-6, 5e-5, 1.25e-4, 2e-3]))) == [
        "1e-6",
        "5e-5",
        "1.25e-4",
        "0.002",
    ]
