"""A sweep computed and classified in this process, without graph and bag: for validation and calibration."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from threading import Event

import numpy as np
from numpy.typing import ArrayLike

from bow_classifier.block_classifier import Verdicts
from bow_classifier.features.slips import Intervals
from bow_classifier.task import classifier_of
from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.kernel.block import Block, ChunkResult
from bow_sim.physics.cells import paper_lanes
from bow_sim.physics.kinds import common
from bow_sim.physics.parameters import Parameters
from bow_sweep.maps.basin_map import Basin
from bow_sweep.plan.sweep import Sweep


def intervals_of(chunk: ChunkResult) -> Intervals:
    """Return the slips of a chunk in the form that the classifier takes."""
    return Intervals(
        slipping=chunk.slipping, offsets=chunk.offsets, onset=chunk.onset, duration=chunk.duration, slip=chunk.slip
    )


def verdicts(
    parameters: Parameters, lanes: Mapping[str, ArrayLike], thresholds: Thresholds | None = None
) -> Iterator[Verdicts]:
    """Simulate cells and yield the verdicts after every five periods; see :func:`judged_chunks`."""
    for _, verdict in judged_chunks(parameters, lanes, thresholds):
        yield verdict


def judged_chunks(
    parameters: Parameters, lanes: Mapping[str, ArrayLike], thresholds: Thresholds | None = None
) -> Iterator[tuple[ChunkResult, Verdicts]]:
    """Simulate cells and yield each chunk with the verdicts on it.

    Parameters
    ----------
    parameters
        Common to all cells.
    lanes
        Name -> (cells,), what differs between the cells; as in :class:`bow_sim.kernel.block.Block`.
    thresholds
        Of the verdicts; None: the default ones.

    Raises
    ------
    ParameterError
        For values that cannot be; names parameter, cell and value.
    """
    own = common(parameters, lanes)
    parameters, lanes = own.parameters, own.lanes
    block = Block(parameters, lanes)
    cells = len(np.asarray(next(iter(lanes.values()))))
    in_paper_units = paper_lanes(parameters, lanes)
    values = {
        name: np.broadcast_to(np.asarray(in_paper_units.get(name, getattr(parameters, name)), np.float64), (cells,))
        for name in ("v_b", "bow_bridge", "acceleration")
    }
    classifier = classifier_of(parameters, replace(thresholds or Thresholds(), **own.thresholds), values)
    for _ in range(parameters.chunks):
        chunk = block.advance()
        yield chunk, classifier.classify(chunk.bridge_force, intervals_of(chunk))


def compute(sweep: Sweep, progress: Callable[[float, float], None] | None = None, workers: int = 1) -> Basin:
    """Compute the map of a sweep block by block; for an adaptive sweep round by round.

    Parameters
    ----------
    progress
        Called with (cells done, cells) after each block.
    workers
        Number of blocks that are computed at a time, each by a thread: kernel and classifier run without Python's lock.
        The verdicts do not depend on it.
    """
    basin = Basin(sweep.x.count, sweep.y.count, sweep.chunks, sweep.repeats.count)
    done, blocks = 0, sweep.first_blocks
    stop = Event()

    def classified(number: int) -> tuple[np.ndarray, list[Verdicts]]:
        cells = blocks.block(number)
        found = []
        for verdict in verdicts(sweep.parameters, sweep.lanes(cells), sweep.thresholds):
            found.append(verdict)
            if stop.is_set():
                break
        return cells, found

    with ThreadPoolExecutor(workers) as pool:
        try:
            while True:
                for task in as_completed([pool.submit(classified, number) for number in range(done, blocks.count)]):
                    cells, found = task.result()
                    for test, verdict in enumerate(found):
                        basin.take(test, cells, verdict._asdict())
                    if progress:
                        progress(int(np.count_nonzero(basin.tested)), sweep.budget)
                more = sweep.more_blocks(blocks, basin.transient_periods)
                if more is None:
                    return basin
                done, blocks = blocks.count, more
        except BaseException:  # Ctrl-C, or a block that cannot be computed: the other threads end after their chunk
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise
