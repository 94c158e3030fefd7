"""The command `bow recover`: repairs a bag whose writer was killed."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE, FAILED


def add_command(commands: Any) -> None:
    """Add the parser of `recover`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "recover",
        help="repair a bag whose writer was killed",
        description="Keep the complete parts of a run's bag, move damaged parts into files beside it (bag_aside/), and "
        "write its index anew; `bow sweep --resume` does this by itself. Prints JSON. "
        "Exit status 0 if no damage is left.",
    )
    parser.add_argument("--dry-run", action="store_true", help="report what would be done, change nothing")
    parser.add_argument("--no-lock", action="store_true", help="for file systems without locks")
    parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")
    parser.set_defaults(run=_recover)


def _recover(args: argparse.Namespace) -> int:
    from bow_sweep.record.recover import recover
    from bow_sweep.run.lock import LockError

    try:
        result = recover(args.directory, dry_run=args.dry_run, lock=not args.no_lock)
    except (LockError, OSError, ValueError) as error:
        return fail(str(error))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED
