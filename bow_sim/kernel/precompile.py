"""Compile the kernels that sweeps and transients use, and cache the code: ``python -m bow_sim.kernel.precompile``.

The code is stored beside the sources (:mod:`bow_sim.simd.code_cache`), for all processes; a second run only loads it.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from bow_sim.kernel.block import Block, transient
from bow_sim.kernel.sources import source_hash
from bow_sim.physics.parameters import CHUNK_PERIODS, DTYPES, Parameters
from bow_sim.simd.lanes import LANES


def precompile(dtype: str) -> None:
    """Run every kernel of one floating-point type once, and print how long each took.

    Parameters
    ----------
    dtype : str
        One of :data:`bow_sim.physics.parameters.DTYPES`.
    """
    delta = Parameters(model="delta_cremer", dtype=dtype, periods=CHUNK_PERIODS)
    stiff = delta.replace(model="stiff_cremer")
    raman = delta.replace(model="raman")
    jobs = (
        ("delta/Cremer", lambda: Block(delta, {"f_asym": [delta.f_asym] * LANES}).advance()),
        ("stiff/Cremer", lambda: Block(stiff, {"f_asym": [stiff.f_asym] * LANES}).advance()),
        ("any other model", lambda: Block(raman, {"f_asym": [raman.f_asym] * LANES}).advance()),
        ("any model, time constants that differ", lambda: Block(raman, {"tau_f": [raman.tau_f] * LANES}).advance()),
        ("transients, few cells", lambda: transient(delta)),
    )
    for name, job in jobs:
        started = time.perf_counter()
        job()
        print(f"  {dtype} {name}: {time.perf_counter() - started:.2f} s", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Compile the kernels of float64, and with ``--float32`` those of float32."""
    parser = argparse.ArgumentParser(
        prog="python -m bow_sim.kernel.precompile", description="Compile and cache the kernels."
    )
    parser.add_argument("--float32", action="store_true", help="those of float32 too, which few sweeps use")
    chosen = parser.parse_args(arguments)
    print(f"kernel source-{source_hash()}", flush=True)
    for dtype in DTYPES if chosen.float32 else DTYPES[:1]:
        precompile(dtype)


if __name__ == "__main__":
    main()
