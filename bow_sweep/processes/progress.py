"""The progress of a sweep on stderr: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from bow_sweep.processes.progress_bar import Bar

PLAIN_EVERY_S = 2.0
SHOWN_REGIMES = 4
WIDE = 130
"""Columns that a terminal must have to show `SHOWN_REGIMES` regimes; a narrower one shows two."""


def percentages(what: str) -> Callable[[float, float], None]:
    """Return a callback (done, total) that prints the percentage done, once `what` takes over two seconds."""
    began = last = time.monotonic()

    def show(done: float, total: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - began > PLAIN_EVERY_S and now - last > PLAIN_EVERY_S / 2:
            last = now
            with contextlib.suppress(OSError):  # stderr is closed: only the percentage is lost
                print(f"{what}: {100 * done / max(total, 1):.0f} %", file=sys.stderr)

    return show


@dataclass(frozen=True)
class Progress:
    """How far a sweep is, in cells; `regimes` is the number of cells in each regime."""

    done: int
    quarantined: int
    planned: int
    regimes: dict[str, int] = field(default_factory=dict)


class _First(NamedTuple):
    """The first progress shown, from which the rate is computed."""

    at_s: float
    done: int


class Display:
    """Live progress on stderr: a bar on a terminal, a line every two seconds elsewhere; stdout is for results."""

    def __init__(self) -> None:
        self._bar: Bar | None = None
        self._first: _First | None = None
        self._last_plain = time.monotonic()
        self._last_text = ""
        self._title, self._before, self._total = "", 0, 0

    def begin(self, title: str, before: int, total: int) -> None:
        """Go to the next of several runs: its name, the cells of the runs before it, the cells of all runs."""
        self._title, self._before, self._total = title, before, total

    def print_line(self, text: str) -> None:
        """Print a line, above the bar where there is one; nothing happens where stderr is closed."""
        with contextlib.suppress(OSError):
            if self._bar is None:
                print(text, file=sys.stderr, flush=True)
            else:
                self._bar.print_line(text)

    def show(self, progress: Progress | None, waiting: str, now: float) -> None:
        """Show the progress at `now`, in seconds, or before there is any, what the sweep waits for; call often."""
        if progress is None or not progress.planned:
            self._plain(f"waiting: {waiting or 'for the nodes of the graph'}", now)
            return
        if self._first is None:
            self._first = _First(now, progress.done)
        done = self._before + progress.done
        total = max(self._total, progress.planned)
        rate = (done - self._first.done) / (now - self._first.at_s) if now > self._first.at_s else 0.0
        left = total - done - progress.quarantined
        speed = f"{rate:,.0f} cells/s" + (f", {left / rate:.0f} s left" if rate else "")
        if progress.done + progress.quarantined == progress.planned:
            speed = "closing the bag, drawing the map"
        if self._bar is None and sys.stderr.isatty():
            from bow_sweep.processes.progress_bar import Bar  # rich: it need not be loaded before the first block

            self._bar = Bar(total)
        shown = SHOWN_REGIMES if self._bar is None or self._bar.width >= WIDE else 2
        ranked = sorted(progress.regimes.items(), key=lambda item: -item[1])[:shown]
        regimes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in ranked if count)
        if progress.quarantined:
            regimes += f", quarantined {progress.quarantined}"
        if self._bar is not None:
            self._bar.show(self._title, done + progress.quarantined, total, speed, regimes)
            return
        name = f"{self._title}: " if self._title else ""
        self._plain(f"{name}{done}/{total} cells, {speed}; {regimes}", now)

    def _plain(self, text: str, now: float) -> None:
        if now - self._last_plain >= PLAIN_EVERY_S and text != self._last_text:
            self._last_plain, self._last_text = now, text
            self.print_line(text)

    def stop(self) -> None:
        """Remove the bar from the terminal."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
