"""The command `bow verify`: everything in a run's bag is accounted for."""

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
        help="account for everything in a run's bag",
        description="Account for every cell, chunk, sample and checksum of a run's bag and derive its verdicts again; "
        "hold map.npz, report.json and ledger.jsonl against them. Prints JSON. "
        "Exit status 0 only if all of it holds; otherwise `problems` names run, file, block and chunk.",
    )
    parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")
    parser.set_defaults(run=_verify)


def _verify(args: argparse.Namespace) -> int:
    from bow_sweep.record.verify import verify

    result = verify(args.directory, progress=percentages("verify"))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED
