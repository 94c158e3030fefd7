"""Entry points of the executables: a signal that comes while Python still imports ends them without a traceback.

`ros2 launch` sends SIGINT to all processes as soon as one of them ends the launch, which may be in the first second of
the others. The modules of a node or of the command take that long to import, so they are imported in here.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Callable
from functools import partial

SIGNALS = (signal.SIGINT, signal.SIGTERM)

MODULES = {
    "coordinator": "bow_sweep.coordinator",
    "simulator": "bow_sim.node",
    "classifier": "bow_classifier.node",
    "recorder": "bow_sweep.record.recorder",
    "dashboard": "bow_sweep.view.dashboard",
}
"""Role -> module with the node's main()."""

CLI = "bow_sweep.cli"

INTERRUPTED = 130


def _function(module: str, name: str, status: int, last_word: bytes = b"") -> Callable[[], int]:
    """Import a function; while that lasts, signals end the process with a status.

    They are left so: the function has handlers of its own, or calls :func:`_as_python_has_them`.
    """

    def end(_number: int, _frame: object) -> None:
        os.write(2, last_word)
        os._exit(status)  # nothing is open yet, and an exception may be caught by what imports

    for number in SIGNALS:
        signal.signal(number, end)
    function: Callable[[], int] = getattr(importlib.import_module(module), name)
    return function


def _as_python_has_them() -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def run_node(role: str) -> int:
    """Be a node; told to stop before it lives, it ends as it does later."""
    return _function(MODULES[role], "main", 0)()


def command() -> int:
    """Entry point of the command `bow`."""
    role = sys.argv[1] if len(sys.argv) > 1 else ""
    if role in MODULES:
        sys.argv[:2] = [f"bow {role}"]
        return run_node(role)
    run = _function(CLI, "command", INTERRUPTED, b"bow: interrupted\n")
    _as_python_has_them()
    return run()


coordinator, simulator, classifier, recorder, dashboard = (partial(run_node, role) for role in MODULES)

if __name__ == "__main__":
    sys.exit(command())
