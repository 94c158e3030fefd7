"""The command `bow classify`: the regimes of a recorded bridge force."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE


def add_command(commands: Any) -> None:
    """Add the parser of `classify`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "classify",
        help="judge a recorded bridge force: the regimes of a map",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Judge the force at the bridge of a real string, recorded by a sensor in or under it: is\n"
        "it Helmholtz motion, multiple slip, raucous? The file is WAV, a NumPy row of numbers (.npy), or an MCAP\n"
        "bag: a topic of blocks of samples (Float32MultiArray or the like), or bridge_force of a run. Unit, sign and\n"
        "offset of the sensor do not matter. When the string sticks and slips is computed from the force, so the bow\n"
        "position is needed. There is a verdict every five periods. docs/desk.md says how reliable they are.\n\n"
        "A microphone does not record the force at the bridge: its sound has passed through the body.",
        epilog="examples:\n"
        "  bow classify g-string.wav --f0 196 --beta 0.09\n"
        "  bow classify take_0.mcap --topic /bridge_force --rate 48000 --f0 196\n"
        "  bow classify runs/fig11d/bag/bag_0.mcap --topic bridge_force --cell 4200\n"
        "  bow classify force.npy --rate 48000 --f0 440 --beta 0.1 --json > force.json\n\n"
        "exit status: 0 done, 2 wrong usage",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="recording: .wav, .npy or .mcap")
    parser.add_argument(
        "--f0", metavar="HZ", type=float, help="frequency of the string, within 3 %%; a run says its own"
    )
    parser.add_argument(
        "--beta", metavar="B", type=float, help="distance of the bow from the bridge / length of string (default 0.1)"
    )
    parser.add_argument("--rate", metavar="HZ", type=float, help="sample rate; WAV files and runs say their own")
    parser.add_argument("--channel", metavar="N", type=int, default=0, help="which of several, from 0 (default 0)")
    parser.add_argument("--topic", metavar="NAME", help="topic of an .mcap, if it has several that can be judged")
    parser.add_argument("--cell", metavar="N", type=int, default=0, help="of a run: index of the cell (default 0)")
    parser.add_argument("--json", action="store_true", help="print every test as JSON")
    parser.set_defaults(run=_classify)


def _classify(args: argparse.Namespace) -> int:
    from bow.recordings import RecordingError, classify

    about = {"beta": args.beta, "topic": args.topic, "channel": args.channel, "cell": args.cell}
    try:
        found = classify(args.file, args.rate, args.f0, **about)
    except RecordingError as error:
        return fail(str(error))
    if args.json:
        said = {"f0": found.f0, "f0_found": found.found, "beta": found.beta, "shares": found.shares}
        said["notes"] = list(found.notes)
        print(json.dumps({**said, "time": found.time.tolist(), "regime": found.regime.tolist()}, indent=2))
    else:
        print(found)
    return DONE
