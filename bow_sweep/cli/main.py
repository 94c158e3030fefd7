"""The command `bow`."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.graph import environment
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection_text import embed_files
from bow_sweep.cli import compare, paper, sweep
from bow_sweep.cli.sweep import DONE, FAILED, INTERRUPTED, SET_HELP, USAGE, fail, settled
from bow_sweep.plan.sweep import ADAPTIVE_BLOCKS, BLOCKS, LEAST_BLOCK, MOST_BLOCK, X_AXIS, Y_AXIS, Sweep
from bow_sweep.processes.progress import percentages

NODES = ("coordinator", "simulator", "classifier", "recorder", "dashboard")


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
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument("--npz", metavar="F", type=Path, help="write the waveforms as a NumPy archive")
    parser.add_argument("--plot", metavar="F", type=Path, help="draw them (.png, .svg or .pdf)")
    parser.add_argument("--wav", metavar="F", type=Path, help="the bridge force as sound, 16 bit")
    parser.set_defaults(run=_transient)


def _field_help(name: str) -> str:
    field = Parameters.__dataclass_fields__[name]
    unit = f", in {field.metadata['unit']}" if field.metadata["unit"] else ""
    return f"{field.metadata['doc']}{unit} (default {field.default})".replace("%", "%%")


def _transient(args: argparse.Namespace) -> int:
    from bow_sim.figures.transient import describe, draw, save_npz, save_wav

    names = ("model", "v_mid", "f_asym", "f_init_ratio", "periods")
    short = [f"{name}={getattr(args, name)}" for name in names if getattr(args, name) is not None]
    try:
        parameters = Parameters.from_settings(embed_files(short + args.settings))
    except ParameterError as error:
        return fail(str(error))
    from bow_sim.kernel.block import transient

    waveforms = transient(parameters)
    try:
        for write, path in ((save_npz, args.npz), (draw, args.plot), (save_wav, args.wav)):
            if path is not None:
                write(path, parameters, waveforms)
                print(f"wrote {path}")
    except (OSError, ValueError) as error:
        return fail(str(error))
    print(describe(parameters, waveforms))
    return DONE


# ---- bow verify, replay, recover


def _add_run_commands(commands: Any) -> None:
    verify = commands.add_parser(
        "verify",
        help="account for everything in a run's bag",
        description="Account for every cell, chunk, sample and checksum of a run's bag and derive its verdicts again; "
        "hold map.npz, report.json and ledger.jsonl against them. Prints JSON. "
        "Exit status 0 only if all of it holds; otherwise `problems` names run, file, block and chunk.",
    )
    verify.set_defaults(run=_verify)
    replay = commands.add_parser(
        "replay",
        help="judge a run's bag again",
        description="Stream a bag through the classifier again. With the same thresholds the verdicts must be the "
        "recorded ones, byte for byte; with others a new set is written beside them, verdicts-HASH.npz.",
    )
    replay.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=_REPLAY_HELP)
    replay.add_argument("--graph", action="store_true", help="through DDS, by a classifier node; slower, same verdicts")
    replay.set_defaults(run=_replay)
    recover = commands.add_parser(
        "recover",
        help="repair a bag whose writer was killed",
        description="Keep what is whole in a run's bag, set aside in files beside it (bag_aside/) what is not, and "
        "write its index anew; `bow sweep --resume` does this by itself. Prints JSON. "
        "Exit status 0 if nothing damaged is left.",
    )
    recover.add_argument("--dry-run", action="store_true", help="say what would be done, change nothing")
    recover.add_argument("--no-lock", action="store_true", help="where the file system has no locks")
    recover.set_defaults(run=_recover)
    for parser in (verify, replay, recover):
        parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")


_REPLAY_HELP = "a threshold, repeatable: correlation=0.9, slip=0.05, corner=0.35, preset=trial"


def _verify(args: argparse.Namespace) -> int:
    from bow_sweep.record.verify import verify

    result = verify(args.directory, progress=percentages("verify"))
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED


def _replay(args: argparse.Namespace) -> int:
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.record.replay import judge_here, replay

    judge = judge_here
    if args.graph:
        if not settled():
            return USAGE
        from bow_sweep.processes.replay_graph import judge_in_graph as judge
    try:
        result = replay(args.directory, settings=args.settings, progress=percentages("replay"), judge=judge)
    except (ParameterError, OSError, ValueError) as error:
        return fail(str(error))
    except GraphError as error:
        return fail(str(error), FAILED)
    except KeyboardInterrupt:
        return fail("interrupted; nothing was written", INTERRUPTED)
    print(json.dumps(result, indent=2))
    return DONE if result["ok"] else FAILED


def _recover(args: argparse.Namespace) -> int:
    from bow_sweep.record.recover import recover

    try:
        result = recover(args.directory, dry_run=args.dry_run, lock=not args.no_lock)
    except (OSError, ValueError) as error:
        return fail(str(error))
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
    print(
        f"block_cells\n    cells that one simulator runs together; unless set, {LEAST_BLOCK} ... {MOST_BLOCK}: a "
        f"{BLOCKS}th of the plane,\n    a {ADAPTIVE_BLOCKS}th of an adaptive sweep's"
    )
    print(
        f"adaptive = {Sweep.adaptive:g}\n    share of the cells to simulate at most; below 1 the others are predicted"
    )
    return DONE


def _describe_field(field: Any) -> str:
    meta = field.metadata
    right = ", ".join(meta["choices"]) if "choices" in meta else str(meta.get("range", ""))
    unit = f" [{meta['unit']}]" if meta["unit"] else ""
    return "; ".join(filter(None, (f"{meta['doc']}{unit}", right, meta.get("source", ""))))


def _node(args: argparse.Namespace) -> int:
    from bow_sweep.processes.supervisor import MODULES

    if not settled():
        return USAGE
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
    sweep.add_command(commands)
    _add_transient(commands)
    _add_run_commands(commands)
    paper.add_commands(commands)
    compare.add_command(commands)
    settings = "list every setting, its default, unit, range and source"
    commands.add_parser("settings", help=settings, description=settings).set_defaults(run=_settings)
    for name in NODES:
        node = commands.add_parser(name, help=f"run one {name} node, as `ros2 run bow {name}` does", add_help=False)
        node.add_argument("arguments", nargs=argparse.REMAINDER)
        node.set_defaults(run=_node)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    environment.open_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in NODES:  # argparse would take --help and --ros-args for its own
        return _node(argparse.Namespace(command=words[0], arguments=words[1:]))
    args = parser().parse_args(words)
    try:
        status: int = args.run(args)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return fail("interrupted", INTERRUPTED)
    except OSError as error:
        if error.filename is not None:
            return fail(str(error), FAILED)
        environment.silence("stdout")
        nobody_reads = isinstance(error, BrokenPipeError)  # as `bow settings | head` does
        return FAILED if nobody_reads else fail(f"standard output: {error.strerror}", FAILED)
    return status
