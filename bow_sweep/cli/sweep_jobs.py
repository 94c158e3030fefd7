"""The runs that a `bow sweep` or `bow study` is to make: new ones, or those of a directory that are not finished."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.identity import random_id
from bow_sweep.plan.preset_files import Chosen, save
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.new_directory import SUPERVISOR, OwnedDirectory, create_directory, open_directory
from bow_sweep.run.directory import CAMPAIGN, SEARCH, STUDY, RunError
from bow_sweep.run.lock import take
from bow_sweep.study.campaigns import campaign, campaigns, study_in
from bow_sweep.study.plan import Study


@dataclass(frozen=True)
class Job:
    """One run that is to be begun, or resumed."""

    directory: Path
    run_id: str
    sweep: Sweep
    resume: bool = False


class Work(NamedTuple):
    """What a command is to do.

    Attributes
    ----------
    owned
        The run directory, or the directory of the study.
    study
        The study that the jobs belong to; None for a single run.
    jobs
        The runs, in order; empty where all are finished.
    """

    owned: OwnedDirectory
    study: Study | None
    jobs: list[Job]


def begin(chosen: Chosen, settings: Sequence[str], out: Path | None, lock: bool, save_as: Path | None) -> Work:
    """Create the directory of a new sweep, or of a campaign; return the runs to make.

    Parameters
    ----------
    chosen
        The preset of a sweep or a campaign, or a user's file.
    settings
        "name=value" over a preset of the package: those of the user's file, then those of the command line.
    out
        Directory that the user named; None for a default name.
    lock
        Lock the directory.
    save_as
        File to write the sweep to as a preset; None for none.

    Raises
    ------
    ParameterError
        For a wrong setting.
    RunError, OSError
        Where the directory cannot be created or used.
    """
    if chosen.preset in campaigns():
        if save_as:
            raise ParameterError(f"--save-preset {save_as}: {chosen.preset} is several sweeps; a preset is one")
        return begin_study(campaign(chosen.preset, settings), chosen.label, out, lock)
    sweep = Sweep.from_spec(chosen.preset, settings)
    if save_as:
        save(save_as, sweep, f"after {chosen.label}" if chosen.label else save_as.stem)
    owned = create_directory(out, chosen.label or sweep.parameters.model, lock)
    return Work(owned, None, [Job(owned.directory, random_id(), sweep)])


def begin_study(study: Study, label: str, out: Path | None, lock: bool) -> Work:
    """Create the directory of a new study; return the runs to make.

    Parameters
    ----------
    label
        First part of a default name of the directory.
    out, lock
        As for :func:`begin`.

    Raises
    ------
    ParameterError
        Where a map of it cannot be.
    RunError, OSError
        Where the directory cannot be created or used.
    """
    members = study.members
    owned = create_directory(out, label, lock)
    try:
        study.begin(owned.directory)
    except OSError:
        owned.release()
        raise
    return Work(owned, study, [Job(owned.directory / each.name, random_id(), each.sweep) for each in members])


def resume(directory: Path, lock: bool, lost: Sequence[str] = ()) -> Work:
    """Open the directory of a run or study; return the runs that are not finished. Repairs their ledgers and bags.

    Parameters
    ----------
    lost
        Stations of a run whose bags are lost: their blocks are computed again.

    Raises
    ------
    RunError, OSError
        Where it cannot be resumed.
    """
    if any((directory / name).exists() for name in (STUDY, CAMPAIGN)):
        if lost:
            raise RunError(f"--lost {lost[0]}: {directory} is a study; resume the run that has lost it first, in there")
        return resume_study(directory, lock)
    if (directory / SEARCH).exists():
        raise RunError(f"{directory}: is a search; go on with bow optimise --resume {shlex.quote(str(directory))}")
    owned = open_directory(directory, lock)
    try:
        return Work(owned, None, unfinished(directory, lock, lost=lost))
    except BaseException:
        owned.release()
        raise


def resume_study(directory: Path, lock: bool = True) -> Work:
    """Open the directory of a study; return the runs that are not finished. Repairs their ledgers and bags.

    Raises
    ------
    RunError, OSError
        Where there is no study, or a run of it cannot be resumed.
    """
    study = study_in(directory)
    owned = open_directory(directory, lock)
    try:
        jobs: list[Job] = []
        for member in study.members:
            run = directory / member.name
            if not has_begun(run):
                jobs.append(Job(run, random_id(), member.sweep))
            else:
                jobs += unfinished(run, lock, member.sweep)
        return Work(owned, study, jobs)
    except BaseException:
        owned.release()
        raise


def unfinished(directory: Path, lock: bool, wanted: Sweep | None = None, lost: Sequence[str] = ()) -> list[Job]:
    """Return the job to resume a run, or none where it is finished; print what was found in ledger and bag.

    Raises
    ------
    RunError
        Where it cannot be resumed, or is another sweep than the one `wanted`.
    """
    from bow_sweep.coordinator.resume import prepare

    run = prepare(directory, lambda line: print(f"resume: {line}", flush=True), lock, lost)
    if wanted is not None and run.sweep.settings() != wanted.settings():
        other = sorted({*run.sweep.settings()} ^ {*wanted.settings()})[0]
        raise RunError(f"{directory}: is a run of other settings than its study ({other}); move it away")
    return [] if run.complete else [Job(directory, run.run_id, run.sweep, resume=True)]


def has_begun(run: Path) -> bool:
    """Return whether a run was begun in a directory."""
    return run.is_dir() and (any(run.glob("ledger.jsonl*")) or any(run.glob("bag/*")))


def shared_directory(directory: Path) -> OwnedDirectory:
    """Create, or open, and lock a directory in which runs lie beside other files.

    Raises
    ------
    RunError, OSError
        Where it cannot be used, or another process is at work on it.
    """
    if not directory.exists():
        return create_directory(directory, "")
    return OwnedDirectory(directory, [], take(directory, SUPERVISOR), new=False)
