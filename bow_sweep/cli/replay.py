"""The command `bow replay`: classifies a run's bag again."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from bow_sim.physics.errors import ParameterError
from bow_sweep.cli.terminal import environment_is_ready, fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED, INTERRUPTED, USAGE
from bow_sweep.processes.progress import percentages

_SET_HELP = "a threshold, repeatable: correlation=0.9, slip=0.05, corner=0.35, preset=trial"


def add_command(commands: Any) -> None:
    """Add the parser of `replay`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "replay",
        help="classify a run's bag again",
        description="Stream a bag through the classifier again. With the same thresholds the verdicts must be the "
        "recorded ones, byte for byte; with others a new set is written beside them, verdicts-HASH.npz.",
    )
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=_SET_HELP)
    parser.add_argument("--graph", action="store_true", help="through DDS, by a classifier node; slower, same verdicts")
    parser.add_argument("directory", metavar="RUN", type=Path, help="run directory")
    parser.set_defaults(run=_replay)


def _replay(args: argparse.Namespace) -> int:
    from bow_sweep.processes.supervisor import GraphError
    from bow_sweep.record.replay import classify_here, replay
    from bow_sweep.record.run_bags import unseen_in_words

    classify = classify_here
    if args.graph:
        if not environment_is_ready():
            return USAGE
        from bow_sweep.processes.replay_graph import classify_in_graph as classify
    try:
        result = replay(args.directory, settings=args.settings, progress=percentages("replay"), classify=classify)
    except (ParameterError, OSError, ValueError) as error:
        return fail(str(error))
    except GraphError as error:
        return fail(str(error), FAILED)
    except KeyboardInterrupt:
        return fail("interrupted; nothing was written", INTERRUPTED)
    print(json.dumps(result, indent=2))
    for line in unseen_in_words(result["unseen"]):
        warn(line)
    return DONE if result["ok"] else FAILED
