"""`bow inspect`: cells are chosen, shown, drawn and heard; what cannot be is refused in a line."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import recording
from scipy.io import wavfile

from bow_sweep.cli import main
from bow_sweep.view.cell_views import cells_in


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def inspect(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    status = main(["inspect", *map(str, words)])
    captured = capsys.readouterr()
    said = [line for line in captured.err.splitlines() if not line.endswith(" %")]  # progress, on a busy machine
    return status, captured.out, "\n".join(said)


def test_cells_are_added_to_the_recording_of_the_run(whole: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = inspect(capsys, whole, "--at", "f_asym=5.8,f_init_ratio=1.0")
    assert status == 0
    assert "cell 6: f_asym 5.848, f_init_ratio 1" in out
    assert "checked           yes: read from the bag" in out
    assert "there is no display here" in err
    assert f"rerun {whole / 'cells.rrd'}" in err
    assert cells_in(whole / "cells.rrd", recording.RUN) == [6]


def test_a_second_cell_is_added_and_a_cell_that_is_there_comes_to_the_front(
    whole: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from bow_sweep.view import cell_views

    for words in (["--cell", 6], ["--cell", 0, "--computed"], ["--cell", 6]):
        status, out, err = inspect(capsys, whole, *words, "--no-view")
        assert (status, err) == (0, "")
    assert "2 cells" in out
    assert cells_in(whole / "cells.rrd", recording.RUN) == [0, 6]
    monkeypatch.setattr(cell_views, "MOST", 2)
    status, _, err = inspect(capsys, whole, "--cell", 3, "--no-view")
    assert status == 0
    assert "holds 2 cells: cell 0 is left out now" in err
    assert cells_in(whole / "cells.rrd", recording.RUN) == [6, 3]
    status, _, err = inspect(capsys, whole, "--cell", 3, "--cell", 4, "--cell", 5)
    assert (status, len(err.splitlines())) == (2, 1)


@pytest.mark.full
def test_picture_and_sound_of_several_cells_have_their_numbers(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    to = tmp_path / "to"
    to.mkdir()
    files = ["--plot", to / "c.png", "--wav", to / "c.wav", "--seconds", 0.5, "--save", to / "c.rrd", "--no-view"]
    status, out, _ = inspect(capsys, whole, "--cell", 6, "--cell", 7, *files)
    assert status == 0
    assert sorted(path.name for path in to.iterdir()) == ["c-6.png", "c-6.wav", "c-7.png", "c-7.wav", "c.rrd"]
    assert not (whole / "cells.rrd").exists()
    rate, samples = wavfile.read(to / "c-7.wav")
    assert (rate, len(samples)) == (48_000, 24_000)
    assert "0.50 s at 48000 Hz, peak -3.0 dB" in out


def test_a_run_without_a_bag_is_computed_again_and_that_is_said(
    whole: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(whole / "bag")
    status, out, _ = inspect(capsys, whole, "--cell", 6, "--no-view")
    assert status == 0
    assert "waveform          computed again" in out
    assert "has no bag/; computed again: there is no bag to hold it against; the kernel is the run's" in out


def test_a_waveform_that_is_not_the_recorded_one_is_a_failure(
    whole: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from bow_sweep.cell import computed

    right = computed.compute
    monkeypatch.setattr(computed, "compute", lambda plane, cell, periods=None: right(plane, cell + 1, periods))
    status, _, err = inspect(capsys, whole, "--cell", 6, "--computed", "--no-view")
    assert status == 1
    assert "cell 6: its waveform is not the recorded one: differs from the bag from sample" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "no cell is chosen: the map has f_asym from 0.5 to 20 and f_init_ratio from 0 to 2; for instance --at"),
        (["--cell", "12"], "cell 12: there is none; this map has cells 0 ... 11"),
        (["--cell", "-1"], "cell -1: there is none"),
        (["--at", "f_asym=90,f_init_ratio=1"], "f_asym = 90: the map reaches from 0.5 to 20; the nearest is 20"),
        (["--at", "f_asym=3"], "f_init_ratio: is not given"),
        (["--at", "f_asim=3,f_init_ratio=1"], "f_asim: is not a parameter"),
        (["--at", "f_asym"], "should be name=value"),
        (["--at", "f_asym=3,f_asym=4"], "f_asym is given twice"),
        (["--at", "f_asym=three,f_init_ratio=1"], "should be name=value"),
        (["--cell", "1", "--wav", "t.mp3"], "should end in .wav"),
        (["--cell", "1", "--plot", "t.bmp"], "t.bmp"),
        (["--cell", "1", "--save", "t.mcap"], "should end in .rrd"),
        (["--cell", "1", "--seconds", "2"], "give --wav"),
        (["--cell", "1", "--wav", "t.wav", "--seconds", "900"], "0.05 to 60 s"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    words: list[str],
    message: str,
    complete: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = inspect(capsys, complete, *words)
    assert (status, out) == (2, "")
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
    assert not (complete / "cells.rrd").exists()


def test_what_is_no_run_or_cannot_be_written_is_said_in_one_line(
    complete: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, _, err = inspect(capsys, tmp_path, "--cell", 0)
    assert status == 2
    assert "has neither map.npz nor bag/" in err
    status, _, err = inspect(capsys, complete, "--cell", 0, "--save", "/nowhere/c.rrd")
    assert status == 1
    assert len(err.strip().splitlines()) == 1
    assert "/nowhere" in err
    (tmp_path / "other.rrd").write_bytes(b"nonsense")
    status, _, err = inspect(capsys, complete, "--cell", 0, "--save", tmp_path / "other.rrd")
    assert status == 2
    assert len(err.strip().splitlines()) == 1
    assert (tmp_path / "other.rrd").read_bytes() == b"nonsense"


@pytest.mark.parametrize(
    ("end", "said"), [(None, ""), ("", ""), ("the viewer ended (exit status 1): no GPU", "no GPU; open it where")]
)
def test_the_viewer_opens_the_recording_and_what_goes_wrong_with_it_is_said(
    end: str | None, said: str, whole: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from bow_sweep.cli import inspect as command
    from bow_sweep.view import viewer

    opened = []

    class Window:
        def __init__(self, recording: str) -> None:
            opened.append(recording)

        def ended(self) -> str | None:
            return end

    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr(viewer, "Viewer", Window)
    monkeypatch.setattr(command, "VIEWER_WAIT_S", 0.2)
    status, _, err = inspect(capsys, whole, "--cell", 6)
    assert status == 0
    assert opened == [str(whole / "cells.rrd")]
    assert (said in err) and bool(err) == bool(said)
    assert cells_in(whole / "cells.rrd", recording.RUN) == [6]
