"""The page as one file: Bokeh's scripts, the maps, and the last periods of every cell, packed small."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.models.callbacks import CustomJS
from bokeh.models.sources import ColumnDataSource
from bokeh.resources import INLINE

from bow_sim.atomic_files import replacing
from bow_sim.physics.parameters import CHUNK_PERIODS
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.explore.packed import LastPeriods, Progress, last_periods, pack
from bow_sweep.explore.page import SECONDS, Page, Panel, page_of, template
from bow_sweep.explore.plots import COLUMNS
from bow_sweep.explore.served import shown

MOST_BYTES = 25_000_000
"""Largest page: what mail servers and browsers still take without complaint."""

LEAST_PERIODS = 2
"""Fewest periods: the sound repeats all but one of them."""

SHARE = 0.6
"""Least bytes in the page for each sample: 8 bits, compressed and in base64."""


class PageError(ValueError):
    """The page cannot be saved as asked; says what would be right."""


def check_page(path: Path) -> None:
    """Raise PageError for a file that is no page by its suffix."""
    if path.suffix.lower() not in (".html", ".htm"):
        what = f"as {path.suffix}" if path.suffix else "without a suffix"
        raise PageError(f"--save {path}: cannot write a page {what}; should end in .html")


def save_page(
    runs: Sequence[Path], names: Sequence[str], path: Path, periods: int | None, progress: Progress | None = None
) -> str:
    """Write the page of one or two runs; readers see the old file or the complete new one.

    Parameters
    ----------
    runs, names
        Directories of the runs, and their names.
    path
        Ends in .html.
    periods
        Last periods of every cell in the page; None: five.

    Returns
    -------
    str
        What is in the page, in words.

    Raises
    ------
    CellError
        Where a run cannot be shown.
    PageError
        For another suffix, a number of periods that cannot be, or a page that would be too large.
    OSError
        Where the file cannot be written.
    """
    check_page(path)
    opened = [RunCells(run, progress) for run in runs]
    try:
        longest = min(run.sweep.parameters.chunks * CHUNK_PERIODS for run in opened)
        kept = min(CHUNK_PERIODS, longest) if periods is None else periods
        if not LEAST_PERIODS <= kept <= longest:
            raise PageError(f"--periods {kept}: should be {LEAST_PERIODS} ... {longest}, the length of the run")
        samples = sum(run.cells * kept * run.sweep.parameters.period for run in opened)
        page, base = _empty_page(opened, names, kept, samples)
        _check_size(path, base, SHARE * samples, kept)
        total = sum(run.cells for run in opened)
        ends: list[LastPeriods] = []
        for run in opened:
            before = sum(len(end.force) for end in ends)
            report = None if progress is None else _later(progress, before, total)
            ends.append(last_periods(run, kept, report))
        for number, panel in enumerate(page.panels):
            panel.play.js_on_click(CustomJS(code=f"bow.play_loop({number}, {SECONDS})"))
        for bits in (16, 8):
            for panel, run, end in zip(page.panels, opened, ends, strict=True):
                _fill(panel, run, end, bits, kept)
            text = _text(page).encode()
            if len(text) <= MOST_BYTES:
                break
        _check_size(path, base, len(text) - base, kept)
        with replacing(path) as file:
            file.write(text)
    finally:
        for run in opened:
            run.close()
    computed = sum(end.computed for end in ends)
    said = f"{len(text) / 1e6:.1f} MB, the last {kept} periods of {total} cells with {bits} bits"
    tests = len(opened[0].map.test_periods)
    if tests > 1 and not page.panels[0].all_tests:
        said += ", the results of the last test only (all tests would make it too large)"
    if computed:
        why = next(filter(None, (end.why for end in ends)))
        said += f"; {computed} cells were computed again: {why}"
    if given_up := sum(end.given_up for end in ends):
        said += f"; {given_up} cells have no waveform, because the run has given them up"
    return said


def _empty_page(runs: Sequence[RunCells], names: Sequence[str], periods: int, samples: int) -> tuple[Page, int]:
    """Return the page without samples, and its bytes; with the last test only where all are too large."""
    described = [shown(run, name) for run, name in zip(runs, names, strict=True)]
    for all_tests in (True, False):
        page = page_of(described, periods, all_tests)
        size = len(_text(page).encode())
        if size + SHARE * samples <= MOST_BYTES:
            break
    return page, size


def _check_size(path: Path, base: int, samples: float, periods: int) -> None:
    """Raise PageError where `base` bytes and those of the samples are too many."""
    size = base + samples
    if size <= MOST_BYTES:
        return
    fit = int(periods * (MOST_BYTES - base) / samples)
    what = f"--save {path}: the page would have {size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} are allowed"
    if fit >= LEAST_PERIODS:
        raise PageError(f"{what}; --periods {fit} would fit")
    raise PageError(f"{what}; should be a map of fewer cells (bow sweep --nx, --ny), or served, without --save")


def _later(progress: Progress, before: int, total: int) -> Progress:
    return lambda done, _: progress(before + done, total)


def _fill(panel: Panel, run: RunCells, end: LastPeriods, bits: int, periods: int) -> None:
    """Put the last periods of a run into its panel."""
    parameters = run.sweep.parameters
    packed = pack(end.force, bits)
    small = np.uint16 if end.force.shape[1] < 1 << 16 else np.uint32
    arrays: dict[str, Any] = {"force": packed.values, "middle": packed.middle, "step": packed.step}
    arrays |= {"offset": end.offset, "onset": end.onset.astype(small), "duration": end.duration.astype(small)}
    arrays["period"] = np.asarray(run.map.period[-1], np.float32).ravel()
    columns = {name: [array] for name, array in arrays.items()}
    first = parameters.chunks * parameters.chunk_samples - end.force.shape[1]
    panel.script |= {
        "packed": ColumnDataSource(name=f"packed{panel.letter}", data=columns),
        "samples": end.force.shape[1],
        "first": first,
        "period": parameters.period,
        "rate": parameters.sample_rate,
    }
    panel.body.visible = False
    for name in ("wave", "spectrum", "harmonics"):  # two points, for the first ranges; the browser replaces them
        getattr(panel, name).data = {column: [0.0, 1.0] for column in COLUMNS[name]}
    worst = float(np.max(packed.step, initial=0.0)) / 2
    panel.say(
        f"Last {periods} periods with {bits} bits, exact to {worst:.1g}; sound: these repeated for {SECONDS:g} s."
    )


def _text(page: Page) -> str:
    """Return the page as HTML."""
    document = Document()
    page.add_to(document)
    text: str = file_html(document, INLINE, document.title, template=template())
    document.clear()
    return text
