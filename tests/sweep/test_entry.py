"""A signal during the imports ends the executables without a traceback."""

import signal
import subprocess
import sys
from pathlib import Path

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
    before = [signal.getsignal(number) for number in entry.SIGNALS]
    monkeypatch.setattr(sys, "argv", ["bow", "settings"])
    monkeypatch.setattr(f"{entry.MAIN}.main", lambda: 7)
    assert entry.command() == 7
    assert [signal.getsignal(number) for number in entry.SIGNALS] == before


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


@pytest.mark.parametrize("role", list(entry.MODULES))
def test_a_node_has_its_own_entry_point(role: str) -> None:
    assert getattr(entry, role).args == (role,)
