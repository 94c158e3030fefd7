"""The recording: what is in the file, also after the process that wrote it was killed."""

import signal
import subprocess
import sys
import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from example_maps import RUN, SLIP, basin_map, inspection, map_file, outline, plan, settings
from read_rrd import colours, entities, named, names_of, pending, rows, verify

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol import cdr
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.figures.colours import GREY, REGIME_COLOURS, transient_colours
from bow_sweep.maps.plane import Snapshot, regime_label
from bow_sweep.view.codes import FOREIGN_LABEL
from bow_sweep.view.map_layers import tensor
from bow_sweep.view.rerun_recording import RunRecording


def snapshot(computed: int | None = None, run: str = RUN) -> Snapshot:
    return Snapshot.from_message(basin_map(computed=computed, run=run)).with_plan(settings(), "fig11d")


def recording(path: Path, **options) -> RunRecording:
    return RunRecording(path, Snapshot.empty(outline()), **options)


def show_waveform(shown: RunRecording, cells: list[int], chunk: int) -> np.ndarray:
    values = [cdr.unseal("InspectedCell", inspection(cell, chunk)) for cell in cells]
    data = np.array([one["bridge_force"] for one in values])
    shown.waveform(cells, values[0]["first_sample"], data)
    return data


PLACES = ("map", "tests/correlation", "tests/slips", "tests/corners", "regime", "terrain")


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "dashboard.rrd"


def test_the_map_is_in_the_file_cell_for_cell(path):
    shown = recording(path)
    shown.map(snapshot(computed=12))
    shown.map(snapshot(computed=20))
    shown.finish()
    assert verify(path) == ""
    for place in ("map", "regime"):
        said = named(path, place)
        assert said[0] == [f"Helmholtz, transient {5 * length} periods" for length in range(1, 9)]
        assert set(said[1]) == {"multiple slip, no Helmholtz motion"}
        assert set(said[3]) == {"pending"}
    slips, corners, correlation = (named(path, f"tests/{name}") for name in ("slips", "corners", "correlation"))
    assert set(slips[1]) == {"10 slips"}
    assert set(corners[0]) == {"5 corners"}
    assert set(corners[3]) == {"pending"}
    assert correlation[0][0] == "correlation 0.90"
    assert correlation[2][0] == "correlation 0.92"
    grown = [sum(text == "pending" for line in named(path, "map", row) for text in line) for row in range(3)]
    assert grown == [32, 20, 12]


def test_the_mouse_finds_the_parameters_of_each_cell(path):
    shown = recording(path)
    shown.map(snapshot())
    shown.finish()
    for place in ("map", "regime", "tests/slips", "terrain"):
        names = rows(path, f"{place}/cells", "cell")[-1][1]
        assert names[0] == "f_asym 0.5 2 Z_0 v_b, f_init/f_asym 0"
        assert names[31] == "f_asym 20 2 Z_0 v_b, f_init/f_asym 2"
        (strips,) = (value for _, value in rows(path, f"{place}/cells", "LineStrips2D:strips"))
        assert len(strips) == 32
        (left, upper), (right, lower) = strips[8]  # the first cell of the second row of four
        assert (left + right) / 2 == pytest.approx(8)
        assert (upper + lower) / 2 == pytest.approx(40)


def test_a_large_map_has_no_cells_to_point_at(path):
    shown = RunRecording(path, Snapshot.empty(SweepOutline.of(plan(nx=210, ny=210))))
    shown.finish()
    assert "map/picture" in entities(path)
    assert "map/cells" not in entities(path)


def test_counts_go_on_in_time(path):
    shown = recording(path)
    shown.map(snapshot(computed=16))
    shown.map(snapshot())
    shown.finish()
    counts = rows(path, "counts", "Scalars:scalars")
    assert [value[REGIMES.index("helmholtz")] for _, value in counts] == [0, 8, 24]
    assert [value[-1] for _, value in counts] == [32, 16, 0]
    ((_, names),) = rows(path, "counts", "SeriesLines:names")
    assert names[REGIMES.index("helmholtz")] == "Helmholtz"
    assert len(names) == len(counts[0][1])
    assert not [when for when, _ in counts if "sample" in when or "test" in when]  # there they would be one point
    times = [when["sweep"] for when, _ in counts]
    assert times == sorted(times)
    assert 0 <= times[0] < 60e9


def test_maps_stand_still_among_the_waveforms(path):
    shown = recording(path)
    shown.map(snapshot())
    show_waveform(shown, [3], 0)
    shown.finish()
    assert {when["sample"] for when, _ in rows(path, "map/picture", "Image:buffer")} == {0}


def test_waveforms_are_seen_on_the_timeline_on_which_the_viewer_opens(path):
    shown = recording(path)
    shown.map(snapshot())
    show_waveform(shown, [3], 0)
    shown.finish()
    found = [when for when, _ in rows(path, "waveform/cell_3", "Scalars:scalars") if when]
    assert [when["sample"] for when in found] == list(range(695))
    assert found[-1]["sweep"] == pytest.approx(694 / 61160 * 1e9, rel=1e-6)


def test_pictures_have_the_colours_of_the_map_and_of_the_regimes(path):
    shown = recording(path)
    shown.map(snapshot(computed=20))
    shown.finish()
    lengths = snapshot(computed=20).transient_periods
    np.testing.assert_array_equal(colours(path, "map"), transient_colours(lengths, 100))
    assert colours(path, "regime")[:, 0].tolist() == [
        list(colour)
        for colour in (REGIME_COLOURS["helmholtz"], REGIME_COLOURS["multiple_slip"], REGIME_COLOURS["helmholtz"], GREY)
    ]


def test_every_test_is_on_a_timeline_of_its_own(path):
    shown = recording(path)
    shown.map(snapshot())
    result = map_file()
    regimes = np.where(result.helmholtz, 1, SLIP).astype(np.uint8)
    confidence = np.full(regimes.shape, 0.875, np.float32)
    shown.tests(replace(result, regimes=regimes, confidence=confidence))
    shown.finish()
    at = [when["test"] for when, _ in rows(path, "map/picture", "Image:buffer") if "log_time" not in when]
    assert at == [0, *range(5, 105, 5)]
    assert set(named(path, "map", 0)[0]) == {"pending"}
    for periods in (5, 15, 100):
        row = periods // 5
        known = [f"Helmholtz, transient {5 * n} periods" for n in range(1, 9) if 5 * n <= periods]
        assert named(path, "map", row)[0] == known + ["multiple slip, no Helmholtz motion"] * (8 - len(known))
    counts = rows(path, "counts", "Scalars:scalars")[:21]
    assert [value[1] for _, value in counts] == [0, *(int(layer.sum()) for layer in result.helmholtz)]
    bars = rows(path, "lengths", "BarChart:values")
    assert {when["test"] for when, _ in bars} == {0, *range(5, 105, 5)}
    assert rows(path, "map/cells", "cell")[-1][1][0] == "f_asym 0.5 2 Z_0 v_b, f_init/f_asym 0; confidence 0.88"


def test_bars_have_the_tensor_that_rerun_itself_makes():
    for values in (np.arange(5, 105, 5), np.array([7])):
        made = tensor(values)
        made.validate(full=True)
        expected = rr.components.TensorDataBatch(values).as_arrow_array()
        assert made.type == expected.type
        assert made.equals(expected)


def test_waveforms_of_inspected_cells_are_there_sample_for_sample(path):
    shown = recording(path)
    shown.map(snapshot())
    sent = np.hstack([show_waveform(shown, [3, 17], chunk) for chunk in range(3)])
    show_waveform(shown, [3, 17], 2)  # another attempt
    shown.finish()
    for cell, force in zip((3, 17), sent, strict=True):
        found = rows(path, f"waveform/cell_{cell}", "Scalars:scalars")
        values = {when["sample"]: value[0] for when, value in found if when}
        assert len([1 for when, _ in found if when]) == 3 * 695
        np.testing.assert_array_equal([values[sample] for sample in range(3 * 695)], force)
        assert f"map/inspected/cell_{cell}/frame" in entities(path)


def waveform(path: Path, cell: int) -> dict[int, float]:
    """The recorded samples of a cell, none of them twice."""
    found = [
        (when["sample"], value[0]) for when, value in rows(path, f"waveform/cell_{cell}", "Scalars:scalars") if when
    ]
    assert len(dict(found)) == len(found)
    return dict(found)


def test_what_comes_after_a_lost_chunk_waits_for_it(path):
    shown = recording(path)
    shown.map(snapshot())
    sent = {chunk: show_waveform(shown, [3], chunk)[0] for chunk in (1, 3)}
    shown.flush()
    assert sorted(waveform(path, 3)) == [*range(695, 2 * 695)]  # no line is drawn across the gap
    assert shown.missing(4 * 695) == {3: [(0, 695), (2 * 695, 3 * 695)]}
    sent |= {chunk: show_waveform(shown, [3], chunk)[0] for chunk in (0, 2)}
    assert shown.missing(4 * 695) == {}
    shown.draw_rest()
    shown.finish()
    whole = waveform(path, 3)
    np.testing.assert_array_equal([whole[sample] for sample in range(4 * 695)], np.hstack([sent[n] for n in range(4)]))


def test_a_chunk_that_stays_lost_is_a_gap_and_not_a_line(path):
    shown = recording(path)
    shown.map(snapshot())
    for chunk in (0, 2):
        show_waveform(shown, [3], chunk)
    shown.draw_rest()
    shown.finish()
    values = waveform(path, 3)
    assert np.isnan(values[2 * 695 - 1])
    assert len(values) == 2 * 695 + 1


def test_axes_scales_and_meanings_are_drawn_once(path):
    shown = recording(path)
    for _ in range(3):
        shown.map(snapshot())
    shown.finish()
    for place in ("map", "tests/correlation", "tests/slips", "tests/corners", "regime"):
        for part in ("axes/lines", "axes/labels", "axes/scale"):
            assert f"{place}/{part}" in entities(path)
    words = rows(path, "map/axes/labels", "Points2D:labels")
    assert {"0.5", "20", "never", "pending", "transient (periods)"} <= set(words[-1][1])
    assert len(words) == 1
    assert words[0][0] == {}


def test_limits_are_lines_over_every_picture(path):
    x = {"x.name": "bow_bridge", "x.scale": "linear", "x.first": 8, "x.last": 15, "x.count": 8}
    y = {"y.name": "f_asym", "y.scale": "log", "y.first": 5, "y.last": 30, "y.count": 4}
    given = {**plan(), "spec.settings": [f"{name}={value}" for name, value in {**x, **y}.items()] + settings()[:1]}
    given["spec.settings"] += [line for line in settings()[1:] if not line.startswith(("x.", "y.", "bow_bridge"))]
    RunRecording(path, Snapshot.empty(SweepOutline.of(given))).finish()
    for place in PLACES:
        assert rows(path, f"{place}/axes/limits/names", "Points2D:labels")[-1][1] == ["F_max"]
        ((line,),) = [strips for _, strips in rows(path, f"{place}/axes/limits/lines", "LineStrips2D:strips")]
        first, last = np.array(line[0]), np.array(line[-1])
        assert first[0] < last[0] and first[1] < last[1]  # y points down: less force farther from the bridge
    assert "axes/limits" not in " ".join(entities(recorded_without_limits(path)))


def recorded_without_limits(path: Path) -> Path:
    other = path.with_name("plain.rrd")
    recording(other).finish()
    return other


def contexts(path: Path) -> dict[str, list]:
    """The names and colours of codes by entity: when they were logged, and what."""
    found = {place: rows(path, place, "AnnotationContext:context") for place in PLACES}
    return {place: [what[0] for _, what in entries] for place, entries in found.items()}


def test_names_and_colours_of_codes_are_there_for_files_and_for_viewers_complete_before_any_map(path):
    shown = recording(path)
    shown.flush()
    before = contexts(path)
    shown.map(snapshot(computed=12))
    shown.map(snapshot())
    shown.finish()
    shown = recording(path)  # a dashboard that is started again
    shown.map(snapshot())
    shown.finish()
    assert contexts(path) == before
    for place, found in before.items():
        assert found[0] == found[1], "as static data and on the timelines"
        times = [when for when, _ in rows(path, place, "AnnotationContext:context")]
        assert [{name: when[name] for name in when if name != "log_time"} for when in times] == [
            {},
            {"sweep": 0, "sample": 0, "test": 0},
        ]
    known = {name.partition(",")[0] for name in names_of(path, "regime").values()}
    assert {regime_label(name) for name in REGIMES} | {"pending"} <= known


def test_the_codes_of_another_classifier_are_translated_to_the_names_that_were_logged(path):
    shown = recording(path)
    usual = snapshot()
    names = ("a_new_regime", *reversed(REGIMES))
    codes = np.array([*(names.index(name) for name in REGIMES), *[PENDING] * (256 - len(REGIMES))], np.uint8)
    other = codes[usual.regime]
    other[0, 0] = 0
    shown.map(replace(usual, regime_names=names, regime=other))
    shown.finish()
    said = named(path, "regime")
    assert said[0][0] == f"{FOREIGN_LABEL}, transient 5 periods"
    assert said[0][1] == "Helmholtz, transient 10 periods"
    assert set(said[1]) == {"multiple slip, no Helmholtz motion"}
    assert rows(path, "counts", "Scalars:scalars")[-1][1][SLIP] == (usual.regime == SLIP).sum()


def test_a_file_without_a_footer_is_taken_up_and_nothing_is_lost(path):
    script = f"""
        import os, sys
        sys.path[:0] = [{str(Path(__file__).parent)!r}, *{sys.path!r}]
        from test_rerun_recording import recording, show_waveform, snapshot
        from pathlib import Path
        shown = recording(Path({str(path)!r}))
        shown.map(snapshot(computed=12))
        show_waveform(shown, [3], 0)
        shown.status("before")
        shown.flush()
        os.kill(os.getpid(), {int(signal.SIGKILL)})
    """
    killed = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=False
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert "footer" in verify(path)
    assert pending(path) == [32, 20]
    before = rows(path, "counts", "Scalars:scalars")

    shown = recording(path)
    assert shown.scope.cells == [3]
    shown.map(snapshot())
    show_waveform(shown, [3], 1)
    shown.status("after")
    shown.finish()
    assert verify(path) == ""
    after = rows(path, "counts", "Scalars:scalars")
    assert after[: len(before)] == before
    assert pending(path) == [32, 20, 32, 0]
    assert after[-1][0]["sweep"] > before[-1][0]["sweep"]  # one clock
    assert [value for _, value in rows(path, "account", "TextDocument:text")] == [["before"], ["after"]]
    force = [value[0] for when, value in rows(path, "waveform/cell_3", "Scalars:scalars") if when]
    assert len(force) == 2 * 695
    assert np.isfinite(force).all()
    assert [p.name for p in path.parent.iterdir()] == ["dashboard.rrd"]


def test_another_runs_recording_is_put_aside(path):
    other = "f" * 16
    first = RunRecording(path, Snapshot.empty(outline(other)))
    first.finish()
    content = path.read_bytes()
    shown = recording(path)
    shown.finish()
    assert (path.parent / "dashboard-1.rrd").read_bytes() == content
    assert pending(path) == [32]


@pytest.mark.parametrize("damage", ["cut", "rubbish"])
def test_a_damaged_recording_is_kept_and_complained_about(path, damage):
    shown = recording(path)
    shown.map(snapshot(computed=12))
    shown.finish()
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if damage == "cut" else b"no recording")
    complaints: list[str] = []
    shown = recording(path, warn=complaints.append)
    shown.map(snapshot())
    shown.finish()
    assert verify(path) == ""
    assert pending(path)[-1] == 0
    if damage == "rubbish":
        assert "dashboard-1.rrd" in complaints[0]
        assert (path.parent / "dashboard-1.rrd").read_bytes() == b"no recording"


def test_a_directory_that_cannot_be_written_is_an_error(tmp_path):
    with pytest.raises((OSError, RuntimeError), match="nowhere"):
        recording(tmp_path / "nowhere" / "dashboard.rrd")
    assert list(tmp_path.iterdir()) == []
