"""What the coordinator's session takes in, events, and what it asks its node to do, instructions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from bow_sim.protocol.neighbours import Neighbour
from bow_sweep.maps.basin_map import Basin
from bow_sweep.run.directory import Run


@dataclass
class Counts:
    """What has arrived: entries of receipts and verdicts that were used, and messages that were ignored."""

    messages: int = 0
    ignored: int = 0


# ---- events


@dataclass(frozen=True)
class RunGiven:
    """There is a run to work on, new or resumed.

    Attributes
    ----------
    layers
        The verdicts in its bag; None if there are none.
    dashboard
        Whether a dashboard, where there is one, draws it.
    """

    run: Run
    layers: Mapping[str, np.ndarray] | None = None
    dashboard: bool = True


@dataclass(frozen=True)
class GoalAccepted:
    """The action server has accepted a goal; `goal` is its UUID."""

    goal: bytes
    preset: str
    settings: tuple[str, ...]


@dataclass(frozen=True)
class GoalRefused:
    """A goal that the action server has accepted cannot be run; `why` becomes the message of its result."""

    goal: bytes
    why: str


@dataclass(frozen=True)
class CancelRequested:
    """A client asks to cancel a goal."""

    goal: bytes


@dataclass(frozen=True)
class HealthReceived:
    """A heartbeat (Health) has arrived; `neighbour` is None if it reports that a node has ended or left."""

    message: Any
    neighbour: Neighbour | None


@dataclass(frozen=True)
class ReceiptReceived:
    """A Receipt of a station has arrived, `data` in CDR."""

    data: bytes
    station: str = ""


@dataclass(frozen=True)
class VerdictsReceived:
    """A Verdicts message of a station has arrived, `data` in CDR."""

    data: bytes
    station: str = ""


@dataclass(frozen=True)
class ResultsWritten:
    """A :class:`WriteResults` has been carried out.

    Attributes
    ----------
    playability
        For the report, see :func:`bow_sweep.coordinator.results.playability_of`.
    problem
        Why there is no picture; "" if there is one.
    """

    playability: Mapping[str, Any]
    problem: str = ""


@dataclass(frozen=True)
class TimePassed:
    """Send it every `TICK_S`."""


Event = (
    RunGiven
    | GoalAccepted
    | GoalRefused
    | CancelRequested
    | HealthReceived
    | ReceiptReceived
    | VerdictsReceived
    | ResultsWritten
    | TimePassed
)

# ---- instructions, to be carried out in order


@dataclass(frozen=True)
class Publish:
    """Publish a message, `data` in CDR."""

    topic: Literal["plan", "blocks"]
    data: bytes


@dataclass(frozen=True)
class ListenTo:
    """Subscribe to the receipts and verdicts of a station: its first node is heard."""

    station: str


@dataclass(frozen=True)
class PublishMap:
    """Publish the map so far, `values` being the fields of a BasinMap, and the same as an image."""

    values: Mapping[str, Any]


@dataclass(frozen=True)
class PublishFeedback:
    """Publish the progress of a goal, `values` being the fields of RunSweep.Feedback."""

    goal: bytes
    values: Mapping[str, Any]


@dataclass(frozen=True)
class AnswerGoal:
    """End a goal, `values` being the fields of RunSweep.Result; without a run_id it has failed."""

    goal: bytes
    values: Mapping[str, Any]


@dataclass(frozen=True)
class SetState:
    """Change the state in this node's heartbeat, see NodeState; `run_id` None leaves that as it is."""

    state: int
    detail: str = ""
    run_id: str | None = None


@dataclass(frozen=True)
class Log:
    """Write a line to the log."""

    severity: Literal["info", "warning", "error"]
    text: str


@dataclass(frozen=True)
class WriteResults:
    """Write the map and the picture of a run, then send :class:`ResultsWritten`."""

    run: Run
    basin: Basin


@dataclass(frozen=True)
class RunEnded:
    """The run is finished: its report is written and its directory released."""


Instruction = Publish | ListenTo | PublishMap | PublishFeedback | AnswerGoal | SetState | Log | WriteResults | RunEnded
