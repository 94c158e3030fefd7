"""The command `bow`: the parser of all commands."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from bow_sim.graph import environment, leaving
from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import FAILED, INTERRUPTED
from bow_sweep.processes.roles import MODULES

ADDED_BY = {
    **{name: name for name in ("sweep", "study", "optimise", "inspect", "explore", "transient", "edges", "repeats")},
    **{name: name for name in ("exponent", "figure", "validate", "compare", "plot", "verify", "replay", "recover")},
    **{name: name for name in ("collect", "export", "classify", "settings", "station", "up")},
    "down": "up",
    "status": "status",
    **dict.fromkeys(MODULES, "nodes"),
}
"""Command -> the module of this package that adds its parser, in the order of the help."""


def parser(only: str = "") -> argparse.ArgumentParser:
    """Return the parser of the whole command, or of `only` one of its commands: that imports no other's modules."""
    top = argparse.ArgumentParser(
        prog="bow",
        description="Explore how a bowed string answers the bow: sweeps of simulated strings as a ROS 2 graph, "
        "after Schumacher and Woodhouse (1995).",
        epilog="begin with: bow sweep fig11d --nx 32 --ny 16",
    )
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in [ADDED_BY[only]] if only in ADDED_BY else dict.fromkeys(ADDED_BY.values()):
        importlib.import_module(f"bow_sweep.cli.{name}").add_command(commands)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Parameters
    ----------
    arguments
        What comes after ``bow``; None for the arguments of this process.

    Returns
    -------
    int
        The exit status, see :mod:`bow_sweep.processes.exit_status`.
    """
    environment.open_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in MODULES:  # argparse would take --help and --ros-args for its own
        from bow_sweep.cli import nodes

        return nodes.run_node(words[0], words[1:])
    return leaving.run_command(lambda: _run(words))


def _run(words: Sequence[str]) -> int:
    try:
        args = parser(words[0] if words else "").parse_args(words)
        status: int = args.run(args)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return fail("interrupted", INTERRUPTED)
    except OSError as error:
        if error.filename is not None:
            return fail(str(error), FAILED)
        environment.silence("stdout")
        nobody_reads = isinstance(error, BrokenPipeError)  # as `bow settings | head` does
        return FAILED if nobody_reads else fail(f"standard output: {error.strerror}", FAILED)
    return status
