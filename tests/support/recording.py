"""Material for tests of the record: the real messages of a small sweep, and a recorder process that gets them."""

from __future__ import annotations

import functools
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from outlines import outline

from bow_classifier.stream import Classifier
from bow_classifier.task import Task
from bow_sim.graph.discovery import apply_defaults
from bow_sim.kernel.block import Block
from bow_sim.protocol import cdr
from bow_sim.protocol.blocks import Blocks
from bow_sim.protocol.states import BlockState, NodeState, PlanState
from bow_sweep.coordinator.results import basin_of, map_of, playability_of
from bow_sweep.maps.map_file import MAP, write_map_npz
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.bag import messages
from bow_sweep.record.replay import load_verdicts
from bow_sweep.record.session import Session
from bow_sweep.record.topics import STORED_ONCE, full_names
from bow_sweep.run.directory import Run
from bow_sweep.run.ledger import State

RUN = "0123456789abcdef"
NAMESPACE = f"/bow/run_{RUN}"
NAMES = full_names()
SMALL = ("model=delta_cremer", "x.count=4", "y.count=3", "block_cells=5", "periods=20")


@functools.cache
def small_sweep(*settings: str) -> Sweep:
    """Return a sweep of 12 cells in blocks of 5, 5 and 2, four chunks each."""
    return Sweep.from_spec("", (*SMALL, *settings))


@dataclass(frozen=True)
class Chunk:
    """The three sealed messages of a chunk."""

    bridge_force: bytes
    stick_slip: bytes
    verdicts: bytes

    def items(self) -> Iterator[tuple[str, bytes]]:
        return iter(vars(self).items())


def plan(
    sweep: Sweep,
    state: int = PlanState.OPEN,
    epoch: int = 1,
    states: Any = None,
    run: str = RUN,
    rounds: Any = None,
    incarnation: str = "c" * 16,
) -> bytes:
    """Return a Plan message."""
    return cdr.encode(
        "Plan",
        {
            "run_id": run,
            "sweep_id": sweep.sweep_id,
            "epoch": epoch,
            "state": state,
            "spec.preset": "",
            "spec.settings": sweep.settings(),
            "fingerprint": sweep.fingerprint,
            "classifier": sweep.thresholds.hash,
            "block_states": np.zeros(sweep.blocks, np.uint8) if states is None else states,
            "rounds": sweep.first_blocks.announce() if rounds is None else rounds,
            "incarnation": incarnation,
        },
    )


@functools.cache
def chunks(
    sweep: Sweep, block: int, attempt: int = 1, run: str = RUN, blocks: Blocks | None = None
) -> tuple[Chunk, ...]:
    """Return the messages of simulator and classifier for a block: waveforms of the real kernel, real verdicts."""
    blocks = blocks or sweep.first_blocks
    cells = blocks.block(block)
    string = Block(sweep.parameters, sweep.lanes(cells))
    classifier = Classifier("c" * 16)
    classifier.open(Task.of(outline(run, sweep.sweep_id, sweep.settings(), blocks.announce())))
    out = []
    for chunk in range(sweep.chunks):
        result = string.advance()
        samples = result.bridge_force.shape[1]
        values = {
            "run_id": run,
            "sweep_id": sweep.sweep_id,
            "block": block,
            "chunk": chunk,
            "attempt": attempt,
            "incarnation": "5" * 16,
            "cells": cells,
            "first_sample": chunk * samples,
            "samples": samples,
            "data": result.bridge_force,
            **result._asdict(),
        }
        force, slip = cdr.encode("BridgeForce", values), cdr.encode("StickSlip", values)
        classifier.take("BridgeForce", force)
        out.append(Chunk(force, slip, classifier.take("StickSlip", slip)[0]))
    return tuple(out)


def inspected(chunk: Chunk, **changes: Any) -> bytes:
    """Return the InspectedCell of the first cell of a chunk."""
    values = cdr.decode("BridgeForce", chunk.bridge_force)
    own = {"cell": values["cells"][0], "name": "x = 1, y = 2", "sample_rate": 61160.0}
    force = values["data"][: values["samples"]]
    waveform = {"periods": np.arange(len(force)) / 139, "bridge_force": force}
    return cdr.encode("InspectedCell", {**values, **own, **waveform, **changes})


def everything(sweep: Sweep, attempt: int = 1) -> Iterator[tuple[str, bytes]]:
    """Yield (topic, message) of a whole sweep."""
    for block in range(sweep.blocks):
        for chunk in chunks(sweep, block, attempt):
            yield from chunk.items()


def session(directory: Path, sweep: Sweep, epoch: int = 1) -> Session:
    """Return a session as the recorder would open it."""
    data = plan(sweep, epoch=epoch)
    return Session(directory, cdr.decode("Plan", data), data, "7" * 16, time.time_ns())


def finish(open_session: Session, sweep: Sweep, epoch: int = 1) -> None:
    """Close a session with a plan on which every block is done."""
    data = plan(sweep, PlanState.CLOSED, epoch, np.full(sweep.blocks, BlockState.DONE, np.uint8))
    open_session.plan(cdr.decode("Plan", data), data, time.time_ns())
    open_session.close(time.time_ns())


def leave_all(directory: Path, sweep: Sweep, quarantined: Collection[int] = ()) -> Path:
    """Write the files of a coordinator beside a recorded bag; return the directory."""
    run = Run.create(directory, RUN, sweep)
    for number, block in enumerate(run.ledger.blocks):
        block.state = State.QUARANTINED if number in quarantined else State.DONE
        run.record([{"event": "dispatched", "block": number, "attempt": 1}])
        run.record([{"event": block.state.value, "block": number, "why": "poison"}])
    run.quarantined = dict.fromkeys(quarantined, "poison")
    basin = basin_of(load_verdicts(directory), sweep)
    write_map_npz(directory / MAP, map_of(run, basin))
    run.report(basin, 1.0, {"playability": playability_of(run, basin)})
    run.close()
    return directory


def record(directory: Path, sweep: Sweep, commit_every: int = 7) -> Path:
    """Record a whole sweep without ROS; return the run directory."""
    recording = session(directory, sweep)
    for number, (topic, data) in enumerate(everything(sweep)):
        recording.take(topic, data, time.time_ns())
        if number % commit_every == 0:
            recording.commit(time.time_ns())
    finish(recording, sweep)
    return directory


def copy(run: Path, to: Path) -> None:
    """Copy a run directory."""
    shutil.copytree(run, to)


# ---- a recorder process


@dataclass
class Graph:
    """A node of the test and a recorder process, in a ROS domain of their own."""

    directory: Path
    node: Any
    executor: Any
    environment: dict[str, str]
    answers: list[dict[str, Any]] = field(default_factory=list)
    health: list[Any] = field(default_factory=list)
    publishers: dict[str, Any] = field(default_factory=dict)
    process: subprocess.Popen[bytes] | None = None

    def start_recorder(self, *parameters: str) -> None:
        """Start the recorder and wait until its subscriptions are matched."""
        arguments = ["--ros-args", "-r", f"__ns:={NAMESPACE}", "-p", f"run_dir:={self.directory}"]
        arguments += [part for parameter in parameters for part in ("-p", parameter)]
        command = [sys.executable, "-m", "bow_sweep.record.node", *arguments]
        self.process = subprocess.Popen(command, env=self.environment)
        pid = self.process.pid
        self.until(lambda: any(h.pid == pid and h.state != 0 for h in self.health), "the recorder is up")
        # matched by the running recorder: the endpoints of a killed one stay for the lease duration
        living = f"{NAMESPACE}/bridge_force"
        gids = self._recorders(living)
        self.until(lambda: bool(self._recorders(living)) and self._matched(), f"streams are matched {gids}")

    def _recorders(self, topic: str) -> set[bytes]:
        infos = self.node.get_subscriptions_info_by_topic(topic)
        return {bytes(i.endpoint_gid) for i in infos if i.node_name == "recorder"}

    def _matched(self) -> bool:
        return all(
            publisher.get_subscription_count() >= len(self._recorders(f"{NAMESPACE}/{name}")) > 0
            for name, publisher in self.publishers.items()
        )

    def publish(self, topic: str, data: bytes) -> None:
        if topic == "plan":  # from a coordinator that sends heartbeats and works for the run
            plan = {**cdr.decode("Plan", data), "incarnation": self.node.incarnation}
            self.node.set_state(NodeState.BUSY, "", plan["run_id"])
            data = cdr.encode("Plan", plan)
        self.publishers[topic].publish(data)

    def on_receipts(self, data: bytes) -> None:
        receipt = cdr.decode("Receipt", data)
        self.node.heard("receipts", receipt["incarnation"])
        self.answers.append(receipt)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def until(self, condition: Callable[[], bool], what: str, timeout: float = 60.0) -> None:
        """Spin until a condition holds; after a time limit fail, naming the condition."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f"waited {timeout} s until {what}"
            assert self.process is None or self.process.poll() is None, f"the recorder died, waiting until {what}"
            self.executor.spin_once(timeout_sec=0.02)

    def answered(self) -> set[tuple[int, int, int, int]]:
        """Return (kind, block, chunk, attempt) of all receipts so far."""
        names = ("kind", "block", "chunk", "attempt")
        return {entry for a in self.answers for entry in zip(*(a[n].tolist() for n in names), strict=True)}

    def state(self) -> int:
        """Return the state in the recorder's latest health message."""
        assert self.process is not None
        return next((int(h.state) for h in reversed(self.health) if h.pid == self.process.pid), -1)

    def kill(self) -> None:
        """SIGKILL the recorder."""
        assert self.process is not None
        self.process.kill()
        self.process.wait()
        self.process = None

    def stop(self) -> int:
        """SIGTERM the recorder; return its exit status."""
        assert self.process is not None
        self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(60)
        self.process = None
        return status


@contextmanager
def graph(directory: Path, domain: int) -> Iterator[Graph]:
    """Make a node in a context of its own; stop all processes at the end."""
    import rclpy
    from bow_msgs.msg import BridgeForce, Health, Plan, Receipt, StickSlip, Verdicts
    from rclpy.executors import SingleThreadedExecutor

    from bow_sim.graph.node_base import LATCHED, STREAM, STREAM_WRITER, BowNode

    apply_defaults()
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    node = BowNode("coordinator", namespace=NAMESPACE, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    made = Graph(directory, node, executor, {**os.environ, "ROS_DOMAIN_ID": str(domain)})
    for name, kind in (("bridge_force", BridgeForce), ("stick_slip", StickSlip), ("verdicts", Verdicts)):
        made.publishers[name] = node.create_publisher(kind, name, STREAM if kind is Verdicts else STREAM_WRITER)
    made.publishers["plan"] = node.create_publisher(Plan, "plan", LATCHED)
    node.create_subscription(Receipt, "receipts", made.on_receipts, STREAM, raw=True)
    node.create_subscription(Health, "health", made.health.append, 100)
    try:
        yield made
    finally:
        if made.process is not None:
            made.process.terminate()  # SIGKILL would leave its shared memory behind
            made.process.wait(30)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def whats(result: Mapping[str, Any]) -> str:
    """Return the problems that a verification found."""
    return " | ".join(problem["what"] for problem in result["problems"])


def quarantined_run(run: Path) -> None:
    """Record the small sweep with block 1 quarantined after one chunk."""
    sweep = small_sweep()
    made = session(run, sweep)
    for topic, data in everything(sweep):
        head = cdr.decode_head(STORED_ONCE[topic], data)
        if head["block"] != 1 or head["chunk"] == 0:
            made.take(topic, data, time.time_ns())
    states = np.array([BlockState.DONE, BlockState.QUARANTINED, BlockState.DONE], np.uint8)
    message = plan(sweep, PlanState.CLOSED, states=states)
    made.plan(cdr.decode("Plan", message), message, time.time_ns())
    made.close(time.time_ns())


def recorded_force(run: Path, cell: int) -> np.ndarray:
    """The bridge force of a cell, by reading all of the bag, (samples,)."""
    found = {}
    for message in messages(run / "bag"):
        if message.topic == "bridge_force":
            values = cdr.unseal("BridgeForce", message.data)
            if cell in values["cells"]:
                row = values["cells"].tolist().index(cell)
                found[values["chunk"]] = values["data"].reshape(-1, values["samples"])[row].copy()
    return np.concatenate([found[chunk] for chunk in sorted(found)])
