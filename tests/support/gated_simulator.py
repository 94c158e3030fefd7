"""Simulators that wait at a gate, and a `bow` that starts such simulators instead of its own.

The small sweeps of tests take a fraction of a second. On a busy machine one may be over before the test gets to do what
the sweep is to survive. ``python -m gated_simulator sweep ...`` is `bow sweep ...` with simulators that compute as all
do, but publish only as many chunks of a run, each of them, as the file ``GATE`` says; without that file they do not
wait. So it is with the standing graph of ``python -m gated_simulator up ...``.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import time
from collections import Counter
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

    sent: Counter[object] = Counter()

    class GatedSimulator(SimulatorNode):
        def _publish(self, messages: Mapping[str, bytes]) -> bool:
            if not any(cdr.hello_from(STREAMS.get(topic, "Verdicts"), data) for topic, data in messages.items()):
                run = self._session.run
                while sent[run] >= allowed() and self._session.run == run and not self._leaving.is_set():
                    time.sleep(LOOK_S)
                sent[run] += 1
            return super()._publish(messages)

    return GatedSimulator(Judges().of_block)


def allowed() -> float:
    """Return how many chunks a simulator may publish."""
    try:
        with contextlib.suppress(ValueError):  # just being written
            return int(Path(os.environ[GATE]).read_text())
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
    if "up" in sys.argv:  # the process of the graph is a new one
        from bow_sweep.standing import start

        start.CHILD = f"import gated_simulator; gated_simulator.put_in_place(); {start.CHILD}"
    return entry.command()


if __name__ == "__main__":
    sys.exit(main())
