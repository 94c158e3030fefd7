"""Several maps run one after the other over one graph: for `bow study` and `bow optimise`."""

from __future__ import annotations

import contextlib
import shlex
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from bow_sweep.cli.sweep import bounded, cores
from bow_sweep.cli.sweep_report import RunCheck
from bow_sweep.cli.terminal import fail
from bow_sweep.processes.exit_status import DONE, FAILED, INTERRUPTED
from bow_sweep.run.directory import RunError

if TYPE_CHECKING:
    from bow_sweep.cli.sweep_jobs import Job
    from bow_sweep.processes.new_directory import OwnedDirectory
    from bow_sweep.processes.progress import Display, Progress
    from bow_sweep.standing.client import Graph


@contextlib.contextmanager
def graph_for(simulators: int | None, own: bool, root: Path, display: Display) -> Iterator[Graph]:
    """Yield the graph of `bow up` where it is there and fits, else one that ends with this context.

    Parameters
    ----------
    simulators
        Number of simulator processes that the user asks for; None for any.
    own
        Never use the graph of `bow up`.
    root
        Directory of the runs.

    Raises
    ------
    GraphError
        Where it cannot be started or reached.
    """
    from bow_sweep.standing.client import connect, private_graph
    from bow_sweep.standing.fits import objection, since
    from bow_sweep.standing.state import default_folder, read_state

    state = None if own else read_state(default_folder())
    problem = objection(state, simulators=simulators, dashboard=False, watched=False) if state else ""
    if state and not problem:
        display.print_line(f"uses the graph of `bow up`, there since {since(state)}; --own-graph does without it")
        with connect() as graph:
            yield graph
        return
    if problem:
        display.print_line(f"the graph of `bow up` is not used, {problem}")
    number = bounded(simulators or cores(), cores())
    with private_graph(number, root, say=display.print_line) as graph:
        yield graph


def run_maps(
    owned: OwnedDirectory,
    jobs: Iterable[Job],
    *,
    count: int,
    cells: int,
    simulators: int | None,
    own_graph: bool,
    go_on: str,
    made: int = 0,
) -> int:
    """Run maps, with one display, and release their directory; return the exit status.

    What goes wrong is printed, with the command that goes on.

    Parameters
    ----------
    owned
        Directory of all of them.
    jobs
        Asked for one after the other: the next may depend on what the one before has found.
    count, cells
        Number of jobs, and of all their cells.
    simulators, own_graph
        As for :func:`graph_for`.
    go_on
        Command with which the user goes on after an interruption.
    made
        Maps that are there already.
    """
    from bow_sweep.processes.progress import Display
    from bow_sweep.processes.supervisor import GraphError

    display = Display()

    def show(progress: Progress | None, waiting: str) -> None:
        display.show(progress, waiting, time.monotonic())

    before = 0
    again = f"go on with: {go_on}"
    owned.new = False  # what was asked is in it: it stays, and can be gone on with
    try:
        with contextlib.ExitStack() as stack:
            graph: Graph | None = None
            for number, job in enumerate(jobs, 1):
                graph = graph or stack.enter_context(graph_for(simulators, own_graph, owned.directory, display))
                which = f"map {made + number} of {made + count}"
                p, x, y = job.sweep.parameters, job.sweep.x, job.sweep.y
                display.begin(which, before, cells)
                display.print_line(
                    f"{which}, {job.directory.name}: {p.model}, {x.count} x {y.count} cells, {p.periods} periods"
                )
                for note in job.sweep.notes if number == 1 else ():
                    display.print_line(f"note: {note}")
                graph.run(job.sweep, job.directory, job.run_id, progress=show, resume=job.resume)
                if problem := RunCheck(job.directory, display.print_line, whole=job.resume).end():
                    raise RunError(problem)
                before += job.sweep.budget
    except KeyboardInterrupt:
        why, status = f"interrupted; nothing is lost, {again}", INTERRUPTED
    except (GraphError, RunError, OSError) as error:
        why, status = f"{error}\n{again}", FAILED
    else:
        why, status = "", DONE
    display.stop()
    owned.release()
    return fail(why, status) if why else status


def resume_command(command: str, directory: Path) -> str:
    """Return the command that goes on with what is in a directory."""
    return f"bow {command} --resume {shlex.quote(str(directory))}"
