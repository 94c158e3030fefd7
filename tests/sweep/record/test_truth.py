"""Whatever happens to the files of a run, resuming it gives the right map, or a refusal whose remedy works."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import recording
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from small_graph import PIXEL, SmallGraph, Snapshot, restore, snapshot

from bow_sim.protocol import cdr
from bow_sim.protocol.states import ReceiptKind
from bow_sweep.coordinator.resume import prepare, resume
from bow_sweep.record.bag import BagError, bag_files
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import McapWriter
from bow_sweep.record.recover import recover
from bow_sweep.record.replay import replay
from bow_sweep.record.verify import verify
from bow_sweep.run.directory import RunError
from bow_sweep.run.ledger import State

PLAIN = recording.small_sweep()
ADAPTIVE = recording.small_sweep(
    *("adaptive=0.8", "x.count=6", "y.count=5", "x.first=2", "x.last=12", "block_cells=8", "periods=50")
)
"""Eight rounds."""
REPEATED = recording.small_sweep("repeats=1", "jitter=0.2", "periods=10")
"""Twelve cells and a repeat of each, in five blocks of two chunks."""

VERDICTS_ONLY = recording.small_sweep("record=verdicts")
LAST_ONLY = recording.small_sweep("record=last")
NAMES = ["plain", "plain", "adaptive", "repeats", "verdicts", "last"]

FILES = ("ledger.jsonl", "bag/bag_0.mcap", "bag/bag_1.mcap", "bag/metadata.yaml", "map.npz", "report.json", "map.png")


class History:
    """A run that was interrupted once, resumed and finished: all its files after every chunk, and its map."""

    def __init__(self, sweep: object, states: tuple[Snapshot, ...]) -> None:
        self.sweep, self.states = sweep, states

    def __repr__(self) -> str:  # Hypothesis prints it where a case fails: megabytes otherwise
        return f"History of {len(self.states)} states"

    @property
    def map(self) -> bytes:
        return self.states[-1]["map.npz"]


def history(directory: Path, sweep: object, cut_after: int) -> History:
    states: list[Snapshot] = []
    note: Callable[[], None] = lambda: states.append(snapshot(directory))
    SmallGraph(directory, sweep, cut_after=cut_after, on_chunk=note).run()
    SmallGraph(directory, sweep, again=True, on_chunk=note).run()
    note()
    undisturbed = directory.with_name(f"{directory.name}-undisturbed")
    SmallGraph(undisturbed, sweep).run()
    assert same_map((undisturbed / "map.npz").read_bytes(), states[-1]["map.npz"])
    return History(sweep, tuple(states))


@pytest.fixture(scope="session")
def histories(tmp_path_factory: pytest.TempPathFactory) -> dict[str, History]:
    """The files that are changed."""
    folder = tmp_path_factory.mktemp("histories")
    return {
        "plain": history(folder / "plain", PLAIN, 5),
        "adaptive": history(folder / "adaptive", ADAPTIVE, 33),
        "repeats": history(folder / "repeats", REPEATED, 6),
        "verdicts": history(folder / "verdicts", VERDICTS_ONLY, 5),
        "last": history(folder / "last", LAST_ONLY, 5),
    }


def same_map(one: bytes, other: bytes) -> bool:
    """Return whether two maps are the same, bit for bit."""
    import io

    with np.load(io.BytesIO(one)) as a, np.load(io.BytesIO(other)) as b:
        return a.files == b.files and all(a[name].tobytes() == b[name].tobytes() for name in a.files)


# ---- what may happen to a file


def spot(content: bytes, place: float) -> int:
    return int(place * len(content))


BEFALL: dict[str, Callable[[bytes, float, int], bytes]] = {
    "cut short": lambda content, place, _: content[: spot(content, place)],
    "a range of zeros": lambda content, place, size: (
        content[: spot(content, place)]
        + bytes(len(content[spot(content, place) :][:size]))
        + content[spot(content, place) + size :]
    ),
    "zeros at the end": lambda content, _, size: content[:-size] + bytes(min(size, len(content))),
    "zeros after the end": lambda content, _, size: content + bytes(size),
    "garbage after the end": lambda content, place, size: (
        content + bytes(int(255 * place) ^ n % 251 for n in range(size))
    ),
    "a flipped bit": lambda content, place, size: (
        content
        and content[: spot(content, place)]
        + bytes([content[spot(content, place)] ^ 1 << size % 8])
        + content[spot(content, place) + 1 :]
    ),
    "emptied": lambda *_: b"",
}
places = st.floats(0, 1, exclude_max=True)
sizes = st.integers(1, 5000) | st.integers(1, 40)
OPERATIONS = (
    st.tuples(st.sampled_from(sorted(BEFALL)), st.sampled_from(FILES), places, sizes)
    | st.tuples(st.just("deleted"), st.sampled_from(FILES), st.just(0.0), st.just(0))
    | st.tuples(st.just("older or newer"), st.sampled_from(FILES), places, st.just(0))
    | st.tuples(st.just("copied"), st.sampled_from(FILES[1:3]), st.just(0.0), st.integers(0, 3))
    | st.tuples(st.just("bag deleted"), st.just("bag"), st.just(0.0), st.just(0))
)


def change(files: Snapshot, of: History, what: str, name: str, place: float, size: int) -> None:
    """Change a file of a run."""
    if what == "bag deleted":
        for each in [each for each in files if each.startswith("bag/")]:
            del files[each]
    elif what == "deleted":
        files.pop(name, None)
    elif what == "older or newer":
        files.pop(name, None)
        other = of.states[spot(bytes(len(of.states)), place)]
        if name in other:
            files[name] = other[name]
    elif what == "copied":
        if name in files:
            files[f"bag/bag_{size}.mcap"] = files[name]
    elif name in files:
        files[name] = BEFALL[what](files[name], place, size)


# ---- resuming


def gone_on_with(directory: Path, sweep: object, remedies: int = 2) -> list[str]:
    """Resume a run as `bow sweep --resume` does, with the remedies that refusals print; return all lines."""
    try:
        said: list[str] = []
        if prepare(directory, said.append).complete:
            return said
        graph = SmallGraph(directory, sweep, again=True)
        graph.run()
        return said + graph.log
    except RunError as error:
        text = str(error)
        assert str(directory) in text, text
        assert remedies, text
        if "sweep anew" in text:
            shutil.rmtree(directory)
            SmallGraph(directory, sweep).run()
            return [text]
        commands = re.findall(r"mv \S+ [^\s,;]+", text)
        assert commands, text
        subprocess.run(shlex.split(commands[0]), check=True)
        return [text, *gone_on_with(directory, sweep, remedies - 1)]


def assert_goes_on(directory: Path, of: History) -> None:
    """Assert that a resumed run is consistent and has the map of an undisturbed one; then nothing is left to do."""
    said = gone_on_with(directory, of.sweep)
    result = verify(directory)
    assert result["ok"], (result["problems"], said)
    assert same_map((directory / "map.npz").read_bytes(), of.map), said
    again: list[str] = []
    assert prepare(directory, again.append).complete, again


def changed_files(directory: Path, of: History, state: float, operations: list[tuple[str, str, float, int]]) -> Path:
    """Write the files of a run at some moment, and change them."""
    files = dict(of.states[spot(bytes(len(of.states)), state)])
    for operation in operations:
        change(files, of, *operation)
    shutil.rmtree(directory, ignore_errors=True)
    restore(directory, files)
    return directory


LAST = 0.9999
SETTINGS = settings(deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("changed_files")


@settings(SETTINGS, max_examples=40)
@given(
    name=st.sampled_from(NAMES),
    state=places | st.just(LAST),
    ops=st.lists(OPERATIONS, min_size=1, max_size=4),
)
@example(name="plain", state=0.3, ops=[("deleted", "bag/bag_0.mcap", 0.0, 0)])
@example(name="verdicts", state=0.7, ops=[("cut short", "bag/bag_0.mcap", 0.5, 0)])
@example(name="last", state=0.7, ops=[("a range of zeros", "bag/bag_0.mcap", 0.5, 300)])
@example(name="plain", state=0.3, ops=[("zeros after the end", "bag/bag_0.mcap", 0.0, 4096)])
@example(name="plain", state=0.3, ops=[("cut short", "bag/bag_0.mcap", 0.0, 0)])
@example(name="plain", state=0.3, ops=[("bag deleted", "bag", 0.0, 0)])
@example(name="plain", state=LAST, ops=[("deleted", "bag/bag_0.mcap", 0.0, 0)])
@example(name="plain", state=LAST, ops=[("bag deleted", "bag", 0.0, 0), ("deleted", "ledger.jsonl", 0.0, 0)])
@example(name="adaptive", state=LAST, ops=[("a range of zeros", "ledger.jsonl", 0.3, 300)])
@example(name="adaptive", state=0.9, ops=[("older or newer", "bag/bag_0.mcap", 0.2, 0)])
@example(name="repeats", state=0.9, ops=[("a flipped bit", "bag/bag_0.mcap", 0.8, 3)])
def test_whatever_happens_to_the_files_the_map_is_that_of_an_undisturbed_run(histories, room, name, state, ops) -> None:
    of = histories[name]
    assert_goes_on(changed_files(room / "run", of, state, ops), of)


@pytest.mark.full
@settings(SETTINGS, max_examples=300)
@given(
    name=st.sampled_from(NAMES),
    state=places | st.just(LAST),
    ops=st.lists(OPERATIONS, min_size=1, max_size=6),
)
def test_many_such_changes(histories, room, name, state, ops) -> None:
    of = histories[name]
    assert_goes_on(changed_files(room / "run", of, state, ops), of)


def test_this_would_find_a_resume_that_believes_the_ledger(histories, room, monkeypatch) -> None:
    """The fault that these tests exclude: a deleted bag, a ledger in which blocks are done, and a map with holes."""
    monkeypatch.setattr("bow_sweep.coordinator.resume._differences", lambda *_: [])
    monkeypatch.setattr("bow_sweep.coordinator.resume._results_agree", lambda *_: True)
    of = histories["plain"]
    directory = changed_files(room / "run", of, 0.5, [("deleted", "bag/bag_0.mcap", 0.0, 0)])
    with pytest.raises(AssertionError):
        assert_goes_on(directory, of)


@pytest.mark.parametrize("state", [0.6, LAST])
def test_a_run_from_before_blocks_were_receipted_holds_and_is_gone_on_with(histories, room, state) -> None:
    of = histories["plain"]
    directory = changed_files(room / "run", of, state, [])
    recover(directory)
    for path in bag_files(directory / "bag"):
        as_of_old(path)
    assert verify(directory)["ok"] == (state == LAST)
    assert prepare(directory).complete == (state == LAST)
    (directory / "map.npz").unlink(missing_ok=True)  # otherwise there is nothing to do
    assert_goes_on(directory, of)


def as_of_old(path: Path) -> None:
    """Write a file of a bag as it was before blocks had receipts."""
    scan = Scan(path)
    messages = list(scan.messages())
    path.unlink()
    writer = McapWriter(path, scan.contents.schemas.values(), scan.contents.channels.values())
    for m in messages:
        data: bytes | memoryview = m.data
        if scan.contents.channels[m.channel].topic.endswith("/receipts"):
            values = cdr.decode("Receipt", data)
            kept = values["kind"] != ReceiptKind.BLOCK
            names = ("kind", "block", "chunk", "attempt", "checksum")
            data = cdr.encode("Receipt", {**values, **{name: values[name][kept] for name in names}})
        writer.add(m.channel, m.sequence, m.log_time, m.publish_time, data)
        writer.commit()
    writer.finish()


def test_a_ledger_that_is_lost_is_made_anew_from_the_bag(histories, room) -> None:
    of = histories["adaptive"]
    for lost in (None, b"", bytes(5000), b"{"):
        directory = changed_files(room / "run", of, 0.8, [("deleted", "ledger.jsonl", 0.0, 0)])
        if lost is not None:
            (directory / "ledger.jsonl").write_bytes(lost)
        said: list[str] = []
        prepare(directory, said.append)
        assert any("made anew from the bag" in line for line in said)
        assert not [line for line in said if "are due again" in line]
        assert_goes_on(directory, of)


def test_torn_lines_of_the_ledger_are_set_aside_and_never_overwritten(histories, room) -> None:
    directory = changed_files(room / "run", histories["plain"], 0.5, [])
    path = directory / "ledger.jsonl"
    torn = []
    for tail in (bytes(200) + b"\n", b'{"event": "done", "bl', b"rubbish\n"):
        path.write_bytes(path.read_bytes() + tail)
        torn.append(path.read_bytes())
        prepare(directory)
        assert all(json.loads(line) for line in path.read_bytes().splitlines())
    names = ["ledger.jsonl.torn", "ledger.jsonl.torn.1", "ledger.jsonl.torn.2"]
    assert [(directory / name).read_bytes() for name in names] == torn


def test_ledger_and_bag_of_different_runs_are_refused_and_both_remedies_work(histories, room, tmp_path) -> None:
    of = histories["plain"]
    for remedy in (0, 1):
        directory = changed_files(room / "run", of, 0.5, [])
        path = directory / "ledger.jsonl"
        path.write_bytes(path.read_bytes().replace(recording.RUN.encode(), b"f" * 16))
        with pytest.raises(RunError, match=f"this is run {'f' * 16}") as refusal:
            prepare(directory)
        commands = re.findall(r"mv \S+ [^\s,;]+", str(refusal.value))
        subprocess.run(shlex.split(commands[remedy]), check=True)
        gone_on_with(directory, of.sweep)
        assert verify(directory)["ok"]


def test_a_block_that_was_given_up_stays_so_whatever_the_bag_has(histories, room) -> None:
    directory = changed_files(room / "run", histories["plain"], 0.3, [])
    path = directory / "ledger.jsonl"
    path.write_bytes(path.read_bytes() + b'{"event": "quarantined", "block": 2, "why": "poison"}\n')
    gone_on_with(directory, PLAIN)
    result = verify(directory)
    assert (result["ok"], result["quarantined_blocks"]) == (True, [2])


def test_while_a_recorder_is_at_work_its_bag_is_read_and_not_touched(room) -> None:
    """Its coordinator was restarted: complete blocks in the bag are done, blocks being written stay due."""
    directory = room / "live"
    graph = SmallGraph(directory, PLAIN, cut_after=9)
    graph.session_survives = True
    graph.run()
    session = graph.session
    assert session is not None
    before = snapshot(directory)
    said: list[str] = []
    run, recorded = resume(directory, said.append)
    assert {name: content for name, content in snapshot(directory).items() if name.startswith("bag/")} == {
        name: content for name, content in before.items() if name.startswith("bag/")
    }
    assert recorded is not None
    assert run.cells_in(State.DONE) == 10
    run.close()
    session.abandon()


def test_a_picture_of_another_map_is_drawn_again(histories, room) -> None:
    of = histories["plain"]
    directory = changed_files(room / "run", of, LAST, [])
    other = PIXEL[:-12] + b"\0\0\0\0tEXt" + zlib.crc32(b"tEXt").to_bytes(4, "big") + PIXEL[-12:]
    assert prepare(directory).complete
    for changed in (other, PIXEL[:-1], b""):
        (directory / "map.png").write_bytes(changed)
        said: list[str] = []
        assert not prepare(directory, said.append).complete
        assert "map.png" in said[-1]
        assert_goes_on(directory, of)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_bag_that_went_through_another_tool_is_not_touched_by_recover_and_not_in_the_way(
    histories, room, compression
) -> None:
    of = histories["plain"]
    directory = changed_files(room / "run", of, LAST, [])
    path = directory / "bag" / "bag_0.mcap"
    rewrite(path, compression)
    content = path.read_bytes()
    report = recover(directory)
    assert (report["ok"], report["files"][0]["did"]) == (True, "keep")
    assert path.read_bytes() == content
    if compression is not CompressionType.NONE:
        with pytest.raises(BagError, match="is compressed"):
            replay(directory)
    assert_goes_on(directory, of)


def rewrite(path: Path, compression: CompressionType) -> None:
    """Write a file of a bag as other tools do: no CRCs, another library, other sizes of chunks."""
    scan = Scan(path)
    messages = list(scan.messages())
    with open(path, "wb") as file:
        writer = Writer(file, chunk_size=50_000, compression=compression, enable_crcs=False)
        writer.start("ros2", "rosbag2")
        schemas = {n: writer.register_schema(s.name, s.encoding, s.data) for n, s in scan.contents.schemas.items()}
        channels = {
            n: writer.register_channel(c.topic, c.message_encoding, schemas[c.schema_id], c.metadata)
            for n, c in scan.contents.channels.items()
        }
        for m in messages:
            writer.add_message(channels[m.channel], m.log_time, bytes(m.data), m.publish_time, m.sequence)
        writer.finish()
