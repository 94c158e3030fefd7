"""A stopped process and a full disk: memory stays bounded, nothing is lost, the run can be resumed."""

import contextlib
import os
import signal
import subprocess
import time
from pathlib import Path

import psutil
import pytest
from graph import SMALL, assert_same_map, halted, orphans, sweeping, verified

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

STOPPED_S = 10.0


@pytest.mark.parametrize("role", ["recorder", "classifier"])
def test_a_consumer_stopped_for_ten_seconds_holds_the_simulators_back_and_loses_nothing(
    role: str, undisturbed: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    with halted(run, *SMALL) as sweep:
        sweep.wait_until(lambda: sweep.done_blocks() >= 2)
        (victim,) = sweep.children(role)
        simulators = sweep.children("simulator")
        before = [process.memory_info().rss for process in simulators]
        victim.send_signal(signal.SIGSTOP)
        sweep.go_on()
        time.sleep(STOPPED_S)
        for process, rss in zip(simulators, before, strict=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                assert process.memory_info().rss < rss + 100e6
        victim.send_signal(signal.SIGCONT)
        assert sweep.wait() == 0, sweep.text
    verified(run)
    assert_same_map(undisturbed, run)


def test_a_full_disk_stops_the_sweep_clearly_and_it_can_be_resumed(undisturbed: Path, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", str(disk)], check=False)
    if mounted.returncode:
        pytest.skip("this user cannot mount a tmpfs")
    run = disk / "run"
    try:
        with sweeping(tmp_path / "first", *SMALL, "--out", str(run)) as sweep:
            assert sweep.wait() == 1, sweep.text
            assert "No space left on device" in sweep.text
            assert f"bow sweep --resume {run}" in sweep.text
        assert orphans(run) == []
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        with sweeping(tmp_path / "second", "--resume", str(run)) as sweep:
            assert sweep.wait() == 0, sweep.text
        verified(run)
        assert_same_map(undisturbed, run)
    finally:
        os.sync()
        subprocess.run(["umount", "-l", str(disk)], check=False)
