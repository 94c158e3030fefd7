"""Compile and cache the kernels that sweeps and transients use: ``python -m bow_sim.warm``."""

from __future__ import annotations

import time

import numpy as np

from bow_sim.kernel import Block, fingerprint, transient
from bow_sim.model import CHUNK_PERIODS, Parameters


def main() -> None:
    """Run every specialisation once and say how long it took."""
    print(f"kernel {fingerprint()}")
    for model in ("delta_cremer", "stiff_cremer"):
        for dtype in ("float64", "float32"):
            p = Parameters(model=model, dtype=dtype, periods=CHUNK_PERIODS)
            started = time.perf_counter()
            Block(p, {"f_asym": np.array([p.f_asym])}).advance()
            transient(p)
            print(f"  {model} {dtype}: {time.perf_counter() - started:.2f} s")


if __name__ == "__main__":
    main()
