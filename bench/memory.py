"""Whether memory stays flat: twenty maps in a row through one graph that is kept: ``python -m bench.memory``.

The nodes are started one by one, as `ros2 run bow ...` starts them, and get one goal after the other. After each map
the memory of every process is read; growth is that from the second quarter of the maps to the last.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bench.graph import PRESET, QUICK, cores, size_settings
from bench.processes import memory_of
from bow_sim.ros import use_local_defaults

MAPS = 20
ALLOWED_MB = 6.0
"""Growth over half of the maps that still counts as flat; the streams of a map of 64 x 32 are 114 MB."""

PATIENCE_S = 90.0
ROLES = ("coordinator", "recorder", "dashboard", "classifier")


@contextlib.contextmanager
def standing_graph(namespace: str, folder: Path, simulators: int) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    """Keep the nodes of a graph, one process each: name -> process; their logs and runs are in `folder`."""
    use_local_defaults()
    processes: dict[str, subprocess.Popen[bytes]] = {}
    names = {role: role for role in ROLES} | {f"simulator_{k + 1}": "simulator" for k in range(simulators)}
    try:
        for name, role in names.items():
            words = ["--ros-args", "-r", f"__ns:={namespace}", "-r", f"__node:={name}"]
            if role in ("coordinator", "recorder", "dashboard"):
                words += ["-p", f"runs_dir:={folder / 'runs'}"]
            with open(folder / f"{name}.log", "wb") as output:
                processes[name] = subprocess.Popen(
                    [sys.executable, "-m", "bow_sweep.cli", role, *words],
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
        self._node = rclpy.create_node("memory", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._action = ActionClient(self._node, RunSweep, "run_sweep")

    def _until(self, future: Any) -> Any:
        self._executor.spin_until_future_complete(future, PATIENCE_S)
        if not future.done():
            raise TimeoutError(f"no answer from the coordinator in {PATIENCE_S:.0f} s")
        return future.result()

    def sweep(self, settings: Sequence[str]) -> Any:
        """Run a sweep and return its result.

        Raises
        ------
        RuntimeError
            Where it is refused or leaves a cell out.
        """
        from bow_msgs.msg import SweepSpec

        if not self._action.wait_for_server(PATIENCE_S):
            raise TimeoutError("no coordinator")
        goal = self._type.Goal(spec=SweepSpec(preset=PRESET, settings=list(settings)))
        handle = self._until(self._action.send_goal_async(goal))
        if not handle.accepted:
            raise RuntimeError("the coordinator refused the sweep; its log says why")
        result = self._until(handle.get_result_async()).result
        if result.cells_done != result.cells_planned:
            raise RuntimeError(f"the sweep left cells out: {result.message}")
        return result

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._rclpy.shutdown(context=self._context)


def growth(rss: Sequence[float]) -> dict[str, float]:
    """Return MB after the first map, the greatest of the second and of the last quarter of maps, and their difference.

    By the second quarter all is filled that is kept for later maps; the greatest counts, as memory goes up and down.
    """
    quarter = max(1, len(rss) // 4)
    early, late = max(rss[-3 * quarter : -2 * quarter] or rss), max(rss[-quarter:])
    return {"first_mb": rss[0], "early_mb": early, "late_mb": late, "growth_mb": late - early}


def measure(maps: int = MAPS, size: tuple[int, int] = QUICK, folder: Path | None = None) -> dict[str, Any]:
    """Run maps in a row; return the memory of each process after each, and whether it stayed flat."""
    namespace = f"/bow/bench_{secrets.token_hex(4)}"
    history: dict[str, list[float]] = {}
    anonymous: dict[str, list[float]] = {}
    walls = []
    made = Path(tempfile.mkdtemp(prefix="bow-memory-", dir=folder))  # left where it is if something goes wrong
    with standing_graph(namespace, made, cores()) as processes, contextlib.closing(Client(namespace)) as client:
        for number in range(maps):
            began = time.perf_counter()
            try:
                result = client.sweep(size_settings(*size))
            except (TimeoutError, RuntimeError) as error:
                raise RuntimeError(f"map {number + 1}: {error}; logs are in {made}") from None
            walls.append(time.perf_counter() - began)
            shutil.rmtree(result.directory, ignore_errors=True)
            for name, process in processes.items():
                memory = memory_of(process.pid)
                history.setdefault(name, []).append(memory["rss"])
                anonymous.setdefault(name, []).append(memory["anonymous"])
            sizes = ", ".join(f"{name} {rss[-1]:.0f}" for name, rss in history.items())
            print(f"memory: map {number + 1} of {maps}, {walls[-1]:.1f} s: {sizes} MB", file=sys.stderr, flush=True)
    shutil.rmtree(made, ignore_errors=True)
    grown = {name: growth(rss) for name, rss in history.items()}
    return {
        "maps": maps,
        "width": size[0],
        "height": size[1],
        "wall_s": walls,
        "flat": all(one["growth_mb"] <= ALLOWED_MB for one in grown.values()),
        "allowed_mb": ALLOWED_MB,
        "growth": grown,
        "rss_mb": history,
        "anonymous_mb": anonymous,
    }


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.memory", description=__doc__)
    parser.add_argument("--maps", type=int, default=MAPS)
    parser.add_argument("--size", type=int, nargs=2, default=QUICK, metavar=("NX", "NY"))
    parser.add_argument("--dir", type=Path, help="where runs are recorded, and removed")
    chosen = parser.parse_args(arguments)
    result = measure(chosen.maps, tuple(chosen.size), chosen.dir)
    print(json.dumps(result, indent=2))
    return 0 if result["flat"] else 1


if __name__ == "__main__":
    sys.exit(main())
