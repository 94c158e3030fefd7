"""What every test stands on: this checkout, and a ROS graph that nobody else hears."""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from domains import own_domain

ROOT = Path(__file__).resolve().parent.parent

# Whatever PYTHONDONTWRITEBYTECODE is, pytest keeps what it makes of the tests' sources: a third of a collection's time.
sys.dont_write_bytecode = False

# Before anything imports rclpy: a middleware or a reach from the caller's shell would test something else.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
for _name in ("RMW_IMPLEMENTATION", "ROS_DOMAIN_ID", "ROS_NAMESPACE", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"):
    os.environ.pop(_name, None)

# A standing graph of whoever runs the tests must not be used by them, nor be stopped; nor one of earlier tests, whose
# process had the same number.
os.environ["XDG_STATE_HOME"] = str(Path(tempfile.gettempdir()) / f"bow-test-state-{os.getpid()}-{time.time_ns()}")

# A shell without job control has commands in the background ignore Ctrl-C, and what they start ignores it too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests that install packages wait for a registry that is slow, or away for half a minute.
for _name, _value in {
    "PIP_DEFAULT_TIMEOUT": "60",
    "PIP_RETRIES": "7",
    "UV_HTTP_TIMEOUT": "60",
    "UV_HTTP_RETRIES": "7",
    "npm_config_fetch_retries": "4",
}.items():
    os.environ.setdefault(_name, _value)

hypothesis.settings.register_profile("untimed", deadline=None)  # how long anything takes is not tested
hypothesis.settings.load_profile("untimed")


@pytest.fixture(scope="session")
def root() -> Path:
    """The root of this checkout."""
    return ROOT


GRAPHS = ("own_domain", "sweeping", "halted", "run_sweep")
"""Names of tests/support by which a module starts graphs."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let tests with a graph run one at a time.

    All graphs of a machine share the numbers of ports in shared memory, whatever their domains. While the nodes of one
    are killed and what they leave is removed, another one that just starts may get a port that does not work.
    """
    for item in items:
        fixtures, module = getattr(item, "fixturenames", ()), getattr(item, "module", None)
        if {"ros_domain", "graph"} & set(fixtures) or any(hasattr(module, name) for name in GRAPHS):
            item.add_marker(pytest.mark.alone)


def participants() -> int:
    """Return how many DDS participants this process has: each has a thread for its events.

    Where one is destroyed late, Fast DDS hangs for ever if another one of the process hears of it at the wrong moment.
    """
    found = 0
    for task in Path("/proc/self/task").glob("*/comm"):
        with contextlib.suppress(OSError):  # it has ended since
            found += task.read_text().startswith("dds.ev.")
    return found


@pytest.fixture
def ros_domain() -> Iterator[int]:
    """A DDS domain of its own, for this process and its children, as long as the test runs."""
    with own_domain() as domain:
        yield domain
        gc.collect()
        deadline = time.monotonic() + 5
        while participants() and time.monotonic() < deadline:  # a thread that was joined is seen for a moment more
            time.sleep(0.01)
        assert participants() == 0, "the test has left a node that nothing destroys but a collection of garbage"
