"""A simulator that dies of one block, and a `bow` that starts such simulators instead of its own.

``python -m poison_simulator sweep ...`` is `bow sweep ...`, but its supervisor starts this module as its simulators:
real nodes that compute as all do, until they have published `CHUNK` of block ``POISON_BLOCK``. Then they end without a
word, by a wild read (``POISON_DEATH=SIGSEGV``) or as a library that gives up ends them (``POISON_DEATH=exit``).
"""

from __future__ import annotations

import ctypes
import os
import resource
import sys
from collections.abc import Mapping

CHUNK = 2
"""Chunks of the block that go out before: the others have to cope with half a block."""


def poison_simulator() -> object:
    """Return the node; what it needs is loaded here, for a `bow` that copies itself must not have loaded ROS."""
    from bow_sim.node import SimulatorNode
    from bow_sim.protocol import cdr

    class PoisonSimulator(SimulatorNode):
        def _publish(self, messages: Mapping[str, bytes]) -> bool:
            published = super()._publish(messages)
            seen = cdr.identity(cdr.decode("BridgeForce", messages["bridge_force"]))
            if (seen.block, seen.chunk) == (int(os.environ["POISON_BLOCK"]), CHUNK):
                die()
            return published

    return PoisonSimulator()


def die() -> None:
    if os.environ["POISON_DEATH"] == "exit":
        os._exit(1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    ctypes.string_at(1)


def main() -> int:
    """Be a simulator where ROS arguments say so, else `bow`."""
    if "--ros-args" in sys.argv:
        from bow_sim.graph.node_process import run_node

        return run_node(poison_simulator)  # type: ignore[arg-type]
    from bow_sweep import cli
    from bow_sweep.processes import supervisor

    supervisor.MODULES["simulator"] = "poison_simulator"
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
