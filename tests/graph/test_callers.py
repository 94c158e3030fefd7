"""`bow sweep` in unusual environments: it works, or refuses in one line and leaves no files."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from graph import PATIENCE_S, SMALL, TINY, assert_same_map, orphans, sweeping, verified

BOW = [str(Path(sys.executable).with_name("bow"))]

SHADOWS = (
    *("random", "json", "numpy", "argparse", "socket", "tempfile", "rclpy", "bow_sim", "bow_sweep", "bow_msgs"),
    *("bow_classifier", "numba", "rich", "yaml", "setproctitle", "sitecustomize", "xml"),
)
"""Names of modules that files in a working directory may have."""

IN_A_THREAD = """
import asyncio, sys, threading
from bow_sweep.cli import main

async def live():
    status = []
    thread = threading.Thread(target=lambda: status.append(main(sys.argv[1:])))
    thread.start()
    while thread.is_alive():
        await asyncio.sleep(0.05)
    return status[0]

sys.exit(asyncio.run(live()))
"""

REAPED = """
import os, sys, threading, time
from bow_sweep.cli import main

def reap():
    while True:
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            time.sleep(0.001)

threading.Thread(target=reap, daemon=True).start()
sys.exit(main(sys.argv[1:]))
"""


def run(
    command: Sequence[str], folder: Path, closed: str = "", **variables: str | None
) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder with variables of the environment changed; None removes one."""
    environment = {name: value for name, value in {**os.environ, **variables}.items() if value is not None}
    words = ["bash", "-c", f'exec "$@" {closed}', "bash", *command]
    return subprocess.run(
        words, cwd=folder, env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


@pytest.fixture
def shadows(tmp_path: Path) -> Path:
    folder = tmp_path / "shadows"
    folder.mkdir()
    for name in SHADOWS:
        (folder / f"{name}.py").write_text("raise SystemExit('a module of the working directory')\n")
    return folder


@pytest.mark.parametrize(
    "variables",
    [
        {"HOME": None, "ROS_LOG_DIR": None},
        {"HOME": "/proc/nowhere", "NUMBA_CACHE_DIR": "/proc/nowhere", "TMPDIR": "/proc"},
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp", "CYCLONEDDS_URI": "file:///nowhere"},
        {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "LD_LIBRARY_PATH": None, "AMENT_PREFIX_PATH": "/nowhere"},
        {"NUMBA_DISABLE_JIT": "1", "PYTHONWARNINGS": "error", "ROS_LOG_DIR": "/proc/nowhere", "ROS_NAMESPACE": "x y"},
    ],
    ids=str,
)
def test_a_sweep_is_made(
    variables: dict[str, str | None], tmp_path: Path, ros_domain: int, undisturbed_tiny: Path
) -> None:
    done = run([*BOW, "sweep", *TINY, "--out", "run"], tmp_path, **variables)
    assert done.returncode == 0, done.stderr
    assert_same_map(undisturbed_tiny, tmp_path / "run")


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-", "2>/dev/full >/dev/full"])
def test_a_sweep_needs_no_open_streams(closed: str, tmp_path: Path, ros_domain: int, undisturbed_tiny: Path) -> None:
    done = run([*BOW, "sweep", *TINY, "--out", "run"], tmp_path, closed)
    assert done.returncode == 0
    assert_same_map(undisturbed_tiny, tmp_path / "run")


@pytest.mark.parametrize("program", [IN_A_THREAD, REAPED], ids=["thread", "reaped"])
def test_a_sweep_is_made_in_other_programs(
    program: str, tmp_path: Path, ros_domain: int, undisturbed_tiny: Path
) -> None:
    done = run([sys.executable, "-c", program, "sweep", *TINY, "--out", "run"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert_same_map(undisturbed_tiny, tmp_path / "run")


def test_a_sweep_is_made_where_exit_statuses_are_ignored(
    tmp_path: Path, ros_domain: int, undisturbed_tiny: Path
) -> None:
    code = "import os, signal, sys; signal.signal(signal.SIGCHLD, signal.SIG_IGN); os.execv(sys.argv[1], sys.argv[1:])"
    done = run([sys.executable, "-c", code, *BOW, "sweep", *TINY, "--out", "run"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert_same_map(undisturbed_tiny, tmp_path / "run")


def test_files_of_the_working_directory_are_no_modules(shadows: Path, ros_domain: int, undisturbed_tiny: Path) -> None:
    """Not even for a process that is no fork, because ROS is loaded already: the classifier of a replay."""
    done = run([*BOW, "replay", "--graph", str(undisturbed_tiny)], shadows)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["ok"]


@pytest.mark.full
def test_what_is_started_again_is_no_module_of_the_working_directory(
    shadows: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch, undisturbed: Path
) -> None:
    monkeypatch.chdir(shadows)
    directory = shadows.parent / "run"
    instead = ["bash", "-c", f'shift 3; exec {BOW[0]} "$@"', "bash"]  # of python -m module
    with sweeping(directory, *SMALL, "--out", str(directory), outer=instead) as sweep:
        sweep.wait_until((directory / "ledger.jsonl").exists)
        sweep.kill("simulator_1")
        assert sweep.wait() == 0, sweep.text
    monkeypatch.undo()
    verified(directory)
    assert_same_map(undisturbed, directory)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ROS_DOMAIN_ID", "300"),
        ("RCUTILS_COLORIZED_OUTPUT", "yes"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/nowhere.xml"),
    ],
)
@pytest.mark.parametrize("command", [["sweep", *TINY], ["sweep", *TINY, "--out", "run"], ["replay", "--graph", "/"]])
def test_what_cannot_work_is_refused_in_one_line_before_anything_is_made(
    command: list[str], name: str, value: str, tmp_path: Path
) -> None:
    done = run([*BOW, *command], tmp_path, **{name: value})
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert f"{name}={value}" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_start_that_fails_leaves_nothing_and_can_be_given_again(
    tmp_path: Path, ros_domain: int, undisturbed_tiny: Path
) -> None:
    words = [*BOW, "sweep", *TINY, "--out", "run"]
    failed = run(["bash", "-c", 'ulimit -n 16; exec "$@"', "bash", *words], tmp_path)
    assert failed.returncode == 1
    assert "Traceback" not in failed.stderr
    assert "the same command can be given again" in failed.stderr
    assert list(tmp_path.iterdir()) == []
    assert run(words, tmp_path).returncode == 0
    assert_same_map(undisturbed_tiny, tmp_path / "run")


def test_more_simulators_than_start_well_are_not_started(tmp_path: Path, ros_domain: int) -> None:
    directory = tmp_path / "run"
    with sweeping(directory, *TINY, "--simulators", "1000", "--out", str(directory)) as sweep:
        sweep.wait_until(lambda: bool(sweep.children("simulator")))
        assert " are started" in sweep.text
        sweep.process.send_signal(signal.SIGTERM)
        assert sweep.wait() == 130, sweep.text
    assert not orphans(directory)


def test_ctrl_c_during_the_first_import_is_reported_in_one_line(tmp_path: Path) -> None:
    code = (
        "import os, signal, sys; from bow_sweep import entry; sys.argv[:] = ['bow', 'settings']\n"
        "class Interrupt:\n"
        "    def find_spec(self, *_):\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "entry.command()\n"
    )
    done = run([sys.executable, "-c", code], tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "bow: interrupted\n")
