"""The ROS graph from a script or a notebook: sweeps recorded in run directories, one after the other."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from bow.maps import Map, open_run
from bow.sweeps import AxisGiven, planned, showing
from bow_sim.graph import environment
from bow_sweep.processes.new_directory import create_directory
from bow_sweep.processes.progress import Progress
from bow_sweep.processes.supervisor import GraphError
from bow_sweep.standing.client import connect, private_graph
from bow_sweep.standing.fits import objection
from bow_sweep.standing.state import default_folder, read_state

if TYPE_CHECKING:
    from bow_sweep.plan.sweep import Sweep
    from bow_sweep.standing.client import Graph as Client


class Graph:
    """A graph of ROS nodes that runs sweeps; to be used as a context, see :func:`graph`.

    Attributes
    ----------
    standing
        Whether it is that of `bow up`; otherwise it is one of its own, which ends with the context.
    """

    def __init__(self, simulators: int | None, own: bool, dashboard: bool) -> None:
        self._simulators, self._own, self._dashboard = simulators, own, dashboard
        self._stack = contextlib.ExitStack()
        self._client: Client | None = None
        self._turn = threading.Lock()  # a client is of one thread at a time
        self.standing = False

    def __enter__(self) -> Graph:
        try:
            if ignored := environment.clean():
                _say(ignored)
        except environment.EnvironmentProblem as error:
            raise GraphError(str(error)) from None
        state = None if self._own else read_state(default_folder())
        if state is not None:
            problem = objection(state, simulators=self._simulators, dashboard=self._dashboard, watched=False)
            if not problem:
                self.standing = True
                self._client = self._stack.enter_context(connect())
                return self
            _say(f"the graph of `bow up` is not used, {problem}")
        number = self._simulators or len(os.sched_getaffinity(0))
        root = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="bow-runs-")))
        made = private_graph(number, root, dashboard=self._dashboard, say=_say)
        self._client = self._stack.enter_context(made)
        return self

    def __exit__(self, *_: object) -> None:
        self._client = None
        self._stack.close()

    async def __aenter__(self) -> Graph:
        return await asyncio.to_thread(self.__enter__)

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.__exit__)

    def sweep(
        self,
        preset: str = "",
        *,
        out: str | Path | None = None,
        nx: int | None = None,
        ny: int | None = None,
        x: AxisGiven | None = None,
        y: AxisGiven | None = None,
        settings: Iterable[str] = (),
        progress: bool = True,
        **parameters: object,
    ) -> Map:
        """Run a sweep in the graph, recorded; return its map when the run is finished.

        Parameters
        ----------
        preset, nx, ny, x, y, settings, progress, **parameters
            As for :func:`bow.sweep`.
        out
            Run directory, new or empty; None for a new one in runs/.

        Returns
        -------
        Map
            Its `directory` is the run directory; cells come from the bag there.

        Raises
        ------
        ParameterError
            For a sweep that cannot be computed. It is a ValueError.
        RunError
            Where the directory cannot be used.
        GraphError
            Where the graph has ended or makes no progress; the run can be resumed with `bow sweep --resume`.
        KeyboardInterrupt
            After Ctrl-C; the run is cancelled, and can be resumed too.
        """
        plan = planned(preset, nx=nx, ny=ny, x=x, y=y, settings=settings, parameters=parameters)
        return self._run(plan, preset, out, progress, lambda: False)

    async def sweep_async(
        self,
        preset: str = "",
        *,
        out: str | Path | None = None,
        nx: int | None = None,
        ny: int | None = None,
        x: AxisGiven | None = None,
        y: AxisGiven | None = None,
        settings: Iterable[str] = (),
        progress: bool = False,
        **parameters: object,
    ) -> Map:
        """As :meth:`sweep`, to be awaited. Several at once run one after the other; a cancelled one is resumable."""
        plan = planned(preset, nx=nx, ny=ny, x=x, y=y, settings=settings, parameters=parameters)
        cancelled = threading.Event()

        def run() -> Map:
            try:
                return self._run(plan, preset, out, progress, cancelled.is_set)
            except KeyboardInterrupt:  # asyncio would end the whole loop with it
                raise GraphError("the sweep was cancelled; it can be resumed") from None

        running = asyncio.ensure_future(asyncio.to_thread(run))
        try:
            return await asyncio.shield(running)
        except asyncio.CancelledError:
            cancelled.set()
            with contextlib.suppress(Exception):
                await running
            raise

    def _run(
        self, plan: Sweep, label: str, out: str | Path | None, progress: bool, cancelled: Callable[[], bool]
    ) -> Map:
        if self._client is None:
            raise GraphError("the graph is not open: with bow.graph() as g: g.sweep(...)")
        while not self._turn.acquire(timeout=0.1):
            if cancelled():
                raise KeyboardInterrupt
        try:
            owned = create_directory(None if out is None else Path(out), label or plan.parameters.model)
            try:
                with showing(progress, plan.budget) as show:
                    report = partial(_report, show) if show is not None else _nothing
                    self._client.run(
                        plan, owned.directory, progress=report, dashboard=self._dashboard, cancelled=cancelled
                    )
            finally:
                owned.release()
        finally:
            self._turn.release()
        return open_run(owned.directory)


def graph(*, simulators: int | None = None, own: bool = False, dashboard: bool = False) -> Graph:
    """Return a graph for sweeps: that of `bow up` if it is there and fits, else one that ends with the context.

    Parameters
    ----------
    simulators
        Number of simulator processes; None: as many as the graph of `bow up` has, or one a core.
    own
        Start one even if `bow up` has.
    dashboard
        Whether each run has a recording for rerun, dashboard.rrd.

    Examples
    --------
    With a graph, runs are recorded, and a sweep can be awaited::

        with bow.graph() as g:
            m = g.sweep("fig11d", nx=32, ny=16, out="run")

        async with bow.graph() as g:
            m = await g.sweep_async("fig11d", nx=32, ny=16)
    """
    if simulators is not None and simulators < 1:
        raise ValueError(f"simulators = {simulators}: should be at least 1")
    return Graph(simulators, own, dashboard)


def _report(show: Callable[[float, float], None], progress: Progress | None, _waiting: str) -> None:
    if progress is not None and progress.planned:
        show(progress.done + progress.quarantined, progress.planned)


def _nothing(_progress: Progress | None, _waiting: str) -> None:
    pass


def _say(text: str) -> None:
    print(f"bow: {text}", file=sys.stderr)
