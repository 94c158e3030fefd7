"""Every test of every cell, for the timeline `test` of a recording: what each cell was after 5, 10 ... periods.

While a sweep runs, its map has only the latest test of each cell. All tests are in ``map.npz``, which the coordinator
writes when the plan has closed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from bow_sim.protocol.verdict_fields import PENDING
from bow_sweep.maps.map_file import MAP, MapFile, MapFileError, read_map_npz
from bow_sweep.maps.plane import Plane, Snapshot

LEDGER = "ledger.jsonl"
"""A file of every run directory; a directory without it is not the coordinator's, and gets no map."""

MAP_S, POLL_S = 10.0, 0.05
"""Longest time to wait for the map after the plan has closed, and between two looks."""


def finished_map(directory: Path, shown: Plane, sleep: Callable[[float], object] = time.sleep) -> MapFile | None:
    """Wait for the map of a run that has ended, and return it; None where there will be none, or it takes too long.

    Parameters
    ----------
    directory
        Of the run.
    shown
        The last map that came; an older map of a run that was resumed has less than this.
    sleep
        Called with seconds.
    """
    if not (directory / LEDGER).exists():
        return None
    for _ in range(round(MAP_S / POLL_S)):
        result = _read(directory / MAP)
        if result is not None and _is_newer(result, shown):
            return result
        sleep(POLL_S)
    return None


def _read(path: Path) -> MapFile | None:
    try:
        return read_map_npz(path) if path.exists() else None
    except (MapFileError, OSError):  # a file from before
        return None


def _is_newer(result: MapFile, shown: Plane) -> bool:
    """Return whether a map has all that a map that came has."""
    if result.run_id != shown.run_id or result.shape != shown.shape or result.regimes is None:
        return False
    known = ~np.isnan(shown.transient_periods)
    return bool((result.transient_periods[known] == shown.transient_periods[known]).all())


def at_each_test(result: MapFile) -> Iterator[tuple[int, Snapshot]]:
    """Yield the number of periods and the map after them, for 0 periods and for each test.

    A cell has the transient length that it had by then: none before the test that found Helmholtz motion. At the last
    test the map is the finished one, with what an adaptive sweep predicted.
    """
    assert result.regimes is not None
    base = {name: getattr(result, name) for name in ("run_id", "sweep_id", "x_name", "y_name", "x", "y")}
    base |= {name: getattr(result, name) for name in ("regime_names", "settings", "preset")}
    nothing = np.full(result.shape, np.nan, np.float32)
    none = np.zeros(result.shape, np.uint16)
    untested = np.full(result.shape, PENDING, np.uint8)
    yield (
        0,
        Snapshot(
            **base,
            transient_periods=nothing,
            regime=untested,
            tests=none,
            correlation=nothing,
            slips=none,
            corners=none,
        ),
    )
    length = result.transient_periods
    for index, periods in enumerate(result.test_periods.tolist()):
        regime = result.regimes[index]
        last = index == len(result.test_periods) - 1
        by_then = np.where(np.nan_to_num(length) <= periods, length, 0).astype(np.float32)
        if result.transient is not None:
            by_then = result.transient[index]
        tested = (regime != PENDING) & ~np.isnan(length)
        yield (
            int(periods),
            Snapshot(
                **base,
                transient_periods=length if last else np.where(tested, by_then, nothing),
                regime=result.regime if last else np.where(tested, regime, PENDING).astype(np.uint8),
                tests=np.where(tested, index + 1, 0).astype(np.uint16),
                correlation=result.correlation[index],
                slips=result.slips[index],
                corners=result.corners[index],
            ),
        )


def confidence_words(result: MapFile) -> list[str]:
    """Return how sure the regime of each cell at the last test is, as text, in the order of the cells."""
    assert result.confidence is not None
    words = [*(f"; confidence {percent / 100:.2f}" for percent in range(101)), ""]
    percents = np.nan_to_num(100 * result.confidence[-1].ravel(), nan=101)
    return [words[percent] for percent in np.rint(percents).astype(int).tolist()]
