"""The command `bow validate`: the paper's claims, and with --beyond those made since."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from bow_sim.atomic_files import replacing
from bow_sweep.cli import validate_beyond
from bow_sweep.cli.terminal import fail, width
from bow_sweep.processes.exit_status import DONE, FAILED
from bow_sweep.processes.progress import percentages


def add_command(commands: Any) -> None:
    """Add the parser of `validate`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "validate",
        help="compare this program with the claims of the paper, and later ones",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Print each claim of the paper with its source, the result of this program, and a verdict: pass\n"
        "or fail by a tolerance, which --markdown and --json give with its reason; report where the paper gives\n"
        "no number to compare with; needs runs where the claim is about a map that was not given.",
        epilog="examples:\n"
        "  bow validate                                  all claims about one string\n"
        "  bow validate runs/fig11?                      those about the maps of Figs 10 and 11 too\n"
        "  bow validate --json v.json --markdown v.md\n"
        "  bow validate --beyond --out beyond            claims since the paper, with the runs they are about\n"
        "  bow validate --beyond --claim wolf-beat       one of them\n\n"
        "Runs are recognised by their settings. For a map coarser than 128 x 64 cells or shorter than 100 periods\n"
        "the results are shown without a verdict.\n\n"
        "--beyond runs sweeps through the graph, some minutes on two cores, checks claims about bodies, bow hair,\n"
        "thermal friction and measured planes, and writes index.html, claims.md and claims.json, with a figure for\n"
        "each claim. Its verdicts: met, near (off by at most the tolerance once more), missed, reported, needs runs.\n"
        "Runs that are there are taken; after an interruption the same command goes on.\n\n"
        "exit status: 0 no claim fails or is missed, 1 one is, 2 wrong usage, 130 interrupted",
    )
    parser.add_argument("runs", metavar="RUN", nargs="*", type=Path, help="run directory, or a map.npz")
    parser.add_argument("--json", metavar="F", type=Path, help="also write the table for programs")
    parser.add_argument("--markdown", metavar="F", type=Path, help="also write the table as Markdown")
    validate_beyond.add_arguments(parser)
    parser.set_defaults(run=_validate)


def _validate(args: argparse.Namespace) -> int:
    if args.beyond:
        return validate_beyond.validate_beyond(args)
    for name in ("out", "claim", "no_runs", "small"):
        if getattr(args, name):
            return fail(f"--{name.replace('_', '-')} is for the claims beyond the paper; give it with --beyond")
    from bow_sweep.maps.map_file import MapFileError
    from bow_sweep.paper.validate import validate

    try:
        report = validate(args.runs, percentages("validate"))
    except MapFileError as error:
        return fail(str(error))
    print(report.to_text(width()))
    for path, text in ((args.json, report.to_json()), (args.markdown, report.to_markdown())):
        if path is not None:
            try:
                with replacing(path) as file:
                    file.write(text.encode())
            except OSError as error:
                return fail(f"{path}: cannot be written: {error.strerror}")
            print(f"wrote {path}")
    return DONE if report.ok else FAILED
