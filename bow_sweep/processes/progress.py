"""How a sweep shows on a terminal, and in plain lines where there is none."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

PLAIN_EVERY_S = 2.0
SHOWN_REGIMES = 4
WIDE = 130
"""Columns of a terminal on which `SHOWN_REGIMES` regimes find room; a narrower one shows two."""


def percentages(what: str) -> Callable[[float, float], None]:
    """Return a callback (done, total) that prints how far `what` is, once it takes over two seconds."""
    began = last = time.monotonic()

    def show(done: float, total: float) -> None:
        nonlocal last
        now = time.monotonic()
        if now - began > PLAIN_EVERY_S and now - last > PLAIN_EVERY_S / 2:
            last = now
            with contextlib.suppress(OSError):  # only words are lost
                print(f"{what}: {100 * done / max(total, 1):.0f} %", file=sys.stderr)

    return show


@dataclass(frozen=True)
class Progress:
    """Where a sweep stands, in cells."""

    done: int
    quarantined: int
    planned: int
    regimes: dict[str, int] = field(default_factory=dict)


class _Console(Console):
    """A console that falls silent where rich would end the process, as nobody reads it any more."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


class Display:
    """Live progress: a bar on a terminal, a line every two seconds elsewhere.

    Parameters
    ----------
    console
        Where to show; stderr, so that stdout stays for results.
    """

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or _Console(stderr=True, highlight=False)
        self._bar: Bar | None = None
        self._task = TaskID(0)
        self._first: tuple[float, int] | None = None
        self._last_plain = time.monotonic()
        self._last_text = ""
        self._title, self._before, self._total = "", 0, 0

    def begin(self, title: str, before: int, total: int) -> None:
        """Go on with another of several runs: its name, the cells of those before it, and of all together."""
        self._title, self._before, self._total = title, before, total

    def say(self, text: str) -> None:
        """Print a line, above the bar where there is one; where nobody takes it, the sweep goes on."""
        with contextlib.suppress(OSError):
            self.console.print(text, soft_wrap=True, markup=False)

    def show(self, progress: Progress | None, waiting: str, now: float) -> None:
        """Show where the sweep stands at `now` (seconds); call often."""
        if progress is None or not progress.planned:
            self._plain(f"waiting: {waiting or 'for the nodes of the graph'}", now)
            return
        if self._first is None:
            self._first = (now, progress.done)
        began, first = self._first
        done = self._before + progress.done
        total = max(self._total, progress.planned)
        rate = (done - first) / (now - began) if now > began else 0.0
        left = total - done - progress.quarantined
        speed = f"{rate:,.0f} cells/s" + (f", {left / rate:.0f} s left" if rate else "")
        if progress.done + progress.quarantined == progress.planned:
            speed = "closing the bag, drawing the map"
        shown = SHOWN_REGIMES if not self.console.is_terminal or self.console.width >= WIDE else 2
        ranked = sorted(progress.regimes.items(), key=lambda item: -item[1])[:shown]
        regimes = ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in ranked if count)
        if progress.quarantined:
            regimes += f", quarantined {progress.quarantined}"
        if not self.console.is_terminal:
            name = f"{self._title}: " if self._title else ""
            self._plain(f"{name}{done}/{total} cells, {speed}; {regimes}", now)
            return
        if self._bar is None:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(20),
                MofNCompleteColumn(),
                TextColumn("{task.fields[speed]}"),
                TimeElapsedColumn(),
            )
            self._bar = Bar(*columns, TextColumn("[dim]{task.fields[regimes]}"), console=self.console)
            self._task = self._bar.add_task("", total=total, speed="", regimes="")
            self._bar.start()
        self._bar.update(
            self._task,
            description=self._title,
            completed=done + progress.quarantined,
            total=total,
            speed=speed,
            regimes=regimes,
        )

    def _plain(self, text: str, now: float) -> None:
        if now - self._last_plain >= PLAIN_EVERY_S and text != self._last_text:
            self._last_plain, self._last_text = now, text
            self.say(text)

    def stop(self) -> None:
        """Leave the terminal as it was."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None
