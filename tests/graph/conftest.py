"""Undisturbed runs to compare with, each made once; and two machines."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from domains import own_domain
from graph import SMALL, TINY, run_sweep
from machines import Machines, machines


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small sweep without any mishap."""
    with own_domain():
        return run_sweep(tmp_path_factory.mktemp("undisturbed") / "run", *SMALL)


@pytest.fixture(scope="session")
def undisturbed_tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sweep of four cells without any mishap."""
    with own_domain():
        return run_sweep(tmp_path_factory.mktemp("undisturbed") / "tiny", *TINY)


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> Iterator[Machines]:
    """Two machines joined by a cable."""
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")  # as users have it
    with contextlib.ExitStack() as stack:
        try:
            made = stack.enter_context(machines())
        except OSError as error:
            pytest.skip(f"this user cannot make network namespaces (unshare, nsenter, ip): {error}")
        yield made
