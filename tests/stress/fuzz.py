"""Hostile input in the long run: `python tests/stress/fuzz.py --cases 100000 [--seed 0] [--only wire,map]`.

The targets are those of tests/fuzz, where Hypothesis brings a few thousand cases. Here every case has its own seed, is
timed, and may take no more than half a gigabyte. Prints a table; a case that fails is named with the seed that makes it
again: `python tests/stress/fuzz.py --only TARGET --again SEED`. Exit status 1 if one failed or took too long.
"""

from __future__ import annotations

import argparse
import collections
import random
import resource
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import targets
from chance import bounded_memory

SLOW_S = 5.0
"""A case that takes longer hangs, for all that its sender can do with it."""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python tests/stress/fuzz.py", description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="targets, separated by commas")
    parser.add_argument("--again", type=int, help="one case, by its seed")
    args = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory(prefix="bow-fuzz-") as folder:
        made = targets.make(Path(folder) / "room")
        every = made.all()
        chosen = {name: every[name] for name in (args.only.split(",") if args.only else every)}
        if args.again is not None:
            for _, case in chosen.values():
                case(random.Random(args.again))
            return 0
        return _run(made, chosen, args.cases, args.seed)


def _run(made: targets.Targets, chosen: dict[str, tuple[int, targets.Case]], cases: int, seed: int) -> int:
    total = sum(share for share, _ in chosen.values())
    failed: collections.Counter[str] = collections.Counter()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.monotonic()
    done = passed = 0
    print(f"{'target':10} {'cases':>7} {'failed':>7} {'mean ms':>8} {'max ms':>8}")
    for name, (share, case) in chosen.items():
        passed += share
        count, longest, spent = cases * passed // total - done, 0.0, 0.0
        with bounded_memory():
            for number in range(count):
                start = time.perf_counter()
                try:
                    case(random.Random(seed + number))
                except Exception as error:
                    failed[name] += 1
                    if failed[name] <= 5:
                        where = traceback.extract_tb(error.__traceback__)[-1]
                        print(f"  {name}, seed {seed + number}: {error!r:.300} at {where.filename}:{where.lineno}")
                seconds = time.perf_counter() - start
                spent, longest = spent + seconds, max(longest, seconds)
                if seconds > SLOW_S:
                    failed[name] += 1
                    print(f"  {name}, seed {seed + number}: took {seconds:.1f} s")
        done += count
        print(
            f"{name:10} {count:7} {failed[name]:7} {1e3 * spent / max(count, 1):8.2f} {1e3 * longest:8.1f}", flush=True
        )
    made.check_room()
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    seconds = time.monotonic() - began
    print(f"{done} cases in {seconds:.0f} s; peak memory grew by {grown:.0f} MB; {failed.total()} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
