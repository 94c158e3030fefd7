"""What the supervisor of a graph knows of it from messages."""

from __future__ import annotations

from dataclasses import dataclass, field

from bow_sim.protocol.neighbours import AwakeClock
from bow_sweep.processes.leader import Leader
from bow_sweep.processes.progress import Progress
from bow_sweep.processes.watchdog import Watchdog

NO_RUN = "-"
"""In place of a run, between two: nobody is late then, however long it takes. Heartbeats are watched all the same."""

MENTIONED_S = 5.0
"""What the coordinator waits for in the middle of a sweep is printed when it lasts longer."""


@dataclass
class Observed:
    """What the supervisor has learned of the graph. It outlives the node, which may have to be made again.

    Attributes
    ----------
    watchdog
        Decides which processes make no progress.
    awake
        The clock of the watchdog.
    progress
        How far the sweep is, from the latest map; None before the first.
    failed
        Why recorder or classifier cannot go on; "" otherwise.
    details, states
        Role -> detail and state of its latest heartbeat.
    news
        Lines for the user -> whether the line is still to be printed.
    ours
        Process numbers of the supervisor's children.
    heard
        Those of them whose heartbeats have arrived.
    closed
        The plan is closed: nothing more will be simulated.
    leader
        The coordinator on another machine; for a station.
    waits
        What the coordinator waits for, and since when.
    """

    watchdog: Watchdog
    awake: AwakeClock = field(default_factory=AwakeClock)
    progress: Progress | None = None
    failed: str = ""
    details: dict[str, str] = field(default_factory=dict)
    states: dict[str, int] = field(default_factory=dict)
    news: dict[str, bool] = field(default_factory=dict)
    ours: set[int] = field(default_factory=set)
    heard: set[int] = field(default_factory=set)
    closed: bool = False
    leader: Leader = field(default_factory=Leader)
    waits: tuple[str, float] = ("", 0.0)

    def follow(self, run_id: str) -> None:
        """Watch the run that the coordinator has now; "" for none."""
        run = run_id or NO_RUN
        if run != self.watchdog.run_id:
            worked, self.watchdog = self.watchdog.worked, Watchdog(run)
            self.watchdog.worked |= worked

    def note_waiting(self, what: str, now: float) -> None:
        """Print what the coordinator waits for in the middle of a sweep; before the first map, the display shows it."""
        if what != self.waits[0]:
            self.waits = (what, now)
            self.news.pop(what, None)
        elif what and self.progress is not None and now - self.waits[1] > MENTIONED_S:
            self.news.setdefault(what, True)
