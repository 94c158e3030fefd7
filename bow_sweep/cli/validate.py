"""The command `bow validate`: the paper's claims."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

from bow_sim.atomic_files import replacing
from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE, FAILED
from bow_sweep.processes.progress import percentages


def add_command(commands: Any) -> None:
    """Add the parser of `validate`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "validate",
        help="hold this program against what the paper states",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Print what the paper claims, where, what this program finds, and a verdict for each claim:\n"
        "pass or fail by a tolerance that --markdown and --json give with its reason, report where the\n"
        "paper gives nothing to hold a number against, needs runs where it speaks of a map that was not given.",
        epilog="examples:\n"
        "  bow validate                                  all claims about one string\n"
        "  bow validate runs/fig11?                      those about the maps of Figs 10 and 11 too\n"
        "  bow validate --json v.json --markdown v.md\n\n"
        "Runs are known by their settings. A map coarser than 128 x 64 cells or shorter than 100 periods is\n"
        "measured, but not judged.\n\n"
        "exit status: 0 no claim fails, 1 one does, 2 wrong usage",
    )
    parser.add_argument("runs", metavar="RUN", nargs="*", type=Path, help="run directory, or a map.npz")
    parser.add_argument("--json", metavar="F", type=Path, help="also write the table for programs")
    parser.add_argument("--markdown", metavar="F", type=Path, help="also write the table as Markdown")
    parser.set_defaults(run=_validate)


def _validate(args: argparse.Namespace) -> int:
    from bow_sweep.maps.map_file import MapFileError
    from bow_sweep.paper.validate import validate

    try:
        report = validate(args.runs, percentages("validate"))
    except MapFileError as error:
        return fail(str(error))
    width = min(max(shutil.get_terminal_size((120, 24)).columns, 60), 140)
    print(report.to_text(width))
    for path, text in ((args.json, report.to_json()), (args.markdown, report.to_markdown())):
        if path is not None:
            try:
                with replacing(path) as file:
                    file.write(text.encode())
            except OSError as error:
                return fail(f"{path}: cannot be written: {error.strerror}")
            print(f"wrote {path}")
    return DONE if report.ok else FAILED
