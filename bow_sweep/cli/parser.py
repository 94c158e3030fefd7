"""The command `bow`: the parser of all commands."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from bow_sim.graph import environment
from bow_sweep.cli import (
    classify,
    collect,
    compare,
    edges,
    explore,
    exponent,
    export,
    figure,
    inspect,
    nodes,
    optimise,
    plot,
    recover,
    repeats,
    replay,
    settings,
    station,
    status,
    study,
    sweep,
    transient,
    up,
    validate,
    verify,
)
from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import FAILED, INTERRUPTED
from bow_sweep.processes.roles import MODULES


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command."""
    top = argparse.ArgumentParser(
        prog="bow",
        description="Explore how a bowed string answers the bow: sweeps of simulated strings as a ROS 2 graph, "
        "after Schumacher and Woodhouse (1995).",
        epilog="begin with: bow sweep fig11d --nx 32 --ny 16",
    )
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    looked_at = sweep, study, optimise, inspect, explore, transient, edges, repeats, exponent, figure, validate
    for module in (*looked_at, compare, plot, verify, replay, recover, collect, export, classify, settings):
        module.add_command(commands)
    station.add_command(commands)
    up.add_commands(commands)
    status.add_command(commands)
    nodes.add_commands(commands)
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
        return nodes.run_node(words[0], words[1:])
    try:
        args = parser().parse_args(words)
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
