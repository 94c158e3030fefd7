"""The bar that shows the progress of a sweep on a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn


class _Console(Console):
    """A console that stops printing where rich would end the process, because its reader is gone."""

    def on_broken_pipe(self) -> None:
        self.quiet = True


class Bar:
    """A bar on stderr, with the speed and the regimes beside it.

    Parameters
    ----------
    total
        Number of cells.
    """

    def __init__(self, total: int) -> None:
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(20),
            MofNCompleteColumn(),
            TextColumn("{task.fields[speed]}"),
            TimeElapsedColumn(),
            TextColumn("[dim]{task.fields[regimes]}"),
            console=_Console(stderr=True, highlight=False),
        )
        self._task = self._bar.add_task("", total=total, speed="", regimes="")
        self._bar.start()

    @property
    def width(self) -> int:
        """Columns of the terminal."""
        return self._bar.console.width

    def show(self, title: str, completed: int, total: int, speed: str, regimes: str) -> None:
        """Show numbers of cells, and texts."""
        self._bar.update(self._task, description=title, completed=completed, total=total, speed=speed, regimes=regimes)

    def print_line(self, text: str) -> None:
        """Print a line above the bar."""
        self._bar.console.print(text, soft_wrap=True, markup=False)

    def stop(self) -> None:
        """Remove the bar from the terminal."""
        self._bar.stop()
