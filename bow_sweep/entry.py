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

from bow_sweep.processes.roles import MODULES

SIGNALS = (signal.SIGINT, signal.SIGTERM)

MAIN = "bow_sweep.cli.main"
"""Module whose main() is the command."""

INTERRUPTED = 130
"""Exit status after Ctrl-C."""


def command() -> int:
    """Entry point of the command `bow`; a node that is told to stop while it starts ends as it does later."""
    is_node = sys.argv[1:2] and sys.argv[1] in MODULES
    status, last_word = (0, b"") if is_node else (INTERRUPTED, b"bow: interrupted\n")

    def end(_number: int, _frame: object) -> None:
        os.write(2, last_word)
        os._exit(status)  # nothing is open yet, and an exception may be caught by what imports

    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, end)
    environment = importlib.import_module("bow_sim.graph.environment")
    environment.prepare()  # before anything is imported that depends on it
    main = importlib.import_module(MAIN).main
    if not is_node:  # a node's own handlers take over from these
        for number, handler in before.items():
            signal.signal(number, handler)
    result: int = main()
    gc = importlib.import_module("gc")
    gc.freeze()  # the process ends: a last collection of garbage would take a fifth of a second
    return result


def _node(role: str) -> int:
    sys.argv[:1] = ["bow", role]
    return command()


coordinator, simulator, classifier, recorder, dashboard = (partial(_node, role) for role in MODULES)
