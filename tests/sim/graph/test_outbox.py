"""Messages that cannot be published now are kept, in order; a hello is sent only where nothing else is."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bow_sim.graph.node_base import RCLError
from bow_sim.graph.outbox import Outbox
from bow_sim.protocol.neighbours import FIRST_HELLO_S, HELLO_S
from bow_sim.protocol.states import NodeState


class Graph:
    """Stands in for a node and its publisher."""

    topic_name = "/bow/verdicts"

    def __init__(self) -> None:
        self.now, self.hangs = 0.0, False
        self.sent: list[bytes] = []
        self.log: list[str] = []
        self.health = SimpleNamespace(state=NodeState.STARTING, detail="")
        self.awake = SimpleNamespace(now=lambda: self.now)

    def every(self, seconds: float, do: Any) -> None:
        self.timer = do

    def get_subscriptions_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(node_name=name) for name in ("recorder", "coordinator", "recorder")]

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=lambda text, **_: self.log.append(text))

    def publish(self, data: bytes) -> None:
        if self.hangs:
            raise RCLError("cannot publish data")
        self.sent.append(data)


@pytest.fixture
def graph() -> Graph:
    return Graph()


@pytest.fixture
def outbox(graph: Graph) -> Outbox:
    return Outbox(graph, graph)  # type: ignore[arg-type]


def test_messages_wait_while_a_subscriber_hangs_and_go_out_in_order(graph: Graph, outbox: Outbox) -> None:
    graph.hangs = True
    outbox.send([b"1"])
    outbox.send([b"2", b"3"])
    assert graph.sent == []
    (line,) = graph.log  # the timer tries again, further messages do not
    assert line == "/bow/verdicts: 1 messages wait, one of the subscribers hangs (coordinator, recorder): " + (
        "cannot publish data"
    )
    graph.timer()
    assert "3 messages wait" in graph.log[-1]
    graph.hangs = False
    graph.timer()
    outbox.send([b"4"])
    assert graph.sent == [b"1", b"2", b"3", b"4"]


def test_a_hello_is_sent_ten_times_a_second_until_the_node_is_ready_then_once_a_second(
    graph: Graph, outbox: Outbox
) -> None:
    def hellos(at: float) -> int:
        graph.now = at
        before = len(graph.sent)
        outbox.send_hello(lambda: b"hello")
        return len(graph.sent) - before

    assert [hellos(at) for at in (0.0, 0.5 * FIRST_HELLO_S, FIRST_HELLO_S)] == [1, 0, 1]
    graph.health.detail = "waiting: /bow/recorder does not hear verdicts"  # it has taken up the run, and hears them now
    assert [hellos(at) for at in (1.1 * FIRST_HELLO_S, 1.2 * FIRST_HELLO_S, 2.1 * FIRST_HELLO_S)] == [1, 0, 1]
    graph.health.state = NodeState.READY
    assert [hellos(at) for at in (0.9 * HELLO_S, 1.3 * HELLO_S)] == [0, 1]
    outbox.send([b"1"])
    assert hellos(2.1 * HELLO_S) == 0, "a message shows as well that messages arrive"


def test_no_hello_waits_behind_other_messages(graph: Graph, outbox: Outbox) -> None:
    graph.hangs = True
    outbox.send([b"1"])
    outbox.send_hello(lambda: b"hello")
    graph.hangs = False
    graph.timer()
    assert graph.sent == [b"1"]
