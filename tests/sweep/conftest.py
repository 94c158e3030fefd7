"""A recorded run."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
import recording
from domains import own_domain


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of the small sweep; not to be changed."""
    return recording.record(tmp_path_factory.mktemp("record") / "run", recording.small_sweep())


@pytest.fixture
def run(recorded: Path, tmp_path: Path) -> Path:
    """A copy of the finished run, to be changed."""
    return Path(shutil.copytree(recorded, tmp_path / "run"))


@pytest.fixture(scope="session")
def complete(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with all its files; not to be changed."""
    run = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("cells") / "run"))
    return recording.leave_all(run, recording.small_sweep())


@pytest.fixture
def whole(complete: Path, tmp_path: Path) -> Path:
    """A copy of it, to be changed."""
    return Path(shutil.copytree(complete, tmp_path / "whole"))


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[recording.Graph]:
    """A node of ours in a domain of its own, and a recorder to come."""
    with own_domain() as domain, recording.graph(tmp_path / "run", domain) as made:
        yield made
