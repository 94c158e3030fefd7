"""What a station knows of its run's coordinator, on another machine: whether it is there, by its heartbeats. No ROS.

Times are seconds in which the supervisor could run (:class:`bow_sim.protocol.neighbours.AwakeClock`).
"""

from __future__ import annotations

from typing import NamedTuple

from bow_sim.protocol.neighbours import SILENT_S

FOUND_S = 60.0
"""A station ends that has not heard the coordinator of its run for this long after its start."""

OVER_S = 20.0
"""So long it waits for one where its own bag says that the run was closed: the run is over, unless somebody resumes it
to compute something again."""

LOST_S = 120.0
"""A station ends that has heard the coordinator of its run, and then none for this long. Until then somebody may resume
the run: the station goes on with it."""


class _Process(NamedTuple):
    incarnation: str
    host: str
    pid: int


class Leader:
    """The coordinator of the run, or of the standing graph, that a station has joined.

    Parameters
    ----------
    awaited
        What brings back one that is away, for people.
    was_closed
        The bag of the station says that the run was closed.

    Attributes
    ----------
    has_ended
        It is known that the one that was heard last has ended, and no other was heard since.
    has_left
        It has ended by itself.
    """

    def __init__(self, awaited: str = "`bow sweep --resume RUN` on its machine", was_closed: bool = False) -> None:
        self._awaited, self._was_closed = awaited, was_closed
        self.has_left = False
        self._began: float | None = None
        self._heard: float | None = None
        self._process = _Process("", "", 0)
        self._away = False
        self.has_ended = ""

    def heard(self, incarnation: str, host: str, pid: int, now: float) -> None:
        """Take in a heartbeat of a coordinator."""
        self._process, self._heard, self.has_ended = _Process(incarnation, host, pid), now, ""
        self.has_left = False

    def left(self, incarnation: str) -> None:
        """Take in the last word of a coordinator; that of one that was not in charge says nothing."""
        if incarnation == self._process.incarnation:
            self.has_ended, self.has_left = "has ended", True

    def died(self, host: str, pid: int, cause: str, now: float) -> None:
        """Take in what a supervisor reports of a coordinator's process, maybe before that one was heard."""
        if self._heard is None:
            self._process, self._heard = _Process("", host, pid), now
        if (host, pid) == self._process[1:]:
            self.has_ended = f"has ended ({cause})"

    @property
    def was_heard(self) -> bool:
        """Whether one was heard at any time."""
        return self._heard is not None

    def is_away(self, now: float) -> bool:
        """Return whether the one that was heard has ended, or is silent for as long as others who count as gone."""
        return bool(self.has_ended) or (self._heard is not None and now - self._heard > SILENT_S)

    def news(self, now: float) -> str:
        """Return a line for the user when it goes and when it, or its successor, is back; "" otherwise."""
        before, self._away = self._away, self.is_away(now)
        if self._away and not before:
            why = self.has_ended or f"is not heard for {SILENT_S:g} s"
            return (
                f"the coordinator {why}: this station waits for {self._awaited}, {LOST_S:g} s at most (Ctrl-C: it "
                "ends now)"
            )
        return "the coordinator is heard again: this station goes on" if before and not self._away else ""

    def is_over(self, now: float) -> bool:
        """Return whether the run has ended before this station came: it was closed, and no coordinator is heard."""
        return self._was_closed and self._heard is None and self._waited(now) > OVER_S

    def lost(self, now: float) -> str:
        """Return why nothing more is to be expected of the run; "" while something is."""
        if self._heard is None:
            why = "is the run in progress, and does it ask for other machines (--network)? A run that is over has none"
            return f"no coordinator is heard for {FOUND_S:g} s: {why}" if self._waited(now) > FOUND_S else ""
        if now - self._heard <= LOST_S:
            return ""
        return f"the coordinator {self.has_ended or 'is not heard'}, and none is there for {LOST_S:g} s"

    def _waited(self, now: float) -> float:
        """Return the seconds since the first call."""
        self._began = now if self._began is None else self._began
        return now - self._began
