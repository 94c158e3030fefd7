"""The roles of the processes of a graph, the module of each, and how a new Python process runs a node."""

from __future__ import annotations

import importlib
import sys

MODULES = {
    "coordinator": "bow_sweep.coordinator.node",
    "simulator": "bow_classifier.simulator",
    "classifier": "bow_classifier.node",
    "recorder": "bow_sweep.record.node",
    "dashboard": "bow_sweep.view.node",
}
"""Role -> module with the node's main()."""

PAINTER = "bow_sweep.coordinator.painter"
"""Module of the process that draws the picture; it is no node."""

CHILD = (
    "import sys; sys.path[:] = [sys.argv.pop(1), *filter(None, sys.path)]; import bow_sim, bow_classifier, bow_sweep; "
    "del sys.path[0]; from bow_sweep.processes.roles import node; sys.exit(node())"
)
"""Code of a new Python process that runs a node. Arguments: the folder of our packages, the module, the node's own.

Our packages are imported from where the parent has them, and nothing from the working directory.
"""


def node() -> int:
    """Run the node whose module the first argument names; return its exit status."""
    sys.argv.pop(0)
    status: int = importlib.import_module(sys.argv[0]).main()
    return status
