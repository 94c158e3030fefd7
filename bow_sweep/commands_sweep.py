"""The command `bow sweep`: one sweep, or the several of a campaign."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
import time
from pathlib import Path
from typing import Any

from bow_sim.model import MODELS, ParameterError
from bow_sim.taps import embed_files

from .plan import Sweep, presets

DONE, FAILED, USAGE, QUARANTINED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses."""


def fail(message: str, status: int = USAGE) -> int:
    """Say what is wrong and return the exit status."""
    print(f"bow: {message}", file=sys.stderr)
    return status


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def add_command(commands: Any) -> None:
    """Add the parser of `sweep`; its default `run` takes the arguments."""
    names = "\n".join(f"  {name:16} {title}" for name, title in presets().items())
    parser = commands.add_parser(
        "sweep",
        help="run a sweep on this machine, recorded and classified",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Start the graph on this machine (loopback only), run a sweep, and leave a run directory.",
        epilog=f"presets:\n{names}\n\nexamples:\n"
        "  bow sweep fig11d                          the paper's Fig 11(d), 8192 cells\n"
        "  bow sweep fig11c --nx 32 --ny 16 --out small\n"
        "  bow sweep fig11d --set x.first=2 --set x.last=8 --set mu_s=0.9\n"
        "  bow sweep --resume small                  go on where a run was cut off\n\n"
        "exit status: 0 done, 1 failed, 2 wrong usage, 3 done but for quarantined blocks, 130 interrupted",
    )
    parser.add_argument("preset", nargs="?", default="", help="named sweep; without one, the defaults of the package")
    parser.add_argument("--model", help=f"one of {', '.join(MODELS)}")
    parser.add_argument("--v-mid", metavar="V", help="string speed where friction is midway, in v_b; below 1")
    parser.add_argument("--nx", metavar="N", help="cells along x (f_asym)")
    parser.add_argument("--ny", metavar="N", help="cells along y (f_init/f_asym)")
    parser.add_argument("--periods", metavar="N", help="length of each simulation, a multiple of 5")
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument("--simulators", metavar="N", type=int, default=_cores(), help="processes (default: one a core)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="run directory (default: runs/PRESET-DATE)")
    parser.add_argument("--resume", metavar="RUN", type=Path, help="go on with this run directory")
    parser.add_argument("--view", action="store_true", help="open the rerun viewer and watch the map grow")
    parser.add_argument(
        "--port", metavar="P", type=int, default=0, help="serve the dashboard to `rerun --connect` on P"
    )
    parser.add_argument("--no-dashboard", action="store_true", help="no dashboard node, no dashboard.rrd")
    parser.set_defaults(run=_sweep)


SET_HELP = "any setting, repeatable; `bow settings` lists them; @FILE is a reflection function of your own"
_SHORT = {"model": "model", "v_mid": "v_mid", "nx": "x.count", "ny": "y.count", "periods": "periods"}


def _sweep(args: argparse.Namespace) -> int:
    from .run import RunError, is_finished, read_ledger

    if args.simulators < 1:
        return fail(f"--simulators {args.simulators}: should be at least 1")
    short = [f"{key}={getattr(args, name)}" for name, key in _SHORT.items() if getattr(args, name) is not None]
    try:
        if args.resume:
            if args.preset or short or args.settings or args.out:
                return fail("--resume takes the sweep from the run directory; give no preset, setting or --out with it")
            entries = read_ledger(args.resume)
            if is_finished(args.resume, entries):
                print(f"nothing to do: every block of this run is done or quarantined\n\n{_summary(args.resume)}")
                return DONE
            plan = entries[0]
            sweep, identity, directory = Sweep.from_spec("", plan["settings"]), plan["run_id"], args.resume
        else:
            from bow_sim.identity import random_id

            settings = embed_files(short + args.settings)
            sweep, identity = Sweep.from_spec(args.preset, settings), random_id()
            name = f"{args.preset or sweep.parameters.model}-{time.strftime('%Y%m%d-%H%M%S')}"
            directory = args.out or Path("runs") / name
            problem = _directory_problem(directory)
            if problem:
                return fail(problem)
    except (ParameterError, RunError) as error:
        return fail(str(error))
    return _run_graph(args, sweep, identity, directory.resolve())


def _directory_problem(directory: Path) -> str:
    """Return why a new run cannot go into `directory`, or ""; makes it."""
    if directory.exists() and not directory.is_dir():
        return f"--out {directory}: is a file; should be a directory that is new or empty"
    try:
        if directory.is_dir() and any(directory.iterdir()):
            return f"--out {directory}: is not empty; choose a new one, or go on with --resume {directory}"
        directory.mkdir(parents=True, exist_ok=True)
        probe = directory / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        return f"--out {directory}: cannot be written: {error.strerror}"
    return ""


def _run_graph(args: argparse.Namespace, sweep: Sweep, identity: str, directory: Path) -> int:
    from .conduct import Interrupted, conduct
    from .display import Display
    from .supervisor import GraphError

    display = Display()
    p = sweep.parameters
    display.say(
        f"{sweep.preset or 'sweep'}: {p.model}, v_mid = {p.v_mid:g}, {sweep.x.count} x {sweep.y.count} cells, "
        f"{p.periods} periods, {args.simulators} simulators -> {directory}"
    )
    dashboard = None if args.no_dashboard else {"view": args.view, "port": args.port}
    again = f"go on with: bow sweep --resume {shlex.quote(str(directory))}"
    try:
        conduct(
            directory,
            identity,
            sweep,
            resume=args.resume is not None,
            simulators=args.simulators,
            dashboard=dashboard,
            display=display,
        )
    except Interrupted:
        return fail(f"interrupted; nothing is lost, {again}", INTERRUPTED)
    except GraphError as error:
        return fail(f"{error}\n{again}", FAILED)
    print(_summary(directory))
    return QUARANTINED if _report(directory)["cells"]["quarantined"] else DONE


def _report(directory: Path) -> dict[str, Any]:
    report: dict[str, Any] = json.loads((directory / "report.json").read_text())
    return report


def _summary(directory: Path) -> str:
    report = _report(directory)
    cells = report["cells"]
    regimes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in report["regimes"].items() if count)
    lines = [
        f"{cells['done']} of {cells['planned']} cells in {report['wall_seconds']:.1f} s; "
        f"Helmholtz motion in {report['helmholtz_fraction']:.3f} of them",
        f"at the last test: {regimes}",
        "",
        f"{directory}/",
        "  map.png         the basin map, to look at",
        "  map.npz         the same as arrays",
        f"  dashboard.rrd   rerun {shlex.quote(str(directory / 'dashboard.rrd'))}",
        "  bag/            every sample, rosbag2/MCAP: ros2 bag play, rosbags, Foxglove, rerun",
        "  report.json     accounts, versions, parameters",
        "",
        f"check it: bow verify {shlex.quote(str(directory))}",
    ]
    for block, why in report["quarantined_blocks"].items():
        lines.insert(2, f"QUARANTINED block {block}: {why}")
    return "\n".join(lines)
