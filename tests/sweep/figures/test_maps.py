from dataclasses import replace

import numpy as np
import pytest
from example_maps import HELMHOLTZ, SLIP, map_file
from PIL import Image

from bow_sim.figures.page import FigureError
from bow_sweep.figures import layout, maps
from bow_sweep.figures.colours import BLACK, GREY, REGIME_COLOURS, transient_colours
from bow_sweep.figures.maps import draw_map, draw_maps, draw_tests
from bow_sweep.maps.map_file import MapFileError


def cells(figure, axes: int, shape: tuple[int, int]) -> np.ndarray:
    """The pixels of one axes of a figure, cut into cells: (ny, nx, rows, columns, 3), y upwards."""
    figure.canvas.draw()
    picture = np.asarray(figure.canvas.buffer_rgba())[..., :3]
    box = figure.axes[axes].get_window_extent()
    x0, x1, y0, y1 = (round(v) for v in (box.x0, box.x1, box.y0, box.y1))
    inside = picture[len(picture) - y1 : len(picture) - y0, x0:x1][::-1]
    ny, nx = shape
    rows, columns = inside.shape[0] // ny, inside.shape[1] // nx
    assert inside.shape[:2] == (ny * rows, nx * columns), "cells are whole pixels"
    return inside.reshape(ny, rows, nx, columns, 3).swapaxes(1, 2)


@pytest.mark.parametrize(
    ("nx", "ny", "dpi"),
    [(8, 4, 200), (8, 4, 100), (128, 64, 200), (128, 64, 72), (4, 1, 200), (1, 1, 200), (33, 50, 150)],
)
def test_every_cell_is_one_rectangle_of_its_colour(nx, ny, dpi):
    result = map_file(nx, ny, computed=nx * ny - nx // 2)
    shown = cells(maps.map_figure(result, dpi), 0, (ny, nx))
    expected = transient_colours(result.transient_periods, 100)
    # the frame covers the outermost pixels
    core = shown[:, :, 1:-1, 1:-1] if min(shown.shape[2:4]) > 4 else shown[1:-1, 1:-1]
    wanted = expected if core.shape[0] == ny else expected[1:-1, 1:-1]
    if min(shown.shape[2:4]) > 4:
        margin = max(2, round(dpi / 100))
        core = shown[:, :, margin:-margin, margin:-margin]
    np.testing.assert_array_equal(core, np.broadcast_to(wanted[:, :, None, None], core.shape))


def test_never_is_black_not_computed_grey_and_y_points_up():
    result = map_file(computed=20)
    centre = cells(maps.map_figure(result, 200), 0, (4, 8))[:, :, 40, 40]
    assert (centre[1] == BLACK).all()
    assert (centre[3] == GREY).all()
    assert (centre[2, 4:] == GREY).all()
    assert (centre[0] != np.array(BLACK)).any(axis=-1).all()


def test_regimes_have_their_colours():
    colours = maps.regime_picture(map_file(computed=20))
    assert tuple(colours[0, 0]) == REGIME_COLOURS["helmholtz"]
    assert tuple(colours[1, 0]) == REGIME_COLOURS["multiple_slip"]
    assert tuple(colours[3, 0]) == GREY
    assert HELMHOLTZ != SLIP


def test_the_title_says_what_was_swept():
    title, made = layout.titles(map_file())
    assert title == r"Stiff/Cremer string, $v_\mathrm{mid} = 0.2$ $v_b$"
    assert made[0].replace(r"$8 \times 4$", "8 \u00d7 4").startswith("8 \u00d7 4 gestures  \u00b7  100 periods each")
    assert r"$\beta = 15/139$" in made[0]
    assert r"$\tau_f = 400$ samples" in made[0]


def test_what_is_held_fixed_takes_as_many_lines_as_it_needs():
    unusual = ("bridge_r=63.5", "torsion_gain=0.9", "nut_power=5", "stiffness_b=0.0001", "torsion_admittance=0.5")
    result = map_file()
    _, made = layout.titles(replace(result, settings=(*result.settings, *unusual)))
    assert len(made) > 1
    assert "$g_R = 0.9$" in " ".join(made)


def test_a_swept_parameter_is_not_in_the_title():
    assert "v_" not in layout.titles(replace(map_file(), x_name="v_mid", x=np.linspace(-2, 0.9, 8)))[0]


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_the_suffix_chooses_the_kind_and_the_same_map_gives_the_same_bytes(tmp_path, suffix, magic):
    for name in ("a", "b"):
        draw_map(map_file(), tmp_path / (name + suffix))
    content = (tmp_path / ("a" + suffix)).read_bytes()
    assert content.startswith(magic)
    assert content == (tmp_path / ("b" + suffix)).read_bytes()


def test_formulas_that_are_kept_from_another_map_give_the_same_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(layout.Canvas, "_parser", None)  # as in a new process
    draw_map(map_file(), tmp_path / "first.png")
    parser = layout.Canvas._parser
    other = replace(map_file(), x_name="v_mid", x=np.linspace(-2, 0.9, 8))
    draw_map(other, tmp_path / "other.png")
    draw_map(map_file(), tmp_path / "again.png")
    assert layout.Canvas._parser is parser
    assert (tmp_path / "first.png").read_bytes() == (tmp_path / "again.png").read_bytes()
    monkeypatch.setattr(layout.Canvas, "_parser", None)
    draw_map(other, tmp_path / "alone.png")
    assert (tmp_path / "other.png").read_bytes() == (tmp_path / "alone.png").read_bytes()


@pytest.mark.parametrize("name", ["map.gif", "map"])
def test_other_suffixes_are_refused_before_anything_is_written(tmp_path, name):
    with pytest.raises(FigureError, match=r"should end in \.png, \.svg, \.pdf"):
        draw_map(map_file(), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_the_tests_are_drawn_as_they_stood_after_so_many_periods(tmp_path):
    result = map_file(computed=20)
    layers = {name: getattr(result, name)[3] for name in ("correlation", "slips", "corners", "helmholtz")}
    figure = maps.tests_figure(result, layers, 20, 200)
    panels = [number for number, ax in enumerate(figure.axes) if ax.get_title(loc="left").startswith("(")]
    passed = cells(figure, panels[3], (4, 8))[:, :, 40, 40]
    assert (passed[0, :4] == 255).all()  # lengths 5 to 20
    assert (passed[0, 4:] == 0).all()
    assert (passed[3] == GREY).all()
    slips = cells(figure, panels[1], (4, 8))[:, :, 40, 40]
    assert (slips[0] == maps.layer_colours("slips", np.array(5))).all()
    assert (slips[1] == maps.layer_colours("slips", np.array(10))).all()
    draw_tests(result, tmp_path / "tests.png", 20)
    assert (tmp_path / "tests.png").stat().st_size > 10_000


def test_tests_that_were_not_made_cannot_be_drawn(tmp_path):
    with pytest.raises(MapFileError, match=r"periods = 42: no test was made then, but after 5, 10, 15, \.\.\., 100"):
        draw_tests(map_file(), tmp_path / "tests.png", 42)


def test_several_maps_share_one_page(tmp_path):
    draw_maps([(f"({letter})", map_file()) for letter in "abcde"], tmp_path / "maps.png")
    with Image.open(tmp_path / "maps.png") as picture:
        assert picture.height > picture.width / 2
    with pytest.raises(MapFileError, match="no maps"):
        draw_maps([], tmp_path / "none.png")


def test_drawing_leaves_matplotlib_as_it_was():
    import matplotlib as mpl

    before = mpl.rcParams["font.size"]
    maps.map_figure(map_file(), 100)
    assert mpl.rcParams["font.size"] == before
