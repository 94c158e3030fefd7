"""The start of a graph: its processes, each as soon as everything is loaded that it shares with others.

They are copies of their supervisor, so ROS and the compiled kernel are loaded once for all of them. None of that makes
DDS entities, which must not be copied. Of the libraries `liblttng-ust` alone starts threads, which only wait for a
tracer; copies lack them.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import time
from collections.abc import Sequence

from bow_sim.graph.imports import absent, know_files
from bow_sim.physics.errors import ParameterError
from bow_sweep.plan.sweep import Sweep
from bow_sweep.processes.interrupts import Interrupts
from bow_sweep.processes.roles import MODULES
from bow_sweep.processes.supervisor import Supervisor

AT_ONCE, BETWEEN_S = 8, 0.1
"""This many simulators, or one for each core if that is more, start at once; the others at this interval. Each uses a
whole core while it starts."""

PACKAGES_OF_TYPES = ("bow_msgs.msg", "rcl_interfaces.msg", "rcl_interfaces.srv", "type_description_interfaces.srv")
"""Messages and services of every node. rclpy loads the code of each for its first publisher or server, 20 ms in all."""


def start_nodes(
    supervisor: Supervisor,
    sweep: Sweep,
    simulators: int,
    stations: Sequence[str],
    dashboard: bool,
    interrupts: Interrupts,
) -> None:
    """Start all processes of a graph.

    Parameters
    ----------
    sweep
        The sweep for which kernel and fingerprint are loaded.
    simulators
        Number of simulators, which are dealt out evenly to the stations.
    stations
        Names of the stations; each gets a recorder and a classifier.
    dashboard
        Whether there is a dashboard.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C or SIGTERM.
    """
    supervisor.start_painter()  # its libraries take as long to load as ROS
    with interrupts.immediate():
        load_ros("recorder", "dashboard")
    for station in stations:
        supervisor.start("recorder", station)
    if dashboard:  # it imports the most that others do not need, meanwhile, on another core
        supervisor.start("dashboard")
    with interrupts.immediate():
        load_compiled(sweep)
        load_ros("coordinator")
    supervisor.start("coordinator")  # it needs the fingerprint, and would compute it itself otherwise
    with interrupts.immediate():
        load_ros("classifier", "simulator")
    for station in stations:
        supervisor.start("classifier", station)
    start_simulators(supervisor, simulators, stations, interrupts)


def start_simulators(supervisor: Supervisor, count: int, stations: Sequence[str], interrupts: Interrupts) -> None:
    """Start simulators, dealt out evenly to stations."""
    for number in range(count):
        if number >= max(AT_ONCE, len(os.sched_getaffinity(0))):
            time.sleep(BETWEEN_S)
            interrupts.check()
        supervisor.start("simulator", stations[number % len(stations)])


def load_ros(*roles: str) -> None:
    """Import what every node needs, and the modules of some roles."""
    with absent("rosidl_generator_py.generate_py_impl"):  # makes code of messages; they would import it beside theirs
        importlib.import_module("bow_sweep.processes.supervisor_node")
        for role in roles:
            importlib.import_module(MODULES[role])
        from rclpy.type_support import check_for_type_support

        for package in PACKAGES_OF_TYPES:
            for kind in vars(importlib.import_module(package)).values():
                if isinstance(kind, type):
                    check_for_type_support(kind)  # loads its code in C
    know_files()


def load_compiled(sweep: Sweep) -> None:
    """Load the compiled kernel and classifier, or compile them, and compute the fingerprint of the sweep."""
    with absent("coverage", "scipy"):  # Numba would measure what it compiles, and compile linear algebra
        import numba  # noqa: F401

    from bow_classifier.precompile import precompile
    from bow_sim.kernel.block import Block
    from bow_sim.physics.kinds import common

    Block(*common(sweep.parameters, sweep.lanes(sweep.block(0)))[:2]).advance()
    precompile()
    with contextlib.suppress(ParameterError):  # the coordinator reports it
        _ = sweep.fingerprint
