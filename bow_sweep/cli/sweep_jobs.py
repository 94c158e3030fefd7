"""The runs that a `bow sweep` command is to make: new ones, or those of a directory that are not finished."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from bow_sim.physics.errors import ParameterError
from bow_sim.protocol.identity import random_id
from bow_sweep.plan.preset_files import Chosen, save
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.new_directory import SUPERVISOR, OwnedDirectory, create_directory, open_directory
from bow_sweep.run.campaign import FILE, Campaign, campaigns
from bow_sweep.run.lock import take


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
        The run directory, or the directory of the campaign.
    campaign
        The campaign that the jobs belong to; None for a single run.
    jobs
        The runs, in order; empty where all are finished.
    """

    owned: OwnedDirectory
    campaign: Campaign | None
    jobs: list[Job]


def begin(chosen: Chosen, settings: Sequence[str], out: Path | None, lock: bool, save_as: Path | None) -> Work:
    """Create the directory of a new sweep or campaign; return the runs to make.

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
    campaign = Campaign.of(chosen.preset, settings) if chosen.preset in campaigns() else None
    if campaign and save_as:
        raise ParameterError(f"--save-preset {save_as}: {campaign.name} is several sweeps; a preset is one")
    sweeps = campaign.sweeps() if campaign else {"": Sweep.from_spec(chosen.preset, settings)}
    if save_as:
        save(save_as, sweeps[""], f"after {chosen.label}" if chosen.label else save_as.stem)
    owned = create_directory(out, chosen.label or sweeps[""].parameters.model, lock)
    try:
        if campaign:
            campaign.begin(owned.directory)
    except OSError:
        owned.release()
        raise
    jobs = [Job(owned.directory / name, random_id(), sweep) for name, sweep in sweeps.items()]
    return Work(owned, campaign, jobs)


def resume(directory: Path, lock: bool) -> Work:
    """Open the directory of a run or campaign; return the runs that are not finished. Repairs their ledgers and bags.

    Raises
    ------
    RunError, OSError
        Where it cannot be resumed.
    """
    owned = open_directory(directory, lock)
    try:
        if not (directory / FILE).exists():
            return Work(owned, None, unfinished(directory, lock))
        campaign = Campaign.in_directory(directory)
        jobs: list[Job] = []
        for preset, sweep in campaign.sweeps().items():
            run = directory / preset
            if not has_begun(run):
                jobs.append(Job(run, random_id(), sweep))
            else:
                jobs += unfinished(run, lock)
        return Work(owned, campaign, jobs)
    except BaseException:
        owned.release()
        raise


def unfinished(directory: Path, lock: bool) -> list[Job]:
    """Return the job to resume a run, or none where it is finished; print what was found in ledger and bag."""
    from bow_sweep.coordinator.resume import prepare

    run = prepare(directory, lambda line: print(f"resume: {line}", flush=True), lock)
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
