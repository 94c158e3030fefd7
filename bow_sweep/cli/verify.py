"""The command `bow verify`: checks everything in a run's bag."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from bow_sweep.processes.exit_status import DONE, FAILED
from bow_sweep.processes.progress import percentages


def add_command(commands: Any) -> None:
    """Add the parser of `verify`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "verify",
        help="check everything in a run's bag",
        description="Check every cell, chunk, sample and checksum of a run's bag, compute its verdicts again, and "
        "compare map.npz, report.json and ledger.jsonl with them. Prints JSON. "
        "Exit status 0 only if there is no problem; otherwise `problems` names run, file, block and chunk.",
    )
    parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")
    parser.set_defaults(run=_verify)


def _verify(args: argparse.Namespace) -> int:
    from bow_sweep.record.verify import verify

    result = verify(args.directory, progress=percentages("verify"))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED
