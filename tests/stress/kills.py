"""The long version of the storm in tests/graph/test_storm.py: ``python tests/stress/kills.py --kills 200 --seed 7``.

SIGKILL at random moments over all roles: one, several at once, and again while the graph recovers; where the whole
graph or its coordinator is killed, the run is gone on with by ``--resume``. Each run must in the end pass `bow verify`
and give the map of an undisturbed run, bit for bit, and leave no process behind; what stays in shared memory is
counted. The same seed gives the same choices; what is under way when they strike is chance.
"""

from __future__ import annotations

import argparse
import json
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "support"), str(TESTS / "graph")]

import graph as tests  # noqa: E402  # of tests/graph
from test_storm import LONG, ROLES, strike  # noqa: E402

PAUSE_S = (0.1, 2.0)
"""Between two strikes; the shorter ones come while processes are still starting."""

RECOVERY_S = (0.0, 0.4)
"""Between a strike and one during the recovery from it."""

AT_ONCE, IN_RECOVERY = 0.25, 0.3
"""How likely a strike hits several roles at once, and how likely another one follows it during the recovery."""

MOST_SAID = 3000
"""Characters of what does not hold."""

SINGLE = tuple(role for role in ROLES if role != "everything")


def choose(chance: random.Random) -> list[str]:
    """Choose what is killed at once."""
    if chance.random() < AT_ONCE:
        return chance.sample(sorted(set(SINGLE)), chance.randint(2, 3))
    return [chance.choice(ROLES)]


def storm(run: Path, chance: random.Random, most: int) -> tuple[list[list[str]], int]:
    """Sweep into `run` under at most so many strikes; return them, and how often the run was gone on with.

    Raises
    ------
    RuntimeError
        Where the sweep ends in a way that nobody asked for.
    """
    struck: list[list[str]] = []
    arguments, resumed = [*LONG, "--out", str(run)], -1
    status: int | None = None
    while status != 0:
        resumed += 1
        with tests.sweeping(run, *arguments) as sweep:
            pause = PAUSE_S
            while sweep.process.poll() is None:
                time.sleep(chance.uniform(*pause))
                pause = PAUSE_S
                if not (run / "ledger.jsonl").exists() or sweep.process.poll() is not None or len(struck) >= most:
                    continue
                hit = [role for role in choose(chance) if strike(sweep, role)]
                if hit:
                    struck.append(hit)
                    pause = RECOVERY_S if chance.random() < IN_RECOVERY else PAUSE_S
            status = sweep.wait()
            if status not in (0, 1, -signal.SIGKILL) or "Traceback" in sweep.text:
                raise RuntimeError(f"{run}: after {struck} the sweep ended with status {status}:\n{sweep.text}")
        arguments = ["--resume", str(run)]
    return struck, resumed


def measure(kills: int, seed: int, folder: Path | None = None) -> dict[str, Any]:
    """Strike so often, over as many runs as it takes; return the account. The runs stay where one fails."""
    chance = random.Random(seed)
    made = Path(tempfile.mkdtemp(prefix="bow-kills-", dir=folder))
    print(f"kills: seed {seed}, in {made}", file=sys.stderr, flush=True)
    began = time.monotonic()
    before = tests.dead_files()
    undisturbed = tests.run_sweep(made / "undisturbed", *LONG)
    total, resumes, runs = 0, 0, 0
    roles: Counter[str] = Counter()
    while total < kills:
        runs += 1
        run = made / f"run{runs}"
        struck, resumed = storm(run, chance, kills - total)
        left = tests.orphans(run)
        if left:
            raise RuntimeError(f"{run}: after {struck} these live on: {left}")
        try:
            tests.verified(run)
            tests.assert_same_map(undisturbed, run)
        except AssertionError as error:
            raise RuntimeError(f"{run}: after {struck}:\n{str(error)[:MOST_SAID]}") from None
        total, resumes = total + len(struck), resumes + resumed
        roles.update(role for hit in struck for role in hit)
        names = ", ".join("+".join(hit) for hit in struck)
        print(
            f"kills: run {runs}: {total} of {kills} strikes, whole and the same: {names}", file=sys.stderr, flush=True
        )
        shutil.rmtree(run)
    shutil.rmtree(made)
    return {
        "seed": seed,
        "strikes": total,
        "roles": dict(roles.most_common()),
        "runs": runs,
        "resumed": resumes,
        "left in shared memory": sorted(tests.dead_files() - before),
        "seconds": time.monotonic() - began,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python tests/stress/kills.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200, help="strikes in all (default: 200, some 20 minutes)")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6), help="default: random")
    parser.add_argument("--dir", type=Path, help="where runs are recorded")
    chosen = parser.parse_args(arguments)
    print(json.dumps(measure(chosen.kills, chosen.seed, chosen.dir), indent=2))


if __name__ == "__main__":
    main()
