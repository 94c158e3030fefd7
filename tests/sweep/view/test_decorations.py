import numpy as np
import pytest
from example_maps import basin_map, settings

from bow_sweep.figures.colours import BLACK, GREY, transient_colours
from bow_sweep.maps.plane import TEST_LAYERS, Snapshot
from bow_sweep.view import decorations
from bow_sweep.view.scope import MOST, Scope

SHAPES = [(128, 64), (8, 4), (1, 1), (4, 1), (1, 64), (512, 8), (8, 512), (300, 300)]


def snapshot(nx: int = 8, ny: int = 4) -> Snapshot:
    return Snapshot.from_message(basin_map(nx, ny)).with_plan(settings(nx, ny))


def all_of(plane: Snapshot) -> list[decorations.Decorations]:
    tests = [decorations.layer_decorations(plane, name) for name in TEST_LAYERS]
    return [decorations.transient_decorations(plane), decorations.regime_decorations(plane), *tests]


@pytest.mark.parametrize(("nx", "ny"), SHAPES)
def test_all_furniture_is_within_what_a_view_shows_at_first(nx, ny):
    for made in all_of(snapshot(nx, ny)):
        (left, right), (top, bottom) = made.bounds
        points = np.vstack([*made.lines, np.array(made.places)])
        assert points[:, 0].min() >= left
        assert points[:, 0].max() <= right
        assert points[:, 1].min() >= top
        assert points[:, 1].max() <= bottom


@pytest.mark.parametrize(("nx", "ny"), SHAPES)
def test_only_the_frame_touches_the_map(nx, ny):
    made = decorations.transient_decorations(snapshot(nx, ny))
    for line in made.lines[1:]:
        inside = (line[:, 0] > 0) & (line[:, 0] < nx) & (line[:, 1] > 0) & (line[:, 1] < ny)
        assert not inside.any()
    assert made.bar_corner[0] > nx


def test_y_points_up():
    made = decorations.surroundings(snapshot(128, 64))
    heights = {word: place[1] for word, place in zip(made.labels, made.places, strict=True) if place[0] < 0}
    assert heights["0"] > heights["1"] > heights["2"]
    lowest = next(line for line in made.lines[1:] if line[0, 0] == 0 and line[0, 1] > 63)
    assert lowest[0, 1] == pytest.approx(63.5)  # y = 0 is the middle of the lowest row


def test_the_bar_has_the_colours_of_the_map_and_says_what_black_and_grey_are():
    made = decorations.transient_decorations(snapshot(128, 64))
    column = made.bar[:, 0]
    shown = {tuple(int(channel) for channel in pixel[:3]) for pixel in column if pixel[3]}
    wanted = {tuple(int(channel) for channel in transient_colours(length, 100)) for length in range(5, 105, 5)}
    assert shown == wanted | {BLACK, GREY}
    assert tuple(column[0, :3]) == tuple(transient_colours(100, 100))  # long ones on top
    assert {"never", "pending", "100", "20", "5"} <= set(made.labels)


def test_the_regimes_have_their_names_beside_their_colours():
    words = decorations.regime_decorations(snapshot()).labels
    assert {"Helmholtz", "multiple slip", "aperiodic", "pending"} <= set(words)


def test_inspected_cells_keep_their_rows():
    scope, force = Scope(), np.sin(np.arange(695.0))
    assert [scope.admit(cell) for cell in (20, 3, 20)] == [True, True, True]
    first, second = (scope.trace(snapshot(), cell, force) for cell in (20, 3))
    assert (first.number, second.number) == (1, 2)
    assert first.label == "cell 20: f_asym 4.12, f_init_ratio 1.33"
    assert first.place[0] == 4.5  # ix = 4, iy = 2 of four rows
    assert first.frame[:, 1].mean() == pytest.approx(1.5, abs=0.3)
    assert first.curve[:, 1].max() < second.curve[:, 1].min()
    assert first.curve[0, 1] > first.curve[np.argmax(force), 1]  # upwards is more force


def test_more_cells_than_rows_are_left_out_and_said_so():
    scope = Scope()
    assert [scope.admit(cell) for cell in range(MOST + 2)] == [True] * MOST + [False] * 2
    assert scope.left_out == {MOST, MOST + 1}


def test_rows_are_remembered_by_the_names_of_traces():
    scope = Scope()
    assert [scope.recall(name) for name in ("cell_7", "help", "cell_2", "cell_7")] == [7, None, 2, 7]
    assert scope.cells == [7, 2]


def test_a_silent_string_is_a_line():
    scope = Scope()
    scope.admit(0)
    assert np.isfinite(scope.trace(snapshot(), 0, np.zeros(695)).curve).all()
