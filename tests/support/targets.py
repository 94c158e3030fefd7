"""What a stranger can hand to this package, and what must come of it: each target takes chance and makes one case.

A case passes where the answer is right or a clear refusal; whatever else is raised, is a bug. Chance is a
:class:`random.Random`: Hypothesis brings its own and shrinks, ``python tests/stress/fuzz.py`` brings seeds.
"""

from __future__ import annotations

import functools
import json
import random
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import recording
from chance import mutated, odd_array, odd_json, odd_text, sealed
from material import odd_archive, odd_settings, odd_yaml

from bow_classifier.stream import Classifier
from bow_classifier.task import Task
from bow_sim import simulator_events
from bow_sim.kernel.block import Block
from bow_sim.physics.errors import ParameterError
from bow_sim.physics.kinds import common
from bow_sim.protocol import cdr
from bow_sim.protocol.limits import MAX_BLOCK_CELLS, MAX_CELLS, MAX_VERDICTS
from bow_sim.protocol.neighbours import Neighbours
from bow_sim.protocol.states import NodeState
from bow_sim.protocol.sweep_outline import SweepOutline
from bow_sim.simulator_session import SimulatorSession
from bow_sweep.coordinator.resume import prepare
from bow_sweep.coordinator.session import CoordinatorSession
from bow_sweep.coordinator.session_events import ReceiptReceived, RunGiven, VerdictsReceived
from bow_sweep.maps.basin_map import Basin
from bow_sweep.maps.map_file import MapFile, MapFileError, read_map_npz, write_map_npz
from bow_sweep.plan import presets as plans
from bow_sweep.plan.sweep import Sweep
from bow_sweep.record.bag import METADATA, BagError, bag_files
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.recover import recover
from bow_sweep.record.replay import load_verdicts, replay
from bow_sweep.record.verify import verify
from bow_sweep.run.directory import Run, RunError, is_finished, read_ledger
from bow_sweep.run.ledger import Ledger

Chance = random.Random
Case = Callable[[Chance], None]

SWEEP = recording.small_sweep()
CHUNK = recording.chunks(SWEEP, 1)[2]


class Targets:
    """All targets, with the files that they change in a room of their own.

    Parameters
    ----------
    room
        An empty directory.
    """

    def __init__(self, room: Path) -> None:
        self.room = room
        self.run = recording.record(room / "run", SWEEP)
        self.bag = bag_files(self.run / "bag")[0]
        self.whole_bag = self.bag.read_bytes()
        self.metadata = (self.run / "bag" / METADATA).read_bytes()
        self.map = room / "map.npz"
        basin = Basin(SWEEP.x.count, SWEEP.y.count, SWEEP.chunks)
        write_map_npz(self.map, MapFile.of(SWEEP, basin, recording.RUN))
        self.whole_map = self.map.read_bytes()
        self.presets = room / "presets"
        self.presets.mkdir()
        self.texts = {path.name: path.read_bytes() for path in plans.preset_directory().glob("*.yaml")}
        self.finished = recording.leave_all(recording.record(room / "finished", SWEEP), SWEEP)
        self.left = {name: (self.finished / name).read_bytes() for name in ("ledger.jsonl", "map.npz", "report.json")}
        run = Run.create(room / "ledgers", recording.RUN, SWEEP)
        run.close()
        self.planned = json.loads((room / "ledgers" / "ledger.jsonl").read_bytes())
        self.listing = sorted(path.name for path in room.iterdir())

    def all(self) -> dict[str, tuple[int, Case]]:
        """Return the targets by name, each with its share of the cases."""
        return {
            "goal": (16, self.goal),
            "plan": (16, self.plan),
            "wire": (30, self.wire),
            "block": (6, self.block),
            "answers": (8, self.answers),
            "stream": (8, self.stream),
            "preset": (4, self.preset),
            "ledger": (6, self.ledger),
            "map": (4, self.map_file),
            "scan": (6, self.scan),
            "bag": (1, self.damaged_run),
            "beside": (2, self.beside_the_bag),
        }

    def check_room(self) -> None:
        """Nothing was written beside what is there."""
        assert sorted(path.name for path in self.room.iterdir()) == self.listing

    # ---- what describes a sweep

    def goal(self, chance: Chance) -> None:
        """A RunSweep goal is a sweep that can be run within bounds, and its written form says the same; or refused."""
        preset = chance.choice(["", "", "fig11d", "schelleng", "raman", "../fig11d", odd_text(chance)])
        try:
            sweep = Sweep.from_spec(preset, odd_settings(chance))
        except ParameterError as error:
            assert str(error)
            return
        assert sweep.cells <= MAX_CELLS
        assert sweep.cells * sweep.chunks <= MAX_VERDICTS
        again = Sweep.from_spec("", sweep.settings())
        assert again.settings() == sweep.settings()
        assert len(sweep.block(sweep.blocks - 1)) <= MAX_BLOCK_CELLS
        if chance.random() < 0.05 and sweep.cells <= 1 << 16:
            Block(*common(sweep.parameters, sweep.lanes(sweep.block(0)))[:2])

    def plan(self, chance: Chance) -> None:
        """A plan is taken where it fits the bounds, or refused."""
        lines = {line.partition("=")[0]: line for line in SWEEP.settings()}
        for line in odd_settings(chance):
            lines[line.partition("=")[0]] = line
        for _ in range(chance.randrange(3)):
            lines.pop(chance.choice(sorted(lines)), None)
        values = cdr.decode("Plan", recording.plan(SWEEP)) | {"spec.settings": list(lines.values())}
        if chance.random() < 0.3:
            values["run_id"] = odd_text(chance)
        if chance.random() < 0.3:
            values["rounds"] = odd_array(chance, chance.choice([0, 1, 12, 12, 13]), np.uint8)
        try:
            made = SweepOutline.of(values)
            Task.of(made)
        except ParameterError:
            return
        assert made.cells <= MAX_CELLS
        assert made.cells * made.chunks <= MAX_VERDICTS
        assert len(made.block(0)) <= MAX_BLOCK_CELLS

    def preset(self, chance: Chance) -> None:
        """A preset file that is none is named as such, and does not keep the others from use."""
        name = chance.choice(sorted(self.texts))
        text = mutated(chance, self.texts[name]) if chance.random() < 0.8 else odd_yaml(chance)
        path = self.presets / name
        path.write_bytes(text)
        (self.presets / "good.yaml").write_bytes(self.texts["raman.yaml"])
        before, plans.preset_directory = plans.preset_directory, lambda: self.presets
        try:
            assert {"good", path.stem} == set(plans.presets())
            Sweep.from_spec("good")
            Sweep.from_spec(path.stem)
        except ParameterError as error:
            assert str(error)
        finally:
            plans.preset_directory = before
            for file in self.presets.iterdir():
                file.unlink()

    # ---- what comes as messages

    def wire(self, chance: Chance) -> None:
        """Bytes are the message they should be or refused; what is read is no larger than they are."""
        name = chance.choice(sorted(cdr.FIELDS))
        data = chance.choice([mutated(chance, messages()[name]), cdr.ENCAPSULATION + chance.randbytes(200)])
        readers: list[Callable[[str, bytes], Any]] = [cdr.decode]
        if cdr.is_sealed(name):
            readers.append(cdr.unseal)
        for read in readers:
            try:
                values = read(name, data)
            except cdr.WireError:
                continue
            assert sum(np.size(value) for value in values.values()) <= 2 * len(data) + len(values)

    def block(self, chance: Chance) -> None:
        """A Block message is one that can be computed, or it is said why not."""
        lines = list(SWEEP.settings()) if chance.random() < 0.7 else []
        settings = [line.replace("\0", "") for line in [*lines, *odd_settings(chance)]]
        count = chance.choice([0, 1, 5, 8, 2000])
        message = {"run_id": "run", "sweep_id": "s", "epoch": 1, "fingerprint": "f", "block": 0, "attempt": 1}
        message |= {"spec.settings": settings, "cells": odd_array(chance, count, np.uint32)}
        message |= {axis: odd_array(chance, count, np.float64) for axis in ("x", "y")}
        message |= {"coordinator": "c", "simulator": "s"}
        session = SimulatorSession("s", lambda _: "f", lambda *_: True)
        session.run, session.state = ("run", "s"), NodeState.READY
        out = session.handle(simulator_events.BlockReceived(message), 0.0)
        assert session.held == [(0, 1)] or any(isinstance(item, simulator_events.Log) and item.text for item in out)

    def answers(self, chance: Chance) -> None:
        """Receipts and verdicts that don't fit are counted by simulator and coordinator, and no more."""
        name = chance.choice(["Receipt", "Verdicts"])
        values = cdr.decode(name, messages()[name])
        for field, kind in cdr.FIELDS[name].items():
            if kind.endswith("[]") and chance.random() < 0.4:
                values[field] = odd_array(chance, chance.randrange(12), kind[:-2])
            elif kind == "uint32" and chance.random() < 0.3:
                values[field] = chance.choice([0, 3, 4, 2**32 - 1])
        data = cdr.encode(name, values)
        no_run: Any = None
        session = CoordinatorSession("c" * 16, "here", "/bow", Neighbours("c" * 16, "here"), no_run, lambda: 0.0)
        run: Any = SimpleNamespace(run_id=recording.RUN, sweep=SWEEP, blocks=SWEEP.first_blocks, directory=self.room)
        run.ledger, run.cells_in = Ledger(SWEEP.blocks, SWEEP.chunks), lambda _: 0
        run.record, run.next_round, run.accounts, run.quarantined = list, lambda _: False, Counter, {}
        session.handle(RunGiven(run), 0.0)
        session.handle(ReceiptReceived(data) if name == "Receipt" else VerdictsReceived(data), 0.0)
        simulator = SimulatorSession("s", lambda _: "f", lambda *_: True)
        simulator.run, simulator._window = (recording.RUN, SWEEP.sweep_id), recording_window()
        if name == "Receipt":
            simulator.handle(simulator_events.ReceiptReceived(cdr.decode(name, data)), 0.0)

    def stream(self, chance: Chance) -> None:
        """The classifier judges a chunk or says why not, whatever its numbers are."""
        classifier = Classifier("c" * 16)
        if chance.random() < 0.2:
            classifier.plan(mutated(chance, recording.plan(SWEEP)))
        else:
            classifier.plan(recording.plan(SWEEP))
        first = recording.chunks(SWEEP, 1)[0]
        name, original = chance.choice([("BridgeForce", first.bridge_force), ("StickSlip", first.stick_slip)])
        other = {"BridgeForce": "StickSlip", "StickSlip": "BridgeForce"}[name]
        out = classifier.take(other, {"BridgeForce": first.bridge_force, "StickSlip": first.stick_slip}[other])
        out += classifier.take(name, sealed(chance, name, original))
        for data in out:
            cdr.unseal("Verdicts", data)
        assert len(out) <= 1
        waits = any(block.waiting[name] for block in classifier._blocks.values())  # a later chunk, itself right
        assert out or waits or classifier.complaints or classifier.task is None or classifier.problem

    # ---- what comes as files

    def ledger(self, chance: Chance) -> None:
        """A run is gone on with, or refused with the line that is wrong; nothing else is touched."""
        entries = [dict(self.planned)]
        for _ in range(chance.randrange(12)):
            event = chance.choice(["dispatched", "died", "done", "quarantined", "reopened", "due", "resumed", "round"])
            entry: dict[str, Any] = {"event": event, "block": chance.randrange(4), "attempt": 1, "alone": True}
            if event == "round":
                entry |= {"cells": odd_array(chance, chance.randrange(5), np.uint8).tolist(), "blocks": 3}
            entries.append(entry)
        for _ in range(chance.randrange(4)):
            entry = chance.choice(entries)
            if chance.random() < 0.3 and entry:
                entry.pop(chance.choice(sorted(entry)))
            else:
                entry[chance.choice([*self.planned, "block", "attempt", "alone", "event", "x"])] = odd_json(chance)
        text = b"".join(json.dumps(entry).encode() + b"\n" for entry in entries)
        if chance.random() < 0.4:
            text = mutated(chance, text)
        directory = self.room / "ledgers"
        (directory / "ledger.jsonl").write_bytes(text)
        try:
            read = read_ledger(directory)
            is_finished(directory, read)
            run = Run.resume(directory)
        except RunError as error:
            assert str(directory) in str(error)
        else:
            accounts = run.accounts()
            assert accounts["planned"] == accounts["done"] + accounts["quarantined"] + accounts["outstanding"]
            run.close()
        try:
            prepare(directory)
        except RunError as error:
            assert str(directory) in str(error)
        for path in directory.glob("ledger.jsonl.torn*"):
            path.unlink()
        assert {path.name for path in directory.iterdir()} <= _LEDGER_FILES

    def map_file(self, chance: Chance) -> None:
        """A map is read with arrays that fit each other, or refused."""
        data = mutated(chance, self.whole_map) if chance.random() < 0.5 else odd_archive(chance, self.whole_map)
        self.map.write_bytes(data)
        try:
            plane = read_map_npz(self.map)
        except MapFileError as error:
            assert str(self.map) in str(error)
            return
        assert plane.transient_periods.shape == plane.shape
        plane.mask(), plane.regime_counts()

    def scan(self, chance: Chance) -> None:
        """A file of a bag is read to its end, with what is wrong in it named."""
        self.bag.write_bytes(mutated(chance, self.whole_bag))
        scan = Scan(self.bag)
        size = sum(len(message.data) for message in scan.messages())
        assert size <= 2 * scan.size
        assert not [damage for damage in scan.damage if "MemoryError" in damage.what]

    def beside_the_bag(self, chance: Chance) -> None:
        """What lies beside a bag is held against it, whatever it has become."""
        name = chance.choice(sorted(self.left))
        data = mutated(chance, self.left[name])
        if name == "report.json" and chance.random() < 0.7:
            report = json.loads(self.left[name])
            report[chance.choice(sorted(report))] = odd_json(chance)
            data = json.dumps(report).encode()
        elif name == "map.npz" and chance.random() < 0.5:
            data = odd_archive(chance, self.left[name])
        (self.finished / name).write_bytes(data)
        result = verify(self.finished)
        (self.finished / name).write_bytes(self.left[name])
        assert result["ok"] == (not result["problems"]) and (result["ok"] or data != self.left[name])
        assert {problem["file"] for problem in result["problems"]} <= {name}

    def damaged_run(self, chance: Chance) -> None:
        """Every command on a run comes to an end, and says what is wrong; changed bytes of the bag are always seen."""
        data = mutated(chance, self.whole_bag)
        self.bag.write_bytes(data)
        metadata = self.run / "bag" / METADATA
        metadata.write_bytes(mutated(chance, self.metadata) if chance.random() < 0.2 else self.metadata)
        holds = verify(self.run)["ok"]
        assert not (holds and data != self.whole_bag)
        assert holds or (data, metadata.read_bytes()) != (self.whole_bag, self.metadata)
        for command in (load_verdicts, replay, recover):
            try:
                command(self.run)  # type: ignore[operator]
            except (BagError, ParameterError) as error:
                assert str(error)
        try:
            recording.session(self.run, SWEEP, epoch=2).abandon()
        except (BagError, ParameterError, cdr.WireError) as error:
            assert str(error)
        for path in self.run.rglob("*.mcap"):
            path.unlink()
        shutil.rmtree(self.run / "bag_aside", ignore_errors=True)
        for path in self.run.glob("verdicts-*"):
            path.unlink()


_LEDGER_FILES = {"ledger.jsonl", ".coordinator.lock", ".recorder.lock"}


def recording_window() -> Any:
    """Return a simulator's window with a few chunks under way."""
    from bow_sim.protocol.flow_control import Window

    window = Window()
    for chunk in range(4):
        window.sent((1, chunk), {"bridge_force": b""}, 0.0)
    return window


@functools.cache
def messages() -> dict[str, bytes]:
    """Return a right message of every kind."""
    receipt = {"run_id": recording.RUN, "sweep_id": SWEEP.sweep_id, "incarnation": "7" * 16}
    receipt |= {name: [1, 1] for name in ("kind", "block", "attempt", "checksum")} | {"chunk": [0, 1]}
    zero: dict[str, Any] = {"string": "a", "string[]": ["a", "b"]}
    basin = {
        field: zero.get(kind, [1, 2, 3] if kind.endswith("[]") else 7) for field, kind in cdr.FIELDS["BasinMap"].items()
    }
    block = {
        field: zero.get(kind, [1, 2, 3] if kind.endswith("[]") else 7) for field, kind in cdr.FIELDS["Block"].items()
    }
    known = {
        "BridgeForce": CHUNK.bridge_force,
        "StickSlip": CHUNK.stick_slip,
        "InspectedCell": recording.inspected(CHUNK),
        "Verdicts": CHUNK.verdicts,
        "Receipt": cdr.encode("Receipt", receipt),
        "Plan": recording.plan(SWEEP),
        "BasinMap": cdr.encode("BasinMap", basin),
        "Block": cdr.encode("Block", block),
    }
    return {name: known[name] for name in cdr.FIELDS}


def make(room: Path) -> Targets:
    """Return the targets in an empty room."""
    if room.exists():
        shutil.rmtree(room)
    room.mkdir(parents=True)
    return Targets(room)
