"""A graph that is kept for several maps: its nodes, started one by one as `ros2 run bow ...` does, and a client."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bow_sim.graph.discovery import apply_defaults

PATIENCE_S = 90.0
ROLES = ("coordinator", "recorder", "dashboard", "classifier")


@contextlib.contextmanager
def standing_graph(namespace: str, folder: Path, simulators: int) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Keep the nodes of a graph, one process each: name -> process; their logs and runs are in `folder`."""
    apply_defaults()
    processes: dict[str, subprocess.Popen[bytes]] = {}
    names = {role: role for role in ROLES} | {f"simulator_{k + 1}": "simulator" for k in range(simulators)}
    try:
        for name, role in names.items():
            words = ["--ros-args", "-r", f"__ns:={namespace}", "-r", f"__node:={name}"]
            if role in ("coordinator", "recorder", "dashboard"):
                words += ["-p", f"runs_dir:={folder / 'runs'}"]
            with open(folder / f"{name}.log", "wb") as output:
                processes[name] = subprocess.Popen(
                    [sys.executable, "-m", "bow_sweep", role, *words],
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    env={**os.environ, "ROS_LOG_DIR": str(folder)},
                )
        yield processes
    finally:
        for process in processes.values():
            process.terminate()
        for process in processes.values():
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


class Client:
    """Sends goals to a coordinator, each when the one before is done."""

    def __init__(self, namespace: str) -> None:
        import rclpy
        from bow_msgs.action import RunSweep
        from rclpy.action import ActionClient
        from rclpy.context import Context
        from rclpy.executors import SingleThreadedExecutor

        self._rclpy, self._type = rclpy, RunSweep
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("bench", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._action = ActionClient(self._node, RunSweep, "run_sweep")

    def _until(self, future: Any) -> Any:
        self._executor.spin_until_future_complete(future, PATIENCE_S)
        if not future.done():
            raise TimeoutError(f"no answer from the coordinator in {PATIENCE_S:.0f} s")
        return future.result()

    def sweep(self, preset: str, settings: Sequence[str]) -> Any:
        """Run a sweep and return its result.

        Raises
        ------
        RuntimeError
            Where it is refused or leaves a cell out.
        """
        from bow_msgs.msg import SweepSpec

        if not self._action.wait_for_server(PATIENCE_S):
            raise TimeoutError("no coordinator")
        goal = self._type.Goal(spec=SweepSpec(preset=preset, settings=list(settings)))
        handle = self._until(self._action.send_goal_async(goal))
        result = self._until(handle.get_result_async()).result
        if not result.run_id:
            raise RuntimeError(f"the coordinator refused the sweep: {result.message}")
        if result.cells_done != result.cells_planned:
            raise RuntimeError(f"the sweep left cells out: {result.message}")
        return result

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._rclpy.shutdown(context=self._context)
