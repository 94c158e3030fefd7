"""The first things of the command `bow`, before it imports what takes long or depends on the environment."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from bow_sim.graph import environment

INTERRUPTED = 130

CHILD = (
    "import sys; sys.path[:] = [sys.argv.pop(1), *filter(None, sys.path)]; import bow_sim, bow_classifier, bow_sweep; "
    "del sys.path[0]; from bow_sweep.start import node; sys.exit(node())"
)
"""Python that is a node: of our packages as the parent has them, and of nothing in the working directory."""


def command() -> int:
    """Entry point of the command `bow`."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)  # there is nothing yet that has to be stopped in order
    environment.prepare()
    import gc

    from bow_sweep.cli.main import main

    if signal.getsignal(signal.SIGINT) is _leave:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    status = main()
    gc.freeze()  # all of it goes with the process: looking for garbage in it would take a fifth of a second
    return status


def _leave(_number: int, _frame: FrameType | None) -> None:
    os._exit(INTERRUPTED)


def node() -> int:
    """Be the node of the module that the first argument names."""
    import importlib

    sys.argv.pop(0)
    status: int = importlib.import_module(sys.argv[0]).main()
    return status
