"""One node as a process, from its start until Ctrl-C."""

from __future__ import annotations

import ctypes
import gc
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

import rclpy
from bow_msgs.msg import Health
from rclpy.exceptions import ParameterException
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from bow_sim.graph import discovery, environment
from bow_sim.graph.leaving import LEAVE_S, cancel_exit, destroy_entities, exit_after
from bow_sim.graph.node_base import BowNode, StartupError
from bow_sim.graph.scheduling import use_batch_scheduling
from bow_sim.graph.shm_notes import Note
from bow_sim.protocol.neighbours import LEFT


def keep_freed_memory() -> None:
    """Make the C library keep freed memory: otherwise each message of 356 kB returns its pages and faults in new ones.

    It saves a sixth of the recorder's CPU time. A simulator has up to 22 MB under way, and 32 MB is the most that glibc
    takes for the second of the two. Without glibc it does nothing.
    """
    trim_threshold, mmap_threshold, kept = -1, -3, 32 << 20
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(trim_threshold, kept)
        mallopt(mmap_threshold, kept)


def run_node(
    make: Callable[[], BowNode], args: Sequence[str] | None = None, description: str = "", exit_s: float = 0.0
) -> int:
    """Run one node until SIGINT or SIGTERM; return the exit status of its process.

    Parameters
    ----------
    make
        Makes the node, in an initialised context.
    args
        Command line; that of the process if None.
    description
        What ``--help`` prints.
    exit_s
        Seconds that the process has to exit after this, where a library may wait for ever; 0 for no limit.

    Returns
    -------
    int
        The status that the node sets; 1 after an error; 2 if the environment cannot be used.
    """
    arguments = list(sys.argv if args is None else args)
    if {"-h", "--help"} & set(remove_ros_args(arguments)[1:]):
        print(description.strip())
        return 0
    environment.open_streams()
    try:
        ignored = environment.clean()
    except environment.EnvironmentProblem as error:
        print(f"{Path(arguments[0]).name if arguments else 'bow'}: {error}", file=sys.stderr)
        return 2
    if ignored:
        print(ignored, file=sys.stderr)
    discovery.apply_defaults()
    keep_freed_memory()
    use_batch_scheduling()
    node: BowNode | None = None
    status = 0
    signals: list[int] = []  # not an Event: a second signal while the first one sets it would deadlock
    for number in (signal.SIGINT, signal.SIGTERM):  # own handlers, so that a node can publish that it leaves
        signal.signal(number, lambda number, _: signals.append(number))
    gc.freeze()  # imported modules are never garbage
    gc.enable()
    note = Note()
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    executor = EventsExecutor()
    try:
        node = make()
        for each in (node, *node.companions):
            executor.add_node(each)
            each.log_ready()
        while not (signals or any(each.finished for each in (node, *node.companions))):
            executor.spin_once(timeout_sec=0.1)
            note.update()
        status = max(each.status for each in (node, *node.companions))
    except (StartupError, ParameterException) as error:
        print(f"{Path(arguments[0]).name if arguments else 'bow'}: {error}", file=sys.stderr)
        status = 1
    except Exception:
        traceback.print_exc()
        status = 1
    finally:
        if node is not None:
            try:
                for each in (*node.companions, node):
                    each.close()
                    each.log_end()
                    exit_after(LEAVE_S, status)
                    each.set_state(Health.CLOSED, LEFT)
            except Exception:
                traceback.print_exc()
                status = 1
        exit_after(LEAVE_S, status)
        executor.shutdown()
        if node is not None:
            for each in (*node.companions, node):
                each.destroy_node()
            del each
        rclpy.try_shutdown()
        node = None
        del executor
        destroy_entities()
        note.close()
        cancel_exit()
        if exit_s:
            exit_after(exit_s, status, "a library does not let this process exit: it ends without that")
    return status
