"""Progress is a bar on a terminal and lines elsewhere; the library of the bar is loaded for a bar only."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

CODE = """
import sys, time
from bow_sweep.processes.progress import Display, Progress
display = Display()
display.print_line("the sweep [begins]")
now = time.monotonic()
display.show(None, "for the recorder", now + 3)
assert "rich" not in sys.modules
for after in (6, 9):
    display.show(Progress(1024, 0, 4096, {"helmholtz": 700, "multiple_slip": 324}), "", now + after)
display.print_line("half of it is done")
display.stop()
print("rich" in sys.modules)
"""


def test_lines_without_a_terminal() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, timeout=60, check=True)
    begins, waits, progress, half = done.stderr.splitlines()
    assert (begins, waits, half) == ("the sweep [begins]", "waiting: for the recorder", "half of it is done")
    assert progress == "1024/4096 cells, 0 cells/s; helmholtz 700, multiple slip 324"
    assert done.stdout == "False\n"


def test_a_bar_on_a_terminal() -> None:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "140"}
    with os.fdopen(ours, "rb", buffering=0) as terminal:
        done = subprocess.run(
            [sys.executable, "-c", CODE], stdout=subprocess.PIPE, stderr=theirs, env=environment, timeout=60, check=True
        )
        shown = terminal.read(1 << 16).decode()
        os.close(theirs)
    assert shown.startswith("the sweep [begins]\r\nwaiting: for the recorder\r\n")
    assert "1024/4096" in shown
    assert "helmholtz 700, multiple slip 324" in shown
    assert "half of it is done" in shown
    assert done.stdout == b"True\n"
