"""The command `bow optimise`: finds where a measure of playability is best."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sim.physics.errors import ParameterError
from bow_sweep.cli.study import add_options, problem_of, settings_of
from bow_sweep.cli.sweep_report import print_text
from bow_sweep.cli.terminal import environment_is_ready, fail, warn
from bow_sweep.plan.preset_files import choose
from bow_sweep.processes.exit_status import DONE, FAILED, USAGE
from bow_sweep.study.search import GOALS, HIGHEST, LOWEST, SEARCH_REPORT, TRIALS, Search
from bow_sweep.study.usual import ranges_of

if TYPE_CHECKING:
    from bow_sweep.cli.sweep_jobs import Job
    from bow_sweep.processes.new_directory import OwnedDirectory
    from bow_sweep.study.search import Optimiser, Trial

SMALL = ("x.count=32", "y.count=16")
"""Grid of the maps where none is given: the smallest, two to one, that has standard errors."""


def add_command(commands: Any) -> None:
    """Add the parser of `optimise`; its default `run` takes the parsed arguments."""
    goals = "\n".join(f"  {name:18} {goal}" for name, goal in GOALS.items())
    parser = commands.add_parser(
        "optimise",
        help="where is a measure of playability best?",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Look for the values of some parameters at which a measure of playability is best. Each trial is\n"
        "a small map, over one graph. The optimiser is Optuna's (pip install 'bow[optimise]'): the first third\n"
        "of the trials, ten at most, are at random places, the others where good ones are expected. The measure has a\n"
        "standard error, and the report names the trials of which it is not known that they are worse than the best.\n"
        "The directory has a run directory for each trial. It can be gone on with after any interruption, and then\n"
        "gives what it would have given without.\n\n"
        "  --over NAME=FIRST:LAST        a parameter and its range; :log or :linear after it sets the scale\n"
        "  --over NAME                   the range of its usual axis, see `bow settings`",
        epilog="examples:\n"
        "  bow optimise fig11d --over stiffness_b=1e-6:3e-4:log --over bridge_r=5:100:log --measure helmholtz\n"
        "  bow optimise fig11d --over mu_s=0.6:1.2 --measure median_transient --trials 15 --out runs/easy\n"
        "  bow optimise --resume runs/easy\n\n"
        f"measures, and what is looked for:\n{goals}\n\n"
        "exit status: 0 done, 1 failed, 2 wrong usage, 130 interrupted",
    )
    add_options(parser)
    parser.add_argument("--over", metavar="NAME[=RANGE]", action="append", default=[], help="a parameter; repeatable")
    parser.add_argument("--measure", metavar="NAME", help="what is to be best (default: helmholtz)")
    parser.add_argument("--goal", choices=(HIGHEST, LOWEST), help="look for this value of the measure instead")
    parser.add_argument("--trials", metavar="N", type=int, help=f"number of maps (default: {TRIALS})")
    parser.add_argument("--seed", metavar="N", type=int, help="another one gives other trials (default: 0)")
    parser.add_argument("--resume", metavar="DIR", type=Path, help="continue the search in this directory")
    parser.set_defaults(run=_optimise)


def _optimise(args: argparse.Namespace) -> int:
    own = [name for name in ("measure", "goal", "trials", "seed") if getattr(args, name) is not None]
    if args.resume and own:
        return fail(f"--resume takes everything from the directory; give no --{own[0]} with it")
    if problem := problem_of(args):
        return fail(problem)
    if not environment_is_ready():
        return USAGE
    from bow_sweep.run.directory import RunError
    from bow_sweep.study.search import NoOptuna, Optimiser

    try:
        if args.resume:
            search = Search.in_directory(args.resume.resolve())
        else:
            search, label = _asked(args)
        optimiser = Optimiser(search)
        owned = _opened(args.resume.resolve()) if args.resume else _created(search, label, args.out)
    except (ParameterError, RunError, NoOptuna, OSError) as error:
        return fail(str(error))
    return _run(args, search, optimiser, owned)


def _asked(args: argparse.Namespace) -> tuple[Search, str]:
    """Return the search that the options ask for, and the name of its preset."""
    chosen = choose(args.preset)
    if chosen.path:
        print(f"preset {chosen.label}: from {chosen.path}", flush=True)
    given = settings_of(chosen, args)
    settings = [line for line in SMALL if not any(each.startswith(line.partition("=")[0] + "=") for each in given)]
    measure = args.measure or "helmholtz"
    search = Search(
        chosen.preset,
        (*settings, *given),
        ranges_of(chosen.preset, (*settings, *given), args.over),
        measure,
        args.goal or GOALS.get(measure, HIGHEST),
        TRIALS if args.trials is None else args.trials,
        args.seed or 0,
    )
    search.check()
    return search, chosen.label


def _created(search: Search, label: str, out: Path | None) -> OwnedDirectory:
    from bow_sweep.processes.new_directory import create_directory

    owned = create_directory(out, label or "optimise")
    try:
        search.begin(owned.directory)
    except OSError:
        owned.release()
        raise
    return owned


def _opened(directory: Path) -> OwnedDirectory:
    from bow_sweep.processes.new_directory import open_directory

    return open_directory(directory)


def _run(args: argparse.Namespace, search: Search, optimiser: Optimiser, owned: OwnedDirectory) -> int:
    """Make the trials that are missing, and print what was found; return the exit status."""
    from bow_sweep.cli.map_runs import resume_command, run_maps
    from bow_sweep.run.directory import REPORT
    from bow_sweep.study.search_picture import PICTURE, draw_search

    directory = owned.directory
    made = sum(1 for _ in directory.glob(f"*/{REPORT}"))
    trials: list[Trial] = []
    cells = search.trial(0, {each.name: each.text(each.low) for each in search.ranges}).sweep.budget
    status = run_maps(
        owned,
        _jobs(search, optimiser, directory, trials),
        count=search.trials - made,
        cells=(search.trials - made) * cells,
        simulators=args.simulators,
        own_graph=args.own_graph,
        go_on=resume_command("optimise", directory),
        made=made,
    )
    if status != DONE:
        return status
    try:
        draw_search(search, trials, directory / PICTURE)
    except Exception as error:  # the trials are good without it
        warn(f"no picture of the search: {error}")
    try:
        _print(search, directory, trials)
    except OSError as error:
        return fail(f"{error.filename or directory}: cannot be written: {error.strerror}", FAILED)
    return DONE


def _jobs(search: Search, optimiser: Optimiser, directory: Path, trials: list[Trial]) -> Iterator[Job]:
    """Yield the runs that are missing, one after the other; append each trial that is finished."""
    from bow_sim.protocol.identity import random_id
    from bow_sweep.cli.sweep_jobs import Job, has_begun, unfinished
    from bow_sweep.run.directory import RunError
    from bow_sweep.study.report import measured, read_run
    from bow_sweep.study.search import Trial, write_report
    from bow_sweep.study.statistics import Measured

    for number in range(search.trials):
        values = optimiser.ask()
        try:
            member = search.trial(number, values)
        except ParameterError as error:
            warn(f"trial {number} cannot be computed, {error}")
            optimiser.tell(float("inf"))
            trials.append(Trial("", values, Measured(None, None, None)))
            continue
        run = directory / member.name
        first = member.name.partition("_")[0]
        if others := [path.name for path in directory.glob(f"{first}_*") if path != run]:
            why = f"{directory / others[0]}: trial {first} of this search would have other values now ({member.name})"
            raise RunError(f"{why}; is Optuna of another version? Begin a new search")
        if not has_begun(run):
            yield Job(run, random_id(), member.sweep)
        else:
            yield from unfinished(run, True, member.sweep)
        found = measured(read_run(run)["playability"], search.measure)
        trials.append(Trial(member.name, values, found))
        optimiser.tell(search.worst(member.sweep) if found.value is None else found.value)
        write_report(directory, search, trials)


def _print(search: Search, directory: Path, trials: list[Trial]) -> None:
    from bow_sweep.study.plan import short
    from bow_sweep.study.report import BY_NAME, aligned
    from bow_sweep.study.search import best, write_report
    from bow_sweep.study.search_picture import PICTURE

    content = write_report(directory, search, trials)
    measure = BY_NAME[search.measure]
    title = measure.title + (f", {measure.unit}" if measure.unit else "")
    top = best(search, trials)
    if top is None:
        print_text(f"no map has a value of {measure.title}; all are in {directory}/")
        return
    names = [each.name for each in search.ranges]
    rows = [["", *names, title]]
    order = sorted(
        (n for n, each in enumerate(trials) if each.found.value is not None), key=lambda n: _rank(search, trials[n])
    )
    for number in order[:10]:
        trial = trials[number]
        mark = "best" if number == top else "~" if trial.run in content["as_good"] else ""
        rows.append(
            [mark, *(short(trial.values[name]) for name in names), measure.text(trial.found.value, trial.found.error)]
        )
    lines = aligned(rows)
    if len(order) > 10:
        lines.append(f"  ... {len(order) - 10} more in {SEARCH_REPORT}")
    if trials[top].found.error is None:
        lines += ["", "the maps are too small for uncertainties: --nx 16 --ny 16 at least"]
    else:
        many = len(content["as_good"])
        lines += [
            "",
            f"~: not known to be worse than the best (Welch's t test on the four interleaved grids, 5%): {many}",
        ]
    lines += [
        "",
        f"{directory}/",
        f"  {PICTURE}   the course of the search",
        f"  {SEARCH_REPORT}  every trial",
        f"  {trials[top].run}: the run of the best; a run directory for each other trial",
    ]
    print_text("\n".join(lines))


def _rank(search: Search, trial: Trial) -> float:
    assert trial.found.value is not None
    return -trial.found.value if search.goal == HIGHEST else trial.found.value
