"""The command `bow transient`: simulates one string, without a graph."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from bow_sim.physics.applicability import notes
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.reflection import ends
from bow_sim.physics.reflection_text import embed_files
from bow_sweep.cli.inspect import BODY_HELP, SOUND_HELP, check_sound
from bow_sweep.cli.settings import SET_HELP
from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE

SHORT = ("model", "v_mid", "f_asym", "f_init_ratio", "periods")
"""Settings with an option of their own."""


def add_command(commands: Any) -> None:
    """Add the parser of `transient`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "transient",
        help="simulate one cell, without a graph",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Simulate one bowed string; write its waveforms as arrays, a picture or sound.",
        epilog="example: bow transient --model delta_cremer --v-mid 0.7 --f-asym 5.5 --f-init-ratio 1 --plot t.png\n\n"
        "--npz holds float64 arrays over samples: bridge_force, v, v_h, v_centre, friction_force, and bool slipping\n"
        "(state after the step); with modes of a body bridge_velocity and bridge_force_real (over Z_0), with thermal\n"
        "friction temperature (K).",
    )
    for name in SHORT:
        parser.add_argument(f"--{name.replace('_', '-')}", metavar=name.upper(), dest=name, help=field_help(name))
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument("--npz", metavar="F", type=Path, help="write the waveforms as a NumPy archive")
    parser.add_argument("--plot", metavar="F", type=Path, help="draw them (.png, .svg or .pdf)")
    parser.add_argument("--wav", metavar="F", type=Path, help="write the bridge force as sound, 48 kHz, 16 bit")
    parser.add_argument("--seconds", metavar="S", type=float, help=SOUND_HELP)
    parser.add_argument("--body", action="store_true", help=BODY_HELP)
    parser.set_defaults(run=_transient)


def field_help(name: str) -> str:
    """Return the help of an option that stands for a setting."""
    field = Parameters.__dataclass_fields__[name]
    unit = f", in {field.metadata['unit']}" if field.metadata["unit"] else ""
    return f"{field.metadata['doc']}{unit} (default {field.default})".replace("%", "%%")


def _transient(args: argparse.Namespace) -> int:
    from bow_sim.figures.transient import check_plot, describe, draw, save_npz
    from bow_sweep.cell.sound import save_wav, sound_of

    short = [f"{name}={getattr(args, name)}" for name in SHORT if getattr(args, name) is not None]
    try:
        parameters = Parameters.from_settings(embed_files(short + args.settings))
        ends(parameters)  # a round trip may be too short for a reflection function
        check_sound(args)
        if args.plot is not None:
            check_plot(args.plot)
    except (ParameterError, ValueError) as error:
        return fail(str(error))
    for note in notes(parameters):
        warn(f"note: {note}")
    from bow_sim.kernel.block import transient

    waveforms = transient(parameters)
    try:
        for write, path in ((save_npz, args.npz), (draw, args.plot)):
            if path is not None:
                write(path, parameters, waveforms)
                print(f"wrote {path}")
        if args.wav is not None:
            made = sound_of(waveforms["bridge_force"], parameters, args.seconds, args.body)
            save_wav(args.wav, made.samples)
            print(f"wrote {args.wav}: {made.describe()}")
    except (OSError, ValueError) as error:
        return fail(str(error))
    print(describe(parameters, waveforms))
    return DONE
