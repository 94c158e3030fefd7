"""Hostile input guided by coverage: `python tests/stress/guided.py wire --runs 100000`, for a target of tests/fuzz.

Needs `pip install atheris` (Linux, CPython up to what it has wheels for), which the package itself does not. libFuzzer
looks for inputs that reach new lines of the readers, where `python tests/stress/fuzz.py` throws dice.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import types
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

import targets

from bow_sim.physics import reflection_text
from bow_sim.protocol import cdr
from bow_sweep.plan import sweep
from bow_sweep.record import mcap_reader, mcap_records
from bow_sweep.run import directory

READERS = (cdr, mcap_reader, mcap_records, sweep, directory, reflection_text)
"""Modules whose coverage guides. Their functions are instrumented one by one: an import hook would upset Numba."""


def instrument(module: types.ModuleType) -> None:
    """Let atheris see which lines of a module run."""
    import atheris

    classes = [item for item in vars(module).values() if isinstance(item, type) and item.__module__ == module.__name__]
    for holder in (module, *classes):
        for item in list(vars(holder).values()):
            if isinstance(item, types.FunctionType) and item.__module__ == module.__name__:
                atheris.instrument_func(item)


class Chance(random.Random):
    """Takes its dice from libFuzzer's bytes."""

    def __init__(self, data: bytes) -> None:
        super().__init__(0)
        import atheris

        self._given = atheris.FuzzedDataProvider(data)

    def getrandbits(self, k: int) -> int:
        """Return `k` bits, zeros where the bytes are at their end."""
        whole = int.from_bytes(self._given.ConsumeBytes(-(-k // 8)), "little")
        return int(whole & ((1 << k) - 1))

    def random(self) -> float:
        return self.getrandbits(53) / (1 << 53)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python tests/stress/guided.py", description=__doc__.split("\n")[0])
    parser.add_argument("target")
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--seconds", type=int, default=600)
    args = parser.parse_args()
    import atheris

    warnings.simplefilter("ignore")
    for module in READERS:
        instrument(module)
    every = targets.make(Path(tempfile.mkdtemp(prefix="bow-guided-")) / "room").all()
    _, case = every[args.target]
    limits = [f"-runs={args.runs}", f"-max_total_time={args.seconds}", "-max_len=512", "-timeout=20"]
    atheris.Setup([sys.argv[0], *limits], lambda data: case(Chance(data)))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
