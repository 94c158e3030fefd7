"""Messages for a simulator's session, decoded, and what stands in for the kernel."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from bow_sim.block_request import BlockRequest
from bow_sim.protocol.messages import STREAMS
from bow_sim.protocol.states import BlockState, PlanState
from bow_sim.simulator_events import ComputeChunk

OWN, COORDINATOR, STRANGER = "a" * 16, "c" * 16, "d" * 16
RUNS = [("r1", "s1"), ("r1", "s2"), ("r2", "s2")]
BLOCKS, CHUNKS = 4, 3


def plan(run: tuple[str, str] = RUNS[0], epoch: int = 1, settled: Any = (), **changes: Any) -> dict[str, Any]:
    states = np.full(BLOCKS, BlockState.OUTSTANDING, np.uint8)
    states[list(settled)] = BlockState.DONE
    values = {"run_id": run[0], "sweep_id": run[1], "epoch": epoch, "state": PlanState.OPEN, "block_states": states}
    values["spec.settings"] = []
    return {**values, "incarnation": COORDINATOR, **changes}


def block(number: int = 0, attempt: int = 1, run: tuple[str, str] = RUNS[0], **changes: Any) -> dict[str, Any]:
    values = {"run_id": run[0], "sweep_id": run[1], "coordinator": COORDINATOR, "simulator": OWN, "epoch": 1}
    return {
        **values,
        "fingerprint": "f",
        "spec.settings": [],
        "block": number,
        "attempt": attempt,
        "cells": [number],
        **changes,
    }


def receipt(entries: list[tuple[int, int, int]], run: tuple[str, str] = RUNS[0]) -> dict[str, Any]:
    """A Receipt with entries of block, chunk and kind."""
    columns = np.array(entries, np.uint32).reshape(-1, 3).T
    return {"run_id": run[0], "sweep_id": run[1], **dict(zip(("block", "chunk", "kind"), columns, strict=True))}


def request(message: dict[str, Any], record: str = "all") -> BlockRequest:
    """Stands in for bow_sim.block_request.prepare: no kernel."""
    if not message["cells"]:
        raise ValueError("cells: there should be some")
    string: Any = SimpleNamespace(parameters=SimpleNamespace(chunks=CHUNKS))
    return BlockRequest(message, string, record)


def chunk_messages(instruction: ComputeChunk) -> dict[str, bytes]:
    """Stand in for the messages of a chunk, by topic."""
    return {topic: f"{topic} {instruction.request.key} {instruction.chunk}".encode() for topic in STREAMS}
