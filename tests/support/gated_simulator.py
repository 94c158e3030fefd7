"""Simulators that wait at a gate, and a `bow` that starts such simulators instead of its own.

The small sweeps of tests take a fraction of a second. On a busy machine one may be over before the test gets to do what
the sweep is to survive. ``python -m gated_simulator sweep ...`` is `bow sweep ...` with simulators that compute as all
do, but publish only as many chunks, each of them, as the file ``GATE`` says; without that file they do not wait.
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

    class GatedSimulator(SimulatorNode):
        _sent = 0

        def _publish(self, messages: Mapping[str, bytes]) -> bool:
            if not any(cdr.hello_from(STREAMS.get(topic, "Verdicts"), data) for topic, data in messages.items()):
                while self._sent >= allowed() and not self._leaving.is_set():
                    time.sleep(LOOK_S)
                self._sent += 1
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


def main() -> int:
    """Be a simulator where ROS arguments say so, else `bow`."""
    if "--ros-args" in sys.argv:
        from bow_sim.graph.node_process import run_node

        return run_node(gated_simulator)  # type: ignore[arg-type]
    from bow_sweep import entry
    from bow_sweep.processes.roles import MODULES

    MODULES["simulator"] = "gated_simulator"
    return entry.command()


if __name__ == "__main__":
    sys.exit(main())
