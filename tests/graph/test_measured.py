"""A measured string, live: a sensor plays a bridge force, and classifier, recorder and dashboard follow it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from graph import PATIENCE_S, verified
from read_rrd import entities, rows
from scipy.signal import resample_poly

import bow
from bow.recorded import read_recording
from bow_classifier.verdict.regimes import HELMHOLTZ, is_helmholtz
from bow_sweep.record.replay import load_verdicts

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

RATE, F0, BETA = 48000, 440.0, 15 / 139
PLAYER = Path(__file__).parents[1] / "support" / "player.py"


@pytest.fixture(scope="module")
def wave() -> np.ndarray:
    """A string that finds into Helmholtz motion, as a sensor with the other polarity gives it, with noise."""
    m = bow.sweep("fig11d", x=("f_asym", 2, 12, 4), y=("f_init_ratio", 0.3, 3, 2), periods=700, progress=False)
    cell = m.cell(int(np.flatnonzero(m.regime.ravel() == "helmholtz")[0]))
    force = resample_poly(cell.bridge_force - cell.bridge_force.mean(), RATE // 20, int(cell.sample_rate) // 20)
    return 1 - 0.02 * force + 2e-4 * np.random.default_rng(1).normal(size=len(force))


@pytest.fixture
def nodes() -> Iterator[dict[str, subprocess.Popen[str]]]:
    """Nodes that the test starts; those that are left are killed."""
    running: dict[str, subprocess.Popen[str]] = {}
    yield running
    for process in running.values():
        if process.poll() is None:
            process.kill()
        process.communicate()


def start(role: str, *parameters: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "bow_sweep", role, "--ros-args"]
    for parameter in parameters:
        words += ["-p", parameter]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def until_it_says(process: subprocess.Popen[str], words: str, said: list[str]) -> None:
    """Read lines of a process until one has some words; the test's own time limit bounds the wait."""
    assert process.stdout is not None
    for line in process.stdout:
        said.append(line)
        if words in line:
            return
    pytest.fail(f"it ended without saying {words!r}: {''.join(said)}")


def test_a_string_that_plays_is_judged_recorded_and_shown(
    wave: np.ndarray, nodes: dict[str, subprocess.Popen[str]], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    np.save(tmp_path / "wave.npy", wave)
    for role in ("recorder", "dashboard"):
        nodes[role] = start(role, f"run_dir:={run}")
    given = (f"sample_rate:={RATE}", f"f0:={F0}", f"beta:={BETA}", "pause:=5")
    nodes["classifier"] = start("classifier", "source:=/bridge_force", *given)
    said: dict[str, list[str]] = {role: [] for role in nodes}
    for role, process in nodes.items():
        until_it_says(process, "ready in /bow", said[role])
    play = [sys.executable, str(PLAYER), str(tmp_path / "wave.npy"), str(RATE)]
    subprocess.run(play, check=True, timeout=3 * PATIENCE_S)
    until_it_says(nodes["classifier"], "closes: nothing came for 5 s", said["classifier"])
    for role, process in nodes.items():
        if role != "classifier":
            until_it_says(process, "closes", said[role])
    assert "s: helmholtz" in "".join(said["classifier"])
    for process in nodes.values():
        process.send_signal(signal.SIGINT)
    for role, process in nodes.items():
        assert process.wait(PATIENCE_S) == 0, role

    account = verified(run)
    assert account["verdicts_equal"] == account["chunks"] >= 130
    verdicts = load_verdicts(run)
    regime = verdicts["regime"][verdicts["tested"].ravel(), 0]
    regime = np.where(is_helmholtz(regime), HELMHOLTZ, regime)
    of_file = bow.classify(wave, RATE, F0, beta=BETA).tests.regime
    tests = min(len(regime), len(of_file))
    assert abs(len(regime) - len(of_file)) <= 2
    assert np.mean(regime[:tests] == of_file[:tests]) > 0.9
    assert (regime[tests // 2 : tests] == HELMHOLTZ).all()

    (bag,) = (run / "bag").glob("*.mcap")
    recorded = read_recording(bag)  # the only topic that can be judged
    assert recorded.f0 == pytest.approx(F0, rel=2e-3)
    assert bow.classify(bag).helmholtz[tests // 2 : tests - 1].all()

    shown = run / "dashboard.rrd"
    assert {"regime", "correlation", "force", "about"} <= entities(shown)
    assert len(rows(shown, "correlation", "Scalars:scalars")) == len(regime)


def test_interrupted_while_a_string_plays_it_leaves_a_closed_bag(
    wave: np.ndarray, nodes: dict[str, subprocess.Popen[str]], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    np.save(tmp_path / "wave.npy", np.tile(wave.astype(np.float32), 200))  # five minutes
    nodes["recorder"] = start("recorder", f"run_dir:={run}")
    given = (f"sample_rate:={RATE}", f"f0:={F0}", f"beta:={BETA}")
    nodes["classifier"] = start("classifier", "source:=/bridge_force", *given)
    said: dict[str, list[str]] = {role: [] for role in nodes}
    for role, lines in said.items():
        until_it_says(nodes[role], "ready in /bow", lines)
    nodes["sensor"] = subprocess.Popen(
        [sys.executable, str(PLAYER), str(tmp_path / "wave.npy"), str(RATE)], stdout=subprocess.PIPE, text=True
    )
    until_it_says(nodes["classifier"], " s: ", said["classifier"])  # a regime

    nodes["classifier"].send_signal(signal.SIGINT)  # Ctrl-C
    assert nodes["classifier"].wait(PATIENCE_S) == 0
    assert nodes["sensor"].poll() is None
    nodes["sensor"].kill()
    until_it_says(nodes["recorder"], "closes", said["recorder"])
    nodes["recorder"].send_signal(signal.SIGINT)
    assert nodes["recorder"].wait(PATIENCE_S) == 0

    account = verified(run)
    assert account["verdicts_equal"] == account["chunks"] > 0
    assert (run / "bag" / "metadata.yaml").exists()
    (bag,) = (run / "bag").glob("*.mcap")
    assert len(bow.classify(bag).tests.regime) >= 1
