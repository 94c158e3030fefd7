"""A map in Python: the same from a run and computed in this process, and its cells."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import recording

import bow
from bow_sim.physics.errors import ParameterError
from bow_sweep.cell.waveform import CellError
from bow_sweep.maps.map_file import MAP, MapFile
from bow_sweep.maps.playability import MEASURES


def differing(one: MapFile, other: MapFile) -> list[str]:
    """The names of the attributes in which two maps differ in any bit."""
    names = [field.name for field in dataclasses.fields(one)]
    return [
        name for name in names if np.asarray(getattr(one, name)).tobytes() != np.asarray(getattr(other, name)).tobytes()
    ]


def test_a_sweep_in_this_process_finds_the_bits_of_the_recorded_run(run: Path, computed: bow.Map) -> None:
    assert differing(bow.open(run).file, computed.file) == ["run_id"]


def test_the_number_of_threads_changes_no_bit(computed: bow.Map) -> None:
    for workers in (1, 3):
        again = bow.sweep(settings=recording.SMALL, progress=False, workers=workers)
        assert differing(again.file, computed.file) == []


def test_an_adaptive_sweep_marks_what_it_has_simulated() -> None:
    m = bow.sweep("fig11c", nx=16, ny=8, periods=20, adaptive=0.5, progress=False)
    assert m.file.simulated is not None
    assert 0 < m.file.simulated.sum() <= 64
    assert not np.isnan(m.transient_periods).any()  # the others are predicted


def test_settings_are_given_as_python_values_and_keep_their_bits() -> None:
    m = bow.sweep("fig11d", nx=2, ny=2, periods=5, mu_s=0.1 + 0.2 + 0.6, classifier={"corner": 0.4}, progress=False)
    assert m.settings["mu_s"] == 0.1 + 0.2 + 0.6
    assert m.settings["classifier.corner"] == 0.4
    assert m.settings["model"] == "stiff_cremer"


def test_what_is_perhaps_not_meant_is_a_warning() -> None:
    with pytest.warns(UserWarning, match="the body counts twice; bridge=rigid leaves all of it to the modes"):
        bow.sweep("fig11d", nx=1, ny=1, periods=5, body="wolf_83", progress=False)


@pytest.mark.parametrize(
    "axis", [("bridge_r", 5, 100, 3), {"name": "bridge_r", "first": 5, "last": 100, "count": 3}], ids=["row", "names"]
)
def test_any_parameter_is_an_axis(axis: object) -> None:
    m = bow.sweep("fig11d", x=axis, ny=2, periods=5, progress=False)  # type: ignore[arg-type]
    assert m.axes[0].name == "bridge_r"
    assert m.x.tolist() == pytest.approx([5.0, 500**0.5, 100.0])  # logarithmic, as `bow settings` says of it


def test_an_axis_is_a_name_or_a_name_with_its_values() -> None:
    m = bow.sweep("fig11d", x=("model", ["stiff_cremer", "raman"]), y="bow_bridge", ny=2, periods=5, progress=False)
    assert (m.shape, m.ds.model.values.tolist()) == ((2, 2), ["raman", "stiff_cremer"])
    assert m.cell(model="raman", bow_bridge=5).at == {"model": "raman", "bow_bridge": 5.0}
    n = bow.sweep("fig11d", x=("mu_s", np.array([0.5, 0.6, 1.2])), y=("mu_d", [0.1]), periods=5, progress=False)
    assert (n.x.tolist(), n.axes[0].scale) == ([0.5, 0.6, 1.2], "values")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"preset": "fig99"}, "preset 'fig99': no such preset"),
        ({"periods": 7}, "periods = 7: must be a multiple of 5"),
        ({"musik": 1}, "musik = '1': unknown parameter"),
        ({"x": ("bridge_r", 500)}, r"x\.first = 500: the usual axis of bridge_r is 5 \.\.\. 200; give x\.last too"),
        ({"x": 5}, r"x = 5: should be a name, \(name, \[value, \.\.\.\]\) or \(name, first, last"),
        ({"mu_s": True}, "mu_s = True: must be a number"),
        ({"nx": 0}, "x.count = 0"),
    ],
)
def test_a_sweep_that_cannot_be_says_what_would_be_right(arguments: dict[str, object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        bow.sweep(**arguments)  # type: ignore[arg-type]


def test_a_failing_block_ends_the_sweep_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    from bow_sweep.maps import in_process

    def fails(*_: object) -> object:
        raise RuntimeError("no")

    monkeypatch.setattr(in_process, "verdicts", fails)
    with pytest.raises(RuntimeError, match="no"):
        bow.sweep(settings=recording.SMALL, progress=False)


def test_a_run_is_opened_by_its_directory_or_its_file(run: Path, tmp_path: Path) -> None:
    by_directory, by_file = bow.open(run), bow.open(run / MAP)
    assert by_file.directory == run
    assert differing(by_directory.file, by_file.file) == []
    saved = bow.open(by_file.save(tmp_path / "copy.npz"))
    assert saved.directory is None
    assert differing(saved.file, by_file.file) == []


def test_what_is_no_run_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nothing"):
        bow.open(tmp_path / "nothing")
    with pytest.raises(ValueError, match="should be the directory of a run"):
        bow.open(tmp_path)


def test_a_run_without_results_has_the_map_of_its_verdicts(run: Path, tmp_path: Path, computed: bow.Map) -> None:
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "bag").symlink_to(run / "bag")
    found = bow.open(tmp_path / "half")
    assert np.array_equal(found.transient_periods, computed.transient_periods)


def test_regimes_and_terrain_have_names(run: Path) -> None:
    m = bow.open(run)
    assert m.regime.shape == m.terrain.shape == m.shape == (3, 4)
    for iy, ix in np.ndindex(m.shape):
        assert m.regime[iy, ix] == m.file.regime_names[m.file.regime[iy, ix]]
    assert np.array_equal(m.regime_at(20), m.regime)
    assert not np.array_equal(m.regime_at(5), m.regime)
    with pytest.raises(ValueError, match=r"should be one of the tests, 5 \.\.\. 20"):
        m.regime_at(7)


def test_a_cell_without_a_verdict_is_pending(computed: bow.Map) -> None:
    regime = computed.file.regime.copy()
    regime[0, 0] = 255
    assert bow.Map(dataclasses.replace(computed.file, regime=regime)).regime[0, 0] == "pending"


def test_playability_is_that_of_the_report(run: Path) -> None:
    import json

    said = json.loads((run / "report.json").read_text())["playability"]
    found = bow.open(run).playability
    assert {name: each.value for name, each in found.items()} == {m.name: said[m.name]["value"] for m in MEASURES}


@pytest.mark.parametrize("source", ["bag", "computed"])
def test_a_cell_of_a_run_is_checked_against_the_record(run: Path, source: str) -> None:
    c = bow.open(run).cell(7, source=source)
    assert (c.source, c.checked) == (source, True)
    assert c.bridge_force.tobytes() == recording.recorded_force(run, 7).tobytes()


def test_a_cell_of_a_computed_map_has_the_same_bits_and_nothing_to_be_checked_against(
    run: Path, computed: bow.Map
) -> None:
    mine, theirs = computed.cell(7), bow.open(run).cell(7)
    assert (mine.source, mine.checked) == ("computed", None)
    assert mine.bridge_force.tobytes() == theirs.bridge_force.tobytes()
    assert np.array_equal(mine.slips, theirs.slips)
    assert mine.regime == theirs.regime


def test_a_cell_is_the_nearest_to_values_of_the_axes(computed: bow.Map) -> None:
    c = computed.cell(f_asym=float(computed.x[2]) * 1.01, f_init_ratio=1.1)
    assert c.index == 1 * 4 + 2
    assert c.at == {"f_asym": float(computed.x[2]), "f_init_ratio": float(computed.y[1])}


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({}, "give the number of a cell or values of both axes, for instance"),
        ({"f_asym": 3.0}, "f_init_ratio: is not given"),
        ({"f_asym": 3.0, "mu_s": 1.0}, "mu_s: is 0.8 in all cells"),
        ({"index": 12}, "cell 12: there is none; this map has cells 0 ... 11"),
        ({"f_asym": 300.0, "f_init_ratio": 1.0}, "f_asym = 300: the map reaches from"),
    ],
)
def test_a_cell_that_is_not_there_says_what_is(computed: bow.Map, values: dict[str, float], words: str) -> None:
    with pytest.raises(CellError, match=words):
        computed.cell(**values)  # type: ignore[arg-type]


def test_slips_are_a_table(computed: bow.Map) -> None:
    c = computed.cell(7)
    assert len(c.slips) > 10
    assert c.slipping.sum() == c.slips["duration"].sum()
    assert (np.diff(c.slips["onset"]) > 0).all()


def test_a_sound_is_played_and_saved(computed: bow.Map, tmp_path: Path) -> None:
    sound = computed.cell(7).audio(seconds=0.1)
    assert len(sound.samples) == 4800
    assert sound._repr_html_().startswith("<audio")
    assert sound.save(tmp_path / "a.wav").stat().st_size == 44 + 2 * 4800
    with pytest.raises(ValueError, match=r"should end in \.wav"):
        sound.save(tmp_path / "a.mp3")


@pytest.mark.parametrize("layer", ["transient", "regime", "terrain", "correlation", "confidence", "slips", "corners"])
def test_every_layer_has_a_picture_of_the_asked_width(computed: bow.Map, layer: str) -> None:
    figure = computed.plot(layer, width_mm=86).figure
    assert figure.get_size_inches()[0] * 25.4 == pytest.approx(86)
    assert figure.axes[0].get_xlabel() == r"asymptotic bow force $f_\mathrm{asym}$ ($2 Z_0 v_b$)"


def test_a_picture_is_saved_with_its_fonts_and_shown(computed: bow.Map, tmp_path: Path) -> None:
    picture = computed.plot("regime")
    pdf = picture.save(tmp_path / "map.pdf").read_bytes()
    assert pdf.startswith(b"%PDF")
    assert b"/FontFile2" in pdf
    assert picture._repr_png_().startswith(b"\x89PNG")


def test_a_picture_that_cannot_be_says_why(computed: bow.Map) -> None:
    with pytest.raises(ValueError, match="layer 'regimes': should be one of transient, regime"):
        computed.plot("regimes")
    with pytest.raises(ValueError, match="periods = 7: should be one of the tests"):
        computed.plot("slips", periods=7)
    with pytest.raises(ValueError, match="leave it out"):
        computed.plot("transient", periods=5)
    with pytest.raises(ValueError, match="width = 3 mm: should be"):
        computed.plot(width_mm=3)


def test_a_comparison_names_the_settings_that_differ(computed: bow.Map) -> None:
    other = bow.sweep(settings=[*recording.SMALL, "v_mid=0.5"], progress=False)
    found = bow.compare(computed, other)
    assert set(found.settings) == {"v_mid"}
    step = found.differences["2"]["helmholtz"].value
    assert step == other.playability["helmholtz"].value - computed.playability["helmholtz"].value  # type: ignore[operator]
    assert "v_mid" in str(found)
    with pytest.raises(ValueError, match="should be two at least"):
        bow.compare(computed)
