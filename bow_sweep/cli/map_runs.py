"""Several maps run one after the other, over one graph where there is one: for `bow study` and `bow optimise`."""

from __future__ import annotations

import contextlib
import shlex
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from bow_sweep.cli.sweep_report import self_check
from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE, FAILED, INTERRUPTED
from bow_sweep.run.directory import RunError

if TYPE_CHECKING:
    from bow_sweep.cli.sweep_jobs import Job
    from bow_sweep.processes.new_directory import OwnedDirectory
    from bow_sweep.processes.progress import Display


class Graph(Protocol):
    """What runs a map: a graph that stays for all of them, or one for each."""

    def run(self, job: Job, display: Display) -> list[Path]:
        """Run a map until its directory is finished; return the logs of processes that it went on without.

        Raises
        ------
        GraphError
            Where the graph cannot go on; the run can be resumed when the cause is removed.
        KeyboardInterrupt
            After Ctrl-C or SIGTERM.
        """


class GraphEach:
    """A graph for each map: its processes start and end with it.

    Parameters
    ----------
    simulators
        Number of simulator processes.
    """

    def __init__(self, simulators: int) -> None:
        self.simulators = simulators

    def run(self, job: Job, display: Display) -> list[Path]:
        """Run a map, see :class:`Graph`."""
        from bow_sweep.processes.run_graph import run_graph

        job.directory.mkdir(exist_ok=True)
        return run_graph(
            job.directory,
            job.run_id,
            job.sweep,
            resume=job.resume,
            simulators=self.simulators,
            dashboard=False,
            display=display,
        )


@contextlib.contextmanager
def graph_of(simulators: int, root: Path) -> Iterator[Graph]:
    """Yield a graph that runs maps in directories below `root`."""
    yield GraphEach(simulators)


def run_maps(
    owned: OwnedDirectory, jobs: Iterable[Job], *, count: int, cells: int, simulators: int, go_on: str, made: int = 0
) -> tuple[int, list[Path]]:
    """Run maps, with one display, and release their directory.

    Parameters
    ----------
    owned
        Directory of all of them.
    jobs
        Asked for one after the other: the next may depend on what the one before has found.
    count, cells
        Number of jobs, and of all their cells.
    simulators
        Number of simulator processes.
    go_on
        Command with which the user goes on after an interruption.
    made
        Maps that are there already.

    Returns
    -------
    int
        Exit status; what is wrong is printed.
    list
        Logs of processes that a run went on without.
    """
    from bow_sweep.processes.progress import Display
    from bow_sweep.processes.supervisor import GraphError

    display = Display()
    left_out: list[Path] = []
    before = 0
    again = f"go on with: {go_on}"
    try:
        with graph_of(simulators, owned.directory) as graph:
            for number, job in enumerate(jobs, 1):
                display.begin(f"map {made + number} of {made + count}", before, cells)
                p, x, y = job.sweep.parameters, job.sweep.x, job.sweep.y
                display.print_line(
                    f"map {made + number} of {made + count}, {job.directory.name}: {p.model}, {x.count} x {y.count} "
                    f"cells, {p.periods} periods"
                )
                if number == 1:
                    for note in job.sweep.notes:
                        display.print_line(f"note: {note}")
                left_out += graph.run(job, display)
                if problem := self_check(job.directory, display.print_line, whole=job.resume):
                    raise RunError(problem)
                before += job.sweep.budget
    except KeyboardInterrupt:
        return _stopped(owned, display, f"interrupted; nothing is lost, {again}", INTERRUPTED), left_out
    except (GraphError, RunError, OSError) as error:
        return _stopped(owned, display, f"{error}\n{again}", FAILED), left_out
    display.stop()
    _release(owned)
    return DONE, left_out


def _stopped(owned: OwnedDirectory, display: Display, why: str, status: int) -> int:
    display.stop()
    _release(owned)
    return fail(why, status)


def _release(owned: OwnedDirectory) -> None:
    """Release the lock, and keep the directory: what was asked is in it, and can be gone on with."""
    owned.new = False
    owned.release()


def resume_command(command: str, directory: Path) -> str:
    """Return the command that goes on with what is in a directory."""
    return f"bow {command} --resume {shlex.quote(str(directory))}"
