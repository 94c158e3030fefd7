"""Undisturbed runs to compare with, each made once."""

from pathlib import Path

import pytest
from domains import own_domain
from graph import SMALL, TINY, run_sweep


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
