"""DDS domains for tests: two test runs, or two processes of one, never have the same."""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pytest

DOMAINS = range(1, 100)
"""DDS domains whose ports stay below those that Linux hands out by itself."""


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Give this process and its children a domain of their own: each domain has a file that its user locks."""
    folder = Path(tempfile.gettempdir()) / f"bow-test-domains-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for domain in DOMAINS:
        with open(folder / str(domain), "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            # All variables are set back: a graph in this process leaves those of its middleware.
            with mock.patch.dict(os.environ, {"ROS_DOMAIN_ID": str(domain)}):
                yield domain
            return
    pytest.fail(f"all {len(DOMAINS)} DDS domains are in use, says {folder}")
