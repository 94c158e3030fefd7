"""Entry points of the executables. A signal during the imports ends them without a traceback.

`ros2 launch` sends SIGINT to all processes as soon as one of them ends the launch, which may be in the first second of
the others. The modules of a node or of the command take that long to import, so they are imported in :func:`command`,
after handlers are installed. A signal before that, while Python itself starts (less than 0.1 s), still gets Python's
own answer: nothing in a package can be run earlier.
"""

from __future__ import annotations

import atexit
import importlib
import os
import signal
import sys
from collections.abc import Sequence
from functools import partial

from bow_sweep.processes.exit_status import DONE, INTERRUPTED
from bow_sweep.processes.roles import MODULES

SIGNALS = (signal.SIGINT, signal.SIGTERM)

MAIN = "bow_sweep.cli.parser"
"""Module whose main() is the command."""

_INTERRUPTED_TEXT = b"bow: interrupted\n"


def command() -> int:
    """Run the command `bow`; return its exit status, after which signals are ignored: the process has to end then.

    A node that is interrupted while it starts ends with `DONE`.
    """
    ended: list[int] = []
    atexit.register(_exit_at_once, ended)  # what libraries register later is called before
    is_node = sys.argv[1:2] and sys.argv[1] in MODULES
    status, text = (DONE, b"") if is_node else (INTERRUPTED, _INTERRUPTED_TEXT)

    def end(_number: int, _frame: object) -> None:
        os.write(2, text)
        os._exit(status)  # no file is open yet, and an exception might be caught by a module that imports others

    before = {number: signal.getsignal(number) for number in SIGNALS}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, end)
    environment = importlib.import_module("bow_sim.graph.environment")
    environment.prepare()  # before modules are imported that depend on it
    main = importlib.import_module(MAIN).main
    try:
        if not is_node:  # a node installs its own handlers
            for number, handler in before.items():
                signal.signal(number, handler)
        ended.append(main())
        text = b""
    except KeyboardInterrupt:
        ended.append(INTERRUPTED)
        text = _INTERRUPTED_TEXT
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)  # one more Ctrl-C would show as a traceback of Python's own end
    if text:
        os.write(2, text)
    return ended[-1]


def _exit_at_once(ended: Sequence[int]) -> None:
    """Exit with the status in `ended`, if there is one: freeing every object one by one would take 0.2 s.

    Python calls it last at its exit, when threads have ended, and files and libraries are closed.
    """
    if not ended:
        return  # an exception, which Python has reported
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return  # Python reports it
    os._exit(ended[-1])


def _node(role: str) -> int:
    sys.argv[:1] = ["bow", role]
    return command()


coordinator, simulator, classifier, recorder, dashboard = (partial(_node, role) for role in MODULES)
