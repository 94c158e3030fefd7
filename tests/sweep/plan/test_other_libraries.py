"""Other releases of Python and NumPy, and another processor, compute the same: fingerprints, waveforms, verdicts."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import digests
import pytest
from checkout import ROOT, copy_sources

from bow_sim.kernel.fingerprint import PARTS

pytestmark = [pytest.mark.full, pytest.mark.timeout(900)]

NEEDED = ("numpy", "numba", "gmpy2", "pyyaml", "xxhash")
"""What fingerprints, kernel and classifier import."""

OLD = ("numpy==1.26.4", "gmpy2==2.2.1")
"""The NumPy of an installation of ROS 2 Jazzy, and the oldest gmpy2 that has wheels for its Python."""

Hashes = dict[str, dict[str, str]]
"""Map -> part of it -> hash, as :mod:`digests` has them."""

PROCESSOR = "Nehalem"
"""One of 2008, the oldest that NumPy runs on: without AVX and fused operations."""

ASK = """
import json
import llvmlite.binding as llvm
print(json.dumps([llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]))
"""

OTHER_EXP = """
import numpy as np
from bow_sim.physics import exact
exact.exp = lambda x: float(np.nextafter(np.exp(x), 2))
import digests
digests.main()
"""


def other_python(version: str) -> str | None:
    """Return a Python of a version: on the PATH, or one of pyenv's, whose shims may refuse to run it."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    found = [str(path) for path in pyenv.glob(f"{version}.*/bin/python{version}")]
    return next(iter(found), None) or shutil.which(f"python{version}")


def install(python: Path, *options: str) -> None:
    """Install wheels for a Python, with uv where there is one; without them the test cannot be."""
    if uv := shutil.which("uv"):
        command = [uv, "pip", "install", "--quiet", "--python", str(python)]
    else:
        command = [str(python), "-m", "pip", "--disable-pip-version-check", "install", "-qq"]
    done = subprocess.run([*command, *options], capture_output=True, text=True, check=False)
    if done.returncode and not os.environ.get("CI"):
        pytest.skip(f"cannot install {' '.join(options)}: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stdout + done.stderr


def with_old_libraries(place: Path) -> Path:
    """Return this Python, for which older libraries than its own are now in the folder old."""
    if sys.version_info >= (3, 13):
        pytest.skip(f"{OLD[0]} has no wheels for Python {sys.version_info[0]}.{sys.version_info[1]}")
    subprocess.run([sys.executable, "-m", "venv", place / "venv"], check=True)  # .venv need not have pip
    install(place / "venv/bin/python", "--no-deps", "--target", str(place / "old"), *OLD)
    return Path(sys.executable)


def with_python(version: str, place: Path) -> Path:
    """Return another Python in an environment of its own, with the releases that constraints.txt has for it."""
    found = other_python(version)
    if found is None:
        pytest.skip(f"there is no Python {version} here")
    subprocess.run([found, "-m", "venv", place / "venv"], check=True)
    python = place / "venv/bin/python"
    install(python, "--constraint", str(ROOT / "constraints.txt"), *NEEDED)
    return python


OTHERS: dict[str, Callable[[Path], Path]] = {
    "NumPy 1.26": with_old_libraries,
    "Python 3.10": partial(with_python, "3.10"),
    "Python 3.13": partial(with_python, "3.13"),
}


def printed_by(command: list[str | Path], sources: Path, **variables: str) -> Any:
    """Return what a Python prints as JSON; it imports these sources, and stores compiled code beside them."""
    kept = {n: v for n, v in os.environ.items() if n in ("PATH", "HOME") or n.startswith("_ROS_WHEELS")}
    paths = [*sources.parent.glob("old"), sources, sources / "tests/support"]
    kept["PYTHONPATH"] = os.pathsep.join(map(str, paths))
    done = subprocess.run(command, cwd=sources, env=kept | variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def computed_by(command: list[str | Path], sources: Path, **variables: str) -> tuple[dict[str, str], Hashes]:
    """Return the versions and hashes that a Python prints."""
    imported, versions, hashes = printed_by(command, sources, **variables)
    assert Path(imported) == sources / "bow_sim"
    return versions, hashes


def differing(a: Hashes, b: Hashes) -> set[str]:
    """Return the parts in which two computations differ."""
    assert {name: set(parts) for name, parts in a.items()} == {name: set(parts) for name, parts in b.items()}
    return {part for name, parts in a.items() for part, found in parts.items() if found != b[name][part]}


@pytest.fixture(scope="module")
def here() -> Hashes:
    """What this environment computes."""
    return digests.all_digests()


@pytest.mark.parametrize("other", OTHERS)
def test_other_releases_compute_the_same(other: str, here: Hashes, tmp_path: Path) -> None:
    python = OTHERS[other](tmp_path)
    sources = tmp_path / "bow"
    copy_sources(sources)
    versions, there = computed_by([python, "-m", "digests"], sources)
    name, release = other.lower().split()
    assert versions[name].startswith(f"{release}.")
    assert differing(here, there) == set()

    _, wrong = computed_by([python, "-c", OTHER_EXP], sources)
    found = differing(here, wrong)
    assert found >= {PARTS["tables"], PARTS["kernel"], "waveforms", "waveforms of few cells"}
    assert not found & {PARTS["source"], PARTS["axes"]}


def test_an_emulated_processor_computes_the_same(here: Hashes, tmp_path: Path) -> None:
    """All libraries ask it for its features. Code is compiled for it here, as an emulated compiler takes minutes."""
    qemu = shutil.which("qemu-x86_64") or shutil.which("qemu-x86_64-static")
    if qemu is None:
        pytest.skip("there is no qemu-x86_64 here (Debian: qemu-user)")
    sources = tmp_path / "bow"
    copy_sources(sources)
    emulated = [qemu, "-cpu", PROCESSOR, sys.executable]
    name, features = printed_by([*emulated, "-c", ASK], sources)
    assert name == PROCESSOR.lower()
    assert "+avx" not in features.split(",")
    asked = {"NUMBA_CPU_NAME": name, "NUMBA_CPU_FEATURES": features}
    for python, variables in (([sys.executable], asked), (emulated, {})):
        _, there = computed_by([*python, "-m", "digests"], sources, **variables)
        assert differing(here, there) == set()
