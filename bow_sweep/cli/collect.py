"""The command `bow collect`: brings the bags of stations together."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED, INTERRUPTED
from bow_sweep.processes.progress import percentages


def add_command(commands: Any) -> None:
    """Add the parser of `collect`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "collect",
        help="bring the bags of stations to the run they belong to",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Each station of a run records a bag of its own, where it runs. This command copies such bags to\n"
        "RUN/bag/NAME/. Then `bow verify`, `bow replay`, `bow inspect` and `bow sweep --resume` have every sample.\n"
        "A run is whole without it: its map and verdicts are, and `bow verify` lists what it has not seen.\n\n"
        "FROM is a directory in which a station has left its part of the run: the run's directory there, or the one\n"
        "that `bow station --out` named. HOST:DIR is one on another machine, copied by rsync over ssh.\n\n"
        "A bag is copied aside and checked before it takes its place. One of another run is refused. A bag that is\n"
        "here stays if it is the same or longer; a shorter one is kept in RUN/bag_aside/.",
        epilog="examples:\n"
        "  bow collect runs/fig11d lab1:/data/d796a44ce68eb887 lab2:/data/d796a44ce68eb887\n"
        "  bow collect runs/fig11d /mnt/lab2/runs\n\n"
        "exit status: 0 all bags are here, 1 one could not be copied, 2 wrong usage, 130 interrupted",
    )
    parser.add_argument("directory", metavar="RUN", type=Path, help="run directory, that of the coordinator's machine")
    parser.add_argument("sources", metavar="FROM", nargs="+", help="DIR, or HOST:DIR")
    parser.add_argument("--no-lock", action="store_true", help="for file systems without locks")
    parser.set_defaults(run=_collect)


def _collect(args: argparse.Namespace) -> int:
    from bow_sweep.record.collect import CollectError, collect
    from bow_sweep.run.lock import LockError

    for source in args.sources:
        shown = percentages(f"copying from {source}")
        try:
            collect(args.directory, source, lambda line: print(line, flush=True), shown, not args.no_lock)
        except (CollectError, LockError) as error:
            return fail(str(error), FAILED)
        except OSError as error:
            where = error.filename or args.directory
            return fail(f"{where}: {error.strerror or error}; nothing is half copied", FAILED)
        except KeyboardInterrupt:
            return fail("interrupted; nothing is half copied, the same command can be given again", INTERRUPTED)
    for line in _missed(args.directory):
        warn(line)
    return DONE


def _missed(run: Path) -> list[str]:
    """Return lines on the stations whose bags are not here, by the ledger."""
    from bow_sweep.record.bag import station_bags
    from bow_sweep.record.run_bags import unseen_in_words
    from bow_sweep.run.ledger_file import done_at, read_leniently

    here = station_bags(run)
    missed: dict[str, list[int]] = {}
    for block, station in done_at(read_leniently(run).entries).items():
        if station and station not in here:
            missed.setdefault(station, []).append(block)
    return list(unseen_in_words(missed))
