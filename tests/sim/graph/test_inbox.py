"""Messages are taken by hand, the oldest first, no more than asked for; the executor is not to serve them."""

from __future__ import annotations

from collections import deque
from typing import Any

import pytest

from bow_sim.graph.inbox import Inbox


class Subscription:
    """Stands in for a node and its subscription: messages wait in it until they are taken."""

    def __init__(self) -> None:
        self.waiting: deque[bytes] = deque()
        self.held = 0
        self.handle = self

    def create_subscription(self, kind: type, topic: str, callback: Any, qos: int, raw: bool) -> Subscription:
        self.made, self.callback = (kind, topic, qos, raw), callback
        return self

    def __enter__(self) -> None:  # as that of rclpy, which returns nothing
        self.held += 1

    def __exit__(self, *_: object) -> None:
        self.held -= 1

    def take_message(self, kind: type, raw: bool) -> tuple[bytes, dict[str, int]] | None:
        assert self.held == 1, "a subscription that is destroyed meanwhile must stay until the message is taken"
        assert (kind, raw) == (self.made[0], self.made[3])
        return (self.waiting.popleft(), {"received": 1}) if self.waiting else None


@pytest.mark.parametrize("raw", [True, False])
def test_what_waits_is_taken_in_order_up_to_a_bound(raw: bool) -> None:
    made = Subscription()
    inbox = Inbox(made, bytes, "verdicts", 7, raw)  # type: ignore[arg-type]
    assert made.made == (bytes, "verdicts", 7, raw)
    assert inbox.take(10) == []
    made.waiting.extend([b"1", b"2", b"3"])
    assert inbox.take(2) == [b"1", b"2"]
    made.waiting.append(b"4")
    assert inbox.take(2) == [b"3", b"4"]
    assert inbox.take(2) == []
    assert made.held == 0


def test_an_executor_that_serves_it_all_the_same_is_noticed() -> None:
    made = Subscription()
    inbox = Inbox(made, bytes, "verdicts", 7)  # type: ignore[arg-type]
    assert inbox.subscription is made  # type: ignore[comparison-overlap]
    with pytest.raises(AssertionError, match="taken by hand"):
        made.callback(b"1")
