"""Whatever befalls the files of a run, going on gives the map of an undisturbed one, or a refusal whose remedy works."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import recording
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from small_graph import SmallGraph, Snapshot, restore, snapshot

from bow_sweep.record.verify import verify
from bow_sweep.resume import prepare
from bow_sweep.run import RunError

PLAIN = recording.small_sweep()
ADAPTIVE = recording.small_sweep(
    *("adaptive=0.8", "x.count=7", "y.count=6", "x.first=2", "x.last=12", "block_cells=9", "periods=10")
)
FILES = ("ledger.jsonl", "bag/bag_0.mcap", "bag/bag_1.mcap", "bag/metadata.yaml", "map.npz", "report.json", "map.png")


@dataclass(frozen=True)
class History:
    """A run that was cut off once, gone on with and finished: all its files after every chunk, and its map."""

    sweep: object
    states: tuple[Snapshot, ...]

    @property
    def map(self) -> bytes:
        return self.states[-1]["map.npz"]


def history(directory: Path, sweep: object, cut_after: int) -> History:
    states: list[Snapshot] = []
    note: Callable[[], None] = lambda: states.append(snapshot(directory))  # noqa: E731
    SmallGraph(directory, sweep, cut_after=cut_after, on_chunk=note).run()
    SmallGraph(directory, sweep, again=True, on_chunk=note).run()
    note()
    undisturbed = directory.with_name(f"{directory.name}-undisturbed")
    SmallGraph(undisturbed, sweep).run()
    assert same_map((undisturbed / "map.npz").read_bytes(), states[-1]["map.npz"])
    return History(sweep, tuple(states))


@pytest.fixture(scope="session")
def histories(tmp_path_factory: pytest.TempPathFactory) -> dict[str, History]:
    """What may befall is done to these."""
    folder = tmp_path_factory.mktemp("histories")
    return {"plain": history(folder / "plain", PLAIN, 5), "adaptive": history(folder / "adaptive", ADAPTIVE, 7)}


def same_map(one: bytes, other: bytes) -> bool:
    """Whether two maps are the same, bit for bit, whoever made them."""
    import io

    with np.load(io.BytesIO(one)) as a, np.load(io.BytesIO(other)) as b:
        return a.files == b.files and all(a[name].tobytes() == b[name].tobytes() for name in a.files)


# ---- what may befall a file


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


def befall(files: Snapshot, of: History, what: str, name: str, place: float, size: int) -> None:
    """Do something to the files of a run."""
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


# ---- going on


def gone_on_with(directory: Path, sweep: object, remedies: int = 2) -> list[str]:
    """Resume a run as `bow sweep --resume` does, to its end, by the remedies that refusals print; return what was said."""
    try:
        said: list[str] = []
        if prepare(directory, said.append).complete:
            return said
        graph = SmallGraph(directory, sweep, again=True)
        graph.run()
        return said + graph.said
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
    """Going on leads to a run that holds and has the map of an undisturbed one; then nothing is left to do."""
    said = gone_on_with(directory, of.sweep)
    result = verify(directory)
    assert result["ok"], (result["problems"], said)
    assert same_map((directory / "map.npz").read_bytes(), of.map), said
    again: list[str] = []
    assert prepare(directory, again.append).complete, again


def befallen(directory: Path, of: History, state: float, operations: list[tuple[str, str, float, int]]) -> Path:
    """Leave the files of a run at some moment, with what befell them."""
    files = dict(of.states[spot(bytes(len(of.states)), state)])
    for operation in operations:
        befall(files, of, *operation)
    shutil.rmtree(directory, ignore_errors=True)
    restore(directory, files)
    return directory


LAST = 0.9999
SETTINGS = settings(deadline=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("befallen")


@settings(SETTINGS, max_examples=150)
@given(
    name=st.sampled_from(["plain", "plain", "adaptive"]),
    state=places | st.just(LAST),
    ops=st.lists(OPERATIONS, min_size=1, max_size=4),
)
@example(name="plain", state=0.3, ops=[("deleted", "bag/bag_0.mcap", 0.0, 0)])
@example(name="plain", state=0.3, ops=[("zeros after the end", "bag/bag_0.mcap", 0.0, 4096)])
@example(name="plain", state=0.3, ops=[("cut short", "bag/bag_0.mcap", 0.0, 0)])
@example(name="plain", state=0.3, ops=[("bag deleted", "bag", 0.0, 0)])
@example(name="plain", state=LAST, ops=[("deleted", "bag/bag_0.mcap", 0.0, 0)])
@example(name="plain", state=LAST, ops=[("bag deleted", "bag", 0.0, 0), ("deleted", "ledger.jsonl", 0.0, 0)])
@example(name="adaptive", state=LAST, ops=[("a range of zeros", "ledger.jsonl", 0.3, 300)])
@example(name="adaptive", state=0.9, ops=[("older or newer", "bag/bag_0.mcap", 0.2, 0)])
def test_whatever_befalls_the_files_the_map_is_that_of_an_undisturbed_run(histories, room, name, state, ops) -> None:
    of = histories[name]
    assert_goes_on(befallen(room / "run", of, state, ops), of)
