"""Twenty kills at random moments over all roles: in the end every cell is there once, as if nothing had happened."""

import random
import signal
import time
from pathlib import Path

import psutil
import pytest
from graph import Sweep, assert_same_map, dead_files, kill_at_once, orphans, run_sweep, sweeping, verified

pytestmark = [pytest.mark.full, pytest.mark.usefixtures("ros_domain")]

LONG = ["fig11d", "--nx", "64", "--ny", "32", "--set", "block_cells=16"]
"""2048 cells in 128 blocks."""

KILLS = 20

CHANCE = 4
"""Files that may stay in shared memory: 120 strikes left 2. Without a cleaner it is one a strike."""

ROLES = (
    "simulator",
    "simulator",
    "classifier",
    "recorder",
    "dashboard",
    "coordinator",
    "shm_cleaner",
    "all simulators",
    "everything",
)


def strike(sweep: Sweep, role: str) -> bool:
    """SIGKILL what a role stands for; return whether there was something to kill."""
    if role == "everything":
        victims = [*sweep.shm_cleaners(), *sweep.children(), psutil.Process(sweep.process.pid)]
    elif role == "shm_cleaner":
        victims = sweep.shm_cleaners()
    else:
        victims = sweep.children("simulator" if role == "all simulators" else role)
        victims = victims if role == "all simulators" else victims[:1]
    kill_at_once(victims)  # of everything no process may be left that has started another one meanwhile
    return bool(victims)


@pytest.mark.parametrize("seed", [1995])
def test_the_account_is_exact_after_twenty_kills(seed: int, tmp_path: Path) -> None:
    before = dead_files()
    undisturbed = run_sweep(tmp_path / "undisturbed", *LONG)
    chance = random.Random(seed)
    struck: list[str] = []
    turn = 0
    while len(struck) < KILLS:  # several runs where one is over before
        turn += 1
        run = tmp_path / f"run{turn}"
        arguments = [*LONG, "--out", str(run)]
        status = None
        while status != 0:
            with sweeping(run, *arguments) as sweep:
                while sweep.process.poll() is None:
                    time.sleep(chance.uniform(0.1, 2.0))
                    if (run / "ledger.jsonl").exists() and sweep.process.poll() is None and len(struck) < KILLS:
                        role = chance.choice(ROLES)
                        if strike(sweep, role):
                            struck.append(role)
                status = sweep.wait()
                assert status in (0, 1, -signal.SIGKILL), sweep.text
                assert "Traceback" not in sweep.text
            arguments = ["--resume", str(run)]
        assert orphans(run) == [], struck
        verified(run)
        assert_same_map(undisturbed, run)
    left = dead_files() - before  # made in the millisecond before a kill, or while a killed cleaner was replaced
    assert len(left) <= CHANCE, (left, struck)
