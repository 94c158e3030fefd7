"""How the kernel divides processors among the processes of a graph."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

from bow_sim.graph import scheduling

REPORT = """
import os, sys, threading
from pathlib import Path
from bow_sim.graph import scheduling
os.nice(3)
if sys.argv[1] == "refused":
    scheduling._SCHED_SETATTR = {os.uname().machine: 100_000}
scheduling.use_batch_scheduling()
def report():
    said = Path(f"/proc/self/task/{threading.get_native_id()}/sched")
    slices = [line.split()[-1] for line in said.read_text().splitlines() if "slice" in line] if said.exists() else []
    print(os.sched_getscheduler(0), os.getpriority(os.PRIO_PROCESS, 0), *slices, flush=True)
report()
thread = threading.Thread(target=report)
thread.start()
thread.join()
"""


@pytest.mark.parametrize("kernel", ["takes it", "refused"])
def test_all_threads_have_the_policy_and_the_slice_and_the_priority_stays(kernel: str) -> None:
    said = subprocess.run([sys.executable, "-c", REPORT, kernel], capture_output=True, text=True, check=True).stdout
    here, thread = (list(map(int, line.split())) for line in said.splitlines())
    assert here == thread
    assert here[:2] == [os.SCHED_BATCH, os.getpriority(os.PRIO_PROCESS, 0) + 3]
    release = tuple(map(int, re.findall(r"\d+", os.uname().release)[:2]))
    if release >= (6, 12) and os.uname().machine in scheduling._SCHED_SETATTR:
        for slice_ns in here[2:]:  # none where the kernel does not show it
            assert (slice_ns == round(scheduling.SLICE_S * 1e9)) is (kernel == "takes it")
