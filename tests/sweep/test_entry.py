"""A signal during the imports ends the executables without a traceback."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bow_sweep import entry

SLOW = """
import os, signal, time
try:
    os.kill(os.getpid(), signal.{name})
    time.sleep(20)
except BaseException:
    print("caught by what imports")
"""


@pytest.fixture(autouse=True)
def handlers_stay() -> Iterator[None]:
    """The command leaves signals ignored."""
    before = {number: signal.getsignal(number) for number in entry.SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def interrupted_while_importing(module: Path, arguments: list[str], name: str) -> subprocess.CompletedProcess[str]:
    """Run an executable with a module in place of its own that sends itself a signal while it is imported."""
    module.write_text(SLOW.format(name=name))
    program = (
        f"import sys; sys.path.insert(0, {str(module.parent)!r}); from bow_sweep import entry\n"
        f"entry.MAIN = {module.stem!r}; sys.exit(entry.command())"
    )
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_node_interrupted_while_it_starts_ends_with_status_0_and_prints_nothing(tmp_path: Path, name: str) -> None:
    ended = interrupted_while_importing(tmp_path / "slow.py", ["simulator"], name)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")


def test_the_command_reports_that_it_was_interrupted(tmp_path: Path) -> None:
    ended = interrupted_while_importing(tmp_path / "slow.py", ["sweep"], "SIGINT")
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, "", "bow: interrupted\n")


def test_the_handlers_are_restored_after_the_imports(monkeypatch: pytest.MonkeyPatch) -> None:
    handlers = lambda: [signal.getsignal(number) for number in entry.SIGNALS]
    before, found = handlers(), []

    def main() -> int:
        found.extend(handlers())
        return 7

    monkeypatch.setattr(sys, "argv", ["bow", "settings"])
    monkeypatch.setattr(f"{entry.MAIN}.main", main)
    assert entry.command() == 7
    assert found == before


def test_ctrl_c_is_reported_where_main_does_not_catch_it(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def main() -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "argv", ["bow", "settings"])
    monkeypatch.setattr(f"{entry.MAIN}.main", main)
    assert entry.command() == 130
    assert capfd.readouterr().err == "bow: interrupted\n"


def test_where_ctrl_c_is_ignored_the_command_goes_on(tmp_path: Path) -> None:
    (tmp_path / "slow.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\ndef main(): return 5\n")
    program = (
        f"import signal, sys; sys.path.insert(0, {str(tmp_path)!r}); signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "from bow_sweep import entry; entry.MAIN = 'slow'; sys.exit(entry.command())"
    )
    ended = subprocess.run([sys.executable, "-c", program, "sweep"], capture_output=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (5, b"")


def ended_after(body: str, folder: Path, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run the command with a main() of this body, and what a library does at the exit of Python."""
    (folder / "short.py").write_text(
        f"import atexit, sys, threading, time\natexit.register(print, 'library closed')\ndef main():\n    {body}\n"
    )
    program = f"import sys; sys.path.insert(0, {str(folder)!r}); from bow_sweep import entry; entry.MAIN = 'short'\n"
    command = [sys.executable, "-c", f"{program}sys.exit(entry.command())", "settings"]
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, timeout=60, check=False, env=buffered, **options)


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ("print('result'); return 3", 3, "result\nlibrary closed\n"),
        ("threading.Timer(0.3, print, ['thread ended']).start(); return 0", 0, "thread ended\nlibrary closed\n"),
        ("print('result'); sys.exit(2)", 2, "result\nlibrary closed\n"),
        ("raise RuntimeError", 1, "library closed\n"),
    ],
)
def test_nothing_is_lost_when_the_command_exits_at_once(body: str, status: int, said: str, tmp_path: Path) -> None:
    ended = ended_after(body, tmp_path, stdout=subprocess.PIPE)
    assert (ended.returncode, ended.stdout) == (status, said)
    assert ("RuntimeError" in ended.stderr) == (status == 1)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize(("body", "status"), [("return 3", 3), ("raise KeyboardInterrupt", 130)])
def test_another_signal_while_python_ends_changes_nothing(body: str, status: int, name: str, tmp_path: Path) -> None:
    signals = f"import os, signal; atexit.register(os.kill, os.getpid(), signal.{name})"
    ended = ended_after(f"{signals}; {body}", tmp_path, stdout=subprocess.PIPE)
    assert (ended.returncode, ended.stdout) == (status, "library closed\n")
    assert ended.stderr == ("bow: interrupted\n" if status == 130 else "")


def test_what_cannot_be_printed_at_the_exit_is_reported(tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        ended = ended_after("print('result'); return 0", tmp_path, stdout=full)
    assert ended.returncode == 120  # Python's own
    assert "No space left" in ended.stderr


@pytest.mark.parametrize("role", list(entry.MODULES))
def test_a_node_has_its_own_entry_point(role: str) -> None:
    assert getattr(entry, role).args == (role,)
