"""A cell that somebody chooses while a sweep runs: which one it is, and its waveform, computed at once. No ROS.

The bits of a cell do not depend on the cells that it is computed with, so a cell computed alone has the samples that it
has in its block, and in the bag.
"""

from __future__ import annotations

import contextlib
import math
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from bow_sim.block_request import BlockRequest
from bow_sim.chunk_messages import ChunkMessages
from bow_sim.kernel.block import Block
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import common, number_of, value_text
from bow_sim.physics.parameters import parse_settings
from bow_sweep.cell.parameters import place
from bow_sweep.cell.waveform import CellError
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import Run

FRAME = "basin_map"
"""Frame of points on the map. One unit is one cell, x to the right and y up: cell (ix, iy) is the square from ix to
ix + 1 and iy to iy + 1, so its index is floor(y) * nx + floor(x)."""

MOST_WAITING = 16
"""Chosen cells that may wait for their turn; one takes some milliseconds for 100 periods."""

NO_SWEEP = "no sweep is open; a cell of a finished run is shown by: bow inspect RUN --at NAME=VALUE,NAME=VALUE"


class ChoiceError(ValueError):
    """A cell that cannot be inspected; says what is wrong and what would be right."""


def cell_at(sweep: Sweep, x: float, y: float, frame: str) -> int:
    """Return the cell at a point of the map, as a click in RViz or Foxglove gives it.

    Parameters
    ----------
    x, y
        The point, in cells, see `FRAME`.
    frame
        Frame of the point; "" counts as `FRAME`.

    Raises
    ------
    ChoiceError
        For a point in another frame, or beside the map.
    """
    if frame not in ("", FRAME):
        raise ChoiceError(f"a point in frame {frame!r}: should be in {FRAME!r}, in which one unit is one cell")
    nx, ny = sweep.x.count, sweep.y.count
    if not (0 <= x <= nx and 0 <= y <= ny):  # NaN too
        raise ChoiceError(f"the point ({x:g}, {y:g}) is beside the map, which reaches from (0, 0) to ({nx}, {ny})")
    return min(math.floor(y), ny - 1) * nx + min(math.floor(x), nx - 1)


def cell_of(sweep: Sweep, at: Sequence[str], cell: int) -> int:
    """Return the cell that a request names.

    Parameters
    ----------
    at
        "name=value" of the parameters of the two axes; the nearest cell is taken. Empty: `cell` counts.
    cell
        Index of a cell.

    Raises
    ------
    ChoiceError
        For a cell that does not exist, a name that is no axis, a missing axis, or a value beyond the map.
    """
    if not at:
        if not 0 <= cell < sweep.plane_cells:
            raise ChoiceError(f"cell {cell}: this map has cells 0 ... {sweep.plane_cells - 1}")
        return cell
    try:
        given = parse_settings(at)
    except ParameterError as error:
        raise ChoiceError(str(error)) from None
    axes = {axis.name: axis for axis in (sweep.x, sweep.y)}
    for name in given:
        if name not in axes:
            raise ChoiceError(f"{name}: is no axis of this map; its axes are {' and '.join(axes)}")
    index = {}
    for name, axis in axes.items():
        if name not in given and axis.count > 1:
            raise ChoiceError(f"{name} is not given; a cell of this map needs {' and '.join(axes)}")
        try:
            index[name] = place(name, number_of(name, given[name]), axis.values(), axis.scale) if name in given else 0
        except (CellError, ParameterError) as error:
            raise ChoiceError(str(error)) from None
        except ValueError:
            raise ChoiceError(f"{name} = {given[name]!r}: should be a number") from None
    return index[sweep.y.name] * sweep.x.count + index[sweep.x.name]


def values_of(sweep: Sweep, cell: int) -> tuple[float, float]:
    """Return the values of the two parameters at a cell, along x and y."""
    at = sweep.axis_values(np.array([cell]))
    return float(at[sweep.x.name][0]), float(at[sweep.y.name][0])


def in_words(sweep: Sweep, cell: int) -> str:
    """Return a cell and its parameters as text."""
    x, y = values_of(sweep, cell)
    return (
        f"cell {cell}: {sweep.x.name} = {value_text(sweep.x.name, x)}, {sweep.y.name} = {value_text(sweep.y.name, y)}"
    )


def waveform(run: Run, cell: int, incarnation: str, clock: Callable[[], int]) -> Iterator[bytes]:
    """Compute a cell; yield an InspectedCell for each chunk, as a simulator publishes them, with attempt 0.

    Parameters
    ----------
    incarnation
        Of the sender.
    clock
        Returns nanoseconds since 1970, for the stamps.
    """
    sweep, cells = run.sweep, np.array([cell], np.uint32)
    blocks = (block for block in range(run.blocks.count) if cell in run.blocks.block(block))
    x, y = values_of(sweep, cell)
    message = {
        "run_id": run.run_id,
        "sweep_id": sweep.sweep_id,
        "block": next(blocks, run.blocks.count),
        "attempt": 0,
        "cells": cells,
        "x": [x],
        "y": [y],
        "spec.settings": sweep.settings(),
    }
    request = BlockRequest(message, Block(*common(sweep.parameters, sweep.lanes(cells))[:2]))
    chunks = ChunkMessages(request, incarnation, cells)
    for _ in range(request.chunks):
        yield bytes(chunks.next(clock())[1][0])


class Inspector:
    """Computes the chosen cells, one after the other, in a thread of its own: the first may have to compile a kernel.

    Parameters
    ----------
    incarnation
        Of the sender.
    publish
        Publishes a chunk on `inspect`; called in that thread.
    report
        Called in that thread with a line for the log where a cell could not be computed.
    """

    def __init__(self, incarnation: str, publish: Callable[[bytes], None], report: Callable[[str], object]) -> None:
        self._incarnation, self._publish, self._report = incarnation, publish, report
        self._waiting: queue.Queue[tuple[Run, int] | None] = queue.Queue(MOST_WAITING)
        self._thread: threading.Thread | None = None
        self._leaving = threading.Event()

    def inspect(self, run: Run, cell: int) -> None:
        """Have a cell computed and published.

        Raises
        ------
        ChoiceError
            Where too many wait already.
        """
        try:
            self._waiting.put_nowait((run, cell))
        except queue.Full:
            raise ChoiceError(f"{MOST_WAITING} chosen cells wait already; choose this one again later") from None
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="inspector", daemon=True)
            self._thread.start()

    def _work(self) -> None:
        while (item := self._waiting.get()) is not None and not self._leaving.is_set():
            run, cell = item
            try:
                for chunk in waveform(run, cell, self._incarnation, time.time_ns):
                    if self._leaving.is_set():
                        return
                    self._publish(chunk)
            except Exception as error:  # only for display: the sweep goes on
                self._report(f"cell {cell} is not inspected: {error}")

    def close(self) -> None:
        """Stop after the chunk in progress; it is waited for, one second at most."""
        self._leaving.set()
        with contextlib.suppress(queue.Full):  # if cells wait, the thread looks at `leaving` before the next one
            self._waiting.put_nowait(None)
        if self._thread is not None:
            self._thread.join(1.0)
