"""Entry points of the executables: a signal that comes while Python still imports ends them without a traceback.

`ros2 launch` sends SIGINT to all processes as soon as one of them ends the launch, which may be in the first second of
the others. The modules of a node or of the command take that long to import, so they are imported in here.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from functools import partial

SIGNALS = (signal.SIGINT, signal.SIGTERM)

MODULES = {
    "coordinator": "bow_sweep.coordinator.node",
    "simulator": "bow_sim.node",
    "classifier": "bow_classifier.node",
    "recorder": "bow_sweep.record.node",
    "dashboard": "bow_sweep.view.node",
}
"""Role -> module with the node's main()."""

BEGIN = "bow_sweep.start"
"""Module whose command() is the rest."""

INTERRUPTED = 130


def command() -> int:
    """Entry point of the command `bow`; a node that is told to stop before it lives ends as it does later."""
    is_node = sys.argv[1:2] and sys.argv[1] in MODULES
    status, last_word = (0, b"") if is_node else (INTERRUPTED, b"bow: interrupted\n")

    def end(_number: int, _frame: object) -> None:
        os.write(2, last_word)
        os._exit(status)  # nothing is open yet, and an exception may be caught by what imports

    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, end)
    run = importlib.import_module(BEGIN).command
    if not is_node:  # its own handlers take over from these
        for number, handler in before.items():
            signal.signal(number, handler)
    result: int = run()
    return result


def _node(role: str) -> int:
    sys.argv[:1] = ["bow", role]
    return command()


coordinator, simulator, classifier, recorder, dashboard = (partial(_node, role) for role in MODULES)

if __name__ == "__main__":
    sys.exit(command())
