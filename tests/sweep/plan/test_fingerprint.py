"""What a machine computes for a sweep, as hashes: alike on all machines, and other where anything else is computed."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from bow_sim.kernel import fingerprint as module
from bow_sim.kernel.block import Block
from bow_sim.kernel.fingerprint import PARTS, difference
from bow_sim.kernel.sources import source_hash
from bow_sim.physics import exact
from bow_sweep.plan.sweep import Sweep

SMALL = ("x.count=8", "y.count=4", "periods=20")


def of(*settings: str) -> str:
    return Sweep.from_spec("fig11d", (*SMALL, *settings)).fingerprint


def test_it_has_a_hash_of_each_part() -> None:
    words = of().split()
    assert [word.partition("-")[0] for word in words] == list(PARTS)
    assert words[0] == f"source-{source_hash()}"
    assert difference(of(), of()) == ""


@pytest.mark.parametrize("setting", ["x.last=21", "mu_s=0.85", "tau_f=300"])
def test_another_sweep_has_another_one(setting: str) -> None:
    parts = ("values of the axes" if "x." in setting else "reflection functions", "compiled time loop")
    assert all(part in difference(of(), of(setting)) for part in parts)


def test_a_time_loop_that_rounds_otherwise_is_told_by_its_part(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = of()
    advance = Block.advance

    def other(block: Block) -> object:
        result = advance(block)
        (ring,) = (block._string.nut.ring,)
        ring[ring != 0] = np.nextafter(ring[ring != 0], 1)  # in the last bit
        return result

    monkeypatch.setattr(Block, "advance", other)
    module._fingerprint.cache_clear()
    try:
        assert difference(usual, of()) == "the compiled time loop"
    finally:
        module._fingerprint.cache_clear()


def test_a_table_that_rounds_otherwise_is_told_by_its_part(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = of()
    from bow_sim.physics import gesture

    gesture.decay.cache_clear()
    monkeypatch.setattr(exact, "exp", lambda x: float(np.nextafter(np.exp(x), 2)))
    module._fingerprint.cache_clear()
    try:
        assert difference(usual, of()) == f"{PARTS['tables']} and {PARTS['kernel']}"
    finally:
        module._fingerprint.cache_clear()
        gesture.decay.cache_clear()


def test_one_of_another_release_is_told() -> None:
    old = "source-e7221b548dd6af72 numba-0.68.1 llvmlite-0.50.0 numpy-2.4.6 glibc-2.36 znver3-11ec95ab"
    assert "another release" in difference(old, of())


MACHINES = {
    "the least of processors": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "an older processor for NumPy and the C library": {
        "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-FMA4",
    },
}

PRINT = """
import sys
from bow_sweep.plan.sweep import Sweep
for setting in sys.argv[1:]:
    print(Sweep.from_spec("fig11d", ["x.count=8", "y.count=4", "periods=20", *setting.split()]).fingerprint)
"""


@pytest.mark.full
@pytest.mark.parametrize("machine", MACHINES)
def test_other_processors_and_libraries_compute_the_same(machine: str) -> None:
    """What such a machine is, this one pretends by the settings of its libraries."""
    settings = ["", "model=stiff_cremer", "model=raman tau_f=250", "model=raman bridge_gain=0.9 gesture=martele"]
    child = [sys.executable, "-c", PRINT, *settings]
    done = subprocess.run(
        child, env={**os.environ, **MACHINES[machine]}, capture_output=True, text=True, check=True, timeout=300
    )
    assert done.stdout.splitlines() == [of(*setting.split()) for setting in settings]
