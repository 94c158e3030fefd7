"""The command `bow` without a graph: its help, its results, and what it refuses in one line."""

from __future__ import annotations

import wave
from pathlib import Path

import numpy as np
import pytest

from bow_sim.physics.motion import regular_from
from bow_sim.physics.parameters import Parameters
from bow_sweep.cli import main
from bow_sweep.cli.parser import ADDED_BY, parser

CELL = ["--model", "delta_cremer", "--v-mid", "0.7", "--f-init-ratio", "1"]


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Return exit status, stdout and stderr of a command."""
    try:
        status = main(words)
    except SystemExit as end:
        status = int(end.code or 0)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def commands() -> list[str]:
    actions = [action for action in parser()._actions if action.choices]
    return list(actions[0].choices or [])


def test_each_command_is_known_with_the_module_that_adds_it() -> None:
    assert list(ADDED_BY) == commands()
    alone = [action.choices for action in parser("settings")._actions if action.choices]
    assert list(alone[0] or []) == ["settings"]


@pytest.mark.parametrize("command", commands())
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, command, "--help")
    assert status == 0
    assert "usage:" in out
    assert len(out) > 80


@pytest.mark.parametrize(("force", "onset"), [("5.5", 2224), ("5.3", 2922)])
def test_the_papers_transients_end_in_helmholtz_motion(
    force: str, onset: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "t.npz"
    status, out, _ = run(capsys, "transient", *CELL, "--f-asym", force, "--npz", str(path))
    assert status == 0
    assert f"slip onset {onset}" in out
    with np.load(path) as file:
        waveforms = {name: file[name] for name in file.files}
    for name in ("bridge_force", "v", "v_h", "v_centre", "friction_force"):
        assert waveforms[name].dtype == np.float64
        assert waveforms[name].shape == (13_900,)
    assert waveforms["slipping"].dtype == bool
    assert regular_from(waveforms["slipping"], 139) == onset
    sticking = ~waveforms["slipping"]
    np.testing.assert_allclose(waveforms["v"][sticking], 1.0, atol=1e-12)
    np.testing.assert_allclose(waveforms["v"], waveforms["v_h"] + 1.617 * waveforms["friction_force"], atol=1e-12)
    again = Parameters.from_settings(waveforms["settings"].tolist())
    assert again.f_asym == float(force)


def test_a_transient_can_be_seen_and_heard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture, sound = tmp_path / "t.png", tmp_path / "t.wav"
    words = ["transient", *CELL, "--periods", "10", "--plot", str(picture), "--wav", str(sound)]
    status, _, _ = run(capsys, *words)
    assert status == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    with wave.open(str(sound)) as file:
        assert (file.getframerate(), file.getnframes()) == (48_000, 1091)


def test_a_reflection_function_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "nut.txt"
    mine.write_text("first=124 taps=-0.9")
    words = ["transient", *CELL, "--periods", "10", "--set", f"nut_function=@{mine}", "--npz", str(tmp_path / "t.npz")]
    assert run(capsys, *words)[0] == 0
    mine.write_text("first=124 taps=-1.5")
    status, _, err = run(capsys, *words)
    assert status == 2
    assert "1.5" in err
    assert "Hz" in err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["transient", "--f-asym", "0"], "f_asym"),
        (["transient", "--f-asym", "nan"], "f_asym"),
        (["transient", "--v-mid", "1"], "v_mid"),
        (["transient", "--model", "erard"], "erard"),
        (["transient", "--periods", "7"], "periods"),
        (["transient", "--set", "tau_f=0"], "tau_f"),
        (["transient", "--set", "colour=red"], "colour"),
        (["transient", "--periods", "5", "--plot", "t.bmp"], "t.bmp"),
        (["transient", "--periods", "5", "--npz", "t.npz", "--plot", "t.bmp"], "t.bmp"),
        (["transient", "--periods", "5", "--npz", "t.npz", "--wav", "t.mp3"], "should end in .wav"),
        (["transient", "--periods", "5", "--wav", "t.wav", "--seconds", "0"], "0.05 to 60 s"),
        (["transient", "--periods", "5", "--body"], "give --wav"),
        (["transient", "--periods", "5", "--npz", "/nowhere/at/all.npz"], "/nowhere"),
        (["sweep", "nope"], "nope"),
        (["replay", "/nowhere"], "/nowhere"),
        (["recover", "/nowhere"], "/nowhere"),
        (["figure", "1", "--out", "f.png"], "figure"),
        (["sweep", "fig11d", "--record", "nothing"], "record = 'nothing': should be one of all, last, verdicts"),
        (["sweep", "--resume", "run", "--record", "all"], "--resume takes the sweep from the run directory"),
        (["verify", "run", "--sample", "-1"], "--sample -1: should be 0 or more"),
        (["verify", "run", "--seed", "-1"], "--seed -1: should be 0 or more"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    status, _, err = run(capsys, *words)
    assert status == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_verifying_nothing_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "verify", str(tmp_path))
    assert status == 1
    assert '"ok": false' in out


def test_settings_are_listed_with_unit_and_range(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(capsys, "settings")
    assert status == 0
    assert "f_asym" in out
    assert "x.count" in out
