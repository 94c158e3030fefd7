"""A run of several stations, made from a recorded run of one: its messages written into several bags, by our writer."""

from __future__ import annotations

import json
import shutil
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from bow_sim.protocol import cdr
from bow_sweep.record.bag import FOLDER, BagWriter, bag_folder, messages
from bow_sweep.record.notes import custom_data, how
from bow_sweep.record.topics import STORED_ONCE, TOPICS, full_names
from bow_sweep.run.ledger_file import LEDGER

ENTRIES = ("kind", "block", "chunk", "attempt", "checksum")
"""Arrays of a receipt."""


def split(run: Path, to: Path, shares: Mapping[str, Collection[int]], done: Mapping[int, str] | None = None) -> Path:
    """Write a run again with a bag for each station; return its directory.

    Parameters
    ----------
    shares
        Station -> the blocks of which its bag has everything.
    done
        Block -> the station that the ledger names; as a rule the first that has it.
    """
    shutil.copytree(run, to, ignore=shutil.ignore_patterns(FOLDER, ".*"))
    identity, names = None, full_names()
    writers: dict[str, BagWriter] = {}
    for message in messages(run / FOLDER):
        data = bytes(message.data)
        if identity is None:  # the first message is a plan
            plan = cdr.decode("Plan", data)
            identity = plan["run_id"], plan["sweep_id"]
            topics = {names[name]: topic for name, topic in TOPICS.items()}
            for station in shares:
                folder = bag_folder(to, station)
                writers[station] = BagWriter(folder, topics, notes=[how(*identity)], identity=custom_data(*identity))
        for station, blocks in shares.items():
            part: bytes | None = data
            if message.topic in STORED_ONCE:
                part = data if cdr.decode_head(STORED_ONCE[message.topic], data)["block"] in blocks else None
            elif message.topic == "receipts":
                part = _receipts(data, blocks)
            if part is not None:
                writers[station].add(names[message.topic], part, message.log_time)
                writers[station].commit()
    for writer in writers.values():
        writer.finish()
    if (run / LEDGER).exists():
        first = {block: station for station, blocks in reversed(shares.items()) for block in blocks}
        rename(to, {**first, **(done or {})})
    return to


def rename(run: Path, done: Mapping[int, str]) -> None:
    """Have the ledger of a run name these stations as those that did the blocks."""
    entries = [json.loads(line) for line in (run / LEDGER).read_text().splitlines()]
    for entry in entries:
        if entry["event"] in ("dispatched", "done"):
            entry.pop("station", None)
            if station := done.get(entry["block"], ""):
                entry["station"] = station
    (run / LEDGER).write_text("".join(json.dumps(entry) + "\n" for entry in entries))


def _receipts(data: bytes, blocks: Collection[int]) -> bytes | None:
    """Return a receipt with the entries of some blocks only; None where there are none."""
    values = cdr.decode("Receipt", data)
    kept = np.isin(values["block"], sorted(blocks))
    return cdr.encode("Receipt", {**values, **{name: values[name][kept] for name in ENTRIES}}) if kept.any() else None
