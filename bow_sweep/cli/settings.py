"""The command `bow settings`: lists every setting with its default, unit, range and source."""

from __future__ import annotations

import argparse
import json
import textwrap
from typing import Any

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics import body
from bow_sim.physics.instruments import PRESETS, SI
from bow_sim.physics.kinds import MODEL, THRESHOLD
from bow_sim.physics.parameters import Parameters
from bow_sim.physics.usual_axes import usual
from bow_sim.protocol.recording import DEFAULT, RECORD
from bow_sim.protocol.repeats import MAX_SEED, Repeats
from bow_sweep.plan.axes import of_threshold
from bow_sweep.plan.preset_files import schema
from bow_sweep.plan.sweep import ADAPTIVE_BLOCKS, BLOCKS, LEAST_BLOCK, MOST_BLOCK, X_AXIS, Y_AXIS, Sweep
from bow_sweep.processes.exit_status import DONE

SET_HELP = "any setting, repeatable; `bow settings` lists them; @FILE reads a reflection, modes or a friction curve"
"""Help of the option --set of other commands."""


def add_command(commands: Any) -> None:
    """Add the parser of `settings`; its default `run` takes the parsed arguments."""
    about = "list every setting, its default, unit, range and source"
    parser = commands.add_parser("settings", help=about, description=about)
    parser.add_argument(
        "--schema", action="store_true", help="print the JSON Schema of preset files instead, for an editor"
    )
    parser.set_defaults(run=_settings)


def _settings(args: argparse.Namespace) -> int:
    if args.schema:
        print(json.dumps(schema(), indent=1))
        return DONE
    for prefix, kind in (("", Parameters), ("classifier.", Thresholds)):
        for name, field in sorted(kind.__dataclass_fields__.items()):
            print(f"{prefix}{name} = {field.default}")
            text = _describe(field) + _other_ways(name) * (not prefix) + _as_axis(f"{prefix}{name}")
            print(textwrap.indent(text, "    "))
    for name, quantity in SI.items():
        needs = f"; needs {' and '.join(quantity.needs)}" if quantity.needs else ""
        unit = f" [{quantity.unit}]" if quantity.unit else ""
        sets = _FORMULAS.get(name, f"sets {quantity.same}")
        text = f"{quantity.doc}{unit}; {sets}{needs}; PHYSICS.md 10{_as_axis(name)}"
        print(name, textwrap.indent(text, "    "), sep="\n")
    for what, (unit, meaning) in body.KINDS.items():
        print(f"body_1_{what}, body_2_{what}, ...")
        own = f" [{unit}]" if unit else ""
        text = f"of one mode of the body: {meaning}{own}; > 0; PHYSICS.md 11{_as_axis(f'body_1_{what}')}"
        print(textwrap.indent(text, "    "))
    for name, presets in PRESETS.items():
        print(f"{name}\n    sets what follows; {_SOURCES.get(name, 'PHYSICS.md 10')}")
        for preset, values in presets.items():
            print(f"    {preset}: {', '.join(f'{key} {value:g}' for key, value in values.items())}")
    for axis, defaults in (("x", X_AXIS), ("y", Y_AXIS)):
        for name, value in defaults.settings().items():
            print(f"{axis}.{name} = {value}")
    print(
        "x.values\ny.values\n"
        "    the axes of the map: a parameter's name, log or linear, first and last value, how many; or all\n"
        "    values, as x.values=[0.1,0.2,0.5]. x=NAME is short for x.name=NAME. Scale, first and last value\n"
        "    that are not given are those after 'axis' at that setting"
    )
    print(
        f"block_cells\n    cells that one simulator runs together; unless set, {LEAST_BLOCK} ... {MOST_BLOCK}: a "
        f"{BLOCKS}th of the plane,\n    a {ADAPTIVE_BLOCKS}th of an adaptive sweep's"
    )
    print(
        f"adaptive = {Sweep.adaptive:g}\n    share of the cells to simulate at most; below 1 the others are predicted"
    )
    print(
        f"repeats = {Repeats.count}\n    further simulations of each cell with slightly other forces, for example 8:\n"
        "    how sure is the map\n"
        f"jitter = {Repeats.jitter:g}\n    largest relative deviation of f_asym and of f_init in a repeat; 0 ... 1\n"
        f"seed = {Repeats.seed}\n    another one gives other deviations; 0 ... {MAX_SEED} (PHYSICS.md section 15)"
    )
    print(f"record = {DEFAULT}\n    what the bag holds beside the verdicts, which are always recorded")
    for name, meaning in RECORD.items():
        print(f"    {name}: {meaning}")
    return DONE


_FORMULAS = {
    "f_0": "sample_rate = period f_0",
    "speed": "v_b = speed/v_unit",
    "force": "f_asym = force/(y_t z_0 v_unit)",
    "bow_acceleration": "acceleration = bow_acceleration/(f_0 v_unit)",
    "v_0": "v_mid = v_b - v_0/v_unit",
    "beta": "bow_bridge + bow_offset = beta period",
}
"""How a value in SI units gives that of the paper's setting."""

_SOURCES = {"bridge": "PHYSICS.md 3 and 10", "hair": "PHYSICS.md 12", "rosin": "PHYSICS.md 13"}


def _as_axis(name: str) -> str:
    """Return the usual axis of a setting on a line of its own; "" where it cannot be an axis."""
    if name == MODEL:
        return "\naxis: all models, or those of x.values=[raman,stiff_cremer]"
    if name.startswith(THRESHOLD):
        return "\naxis: {0.scale} {0.first:g} ... {0.last:g}".format(of_threshold(name.removeprefix(THRESHOLD)))
    if (found := usual(name)) is not None:
        return f"\naxis: {found}"
    return f"\naxis: that of {SI[name].same}, in SI units" if name in SI else ""


def _other_ways(name: str) -> str:
    """Return the settings in SI units that give the same, with their units."""
    others = [f"{other} [{q.unit}]" if q.unit else other for other, q in SI.items() if q.same == name]
    return f"; also: {', '.join(others)}" if others else ""


def _describe(field: Any) -> str:
    meta = field.metadata
    allowed = ", ".join(meta["choices"]) if "choices" in meta else str(meta.get("range", ""))
    unit = f" [{meta['unit']}]" if meta["unit"] else ""
    return "; ".join(filter(None, (f"{meta['doc']}{unit}", allowed, meta.get("source", ""))))
