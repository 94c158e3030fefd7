"""The wheels of `make dist`: they install, and run a sweep, where there is no compiler."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from checkout import ROOT, copy_sources

pytestmark = [pytest.mark.full, pytest.mark.timeout(900)]

NO_COMPILER = ("cc", "gcc", "g++", "c++", "clang", "cmake", "ninja", "make")


def run(*command: str | Path, where: Path, path: str = os.environ["PATH"], seconds: float = 600) -> str:
    """Run a command away from the sources; what it prints."""
    network = ("PIP_", "UV_", "HTTP", "http", "SSL_")  # where this machine gets packages from
    kept = {n: v for n, v in os.environ.items() if n in ("HOME", "ROS_DOMAIN_ID", "CI") or n.startswith(network)}
    environment = kept | {"PATH": path, "LANG": "C.UTF-8", "PIP_CONSTRAINT": str(ROOT / "constraints.txt")}
    told = subprocess.run(
        command, cwd=where, env=environment, capture_output=True, text=True, timeout=seconds, check=False
    )
    assert told.returncode == 0, told.stdout + told.stderr
    return told.stdout


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that the commands of `make dist` fill, from a copy of the sources."""
    place = tmp_path_factory.mktemp("dist")
    copy_sources(place / "bow")
    for options in (["."], ["--wheel", "msg_defs"]):
        run(sys.executable, "-m", "build", "--outdir", place / "out", *options, where=place / "bow")
    return place / "out"


@pytest.fixture(scope="module")
def installed(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A fresh environment with the wheels, and a PATH that has no compiler."""
    place = tmp_path_factory.mktemp("fresh")
    tools = place / "tools"
    tools.mkdir()
    for name in ("env", "bash", "sh", "ldconfig", "uname"):
        if found := shutil.which(name):
            (tools / name).symlink_to(found)
    path = f"{place}/venv/bin:{tools}"
    assert not [name for name in NO_COMPILER if shutil.which(name, path=path)]
    wheel, messages = next(dist.glob("bow-*.whl")), next(dist.glob("bow_msgs-*.whl"))
    wanted = [f"bow[ros] @ {wheel.as_uri()}", f"bow_msgs @ {messages.as_uri()}"]
    run(sys.executable, "-m", "venv", place / "venv", where=place)
    python = place / "venv/bin/python"
    if uv := shutil.which("uv"):
        limits = ("--constraint", ROOT / "constraints.txt")
        run(uv, "pip", "install", "--python", python, *limits, *wanted, where=place, path=path)
    else:
        run(python, "-m", "pip", "install", "-q", *wanted, where=place, path=path)
    return place, path


def test_the_sdist_has_all_that_a_build_needs(dist: Path) -> None:
    with tarfile.open(next(dist.glob("bow-*.tar.gz"))) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout.split()
    rooms = ("bow_", "config/", "launch/", "msg_defs/", "resource/")
    needed = {name for name in tracked if name.startswith(rooms)} | {"setup.py", "requirements.txt", "package.xml"}
    assert needed <= names


@pytest.mark.usefixtures("ros_domain")
def test_the_wheels_run_a_sweep_where_there_is_no_compiler(installed: tuple[Path, str]) -> None:
    place, path = installed
    where = run(place / "venv/bin/python", "-c", "import bow_sim; print(bow_sim.__file__)", where=place, path=path)
    assert Path(where.strip()).is_relative_to(place / "venv")
    run(
        place / "venv/bin/bow",
        *("sweep", "fig11d", "--nx", "2", "--ny", "2", "--periods", "10", "--no-dashboard", "--out", place / "run"),
        where=place,
        path=path,
    )
    run(place / "venv/bin/bow", "verify", place / "run", where=place, path=path)
