"""The command `bow verify`: checks everything in a run's bag."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from bow_sim.protocol.recording import PROVED_CELLS
from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED
from bow_sweep.processes.progress import percentages


def add_command(commands: Any) -> None:
    """Add the parser of `verify`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "verify",
        help="check everything in a run's bag",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Check every cell, chunk, sample and checksum of a run's bag, derive its verdicts again, and\n"
        "compare map.npz, report.json and ledger.jsonl with them. Prints JSON.\n\n"
        "Of a run with stations all bags that are here are read as one. Blocks of a station whose bag is elsewhere\n"
        "are listed as `unseen`, which is no problem; `bow collect` brings such bags here.\n\n"
        "The verdicts are derived from the recorded streams. Of a run that does not record them (bow sweep --record\n"
        "verdicts, or last), some of its cells are computed again, drawn at random in whole blocks, and checksums and\n"
        "verdicts are compared. That needs the kernel of the run, the same release of bow; another one is named.",
        epilog="examples:\n"
        "  bow verify runs/one\n"
        "  bow verify runs/small --sample 2000 --seed 7      2000 cells or a few more, another draw\n"
        "  bow verify runs/small --all                       every cell; takes about as long as the sweep\n\n"
        "exit status: 0 only if there is no problem; 1 otherwise: `problems` names run, file, block and chunk; "
        "2 wrong usage",
    )
    parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")
    many = parser.add_mutually_exclusive_group()
    many.add_argument(
        "--sample",
        metavar="N",
        type=int,
        help=f"compute at least N cells again, 0 for none; default: {PROVED_CELLS} of a run without all of its streams",
    )
    many.add_argument("--all", action="store_true", help="compute all cells again; also of a run with its streams")
    parser.add_argument("--seed", metavar="S", type=int, default=0, help="of the draw; default 0")
    parser.set_defaults(run=_verify)


def _verify(args: argparse.Namespace) -> int:
    from bow_sweep.cell.computed import kernel
    from bow_sweep.record.again import Again
    from bow_sweep.record.run_bags import unseen_in_words
    from bow_sweep.record.verify import verify

    for name in ("sample", "seed"):
        if (getattr(args, name) or 0) < 0:
            return fail(f"--{name} {getattr(args, name)}: should be 0 or more")
    again = Again(kernel(), math.inf if args.all else args.sample, args.seed)
    result = verify(args.directory, progress=percentages("verify"), again=again)
    print(json.dumps(result, indent=2))
    for line in unseen_in_words(result.get("unseen", {})):
        warn(line)
    return DONE if result["ok"] else FAILED
