"""`bow validate --beyond`: makes the runs that claims beyond the paper are about, checks them, writes the page."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from bow_sim.protocol.identity import random_id
from bow_sweep.cli.sweep import cores, run_jobs
from bow_sweep.cli.terminal import environment_is_ready, fail, warn, width
from bow_sweep.processes.exit_status import DONE, FAILED, USAGE
from bow_sweep.processes.progress import percentages

OUT = Path("runs/beyond")
"""Default directory of runs and page."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the second page."""
    group = parser.add_argument_group("claims beyond the paper")
    group.add_argument("--beyond", action="store_true", help="the second page: claims since the paper, with figures")
    group.add_argument("--out", metavar="DIR", type=Path, help=f"directory of its runs and its page (default: {OUT})")
    group.add_argument("--claim", metavar="KEY", action="append", default=[], help="check this claim only; repeatable")
    group.add_argument("--no-runs", action="store_true", help="make no runs; take those that are in DIR")
    group.add_argument("--small", action="store_true", help="coarse maps, to try it: not for a judgement")
    group.add_argument("--simulators", metavar="N", type=int, default=cores(), help="processes (default: one a core)")


def validate_beyond(args: argparse.Namespace) -> int:
    """Run `bow validate --beyond`; return the exit status."""
    from bow_sweep.beyond.report import CLAIMS, check, write
    from bow_sweep.beyond.sweeps import SWEEPS, find
    from bow_sweep.maps.map_file import MapFileError

    keys = [claim.key for claim in CLAIMS]
    for key in args.claim:
        if key not in keys:
            return fail(f"--claim {key}: no such claim; one of {', '.join(keys)}")
    if args.runs or args.json or args.markdown:
        return fail(
            "--beyond makes its own runs in --out DIR and writes its table there; give no RUN, --json or --markdown"
        )
    if args.simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    needed = {name for claim in CLAIMS if not args.claim or claim.key in args.claim for name in claim.needs}
    names = [name for name in SWEEPS if name in needed]
    out = (args.out or OUT).absolute()
    if out.exists() and not out.is_dir():
        return fail(f"--out {args.out}: is a file; should be a directory, new or with runs of this command")
    try:
        find(out, names, args.small)  # runs of other settings are refused before anything is started
        if names and not args.no_runs:
            status = _make_runs(out, names, args)
            if status != DONE:
                return status
        maps = find(out, names, args.small)
        out.mkdir(parents=True, exist_ok=True)
        report = check(maps, out, args.claim, args.small, percentages("validate"))
        files = write(report, out)
    except MapFileError as error:
        return fail(str(error))
    except OSError as error:
        return fail(f"{error.filename or out}: cannot be written: {error.strerror or error}")
    print(report.to_text(width()))
    for path in files:
        print(f"wrote {path}")
    return DONE if report.ok else FAILED


def _make_runs(out: Path, names: list[str], args: argparse.Namespace) -> int:
    """Make the runs that are missing, go on with those that are not finished; return the exit status."""
    from bow_sweep.beyond.sweeps import SWEEPS
    from bow_sweep.cli import sweep_jobs
    from bow_sweep.maps.map_file import MAP
    from bow_sweep.run.directory import RunError
    from bow_sweep.view.viewer import Screen
    from bow_sweep.view.wanted import wanted

    todo = [name for name in names if not (out / name / MAP).exists()]
    if not todo:
        return DONE
    if not environment_is_ready():
        return USAGE
    try:
        owned = sweep_jobs.shared_directory(out)
    except (RunError, OSError) as error:
        return fail(str(error))
    jobs = []
    try:
        for name in todo:
            run = out / name
            if sweep_jobs.has_begun(run):
                jobs += sweep_jobs.unfinished(run, lock=True)
            else:
                jobs.append(sweep_jobs.Job(run, random_id(), SWEEPS[name].sweep(args.small)))
    except (RunError, OSError) as error:
        owned.release()
        return fail(str(error))
    warn(f"{len(jobs)} of {len(names)} runs are to be made in {out}; after an interruption give the same command again")
    options = argparse.Namespace(simulators=args.simulators, no_lock=False, no_sync=False)
    work = sweep_jobs.Work(owned, None, jobs)
    again = f"bow validate --beyond --out {shlex.quote(str(out))}" + (" --small" if args.small else "")
    return run_jobs(options, work, wanted(False, "0", True), Screen(), [], again)
