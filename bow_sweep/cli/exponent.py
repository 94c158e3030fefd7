"""The command `bow exponent`: whether an infinitesimal change of a motion grows."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from bow_sweep.cli.settings import SET_HELP
from bow_sweep.cli.terminal import fail
from bow_sweep.cli.transient import SHORT, field_help
from bow_sweep.processes.exit_status import DONE

if TYPE_CHECKING:
    from bow_sweep.edges.exponent import Exponent

_SHORT = tuple(name for name in SHORT if name != "periods")


def add_command(commands: Any) -> None:
    """Add the parser of `exponent`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "exponent",
        help="whether a small change of a motion grows or decays",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Simulate one bowed string, and beside it its linearised motion: how an infinitesimal change goes\n"
        "on. After --skip periods a small random force is added under the bow for one period. The norm is the r.m.s.\n"
        "of both outgoing transverse waves over a period; the exponent is the mean logarithm of its growth in a\n"
        "period, the first five left out. Below 0 a small change decays, above 0 it grows.\n\n"
        "When the string begins or ends to slip does not move under an infinitesimal change, so an exponent says\n"
        "nothing of such decisions; `bow edges` does. Only for friction=hyperbola and a rigid bow.",
        epilog="examples:\n"
        "  bow exponent --model stiff_cremer --v-mid 0.2 --f-asym 5.5\n"
        "  bow exponent --model raman --set bridge_gain=0.9 --set nut_gain=0.7 --json\n\n"
        "exit status: 0 done, 2 wrong usage",
    )
    for name in _SHORT:
        parser.add_argument(f"--{name.replace('_', '-')}", metavar=name.upper(), dest=name, help=field_help(name))
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument("--skip", metavar="N", type=int, default=200, help="periods before the kick (default 200)")
    parser.add_argument("--periods", metavar="N", type=int, default=400,
                        help="periods after it, at most (default 400)")  # fmt: skip
    parser.add_argument("--fall", metavar="E", type=float, default=23.0,
                        help="end earlier where the norm has fallen by e^E (default 23)")  # fmt: skip
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of the random force (default 0)")
    parser.add_argument("--json", action="store_true", help="print JSON, with the growth in each period")
    parser.set_defaults(run=_exponent)


def _exponent(args: argparse.Namespace) -> int:
    from bow_sim.physics.errors import ParameterError
    from bow_sim.physics.parameters import Parameters
    from bow_sim.physics.reflection_text import embed_files
    from bow_sweep.edges.exponent import exponent
    from bow_sweep.processes.progress import percentages

    short = [f"{name}={getattr(args, name)}" for name in _SHORT if getattr(args, name) is not None]
    try:
        if any(text.partition("=")[0].strip() == "periods" for text in args.settings):
            raise ParameterError("--set periods: give --skip N, the periods before the kick, and --periods N after it")
        parameters = Parameters.from_settings(embed_files(short + args.settings))
        found = exponent(parameters, args.skip, args.periods, args.seed, args.fall, percentages("simulating"))
    except (ParameterError, ValueError) as error:
        return fail(str(error))
    print(json.dumps(found.as_json(), indent=1) if args.json else describe(found))
    return DONE


def describe(found: Exponent) -> str:
    """Return an exponent in words."""
    p, (low, high), (first, second) = found.parameters, found.spread, found.halves
    return (
        f"{p.model}, v_mid = {p.v_mid:g}, f_asym = {p.f_asym:g}, {p.gesture} gesture\n"
        f"  exponent {found.value:+.4f} per period of {p.period} samples\n"
        f"  first half {first:+.4f}, second half {second:+.4f}; single periods {low:+.3f} ... {high:+.3f} "
        "(10th ... 90th percentile)\n"
        f"  {len(found.growth)} periods from period {found.skip + 6} on; {found.stopped}\n"
        f"  the string slips in {100 * found.sliding:.0f} % of the steps"
    )
