"""Single cells as a recording: what is in the file, what is kept in it, and that the real viewer shows it."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import recording
from live_viewer import eventually, headless_viewer, needs_vulkan
from read_rrd import entities, rows, verify

from bow_sweep.cell import analysis
from bow_sweep.cell.portrait import Portrait
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.figures.colours import REGIME_COLOURS
from bow_sweep.view import cell_views
from bow_sweep.view.cell_views import cells_in, write_cells
from bow_sweep.view.panel import HEIGHT, WIDTH, Panel, ticks

CELLS = (6, 1)


@pytest.fixture(scope="module")
def portraits(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Portrait]:
    run = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("views") / "run"))
    recording.leave_all(run, recording.small_sweep())
    with RunCells(run) as cells:
        return [Portrait.of(cells.record(cell)) for cell in CELLS]


@pytest.fixture(scope="module")
def written(portraits: list[Portrait], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("written") / "cells.rrd"
    write_cells(path, portraits)
    return path


def series(path: Path, entity: str, line: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a series, by rising time."""
    found = sorted((times[line], value[0]) for times, value in rows(path, entity, "Scalars:scalars") if line in times)
    return np.array([at for at, _ in found]), np.array([value for _, value in found])


def test_the_file_is_whole_and_holds_the_cells_in_their_order(written: Path, portraits: list[Portrait]) -> None:
    assert verify(written) == ""
    assert cells_in(written, portraits[0].record.run_id) == [6, 1]
    assert list(written.parent.iterdir()) == [written]
    parts = ("bridge_force", "slip_bars", "velocity/surface", "velocity/bow", "pitch", "friction/steady", "facts")
    for cell in CELLS:
        assert {f"cell_{cell}/{part}" for part in parts} <= entities(written)


def test_the_waveform_is_every_sample_of_the_record_once(written: Path, portraits: list[Portrait]) -> None:
    for portrait in portraits:
        force = portrait.record.bridge_force
        samples, values = series(written, f"cell_{portrait.record.cell}/bridge_force", "sample")
        assert samples.tolist() == list(range(len(force)))
        assert values.astype(np.float32).tobytes() == force.tobytes()
        _, bars = series(written, f"cell_{portrait.record.cell}/slip_bars", "sample")
        assert np.array_equal(np.isfinite(bars), portrait.record.slipping)


def test_the_lanes_change_where_the_string_and_the_regime_do(written: Path, portraits: list[Portrait]) -> None:
    for portrait in portraits:
        record = portrait.record
        motion = rows(written, f"cell_{record.cell}/states/motion", "StateChange:state")
        at = sorted((times["sample"], state[0]) for times, state in motion if "sample" in times)
        assert [sample for sample, state in at if state == "slip"] == record.onsets.tolist()
        regimes = rows(written, f"cell_{record.cell}/states/regime", "StateChange:state")
        begin = sorted(times["sample"] for times, _ in regimes)
        assert begin == [first * record.period for first, _, _ in record.tests.runs()]


def test_the_pitch_is_in_cents_and_in_the_colour_of_the_regime(written: Path, portraits: list[Portrait]) -> None:
    record = portraits[0].record
    known = np.isfinite(record.tests.period)
    assert known.any()
    _, cents = series(written, "cell_6/pitch", "sample")
    right = [analysis.cents(period, record.period) for period in record.tests.period[known].tolist()]
    assert cents == pytest.approx(right)
    colours = [value[0] for _, value in rows(written, "cell_6/pitch", "SeriesPoints:colors")]
    names = [record.tests.name(test) for test in np.flatnonzero(known)]
    packed = [int("".join(f"{channel:02x}" for channel in REGIME_COLOURS[name]) + "ff", 16) for name in names]
    assert colours == packed


def test_the_sound_is_in_the_file(written: Path) -> None:
    ((_, blob),) = rows(written, "cell_6/sound", "AssetAudio:blob")
    content = bytes(blob[0])
    assert content.startswith(b"RIFF")
    assert len(content) == 44 + 2 * 2 * 48_000
    assert rows(written, "cell_6/sound_end", "sound")


def test_a_recording_of_another_run_is_not_added_to(written: Path, tmp_path: Path) -> None:
    assert cells_in(tmp_path / "none.rrd", "a") == []
    with pytest.raises(ValueError, match="is not a recording of cells of run abc"):
        cells_in(written, "abc")
    (tmp_path / "bad.rrd").write_bytes(b"nonsense")
    with pytest.raises(ValueError, match=r"bad\.rrd"):
        cells_in(tmp_path / "bad.rrd", "abc")


def test_a_file_that_cannot_be_written_leaves_the_old_one(
    written: Path, portraits: list[Portrait], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = Path(shutil.copy(written, tmp_path / "cells.rrd"))
    before = path.read_bytes()

    def fails(*_: object) -> None:
        raise OSError(28, os.strerror(28), "cells.rrd")

    monkeypatch.setattr(cell_views, "_layout", fails)
    with pytest.raises(OSError, match="No space"):
        write_cells(path, portraits)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(OSError, match="nowhere"):
        write_cells(Path("/nowhere/cells.rrd"), portraits)


def test_a_panel_places_values_and_labels_within_its_bounds() -> None:
    panel = Panel((-15.0, 3.0), (-1.0, 4.5), "x", "y")
    assert panel.place(np.array([-15.0, 3.0]), np.array([-1.0, 4.5])).tolist() == [[0, HEIGHT], [WIDTH, 0]]
    (left, right), (top, bottom) = panel.bounds
    for x, y, _ in panel.labels():
        assert left < x < right
        assert top < y < bottom
    assert ticks((0.0, 12.0)) == [0, 2, 4, 6, 8, 10, 12]


@pytest.mark.full
def test_the_real_viewer_shows_every_part_of_a_cell_and_complains_of_none(written: Path) -> None:
    needs_vulkan()
    shown = {
        "bridge force": cell_views.FORCE,
        "slips": cell_views.SLIP,
        "velocity": cell_views.VELOCITY,
        "friction curve": cell_views.CURVE,
    }
    with headless_viewer() as viewer:
        viewer.open(str(written))

        def pixels() -> dict[str, int]:
            painted = viewer.window()
            near = {what: abs(painted - np.array(colour)).max(axis=-1) <= 10 for what, colour in shown.items()}
            return {what: int(found.sum()) for what, found in near.items()}

        eventually(lambda: min(pixels().values()) > 40, f"there are pixels in the colours of {', '.join(shown)}")
        assert viewer.complaints() == {}
        assert viewer.client.get_state().recordings[0].current_timeline == "time"
