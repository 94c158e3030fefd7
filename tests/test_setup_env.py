"""`make setup` does what is due, reuses the rest, and never takes half an environment for a whole one."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from checkout import ROOT

SCRIPT = ROOT / "tools" / "setup_env.py"


@pytest.fixture
def env(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """tools/setup_env.py at work in a small checkout; what it would run is listed in `env.commands`."""
    spec = importlib.util.spec_from_file_location("setup_env", SCRIPT)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    root = tmp_path / "a checkout"
    for name in ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "constraints.txt", "requirements-dev.txt"):
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_text(name)
    (root / "requirements.txt").write_text("ros-jazzy-rclpy==7.1.6  # ROS\n./msg_defs\n.\n")
    rooms = ("bow_sim/kernel/block.py", "bow_classifier/features/corners.py")
    for name in ("msg_defs/msg/Plan.msg", "resource/lib/node", "resource/lib/simulator", *rooms):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name)
    venv = root / ".venv"
    constants = {
        "ROOT": root,
        "VENV": venv,
        "PYTHON": venv / "bin" / "python",
        "RECORD": venv / ".bow-setup.json",
        "STARTED": venv / ".bow-setup.started",
    }
    for name, value in constants.items():
        monkeypatch.setattr(module, name, str(value))
    module.commands = []  # type: ignore[attr-defined]

    def run(command: list[str], what: str) -> None:
        module.commands.append(command)  # type: ignore[attr-defined]
        if "venv" in command:
            (venv / "bin").mkdir()
            (venv / "bin" / "python").touch()

    monkeypatch.setattr(module, "run", run)
    monkeypatch.setattr(module, "run_together", lambda jobs: [run(*job) for job in jobs])
    return module


def installed(env: ModuleType) -> list[str]:
    """What the last command asked pip for."""
    command = env.commands[-1]
    return command[command.index("constraints.txt") + 1 :]


def test_the_first_set_up_makes_everything(env: ModuleType) -> None:
    env.sync(None, tests=False)
    made, _ = env.commands
    assert made[1:3] == ["-m", "venv"]
    assert installed(env) == ["./msg_defs", "ros-jazzy-rclpy==7.1.6", "--editable", ".[explore,data,optimise]"]


def test_the_second_set_up_does_nothing(env: ModuleType) -> None:
    env.sync(None, tests=True)
    env.commands.clear()
    env.sync(None, tests=True)
    env.sync(None, tests=False)
    assert env.commands == []


def test_an_edited_message_rebuilds_the_interfaces_and_nothing_else(env: ModuleType) -> None:
    env.sync(None, tests=True)
    Path(env.ROOT, "msg_defs/msg/Plan.msg").write_text("string run_id")
    env.sync(None, tests=False)
    assert installed(env) == ["./msg_defs"]


def test_uv_is_told_not_to_reuse_the_interfaces_of_before(env: ModuleType) -> None:
    env.sync("/usr/bin/uv", tests=False)
    assert env.commands[-1][:3] == ["/usr/bin/uv", "pip", "install"]
    assert installed(env)[:3] == ["./msg_defs", "--reinstall-package", "bow_msgs"]


def test_an_edited_source_needs_no_set_up(env: ModuleType) -> None:
    env.sync(None, tests=False)
    env.commands.clear()
    Path(env.ROOT, "bow_sim/kernel/block.py").write_text("SAMPLES = 139")
    env.sync(None, tests=False)
    assert env.commands == []


def test_the_test_tools_come_on_top(env: ModuleType) -> None:
    env.sync(None, tests=False)
    env.sync(None, tests=True)
    assert installed(env)[-2:] == ["--requirement", "requirements-dev.txt"]


def test_an_interrupted_set_up_starts_from_nothing(env: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    env.sync(None, tests=False)
    Path(env.ROOT, "setup.py").write_text("changed")
    interrupted = monkeypatch.context()
    with interrupted as patch:

        def run(command: list[str], what: str) -> None:
            raise KeyboardInterrupt

        patch.setattr(env, "run", run)
        with pytest.raises(KeyboardInterrupt):
            env.sync(None, tests=False)
    leftover = Path(env.VENV, "lib", "leftover")
    leftover.parent.mkdir(exist_ok=True)
    leftover.touch()
    env.commands.clear()
    env.sync(None, tests=False)
    assert [command[2] for command in env.commands] == ["venv", "pip"]
    assert not leftover.exists()


def test_somebody_elses_environment_is_left_alone(env: ModuleType) -> None:
    theirs = Path(env.VENV, "theirs")
    theirs.parent.mkdir()
    theirs.touch()
    with pytest.raises(SystemExit, match="make setup did not make it"):
        env.sync(None, tests=False)
    assert theirs.exists()


def test_a_moved_checkout_gets_a_new_environment(env: ModuleType) -> None:
    record = env.sync(None, tests=False)
    record["home"]["place"] = "/where/it/was"
    env.write_record(record)
    env.commands.clear()
    env.sync(None, tests=False)
    assert env.commands[0][1:3] == ["-m", "venv"]


def test_the_environment_has_the_share_of_bow(env: ModuleType) -> None:
    env.sync(None, tests=False)
    assert Path(env.VENV, "lib/bow/simulator").resolve() == Path(env.ROOT, "resource/lib/node")
    assert Path(env.VENV, "share/bow/package.xml").resolve() == Path(env.ROOT, "package.xml")


def test_kernels_are_compiled_anew_only_after_an_edit(env: ModuleType) -> None:
    record = env.sync(None, tests=False)
    env.commands.clear()
    env.precompile(record)
    compiled = list(env.commands)
    assert compiled
    env.precompile(env.read_record())
    assert env.commands == compiled
    Path(env.ROOT, "bow_sim/kernel/block.py").write_text("SAMPLES = 139")
    env.precompile(env.read_record())
    assert env.commands == 2 * compiled


def test_two_compilations_run_at_a_time_and_neither_outlives_a_failure_of_the_other(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.undo()  # the commands are run now
    pipe, pid = tmp_path / "pipe", tmp_path / "pid"
    os.mkfifo(pipe)
    write, read = ["sh", "-c", f"echo > {pipe}"], ["cat", str(pipe)]  # each waits for the other
    env.run_together([(write, "writing"), (read, "reading")])
    fails = ["sh", "-c", f"until test -s {pid}; do sleep 0.01; done; exit 3"]
    with pytest.raises(SystemExit, match="failing failed"):
        env.run_together([(["sh", "-c", f"echo $$ > {pid}; exec sleep 60"], "waiting"), (fails, "failing")])
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


@pytest.mark.parametrize(
    ("lacks", "package"),
    [("compiler", "g\\+\\+"), ("headers", "python3(.[0-9]+)?-dev"), ("venv", "python3(.[0-9]+)?-venv")],
)
def test_a_missing_prerequisite_is_named_with_its_debian_package(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, lacks: str, package: str
) -> None:
    if lacks == "compiler":
        monkeypatch.setattr(env.shutil, "which", lambda name: None)
    elif lacks == "headers":
        monkeypatch.setattr(env.sysconfig, "get_paths", lambda: {"include": "/nowhere"})
    else:
        monkeypatch.setitem(sys.modules, "ensurepip", None)
    with pytest.raises(SystemExit, match=f"apt-get install {package}"):
        env.check_machine(None)


def test_an_old_python_is_told_what_would_be_right(env: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(env.sys, "version_info", (3, 9, 18))
    with pytest.raises(SystemExit, match=r"the ROS wheels are for 3\.10 to 3\.14"):
        env.check_machine(None)


def system_python(env: ModuleType, script: str) -> str:
    """Put a program in the place of the system's Python."""
    place = Path(env.ROOT, "python3")
    place.write_text(f"#!/bin/sh\n{script}\n")
    place.chmod(0o755)
    env.SYSTEM_PYTHON = str(place)
    return str(place)


def test_the_systems_python_is_taken_where_it_is_good_and_ours_is_slow(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(env, "optimised", lambda: False)
    place = system_python(env, '[ "$2" = --is-good ]')
    assert env.faster_python() == place
    system_python(env, "exit 1")
    assert env.faster_python() is None
    env.SYSTEM_PYTHON = "/nowhere"
    assert env.faster_python() is None
    monkeypatch.setattr(env, "optimised", lambda: True)
    system_python(env, "exit 0")
    assert env.faster_python() is None


def test_a_python_says_whether_it_would_do(env: ModuleType) -> None:
    told = subprocess.run([sys.executable, SCRIPT, "--is-good"], check=False, capture_output=True, timeout=60)
    assert told.returncode == bool(env.missing_prerequisites(None))


@pytest.mark.parametrize(
    ("place", "words", "fast"),
    [
        ("/home/me/.pyenv/versions/3.11.7/bin/python3.11", "'--enable-shared'", False),
        ("/home/me/.pyenv/versions/3.11.7/bin/python3.11", "'--enable-optimizations' '--with-lto'", True),
        ("/usr/bin/python3.11", "'--enable-shared'", True),
        ("/opt/python", None, True),
    ],
)
def test_a_python_knows_whether_it_was_compiled_to_be_fast(
    env: ModuleType, monkeypatch: pytest.MonkeyPatch, place: str, words: str | None, fast: bool
) -> None:
    monkeypatch.setattr(env, "base_python", lambda: place)
    monkeypatch.setattr(env.sysconfig, "get_config_var", {"CONFIG_ARGS": words}.get)
    assert env.optimised() is fast


def test_the_callers_ros_does_not_leak_into_the_set_up(env: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "AMENT_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"):
        monkeypatch.setenv(name, "/opt/ros/other")
    assert "/opt/ros/other" not in env.clean_environment().values()


def test_make_hides_the_callers_ros_from_every_command(tmp_path: Path) -> None:
    show = tmp_path / "show"
    show.write_text("#!/bin/sh\nenv\n")
    show.chmod(0o755)
    leaks = {"AMENT_PREFIX_PATH": "/leak", "PYTHONPATH": "/leak", "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "/leak"}
    command = ["make", "--no-print-directory", "-C", ROOT, "setup", f"PYTHON={show}"]
    told = subprocess.run(command, env=os.environ | leaks, capture_output=True, text=True, timeout=60, check=True)
    assert "PATH=" in told.stdout
    assert "/leak" not in told.stdout
