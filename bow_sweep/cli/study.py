"""The command `bow study`: a family of maps over further parameters, with one report."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sim.physics.errors import ParameterError
from bow_sim.physics.parameters import parse_settings
from bow_sim.physics.reflection_text import embed_files
from bow_sweep.cli.settings import SET_HELP
from bow_sweep.cli.terminal import environment_is_ready, fail, warn
from bow_sweep.maps.playability import MEASURES
from bow_sweep.plan.preset_files import Chosen, choose
from bow_sweep.processes.exit_status import DONE, FAILED, QUARANTINED, USAGE
from bow_sweep.study.campaigns import campaign, campaigns
from bow_sweep.study.plan import Study
from bow_sweep.study.usual import COUNT, overs_of

if TYPE_CHECKING:
    from bow_sweep.cli.sweep_jobs import Work

SHORT = {"nx": "x.count", "ny": "y.count", "periods": "periods", "record": "record"}
"""Option -> the setting that it gives."""

RECORD = "record=verdicts"
"""Unless it is set: waveforms of many maps are computed again when they are asked for."""


def add_command(commands: Any) -> None:
    """Add the parser of `study`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "study",
        help="a family of maps over further parameters: how does playability change?",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Run a map for each value of a further parameter, or for each combination of several, over one\n"
        "graph, and report how playability changes: a table with standard errors, in which significant differences\n"
        "are marked, a picture, and all maps as one dataset. The directory has a run directory for each map. It can\n"
        "be gone on with after any interruption: finished maps are checked and kept.\n\n"
        "  --over NAME=FIRST:LAST:COUNT   COUNT values; :log or :linear sets the scale\n"
        "  --over NAME=VALUE,VALUE,...    these values, texts too: model=raman,delta_cremer, preset=fig11c,fig11d\n"
        f"  --over NAME                    {COUNT} values along its usual axis, see `bow settings`\n\n"
        "Each measure has four independent values, from the four interleaved grids of a map. Two maps are compared by\n"
        "Welch's t test on these, with Holm's correction for there being many maps. It needs 16 x 16 cells a map.",
        epilog="examples:\n"
        "  bow study fig11d --over stiffness_b=1e-6:3e-4:12:log --nx 64 --ny 32\n"
        "  bow study fig11d --over bridge_r --nx 32 --ny 16\n"
        "  bow study fig11d --over stiffness_b=1e-6:3e-4:6:log --over v_mid=-2,0.2,0.9 --out runs/stiffness\n"
        "  bow study --over preset=fig11c,fig11d --set mu_s=1 --nx 32 --ny 16\n"
        "  bow study --resume runs/stiffness\n\n"
        f"measures: {', '.join(measure.name for measure in MEASURES)}\n\n"
        "exit status: 0 done, 1 failed, 2 wrong usage, 3 done but for quarantined blocks, 130 interrupted",
    )
    add_options(parser)
    parser.add_argument(
        "--over", metavar="NAME[=VALUES]", action="append", default=[], help="a further parameter; repeatable"
    )
    parser.add_argument(
        "--measure",
        metavar="NAME",
        action="append",
        default=[],
        help="a measure of the printed table; repeatable; study.json has all",
    )
    parser.add_argument("--resume", metavar="DIR", type=Path, help="continue the study in this directory")
    parser.set_defaults(run=_study)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what `bow study` and `bow optimise` have in common."""
    parser.add_argument("preset", nargs="?", default="", help="named sweep, or a .yaml file, as of `bow sweep`")
    parser.add_argument("--nx", metavar="N", help="cells along x of each map")
    parser.add_argument("--ny", metavar="N", help="cells along y")
    parser.add_argument("--periods", metavar="N", help="length of each simulation, a multiple of 5")
    parser.add_argument(
        "--record",
        metavar="WHAT",
        help="what the bags hold beside the verdicts: verdicts (nothing, the default), last or all, as of `bow sweep`",
    )
    parser.add_argument("--set", metavar="NAME=VALUE", action="append", default=[], dest="settings", help=SET_HELP)
    parser.add_argument("--simulators", metavar="N", type=int, help="processes (default: one a core)")
    parser.add_argument(
        "--own-graph", action="store_true", help="start a graph for this command, even if `bow up` has started one"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="directory (default: runs/PRESET-DATE)")


def settings_of(chosen: Chosen, args: argparse.Namespace) -> list[str]:
    """Return the settings of a user's file and of the options, for all maps."""
    short = [f"{key}={getattr(args, name)}" for name, key in SHORT.items() if getattr(args, name) is not None]
    given = list(embed_files([*chosen.settings, *short, *args.settings]))
    return given if "record" in parse_settings(given) else [RECORD, *given]


def problem_of(args: argparse.Namespace) -> str:
    """Return what is wrong with the options that both commands have; "" for nothing."""
    if args.simulators is not None and args.simulators < 1:
        return f"--simulators {args.simulators}: should be at least 1"
    short = [name for name in SHORT if getattr(args, name) is not None]
    if args.resume and (args.preset or short or args.settings or args.out or args.over):
        return "--resume takes everything from the directory; give no preset, setting, --over or --out with it"
    return ""


def _study(args: argparse.Namespace) -> int:
    if problem := problem_of(args):
        return fail(problem)
    known = [measure.name for measure in MEASURES]
    for name in args.measure:
        if name not in known:
            return fail(f"--measure {name}: no such measure; one of {', '.join(known)}")
    if not environment_is_ready():
        return USAGE
    from bow_sweep.run.directory import RunError

    try:
        work = _work(args)
    except (ParameterError, RunError, OSError) as error:
        return fail(str(error))
    return run_study(work, args)


def _work(args: argparse.Namespace) -> Work:
    """Return the runs to make."""
    from bow_sweep.cli.sweep_jobs import begin_study, resume_study

    if args.resume:
        return resume_study(args.resume.resolve())
    chosen = choose(args.preset, campaigns())
    if chosen.path:
        print(f"preset {chosen.label}: from {chosen.path}", flush=True)
    settings = settings_of(chosen, args)
    if chosen.preset in campaigns():
        if args.over:
            right = "a study over presets is: --over preset=A,B"
            raise ParameterError(f"{chosen.preset} is several presets; give no --over with it; {right}")
        study = campaign(chosen.preset, settings)
    else:
        study = Study(chosen.preset, tuple(settings), overs_of(chosen.preset, settings, args.over))
    return begin_study(study, chosen.label or "study", args.out, lock=True)


def run_study(work: Work, args: argparse.Namespace) -> int:
    """Make the maps of a study that are missing, and print its report; return the exit status."""
    from bow_sweep.cli.map_runs import resume_command, run_maps
    from bow_sweep.cli.study_report import print_study
    from bow_sweep.run.directory import RunError

    assert work.study is not None
    kept = len(work.study.members) - len(work.jobs)
    if kept:
        warn(f"{kept} of {len(work.study.members)} maps are finished, and were checked")
    status = run_maps(
        work.owned,
        work.jobs,
        count=len(work.jobs),
        cells=sum(job.sweep.budget for job in work.jobs),
        simulators=args.simulators,
        own_graph=args.own_graph,
        go_on=resume_command("study", work.owned.directory),
        made=kept,
    )
    if status != DONE:
        return status
    try:
        return QUARANTINED if print_study(work.study, work.owned.directory, [], args.measure) else DONE
    except (RunError, OSError) as error:
        return fail(str(error), FAILED)
