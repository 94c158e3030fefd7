"""Simulators that wait at a gate, and a `bow` that starts such simulators instead of its own.

The small sweeps of tests take a fraction of a second. On a busy machine one may be over before the test gets to do what
the sweep is to survive. ``python -m gated_simulator sweep ...`` is `bow sweep ...` with simulators that compute as all
do, but publish only as many chunks of a run, each of them, as the file ``GATE`` says; without that file they do not
wait. A second number in it is that of the run from which on they wait, 0 for their first. So it is with a station, and
with the standing graph of ``python -m gated_simulator up ...``, ``study ...`` and ``optimise ...``.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path

GATE = "BOW_TEST_GATE"
"""Environment variable: path of the file."""

LOOK_S = 0.005


def gated_simulator() -> object:
    """Return the node; what it needs is loaded here, for a `bow` that copies itself must not have loaded ROS."""
    from bow_classifier.at_source import Judges
    from bow_sim.node import SimulatorNode
    from bow_sim.protocol import cdr
    from bow_sim.protocol.messages import STREAMS
    from bow_sim.protocol.neighbours import HELLO_S
    from bow_sim.simulator_events import PlanReceived
    from bow_sim.simulator_session import NO_RUN

    sent: dict[object, int] = {}  # of each run, in the order in which they began

    class GatedSimulator(SimulatorNode):
        _hello_at = 0.0

        def _on_plan(self, event: PlanReceived) -> None:
            super()._on_plan(event)
            if self._session.run != NO_RUN:
                sent.setdefault(self._session.run, 0)

        def _publish(self, messages: Mapping[str, bytes]) -> bool:
            if not any(cdr.hello_from(STREAMS.get(topic, "Verdicts"), data) for topic, data in messages.items()):
                run = self._session.run
                sent.setdefault(run, 0)
                number = list(sent).index(run)
                while sent[run] >= allowed(number) and self._session.run == run and not self._leaving.is_set():
                    time.sleep(LOOK_S)
                    self._stay_heard()
                sent[run] += 1
            return super()._publish(messages)

        def _stay_heard(self) -> None:
            """Hear and be heard as any simulator that waits: who waits for long is taken for lost otherwise."""
            self._take_receipts()
            if time.monotonic() - self._hello_at > HELLO_S:
                self._hello_at = time.monotonic()
                hello = self._session._hello.items()
                super()._publish({topic: data for topic, data in hello if topic in self._publisher_of})

    return GatedSimulator(Judges().of_block)


def allowed(number: int) -> float:
    """Return how many chunks a simulator may publish of its run of this number, 0 for the first."""
    try:
        with contextlib.suppress(ValueError):  # just being written
            chunks, *first = map(int, Path(os.environ[GATE]).read_text().split())
            return math.inf if first and number < first[0] else chunks
    except FileNotFoundError:
        return math.inf
    return 0


def put_in_place() -> None:
    """Have the graphs that this process starts take such simulators."""
    from bow_sweep.processes.roles import MODULES

    MODULES["simulator"] = "gated_simulator"


def main() -> int:
    """Be a simulator where ROS arguments say so, else `bow`."""
    if "--ros-args" in sys.argv:
        from bow_sim.graph.node_process import run_node

        return run_node(gated_simulator)  # type: ignore[arg-type]
    from bow_sweep import entry

    put_in_place()
    if {"up", "study", "optimise"} & set(sys.argv):  # the process of the graph is a new one
        from bow_sweep.standing import start

        start.CHILD = f"import gated_simulator; gated_simulator.put_in_place(); {start.CHILD}"
    return entry.command()


if __name__ == "__main__":
    sys.exit(main())
