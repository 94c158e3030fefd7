"""The commands `bow coordinator`, `bow simulator` and so on: one node, as `ros2 run bow NODE` starts it."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence
from typing import Any

from bow_sweep.cli.terminal import environment_is_ready
from bow_sweep.processes.exit_status import USAGE
from bow_sweep.processes.roles import MODULES


def add_command(commands: Any) -> None:
    """Add a parser for each node; its default `run` passes all arguments to the node."""
    for name in MODULES:
        parser = commands.add_parser(name, help=f"run one {name} node, as `ros2 run bow {name}` does", add_help=False)
        parser.add_argument("arguments", nargs=argparse.REMAINDER)
        parser.set_defaults(run=lambda args: run_node(args.command, args.arguments))


def run_node(role: str, arguments: Sequence[str]) -> int:
    """Run a node of this role in this process; return its exit status."""
    if not environment_is_ready():
        return USAGE
    sys.argv = [f"bow {role}", *arguments]
    status: int = importlib.import_module(MODULES[role]).main()
    return status
