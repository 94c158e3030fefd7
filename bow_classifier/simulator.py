"""The simulator node as it is started: with what judges its blocks where a sweep records verdicts only."""

from __future__ import annotations

import sys

from bow_classifier.at_source import Judges
from bow_sim.graph.node_process import run_node
from bow_sim.node import HELP, SimulatorNode


def main() -> int:
    """Entry point of ``ros2 run bow simulator``."""
    return run_node(lambda: SimulatorNode(Judges().of_block), description=HELP)


if __name__ == "__main__":
    sys.exit(main())
