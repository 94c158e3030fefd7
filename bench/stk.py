"""The Synthesis ToolKit's `Bowed`, a tick of it beside a cell-step of ours: ``python -m bench.stk``.

A yardstick, not a peer: another model. A tick is one sample of one string with interpolated delays, a
memoryless bow table instead of friction with hysteresis, no torsion, no stiffness, and six body filters after it.
It needs g++ and Debian's libstk-dev, and is left out with a message where they are not.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from bench.kernel import pinned

SOURCE = Path(__file__).with_name("bowed.cpp")
FLAGS = ("-O3", "-march=native")


def compile_harness(folder: Path) -> tuple[Path | None, str]:
    """Compile the harness into a folder; return it, or None and why there is none."""
    compiler = os.environ.get("CXX") or shutil.which("g++")
    if not compiler:
        return None, "no g++ here: sudo apt-get install g++ libstk-dev"
    program = folder / "bowed"
    built = subprocess.run(
        [compiler, *FLAGS, str(SOURCE), "-lstk", "-o", str(program)], capture_output=True, text=True, check=False
    )
    if built.returncode:
        lines = [line for line in built.stderr.splitlines() if "error" in line or "cannot find" in line]
        return None, f"libstk-dev is not here (sudo apt-get install libstk-dev): {(lines or ['it does not link'])[0]}"
    return program, ""


def measure(ticks: int = 2_000_000, repeats: int = 10) -> dict[str, Any]:
    """Return ns a tick, the least of all repeats on one core, or why there is none."""
    with tempfile.TemporaryDirectory() as folder:
        program, problem = compile_harness(Path(folder))
        if program is None:
            return {"skipped": problem}
        with pinned():
            run = subprocess.run([program, str(ticks), str(repeats)], capture_output=True, text=True, check=False)
        if run.returncode:
            return {"skipped": f"the harness ended with status {run.returncode}: {run.stderr.strip()}"}
    lines = [line.split() for line in run.stdout.splitlines()]
    return {
        "ns_per_tick": min(float(seconds) / int(count) for count, seconds, _ in lines) * 1e9,
        "rms": float(lines[-1][2]),  # it does sound
        "flags": " ".join(FLAGS),
    }


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
