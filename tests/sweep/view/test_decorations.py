import itertools

import numpy as np
import pytest
from example_maps import basin_map, settings

from bow_sim.physics.parameters import FIELDS
from bow_sweep.figures.colours import BLACK, GREY, regime_legend, transient_colours
from bow_sweep.maps.plane import TEST_LAYERS, Snapshot
from bow_sweep.plan.presets import presets
from bow_sweep.plan.sweep import Sweep
from bow_sweep.view import decorations
from bow_sweep.view.scope import CAPTION, MOST, ROW, WIDTH, Scope

SHAPES = [(128, 64), (8, 4), (1, 1), (4, 1), (1, 64), (512, 8), (5, 200), (200, 5), (300, 300)]
SWEPT = [name for name, known in FIELDS.items() if isinstance(known.default, float) and name != "periods"]


def snapshot(nx: int = 8, ny: int = 4) -> Snapshot:
    return Snapshot.from_message(basin_map(nx, ny)).with_plan(settings(nx, ny))


def all_of(plane: Snapshot) -> list[decorations.Decorations]:
    tests = [decorations.layer_decorations(plane, name) for name in TEST_LAYERS]
    regime, terrain = decorations.regime_decorations(plane), decorations.terrain_decorations(plane)
    return [decorations.transient_decorations(plane), regime, terrain, *tests]


def overlapping(boxes: list[decorations.Box], labels: list[str]) -> list[tuple[str, str]]:
    """Which labels touch each other."""
    return [
        (labels[i], labels[j])
        for (i, one), (j, other) in itertools.combinations(enumerate(boxes), 2)
        if one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
    ]


def check(plane: Snapshot) -> None:
    """No label of any picture touches another, the map or the scale, and none is cut off."""
    for made in all_of(plane):
        boxes = made.boxes()
        assert overlapping(boxes, made.labels) == []
        (left, right), (top, bottom) = made.bounds
        for box, text in zip(boxes, made.labels, strict=True):
            assert left <= box[0], text
            assert box[2] <= right, text
            assert top <= box[1], text
            assert box[3] <= bottom, text
            inside = box[0] < decorations.WIDTH and box[2] > 0 and box[1] < decorations.HEIGHT and box[3] > 0
            assert not inside, text
            bar = made.bar_corner[0]
            assert not (
                box[0] < bar + decorations.BAR_WIDTH and box[2] > bar and box[1] < decorations.HEIGHT and box[3] > 0
            )


@pytest.mark.parametrize(("nx", "ny"), SHAPES)
def test_labels_neither_collide_nor_are_cut_off(nx, ny):
    check(snapshot(nx, ny))


@pytest.mark.parametrize("preset", sorted(presets()))
def test_labels_of_every_preset_neither_collide_nor_are_cut_off(preset):
    sweep = Sweep.from_spec(preset)
    check(plane_of(sweep.settings(), sweep.x.name, sweep.x.values(), sweep.y.name, sweep.y.values()))


@pytest.mark.parametrize("name", SWEPT)
def test_labels_of_any_two_parameters_neither_collide_nor_are_cut_off(name):
    long = "torsion_admittance" if name != "torsion_admittance" else "bridge_gain"
    unusual = (*settings(), "stiffness_b=0.001", "torsion_gain=0.9", "bridge_r=63.5", "gesture=constant_acceleration")
    for x_name, y_name in ((name, long), (long, name)):
        check(plane_of(unusual, x_name, np.geomspace(1e-3, 1.1e3, 24), y_name, np.linspace(0.00012, 0.00013, 12)))


def plane_of(given, x_name: str, x: np.ndarray, y_name: str, y: np.ndarray) -> Snapshot:
    values = basin_map(len(x), len(y)) | {"x_name": x_name, "y_name": y_name, "x": x, "y": y}
    return Snapshot.from_message(values).with_plan(given)


@pytest.mark.parametrize(("nx", "ny"), SHAPES)
def test_every_map_has_the_same_size_and_its_cells_fill_it(nx, ny):
    plane = snapshot(nx, ny)
    centres, (width, height) = decorations.cell_centres(plane), decorations.cell_size(plane)
    half = np.array([width, height]) / 2
    low, high = centres.min(axis=0) - half, centres.max(axis=0) + half
    np.testing.assert_allclose([low, high], [(0, 0), (decorations.WIDTH, decorations.HEIGHT)], atol=1e-9)
    for made in all_of(plane):
        (left, right), (top, bottom) = made.bounds
        assert decorations.WIDTH / (right - left) > 0.6
        assert decorations.HEIGHT / (bottom - top) > 0.6


@pytest.mark.parametrize(("nx", "ny"), SHAPES)
def test_only_the_frame_touches_the_map(nx, ny):
    made = decorations.transient_decorations(snapshot(nx, ny))
    wide, high = decorations.WIDTH, decorations.HEIGHT
    for line in made.lines[1:]:
        inside = (line[:, 0] > 0) & (line[:, 0] < wide) & (line[:, 1] > 0) & (line[:, 1] < high)
        assert not inside.any()
    assert made.bar_corner[0] > wide


def test_a_label_without_space_gives_way_and_powers_of_ten_stay():
    made = decorations.surroundings(
        plane_of(settings(), "f_asym", np.geomspace(1e-3, 90, 50), "tau_f", np.arange(1.0, 9))
    )
    below = [text for text, (_, y) in zip(made.labels, made.places, strict=True) if y == decorations.BELOW]
    assert {"0.001", "0.01", "0.1", "1", "10"} <= set(below)


def test_the_caption_names_what_is_held_fixed_and_its_units():
    made = decorations.transient_decorations(snapshot())
    words = " ".join(made.labels)
    for part in (
        "Stiff/Cremer string",
        "tau_f = 400 samples",
        "v_mid = 0.2 v_b",
        "beta = 15/139",
        "mu_s = 0.8",
        "Y_T = 2",
    ):
        assert part in words
    assert "f_asym =" not in words


def test_the_legend_of_the_lines_does_not_touch_itself():
    names = [label for _, label, _ in regime_legend(snapshot().regime_names)]
    strokes, boxes = decorations.legend([*names, *names[:5]])
    assert overlapping(boxes, [*names, *names[:5]]) == []
    reach = decorations.LEGEND_STROKE / 2
    for (start, end), box in zip(strokes, boxes, strict=True):
        assert end[0] + reach < box[0]
        assert box[1] < start[1] < box[3]
        assert start[0] - reach >= 0
        assert box[2] <= decorations.LEGEND_WIDTH


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
    assert first.label == "cell 20: f_asym 4.116 2 Z_0 v_b, f_init/f_asym 1.333"
    x, y = (4.5 * 16, 24.0)  # ix = 4, iy = 2: eight columns and four rows of 16 units
    assert first.place[0] == x
    assert first.frame[:4].mean(axis=0) == pytest.approx((x, y))
    assert first.curve[:, 1].max() < second.curve[:, 1].min()
    assert first.curve[0, 1] > first.curve[np.argmax(force), 1]  # upwards is more force


def test_captions_of_inspected_cells_are_within_their_rows():
    plane = plane_of(
        settings(), "torsion_admittance", np.linspace(0.11111, 0.7, 8), "bridge_w_c", np.linspace(0.5, 8.33333, 4)
    )
    scope, force = Scope(), np.sin(np.arange(695.0))
    for row, cell in enumerate((1, 31)):
        scope.admit(cell)
        trace = scope.trace(plane, cell, force)
        assert trace.corner[1] == row * ROW
        assert trace.curve[:, 1].min() > row * ROW + CAPTION
        assert trace.curve[:, 1].max() < (row + 1) * ROW
        assert 0 < trace.corner[0] < WIDTH / 2


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
