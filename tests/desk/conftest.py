"""A recorded run, and the same sweep computed in this process."""

from __future__ import annotations

from pathlib import Path

import pytest
import recording

import bow


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of the small sweep with all its files; not to be changed."""
    directory = recording.record(tmp_path_factory.mktemp("desk") / "run", recording.small_sweep())
    return recording.leave_all(directory, recording.small_sweep())


@pytest.fixture(scope="session")
def computed() -> bow.Map:
    """The small sweep in this process."""
    return bow.sweep(settings=recording.SMALL, progress=False)
