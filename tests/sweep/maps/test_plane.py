import numpy as np
import pytest
from example_maps import HELMHOLTZ, SLIP, basin_map, outline, settings

from bow_sweep.maps import plane
from bow_sweep.maps.plane import CLEAR, NEVER, NOT_COMPUTED, Snapshot


def snapshot(**changes) -> Snapshot:
    return Snapshot.from_message({**basin_map(), **changes}).with_plan(settings())


def test_rows_of_the_message_become_rows_of_the_map():
    taken = snapshot()
    assert taken.shape == (4, 8)
    assert taken.transient_periods[0].tolist() == [5, 10, 15, 20, 25, 30, 35, 40]
    assert (taken.regime[1] == SLIP).all()
    assert (taken.regime[0] == HELMHOLTZ).all()


def test_the_mask_tells_never_from_not_computed():
    mask = Snapshot.from_message(basin_map(computed=20)).mask()
    assert (mask[0] == CLEAR).all()
    assert (mask[1] == NEVER).all()
    assert (mask[2, :4] == CLEAR).all()
    assert (mask[2, 4:] == NOT_COMPUTED).all()
    assert (mask[3] == NOT_COMPUTED).all()


def test_counts_add_up_to_the_cells():
    counts = Snapshot.from_message(basin_map(computed=20)).regime_counts()
    assert counts.tolist() == [0, 12, 8, 0, 0, 0, 12]


def test_a_regime_without_a_name_is_counted_as_none():
    assert snapshot(regime_names=["no_oscillation"]).regime_counts().tolist() == [0, 32]


def test_the_image_has_the_highest_y_on_top():
    height, width, data = plane.image_of(snapshot())
    image = np.frombuffer(data, "<f4").reshape(height, width)
    assert (height, width) == (4, 8)
    assert image[-1].tolist() == [5, 10, 15, 20, 25, 30, 35, 40]
    assert (image[2] == 0).all()


@pytest.mark.parametrize("name", ["transient_periods", "regime", "tests", "correlation", "slips", "corners"])
def test_an_array_of_the_wrong_length_is_refused_by_name(name):
    with pytest.raises(ValueError, match=f"BasinMap.{name}: 31 values for 8 x 4 cells"):
        snapshot(**{name: basin_map()[name][:-1]})


def test_axes_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="axis f_asym"):
        snapshot(x=np.zeros(8))


def test_a_planned_map_is_all_pending_and_has_the_axes_of_the_plan():
    planned = Snapshot.empty(outline())
    assert (planned.x_name, planned.y_name) == ("f_asym", "f_init_ratio")
    assert planned.x == pytest.approx(basin_map()["x"])
    assert planned.y == pytest.approx(basin_map()["y"])
    assert (planned.x[0], planned.x[-1], planned.y[0], planned.y[-1]) == (0.5, 20, 0, 2)
    assert (planned.mask() == NOT_COMPUTED).all()
    assert (planned.planned, planned.outstanding) == (32, 32)
    assert [axis.scale for axis in planned.axes] == ["log", "linear"]
