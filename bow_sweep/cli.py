"""The command `bow`."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shlex
import sys
import textwrap
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bow_classifier.thresholds import Thresholds
from bow_sim.model import MODELS, ParameterError, Parameters
from bow_sim.taps import embed_files

from . import commands_compare, commands_paper
from .display import percentages
from .plan import X_AXIS, Y_AXIS, Sweep, presets

DONE, FAILED, USAGE, QUARANTINED, INTERRUPTED = 0, 1, 2, 3, 130
"""Exit statuses."""

NODES = ("coordinator", "simulator", "classifier", "recorder", "dashboard")


def _fail(message: str, status: int = USAGE) -> int:
    print(f"bow: {message}", file=sys.stderr)
    return status


def _cores() -> int:
    return len(os.sched_getaffinity(0))


# ---- bow sweep


def _add_sweep(commands: Any) -> None:
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
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=_SET_HELP)
    parser.add_argument("--simulators", metavar="N", type=int, default=_cores(), help="processes (default: one a core)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="run directory (default: runs/PRESET-DATE)")
    parser.add_argument("--resume", metavar="RUN", type=Path, help="go on with this run directory")
    parser.add_argument("--view", action="store_true", help="open the rerun viewer and watch the map grow")
    parser.add_argument(
        "--port", metavar="P", type=int, default=0, help="serve the dashboard to `rerun --connect` on P"
    )
    parser.add_argument("--no-dashboard", action="store_true", help="no dashboard node, no dashboard.rrd")
    parser.set_defaults(run=_sweep)


_SET_HELP = "any setting, repeatable; `bow settings` lists them; @FILE is a reflection function of your own"
_SHORT = {"model": "model", "v_mid": "v_mid", "nx": "x.count", "ny": "y.count", "periods": "periods"}


def _sweep(args: argparse.Namespace) -> int:
    from .run import RunError, is_finished, read_ledger

    if args.simulators < 1:
        return _fail(f"--simulators {args.simulators}: should be at least 1")
    short = [f"{key}={getattr(args, name)}" for name, key in _SHORT.items() if getattr(args, name) is not None]
    try:
        if args.resume:
            if args.preset or short or args.settings or args.out:
                return _fail(
                    "--resume takes the sweep from the run directory; give no preset, setting or --out with it"
                )
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
                return _fail(problem)
    except (ParameterError, RunError) as error:
        return _fail(str(error))
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
        return _fail(f"interrupted; nothing is lost, {again}", INTERRUPTED)
    except GraphError as error:
        return _fail(f"{error}\n{again}", FAILED)
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


# ---- bow transient


def _add_transient(commands: Any) -> None:
    parser = commands.add_parser(
        "transient",
        help="simulate one cell, without a graph",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Simulate one bowed string and write, draw or sound its waveforms.",
        epilog="example: bow transient --model delta_cremer --v-mid 0.7 --f-asym 5.5 --f-init-ratio 1 --plot t.png\n\n"
        "--npz holds float64 arrays over samples: bridge_force, v, v_h, v_centre, friction_force, and bool slipping\n"
        "(state after the step).",
    )
    for name in ("model", "v_mid", "f_asym", "f_init_ratio", "periods"):
        parser.add_argument(f"--{name.replace('_', '-')}", metavar=name.upper(), dest=name, help=_field_help(name))
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=_SET_HELP)
    parser.add_argument("--npz", metavar="F", type=Path, help="write the waveforms as a NumPy archive")
    parser.add_argument("--plot", metavar="F", type=Path, help="draw them (.png, .svg or .pdf)")
    parser.add_argument("--wav", metavar="F", type=Path, help="the bridge force as sound, 16 bit")
    parser.set_defaults(run=_transient)


def _field_help(name: str) -> str:
    field = Parameters.__dataclass_fields__[name]
    unit = f", in {field.metadata['unit']}" if field.metadata["unit"] else ""
    return f"{field.metadata['doc']}{unit} (default {field.default})".replace("%", "%%")


def _transient(args: argparse.Namespace) -> int:
    from .single import describe, draw, save_npz, save_wav

    names = ("model", "v_mid", "f_asym", "f_init_ratio", "periods")
    short = [f"{name}={getattr(args, name)}" for name in names if getattr(args, name) is not None]
    try:
        parameters = Parameters.from_settings(embed_files(short + args.settings))
    except ParameterError as error:
        return _fail(str(error))
    from bow_sim.kernel import transient

    waveforms = transient(parameters)
    try:
        for write, path in ((save_npz, args.npz), (draw, args.plot), (save_wav, args.wav)):
            if path is not None:
                write(path, parameters, waveforms)
                print(f"wrote {path}")
    except (OSError, ValueError) as error:
        return _fail(str(error))
    print(describe(parameters, waveforms))
    return DONE


# ---- bow verify, replay, recover


def _add_run_commands(commands: Any) -> None:
    verify = commands.add_parser(
        "verify",
        help="account for everything in a run's bag",
        description="Account for every cell, chunk, sample and checksum of a run's bag and derive its verdicts again. "
        "Prints JSON. Exit status 0 only if all of it holds; otherwise `problems` names run, block and chunk.",
    )
    verify.set_defaults(run=_verify)
    replay = commands.add_parser(
        "replay",
        help="judge a run's bag again",
        description="Stream a bag through the classifier again. With the same thresholds the verdicts must be the "
        "recorded ones, byte for byte; with others a new set is written beside them, verdicts-HASH.npz.",
    )
    replay.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=_REPLAY_HELP)
    replay.set_defaults(run=_replay)
    recover = commands.add_parser(
        "recover",
        help="repair a bag whose writer was killed",
        description="Keep the complete chunks of every file of a run's bag that was cut off, and write its index anew.",
    )
    recover.set_defaults(run=_recover)
    for parser in (verify, replay, recover):
        parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")


_REPLAY_HELP = "a threshold, repeatable: correlation=0.9, slip=0.05, corner=0.35, preset=trial"


def _verify(args: argparse.Namespace) -> int:
    from .record.verify import verify

    result = verify(args.directory, progress=percentages("verify"))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED


def _replay(args: argparse.Namespace) -> int:
    from .record.replay import replay

    try:
        result = replay(args.directory, settings=args.settings, progress=percentages("replay"))
    except (ParameterError, OSError, ValueError) as error:
        return _fail(str(error))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED


def _recover(args: argparse.Namespace) -> int:
    from .record.recover import recover

    try:
        result = recover(args.directory)
    except (OSError, ValueError) as error:
        return _fail(str(error))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED


# ---- bow settings, nodes


def _settings(_: argparse.Namespace) -> int:
    for name, field in sorted(Parameters.__dataclass_fields__.items()):
        print(f"{name} = {field.default}")
        print(textwrap.indent(_describe_field(field), "    "))
    for name, field in sorted(Thresholds.__dataclass_fields__.items()):
        print(f"classifier.{name} = {field.default}")
        print(textwrap.indent(_describe_field(field), "    "))
    for axis, defaults in (("x", X_AXIS), ("y", Y_AXIS)):
        for name, value in vars(defaults).items():
            print(f"{axis}.{name} = {value}")
    print("    the axes of the map: a parameter's name, log or linear, first and last value, how many")
    print(f"block_cells = {Sweep.block_cells}\n    cells that one simulator runs together")
    return DONE


def _describe_field(field: Any) -> str:
    meta = field.metadata
    right = ", ".join(meta["choices"]) if "choices" in meta else str(meta.get("range", ""))
    unit = f" [{meta['unit']}]" if meta["unit"] else ""
    return "; ".join(filter(None, (f"{meta['doc']}{unit}", right, meta.get("source", ""))))


def _node(args: argparse.Namespace) -> int:
    from .supervisor import MODULES

    sys.argv = [f"bow {args.command}", *args.arguments]
    status: int = importlib.import_module(MODULES[args.command]).main()
    return status


def parser() -> argparse.ArgumentParser:
    """Return the parser of the whole command."""
    top = argparse.ArgumentParser(
        prog="bow",
        description="Explore how a bowed string answers the bow: sweeps of simulated strings as a ROS 2 graph, "
        "after Schumacher and Woodhouse (1995).",
        epilog="begin with: bow sweep fig11d --nx 32 --ny 16",
    )
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    _add_sweep(commands)
    _add_transient(commands)
    _add_run_commands(commands)
    commands_paper.add_commands(commands)
    commands_compare.add_command(commands)
    settings = "list every setting, its default, unit, range and source"
    commands.add_parser("settings", help=settings, description=settings).set_defaults(run=_settings)
    for name in NODES:
        node = commands.add_parser(name, help=f"run one {name} node, as `ros2 run bow {name}` does", add_help=False)
        node.add_argument("arguments", nargs=argparse.REMAINDER)
        node.set_defaults(run=_node)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in NODES:  # argparse would take --help and --ros-args for its own
        return _node(argparse.Namespace(command=words[0], arguments=words[1:]))
    args = parser().parse_args(words)
    try:
        status: int = args.run(args)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    return status


if __name__ == "__main__":
    sys.exit(main())
