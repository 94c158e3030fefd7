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
        help="compare this program with the claims of the paper",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Print each claim of the paper with its source, the result of this program, and a verdict: pass\n"
        "or fail by a tolerance, which --markdown and --json give with its reason; report where the paper gives\n"
        "no number to compare with; needs runs where the claim is about a map that was not given.",
        epilog="examples:\n"
        "  bow validate                                  all claims about one string\n"
        "  bow validate runs/fig11?                      those about the maps of Figs 10 and 11 too\n"
        "  bow validate --json v.json --markdown v.md\n\n"
        "Runs are recognised by their settings. For a map coarser than 128 x 64 cells or shorter than 100 periods\n"
        "the results are shown without a verdict.\n\n"
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
