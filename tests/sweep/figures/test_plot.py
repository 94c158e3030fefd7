"""Figures for papers: what is in them, what they weigh on, and that nothing is cut or overlaps."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from example_maps import HELMHOLTZ, SLIP, map_file
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from bow.pictures import picture
from bow_sim.figures.page import save
from bow_sweep.cli import main
from bow_sweep.cli.plot import length_mm
from bow_sweep.figures.caption import titled
from bow_sweep.figures.colours import BLACK, REGIME_COLOURS
from bow_sweep.figures.layers import LAYERS, LayerError, Panel, available, shown
from bow_sweep.figures.panel import Along, Cells, areas_of, number
from bow_sweep.figures.plot import figure
from bow_sweep.maps.axes import PlotAxis
from bow_sweep.maps.map_file import MapFile, write_map_npz

SCHELLENG = ("model=stiff_cremer", "period=139", "periods=100", "mu_s=0.8", "mu_d=0.3", "v_mid=0.2", "y_t=2.0")


def schelleng() -> MapFile:
    """A plane with limits, one axis of SI units, and values of which no step is like another."""
    given = (*SCHELLENG, "z_0=0.35", "v_unit=0.1", "x.name=force", "y.name=beta", "x.scale=log", "y.scale=linear")
    return replace(
        map_file(12, 6), x_name="force", y_name="beta", x=np.geomspace(0.05, 5, 12), y=np.linspace(0.05, 0.15, 6),
        settings=given,
    )  # fmt: skip


def uneven() -> MapFile:
    return replace(map_file(4, 4), x=np.array([0.5, 0.7, 5.0, 20.0]))


def texts(drawn: Figure) -> Iterator[tuple[Text, Bbox]]:
    """Every text that is seen, and where it is."""
    renderer = drawn.canvas.get_renderer()  # type: ignore[attr-defined]
    for text in drawn.findobj(Text):
        if text.get_text() and text.get_visible():
            yield text, text.get_window_extent(renderer)


FIGURES = {
    "one column": ([Panel(map_file())], {}),
    "regimes": ([Panel(map_file(computed=20), "regime")], {}),
    "two panels": (titled([map_file(), replace(map_file(), settings=("model=raman",))], ["transient"]), {}),
    "two columns": (titled([map_file(), map_file()], ["transient", "regime"], None, list("abcd")), {"width_mm": 180}),
    "limits": ([Panel(schelleng(), "regime")], {}),
    "serif": ([Panel(schelleng())], {"style": "serif"}),
    "slides": ([Panel(map_file(), "correlation")], {"style": "slides", "width_mm": 160}),
    "tall": ([Panel(map_file(2, 40), "terrain")], {}),
    "wide": ([Panel(map_file(40, 2), "terrain")], {"width_mm": 60}),
    "uneven": ([Panel(uneven())], {}),
    "narrow": ([Panel(map_file(), layer) for layer in ("transient", "regime", "slips")],
               {"columns": 3, "width_mm": 150}),
}  # fmt: skip


@pytest.mark.full
@pytest.mark.parametrize("name", FIGURES)
def test_no_text_is_cut_covered_by_another_or_too_small_to_read(name: str) -> None:
    panels, options = FIGURES[name]
    drawn = figure(panels, dpi=150, **options)
    drawn.canvas.draw()
    page = Bbox([[0, 0], [drawn.bbox.width, drawn.bbox.height]])
    found = list(texts(drawn))
    assert found
    for text, box in found:
        where = f"{text.get_text()!r} at {box}"
        assert page.x0 - 1 <= box.x0 and box.x1 <= page.x1 + 1, where
        assert page.y0 - 1 <= box.y0 and box.y1 <= page.y1 + 1, where
        assert text.get_fontsize() >= 6, where
    for (one, a), (other, b) in itertools.combinations(found, 2):
        inside = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert min(inside) <= 1.5, f"{one.get_text()!r} and {other.get_text()!r}"


@pytest.mark.full
def test_the_figure_is_as_wide_as_asked(tmp_path: Path) -> None:
    for width in (60, 86, 180):
        drawn = figure([Panel(map_file())], width, dpi=100)
        assert drawn.get_size_inches()[0] * 25.4 == pytest.approx(width)


@pytest.mark.full
def test_panels_of_one_layer_share_one_scale_and_have_letters() -> None:
    maps = [map_file(), replace(map_file(), settings=("model=raman",))]
    drawn = figure(titled(maps, ["transient"]), 86, dpi=100)
    scales = [ax for ax in drawn.axes if ax.get_xlabel() == LAYERS["transient"]]
    assert len(scales) == 1
    assert {"(a)", "(b)"} <= {text.get_text() for text, _ in texts(drawn)}
    both = figure(titled(maps, ["transient", "regime"]), 180, dpi=100)
    assert len([ax for ax in both.axes if ax.get_xlabel() == LAYERS["transient"]]) == 1
    assert len([text for text, _ in texts(both) if text.get_text() == "Helmholtz"]) == 1


def test_a_regime_has_its_letter_in_its_area_and_beside_its_name() -> None:
    drawn = figure([Panel(map_file(), "regime")], dpi=100)
    letters = [text.get_text() for text, _ in texts(drawn)]
    assert letters.count("H") == 3  # two areas and the name
    assert letters.count("S") == 2


def test_cells_reach_to_the_midpoints_between_uneven_values() -> None:
    along = Along(PlotAxis.of("f_asym", np.array([1.0, 2.0, 4.0, 10.0])))
    assert along.edges[[0, -1]].tolist() == [0, 4]
    logs = np.log10([1, 2, 4, 10])
    middle = (logs[1:] + logs[:-1]) / 2
    ends = [2 * logs[0] - middle[0], *middle, 2 * logs[-1] - middle[-1]]
    np.testing.assert_allclose(along.edges, (np.array(ends) - ends[0]) / (ends[-1] - ends[0]) * 4)
    ticks = {tick.text: tick.position for tick in along.ticks() if tick.text}
    assert ticks["2"] == pytest.approx((logs[1] - ends[0]) / (ends[-1] - ends[0]) * 4)
    even = Along(PlotAxis.of("f_asym", np.geomspace(1, 10, 5)))
    assert even.edges.tolist() == [0, 1, 2, 3, 4, 5]
    assert even.ticks() == even.axis.ticks()


def test_models_along_an_axis_have_their_names_and_cells_of_one_size() -> None:
    along = Along(PlotAxis.of("model", np.array([4.0, 5.0])))
    assert [tick.text for tick in along.ticks()] == ["Delta/Cremer", "Stiff/Cremer"]
    assert along.edges.tolist() == [0, 1, 2]


@pytest.mark.parametrize("plane", [map_file(computed=20), uneven()], ids=["even", "uneven"])
def test_a_vector_file_has_every_cell_as_an_area_of_its_colour(plane: MapFile) -> None:
    colours = shown(plane, "regime").colours
    x, y = (np.sort(np.random.default_rng(3).random(count + 1)) for count in plane.shape[::-1])
    painted = np.full((*plane.shape, 3), -1.0)
    middle = [(edges[1:] + edges[:-1]) / 2 - np.diff(edges) / 100 for edges in (x, y)]
    for colour, corners in areas_of(colours, x, y):  # painted in order, as a viewer does
        (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
        inside = np.ix_((middle[1] > low) & (middle[1] < high), (middle[0] > left) & (middle[0] < right))
        painted[inside] = colour
    np.testing.assert_allclose(painted * 255, colours, atol=1e-9)


@pytest.mark.full
def test_a_pdf_has_no_image_and_its_fonts_are_embedded_as_truetype(tmp_path: Path) -> None:
    from pypdf import PdfReader

    made = picture([Drawn(schelleng())], ["regime"])
    made.save(tmp_path / "fig.pdf")
    reader = PdfReader(tmp_path / "fig.pdf")
    (page,) = reader.pages
    assert len(page.images) == 0
    fonts = [font.get_object() for font in page["/Resources"]["/Font"].values()]
    assert fonts
    for font in fonts:
        (descendant,) = (each.get_object() for each in font["/DescendantFonts"])
        assert descendant["/Subtype"] == "/CIDFontType2"  # TrueType
        assert "/FontFile2" in descendant["/FontDescriptor"].get_object()
    assert "bow force F (N)" in page.extract_text().replace("\n", " ")
    assert float(page.mediabox.width) == pytest.approx(86 / 25.4 * 72, abs=0.01)
    assert reader.metadata is not None
    assert reader.metadata["/Keywords"] == f"run {schelleng().run_id}"
    assert reader.metadata["/Subject"] == made.caption
    assert "/CreationDate" not in reader.metadata


class Drawn:
    """What `bow.pictures.picture` needs of a map."""

    def __init__(self, file: MapFile) -> None:
        self.file = file


@pytest.mark.full
@pytest.mark.parametrize("suffix", [".pdf", ".svg", ".png"])
def test_the_same_maps_give_the_same_bytes_with_the_id_of_the_run(suffix: str, tmp_path: Path) -> None:
    files = []
    for name in "ab":
        made = picture([Drawn(map_file())], ["regime"], dpi=100)
        files.append(made.save(tmp_path / f"{name}{suffix}").read_bytes())
    assert files[0] == files[1]
    if suffix != ".pdf":
        assert map_file().run_id.encode() in files[0]


def test_a_png_has_the_exact_colours_of_its_cells(tmp_path: Path) -> None:
    drawn = figure([Panel(map_file())], dpi=200)
    cells = next(each for each in drawn.axes[0].images if isinstance(each, Cells))
    drawn.canvas.draw()
    box = drawn.axes[0].get_window_extent()
    dots = np.asarray(drawn.canvas.buffer_rgba())[::-1, :, :3]  # type: ignore[attr-defined]
    for iy, ix in ((0, 0), (1, 3), (3, 7)):
        x, y = box.x0 + (ix + 0.5) / 8 * box.width, box.y0 + (iy + 0.5) / 4 * box.height
        assert tuple(dots[round(y), round(x)]) == tuple(cells.cells[0][iy, ix])
    assert tuple(cells.cells[0][1, 0]) == BLACK
    assert tuple(shown(map_file(), "regime").colours[1, 0]) == REGIME_COLOURS["multiple_slip"]
    assert {HELMHOLTZ, SLIP} == set(np.unique(map_file().regime))


def test_what_a_map_does_not_have_is_refused_with_what_it_has() -> None:
    plane = map_file()
    assert available(plane) == ["transient", "regime", "correlation", "terrain", "slips", "corners"]
    with pytest.raises(
        LayerError, match="layer 'reliability': not in this map, of a sweep without repeats; it has tra"
    ):
        shown(plane, "reliability")
    with pytest.raises(LayerError, match="layer 'confidence': not in this map, of a run of an older version; it has"):
        shown(plane, "confidence")
    with pytest.raises(LayerError, match="layer 'musik': should be one of transient, regime"):
        shown(plane, "musik")
    with pytest.raises(LayerError, match=r"periods = 42: should be one of the tests, 5 \.\.\. 100 by fives"):
        shown(plane, "slips", 42)
    with pytest.raises(LayerError, match="has the regimes of the last test only"):
        shown(plane, "regime", 40)
    with pytest.raises(LayerError, match="3 titles given: should be one for each of the 2 panels"):
        titled([plane], ["transient", "regime"], None, ["a", "b", "c"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"width_mm": 10}, r"width = 10 mm: should be 40 \.\.\. 400 mm"),
        ({"style": "neon"}, "style 'neon': should be one of paper, serif, slides"),
        ({"columns": 9}, r"columns = 9: should be 1 \.\.\. 6"),
        ({"shape": 99}, "shape = 99"),
        ({"dpi": 0.5}, "dpi = 0.5"),
    ],
)
def test_a_figure_that_cannot_be_says_what_would_be_right(options: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        figure([Panel(map_file()), Panel(map_file())], **options)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="panels would be too narrow; should be wider, or of fewer columns"):
        figure([Panel(map_file())] * 6, 60, 6)


def test_numbers_are_written_as_in_print() -> None:
    assert [number(text) for text in ("-0.5", "1e-05", "2e-05", "20")] == [
        "\N{MINUS SIGN}0.5",
        "$10^{-5}$",
        r"$2\times10^{-5}$",
        "20",
    ]


def test_lengths_have_their_units() -> None:
    assert [round(length_mm(text), 2) for text in ("86mm", "8.6 cm", "3.4in", "246pt", "86")] == [
        86,
        86,
        86.36,
        86.46,
        86,
    ]
    with pytest.raises(ValueError, match="--width 3 feet: should be a length such as 86mm"):
        length_mm("3 feet")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run").mkdir()
    write_map_npz(tmp_path / "run" / "map.npz", map_file())
    return tmp_path / "run"


def bow(*words: object) -> int:
    return main([str(word) for word in words])


@pytest.mark.full
def test_the_command_draws_and_prints_the_caption(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "fig.svg"
    assert bow("plot", run, run, "--layer", "transient,regime", "--width", "18cm", "--out", out) == 0
    assert capsys.readouterr().out == f"wrote {out}\n"
    assert bow("plot", run, "--caption", "latex", "--layer", "correlation", "--after", 40, "--out", out) == 0
    said = capsys.readouterr().out
    assert said.startswith(
        "Correlation of successive periods after 40 periods. Stiff/Cremer string, $v_\\mathrm{mid} ="
    )
    assert sorted(tmp_path.iterdir()) == [out, run]


def test_the_command_refuses_in_one_line_and_leaves_no_file(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, status, problem in (
        ((run,), 2, "nothing to do: give --out FILE"),
        ((run, "--out", tmp_path / "fig.txt"), 2, "fig.txt: cannot draw as .txt; should end in"),
        ((run, "--layer", "reliability", "--out", tmp_path / "fig.pdf"), 2, "of a sweep without repeats; it has"),
        ((run, "--width", "1mm", "--out", tmp_path / "fig.pdf"), 2, "width = 1 mm: should be 40 ... 400 mm"),
        ((tmp_path / "nowhere", "--out", tmp_path / "fig.pdf"), 2, "nowhere: cannot be read as a map"),
        ((run, "--out", tmp_path / "no" / "fig.pdf"), 1, "cannot be written: No such file"),
    ):
        assert bow("plot", *words) == status
        (line,) = capsys.readouterr().err.splitlines()
        assert problem in line
    assert list(tmp_path.iterdir()) == [run]


def test_metadata_is_written_under_the_names_of_each_format(tmp_path: Path) -> None:
    from PIL import Image

    save(
        figure([Panel(map_file())], dpi=100),
        tmp_path / "fig.png",
        {"Title": "a map", "Subject": "of β", "Keywords": "run 1"},
    )
    with Image.open(tmp_path / "fig.png") as image:
        assert image.info["Title"] == "a map"
        assert image.info["Description"] == "of β"
