"""What the coordinator costs with many simulators: ``python -m bench.coordinator``.

A real coordinator in a process of its own, over real DDS. This process stands for all others: recorder, classifier and
K simulators. It answers without computing: every simulator has its own heartbeat and holds its blocks, every chunk gets
verdicts with their checksum and receipts that fit, four MiB of streams a receipt, as a recorder gives them. The streams
themselves, which the coordinator does not get, are left out. So one machine can show a coordinator with 1024
simulators. What it cannot show: 1024 DDS participants, as all of these nodes share one.
"""

from __future__ import annotations

import argparse
import json
import secrets
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench.processes import memory_of
from bow_classifier.verdict.regimes import HELMHOLTZ
from bow_sim.graph.discovery import apply_defaults
from bow_sim.protocol import cdr
from bow_sim.protocol.identity import random_id
from bow_sim.protocol.states import BlockState, NodeState, PlanState, ReceiptKind
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS
from bow_sweep.plan.sweep import Sweep

PRESET = "fig11d"
SIMULATORS = (1, 8, 64, 256, 1024)
QUICK = (1, 64)
PLANES = {1: (256, 128), 8: (256, 256), 64: (512, 256), 256: (512, 512), 1024: (1024, 512)}
"""Simulators -> the plane, width and height: two blocks of 512 cells for each of them at least, one at 1024."""

CHUNKS_A_RECEIPT = 3
"""A recorder flushes after 4 MiB; a chunk of 512 cells has 1.42 MB."""

TAKEN_A_CHUNK = 8
"""Messages that are taken in for each chunk that is answered, at most: blocks come in hundreds at once, and real
simulators take them in at once too."""

BEAT_S = 1.0
IDLE_S = 5.0
PATIENCE_S = 120.0
"""Without a block that is done for this long the benchmark gives up."""


@dataclass
class Simulator:
    """One simulator that computes nothing."""

    name: str
    incarnation: str = field(default_factory=random_id)
    held: deque[tuple[int, int]] = field(default_factory=deque)
    chunk: int = 0
    beat_at: float = 0.0


class StandIn:
    """The nodes around a coordinator, all in this process."""

    def __init__(self, namespace: str, sweep: Sweep, simulators: int) -> None:
        import rclpy
        from bow_msgs.msg import Block, Health, Plan, Receipt, Verdicts
        from rclpy.context import Context
        from rclpy.experimental import EventsExecutor
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        from bow_sim.graph.node_base import LATCHED_DEEP, STREAM, WORK, RCLError

        self._rclpy, self._health_type, self._busy = rclpy, Health, RCLError
        self._namespace, self._sweep = namespace, sweep
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("bench", namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        many = QoSProfile(  # one publisher for all nodes: it must not drop one's heartbeat for another's
            depth=2 * (simulators + 2),
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._health = self._node.create_publisher(Health, "health", many)
        self._verdicts = self._node.create_publisher(Verdicts, "verdicts", STREAM)
        self._receipts = self._node.create_publisher(Receipt, "receipts", STREAM)
        self._node.create_subscription(Health, "health", self._on_health, LATCHED_DEEP)
        self._node.create_subscription(Plan, "plan", self._on_plan, LATCHED_DEEP, raw=True)
        self._node.create_subscription(Block, "blocks", self._on_block, WORK, raw=True)
        names = [f"{namespace}/simulator_{number}" for number in range(simulators)]
        self.simulators = {one.incarnation: one for one in map(Simulator, names)}
        self._consumers = {role: Simulator(f"{namespace}/{role}") for role in ("recorder", "classifier")}
        self._beats = deque((*self._consumers.items(), *(("simulator", one) for one in self.simulators.values())))
        self._started = self._node.get_clock().now().to_msg()
        self._coordinator, self._number, self._waiting = "", 0, deque[tuple[Any, bytes]]()
        self._working: deque[Simulator] = deque()
        self._beats_at = 0.0
        self._answers: list[tuple[int, int, int, int, int]] = []
        self.plan: dict[str, Any] = {}
        self.ready = False
        self.first_block_at = 0.0
        self.chunks = self.beats = 0
        regular = {name: kind.array((sweep.block_cells,)) for name, kind in VERDICT_FIELDS.items()}
        self._verdict = regular | {"regime": np.full(sweep.block_cells, HELMHOLTZ, np.uint8)}

    # ---- what the coordinator sends

    def _on_health(self, message: Any) -> None:
        if message.role == "coordinator":
            self._coordinator = message.incarnation

    def _on_plan(self, data: bytes) -> None:
        self.plan = cdr.decode("Plan", data)

    def _on_block(self, data: bytes) -> None:
        block = cdr.decode("Block", data)
        one = self.simulators.get(block["simulator"])
        if one is None or not len(block["cells"]):
            return
        self.first_block_at = self.first_block_at or time.monotonic()
        one.held.append((block["block"], block["attempt"]))
        if len(one.held) == 1:
            self._working.append(one)
        self._beat("simulator", one)

    # ---- what the others send

    def _beat(self, role: str, one: Simulator) -> None:
        """Publish the heartbeat of one node."""
        self._number += 1
        self.beats += 1
        one.beat_at = time.monotonic()
        ready = NodeState.READY if self.ready and self.plan else NodeState.STARTING
        closed = role == "recorder" and self.plan and self.plan["state"] == PlanState.CLOSED
        self._health.publish(
            self._health_type(
                role=role,
                node=one.name,
                incarnation=one.incarnation,
                host="elsewhere",
                pid=1,
                number=self._number,
                started=self._started,
                run_id=self.plan.get("run_id", ""),
                state=NodeState.CLOSED if closed else NodeState.BUSY if one.held else ready,
                hears=[f"{self._coordinator} blocks health plan"],
                held_blocks=[block for block, _ in one.held],
                held_attempts=[attempt for _, attempt in one.held],
            )
        )

    def _send(self, publisher: Any, data: bytes) -> None:
        self._waiting.append((publisher, data))

    def _flush(self) -> bool:
        """Publish what waits; return whether all of it has gone: the coordinator may have to catch up."""
        while self._waiting:
            publisher, data = self._waiting[0]
            try:
                publisher.publish(data)
            except self._busy:
                return False
            self._waiting.popleft()
        return True

    def _answer_chunk(self, one: Simulator) -> None:
        """Send verdicts for the next chunk of a simulator's block, and receipts for some chunks together."""
        (block, attempt), chunk = one.held[0], one.chunk
        cells = self._sweep.first_blocks.block(block)
        identity = {"run_id": self.plan["run_id"], "sweep_id": self.plan["sweep_id"]}
        place = {"block": block, "chunk": chunk, "attempt": attempt}
        values = {name: layer[: len(cells)] for name, layer in self._verdict.items()}
        streams = cdr.chunk_checksum(block, chunk, 1, 2)
        more = {"chunk_checksum": streams, "classifier": self._sweep.thresholds.hash, "cells": cells}
        by = {"incarnation": self._consumers["classifier"].incarnation}
        data = cdr.encode("Verdicts", {**identity, **place, **by, **more, **values})
        self._send(self._verdicts, data)
        self._answers.append((ReceiptKind.STREAMS, block, chunk, attempt, streams))
        verdicts = cdr.decode_head("Verdicts", data)["checksum"]
        self._answers.append((ReceiptKind.VERDICTS, block, chunk, attempt, verdicts))
        self.chunks += 1
        one.chunk += 1
        if one.chunk == self._sweep.chunks:
            self._answers.append((ReceiptKind.BLOCK, block, 0, attempt, 0))
            one.chunk = 0
            one.held.popleft()
            self._beat("simulator", one)
        if one.held:
            self._working.append(one)
        if len(self._answers) >= 2 * CHUNKS_A_RECEIPT or not self._working:
            names = ("kind", "block", "chunk", "attempt", "checksum")
            columns = dict(zip(names, zip(*self._answers, strict=True), strict=True))
            by = {"incarnation": self._consumers["recorder"].incarnation}
            self._send(self._receipts, cdr.encode("Receipt", {**identity, **by, **columns}))
            self._answers.clear()

    def spin(self, seconds: float) -> None:
        """Take in what has arrived, beat where it is time, and answer one chunk of every simulator that works."""
        self._executor.spin_once(timeout_sec=0.0 if self._working else seconds)
        for _ in range(TAKEN_A_CHUNK - 1 if self._working else 0):
            self._executor.spin_once(timeout_sec=0.0)
        now = time.monotonic()
        while self._beats_at < now:  # spread evenly, as those of nodes that started at different times
            self._beats_at = max(self._beats_at, now - BEAT_S) + BEAT_S / len(self._beats)
            self._beats.rotate(-1)
            if self._beats[0][1].beat_at + BEAT_S / 2 < now:
                self._beat(*self._beats[0])
        if self._flush() and self._working:
            self._answer_chunk(self._working.popleft())

    @property
    def done(self) -> int:
        """Number of blocks that the plan says are done."""
        return int(np.count_nonzero(self.plan["block_states"] == BlockState.DONE)) if self.plan else 0

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._rclpy.shutdown(context=self._context)


@contextmanager
def coordinator(namespace: str, settings: Sequence[str], folder: Path) -> Iterator[psutil.Process]:
    """Keep a real coordinator that runs one sweep."""
    words = ["-r", f"__ns:={namespace}", "-p", f"preset:={PRESET}", "-p", f"settings:=[{','.join(settings)}]"]
    words += ["-p", f"run_dir:={folder / 'run'}"]
    with open(folder / "coordinator.log", "wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", "bow_sweep", "coordinator", "--ros-args", *words],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    try:
        yield psutil.Process(process.pid)
    finally:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:  # it draws a map that nobody looks at
            process.kill()
            process.wait()


def cpu(process: psutil.Process) -> float:
    """Return the CPU seconds of a process so far."""
    return float(sum(process.cpu_times()[:2]))


def measure(simulators: int, plane: tuple[int, int] | None = None, folder: Path | None = None) -> dict[str, Any]:
    """Measure a coordinator with some simulators; CPU times are per chunk of a block of up to 512 cells.

    The heartbeats alone are measured first, with every simulator there and no work. What they cost in the time of the
    work is taken off to give `chunk_ms`, that of a chunk in the second half of the map: the first half has what comes
    once a run too, as the libraries that are imported for the map's picture, `once_s` together.

    Raises
    ------
    RuntimeError
        If the sweep does not get on.
    """
    width, height = plane or PLANES[simulators]
    settings = (f"x.count={width}", f"y.count={height}")
    sweep = Sweep.from_spec(PRESET, settings)
    apply_defaults()
    namespace = f"/bow/bench_{secrets.token_hex(4)}"
    print(f"coordinator: {simulators} simulators, {width} x {height} cells", file=sys.stderr, flush=True)
    with (
        tempfile.TemporaryDirectory(dir=folder) as made,
        coordinator(namespace, settings, Path(made)) as process,
        closing(StandIn(namespace, sweep, simulators)) as around,
    ):

        def until(what: str, holds: Any) -> None:
            """Spin until something holds, as long as blocks get done."""
            patient, done = time.monotonic() + PATIENCE_S, 0
            while not holds():
                around.spin(0.02)
                if around.done > done:
                    patient, done = time.monotonic() + PATIENCE_S, around.done
                if time.monotonic() > patient or not process.is_running() or process.status() == psutil.STATUS_ZOMBIE:
                    log = (Path(made) / "coordinator.log").read_text(errors="replace")[-2000:]
                    raise RuntimeError(f"coordinator with {simulators} simulators: {what} is missing:\n{log}")

        until("its plan", lambda: around.plan)
        settled = time.monotonic() + 2 * BEAT_S
        until("time", lambda: time.monotonic() > settled)
        began, before, beats = time.monotonic(), cpu(process), around.beats
        until("time", lambda: time.monotonic() > began + IDLE_S)
        idle, idle_beats = (cpu(process) - before) / IDLE_S, (around.beats - beats) / IDLE_S
        around.ready = True
        until("a block", lambda: around.first_block_at)
        before, own, began, chunks = cpu(process), time.process_time(), around.first_block_at, around.chunks
        every = sweep.blocks * sweep.chunks
        until("half of the chunks", lambda: 2 * around.chunks >= every)
        half, at_half, answered = time.monotonic(), cpu(process), around.chunks
        until("the last chunk", lambda: around.chunks >= every)
        second_half = cpu(process) - at_half - idle * (time.monotonic() - half)
        chunk_s = max(second_half, 0) / (around.chunks - answered)
        until("the last block", lambda: around.plan["state"] == PlanState.CLOSED)
        wall, used, own = time.monotonic() - began, cpu(process) - before, time.process_time() - own
        if around.done != sweep.blocks:
            raise RuntimeError(f"coordinator with {simulators} simulators: {around.done} of {sweep.blocks} blocks done")
        chunks, memory = around.chunks - chunks, memory_of(process.pid)
    return {
        "simulators": simulators,
        "width": width,
        "height": height,
        "blocks": sweep.blocks,
        "chunks": chunks,
        "wall_s": wall,
        "blocks_per_s": sweep.blocks / wall,
        "chunks_per_s": chunks / wall,
        "cpu_s": used,
        "busy": used / wall,
        "cpu_ms_a_chunk": 1e3 * used / chunks,
        "idle_cpu": idle,
        "idle_beats_per_s": idle_beats,
        "chunk_ms": 1e3 * chunk_s,
        "once_s": max(used - idle * wall - chunk_s * chunks, 0),
        "rss_mb": memory["rss"],
        "stand_in_cpu_ms_a_chunk": 1e3 * own / chunks,
    }


def measure_all(quick: bool = False, folder: Path | None = None) -> list[dict[str, Any]]:
    """Measure a coordinator with few and with many simulators."""
    return [measure(simulators, folder=folder) for simulators in (QUICK if quick else SIMULATORS)]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m bench.coordinator", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--simulators", type=int, nargs="+", choices=SIMULATORS, default=list(SIMULATORS))
    parser.add_argument("--dir", type=Path, help="where runs are recorded, and removed")
    chosen = parser.parse_args(arguments)
    print(json.dumps([measure(number, folder=chosen.dir) for number in chosen.simulators], indent=2))


if __name__ == "__main__":
    main()
