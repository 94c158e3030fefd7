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
        "it Helmholtz motion, multiple slip, raucous? The file is WAV, or a NumPy row of numbers (.npy). Unit, sign\n"
        "and offset of the sensor do not matter. When the string sticks and slips is computed from the force, so the\n"
        "bow position is needed. There is a verdict every five periods. docs/desk.md says how reliable they are.\n\n"
        "A microphone does not record the force at the bridge: its sound has passed through the body.",
        epilog="examples:\n"
        "  bow classify g-string.wav --f0 196 --beta 0.09\n"
        "  bow classify force.npy --rate 48000 --f0 440 --beta 0.1 --json > force.json\n\n"
        "exit status: 0 done, 2 wrong usage",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="recording: .wav or .npy")
    parser.add_argument("--f0", metavar="HZ", type=float, required=True, help="frequency of the string, within 3 %%")
    parser.add_argument(
        "--beta", metavar="B", type=float, help="distance of the bow from the bridge / length of string (default 0.1)"
    )
    parser.add_argument("--rate", metavar="HZ", type=float, help="sample rate of a .npy; a WAV file says its own")
    parser.add_argument("--channel", metavar="N", type=int, default=0, help="which of several, from 0 (default 0)")
    parser.add_argument("--json", action="store_true", help="print every test as JSON")
    parser.set_defaults(run=_classify)


def _classify(args: argparse.Namespace) -> int:
    from bow.recordings import BETA, RecordingError, classify, read_recording

    try:
        samples, rate = read_recording(args.file, args.channel)
        if rate is not None and args.rate is not None and args.rate != rate:
            raise RecordingError(f"--rate {args.rate:g}: {args.file} says {rate:g} Hz; leave --rate out")
        rate = rate or args.rate
        if rate is None:
            raise RecordingError(f"{args.file}: does not say its sample rate; give --rate HZ")
        found = classify(samples, rate, args.f0, beta=BETA if args.beta is None else args.beta)
    except RecordingError as error:
        return fail(str(error))
    if args.json:
        about = {"f0": found.f0, "f0_found": found.found, "beta": found.beta, "shares": found.shares}
        print(json.dumps({**about, "time": found.time.tolist(), "regime": found.regime.tolist()}, indent=2))
    else:
        print(found)
    return DONE
