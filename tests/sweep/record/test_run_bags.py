"""A run whose bag is several directories, one for each station, is the run of one bag: for every reader."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import recording
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from split_runs import rename, split

from bow_sim.protocol import cdr
from bow_sweep.cell.run_cells import RunCells
from bow_sweep.cell.waveform import CellError
from bow_sweep.coordinator.resume import prepare, resume
from bow_sweep.record.bag import BagWriter, bag_files, bag_folder, messages, station_bags
from bow_sweep.record.recover import recover
from bow_sweep.record.replay import load_verdicts, replay
from bow_sweep.record.topics import TOPICS, full_names
from bow_sweep.record.verify import verify
from bow_sweep.run.errors import RunError
from bow_sweep.run.ledger import State
from bow_sweep.run.ledger_file import done_at, latest_states, read_ledger
from bow_sweep.run.lock import locked, recorder_of

SWEEP = recording.small_sweep()
BLOCKS = range(SWEEP.blocks)
STATIONS = ("", "lab", "station_2")
COUNTED = ("cells", "chunks", "samples", "verdicts", "verdicts_equal", "quarantined_blocks", "ok", "problems")


@pytest.fixture
def two(complete, tmp_path):
    """The run in the bags of two stations; both have block 1, the ledger names station a."""
    return split(complete, tmp_path / "two", {"a": [0, 1], "b": [1, 2]})


@pytest.mark.full
@settings(max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_blocks_shared_out_over_any_bags_are_the_same_run(complete, tmp_path_factory, data):
    having = [data.draw(st.sets(st.sampled_from(STATIONS), min_size=1), label=f"block {block}") for block in BLOCKS]
    shares = {station: [block for block in BLOCKS if station in having[block]] for station in STATIONS}
    here = {station: blocks for station, blocks in shares.items() if blocks}
    done = {block: data.draw(st.sampled_from(sorted(having[block]))) for block in BLOCKS}
    run = split(complete, tmp_path_factory.mktemp("shared") / "run", here, done)
    one, several = verify(complete), verify(run)
    assert {name: several[name] for name in COUNTED} == {name: one[name] for name in COUNTED}
    assert several["unseen"] == {}
    there = load_verdicts(run)
    for name, layer in load_verdicts(complete).items():
        assert np.array_equal(there[name], layer, equal_nan=layer.dtype.kind == "f"), name
    if len(here) == 1:
        return
    gone = data.draw(st.sampled_from(sorted(here)))
    for path in bag_files(bag_folder(run, gone)):
        path.unlink()
    (bag_folder(run, gone) / "metadata.yaml").unlink()
    rest = verify(run)
    lost = [block for block in BLOCKS if having[block] == {gone}]
    sizes = [SWEEP.first_blocks.size(block) for block in BLOCKS]
    assert rest["cells"] == sum(sizes) - sum(sizes[block] for block in lost)
    if gone:  # the bag of the coordinator's machine is never elsewhere
        assert rest["ok"], recording.whats(rest)
        assert rest["unseen"] == ({gone: lost} if lost else {})
        assert rest["cells_unseen"] == sum(sizes[block] for block in lost)


def test_a_bag_is_held_against_the_station_that_the_ledger_names(two):
    rename(two, {0: "a", 1: "b", 2: "b"})
    path = bag_files(two / "bag" / "b")[0]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = verify(two)
    assert not found["ok"]
    torn = [problem for problem in found["problems"] if problem.get("file") == "b/b_0.mcap"]
    assert torn and torn[0]["station"] == "b"
    assert any(problem.get("block") == 2 and problem.get("station") == "b" for problem in found["problems"])


def test_duplicates_with_other_checksums_name_both_stations(complete, tmp_path):
    run = split(complete, tmp_path / "run", {"a": [0, 1], "b": [1, 2]})
    folder, names = run / "bag" / "b", full_names()

    def other(data):
        values = cdr.decode("BridgeForce", data)
        if values["block"] == 1 and not values["chunk"]:
            values["data"] = values["data"] + np.float32(1e-6)
        return cdr.encode("BridgeForce", values)

    kept = [(message.topic, bytes(message.data), message.log_time) for message in messages(folder)]
    shutil.rmtree(folder)
    writer = BagWriter(folder, {names[name]: topic for name, topic in TOPICS.items()})
    for topic, data, time in kept:
        writer.add(names[topic], other(data) if topic == "bridge_force" else data, time)
        writer.commit()
    writer.finish()
    problems = [problem for problem in verify(run)["problems"] if problem.get("block") == 1]
    assert "at station a" in problems[0]["what"]
    assert problems[0]["station"] == "b"


def test_a_bag_of_another_run_is_named_and_left_out(two, tmp_path):
    other = recording.session(tmp_path / "other", recording.small_sweep("v_mid=0.1"))
    recording.finish(other, recording.small_sweep("v_mid=0.1"))
    shutil.move(tmp_path / "other" / "bag", two / "bag" / "c")
    found = verify(two)
    assert found["cells"] == 12
    assert [problem["station"] for problem in found["problems"]] == ["c"]
    assert "should be of run" in found["problems"][0]["what"]


def test_a_bag_alone_says_what_it_has_not_seen(two):
    alone = verify(two / "bag" / "b")
    assert alone["ok"], recording.whats(alone)
    assert alone["unseen"] == {"?": [0]}
    assert alone["cells"] == 7


def test_the_part_of_another_machine_is_checked_without_a_ledger(two, tmp_path):
    shutil.copytree(two / "bag" / "b", tmp_path / "part" / "bag" / "b")
    part = verify(tmp_path / "part")
    assert part["ok"], recording.whats(part)
    assert part["unseen"] == {"?": [0]}


def test_replay_classifies_the_blocks_of_all_bags(two, complete):
    both, one = replay(two), replay(complete)
    assert both == {**one, "unseen": {}}
    shutil.rmtree(two / "bag" / "a")
    rest = replay(two)
    assert rest["ok"]
    assert (rest["chunks"], rest["unseen"]) == (8, {"a": [0]})


def test_a_cell_comes_from_the_bag_of_its_station(two, complete):
    with RunCells(two) as cells, RunCells(complete) as right:
        for cell in (0, 11):
            found = cells.record(cell)
            assert found.source == "bag" and found.checked
            assert np.array_equal(found.bridge_force, right.record(cell).bridge_force)


def test_a_cell_whose_bag_is_not_here_is_computed_and_says_where_it_is(two):
    shutil.rmtree(two / "bag" / "a")
    with RunCells(two) as cells:
        found = cells.record(0)
        assert found.source == "computed"
        assert "station a, whose bag is not here" in found.why
        with pytest.raises(CellError, match="bow collect"):
            cells.record(0, "bag")


def test_recover_repairs_each_bag_and_keeps_what_it_takes_out_beside_all(two):
    path = bag_files(two / "bag" / "a")[0]
    path.write_bytes(path.read_bytes() + b"garbage after the end")
    report = recover(two)
    assert report["ok"] and list(report["bags"]) == ["a", "b"]
    (file,) = report["bags"]["a"]["files"]
    assert [Path(aside).parent for aside in file["aside"]] == [two / "bag_aside" / "a"]
    assert verify(two)["ok"]


# ---- resuming


def unfinished(run):
    """Have a run end before its report was written."""
    (run / "report.json").unlink()
    return run


def test_a_run_is_resumed_from_all_its_bags(two, complete):
    unfinished(two)
    found = resume(two)
    found.run.close()
    assert found.run.ledger.finished
    assert np.array_equal(found.layers["regime"], load_verdicts(complete)["regime"])
    assert done_at(read_ledger(two)) == {0: "a", 1: "a", 2: "b"}


def test_a_resume_without_a_bag_names_station_blocks_and_both_remedies(two):
    shutil.move(two / "bag" / "a", two.parent / "a")
    before = (unfinished(two) / "ledger.jsonl").read_bytes()
    with pytest.raises(RunError) as refused:
        prepare(two)
    text = str(refused.value)
    assert "station a: blocks 0\n" in text
    assert f"bow collect {two}" in text
    assert f"bow sweep --resume {two} --lost a" in text
    assert (two / "ledger.jsonl").read_bytes() == before
    shutil.move(two.parent / "a", two / "bag" / "a")
    found = resume(two)
    found.run.close()
    assert found.run.ledger.finished


def test_the_blocks_of_a_station_that_is_lost_are_computed_again(two):
    shutil.rmtree(two / "bag" / "a")
    prepare(unfinished(two), lost=["a"])
    entries = read_ledger(two)
    assert [block for block, state in latest_states(entries).items() if state == "reopened"] == [0]
    assert done_at(entries) == {1: "b", 2: "b"}  # block 1 is whole in the other bag
    found = resume(two)  # as the coordinator does, which is told nothing of it
    found.run.close()
    assert not found.run.ledger.finished


def test_a_coordinator_that_is_started_again_in_a_run_goes_on_without_a_bag_elsewhere(two):
    shutil.rmtree(two / "bag" / "a")
    with locked(unfinished(two), recorder_of("b")):
        found = resume(two)
    found.run.close()
    assert done_at(read_ledger(two)) == {1: "b", 2: "b"}
    assert not found.run.ledger.finished


@pytest.mark.parametrize("name", ["b", "c"])
def test_what_is_not_missed_cannot_be_lost(two, name):
    shutil.rmtree(two / "bag" / "a")
    with pytest.raises(RunError, match=f"--lost {name}: "):
        prepare(unfinished(two), lost=[name])


def test_a_block_that_its_own_bag_lacks_counts_from_another(two):
    for path in (two / "bag" / "a").iterdir():
        path.unlink()
    shutil.copytree(two / "bag" / "b", two / "bag" / "a", dirs_exist_ok=True)  # has not block 0
    said = []
    prepare(unfinished(two), said.append)
    entries = read_ledger(two)
    assert latest_states(entries)[0] == "reopened"
    assert "1 of 3 blocks are due again" in " ".join(said)
    shutil.rmtree(two / "bag" / "a")
    prepare(two)
    assert done_at(read_ledger(two)) == {1: "b", 2: "b"}


def test_a_finished_run_is_finished_wherever_its_bags_are(two):
    report = two / "report.json"
    (two / "map.png").write_bytes(b"")
    found = json.loads(report.read_text())
    found.pop("picture")  # as in an old report
    report.write_text(json.dumps(found))
    shutil.rmtree(two / "bag" / "a")
    rename(two, {0: "a", 1: "b", 2: "b"})
    said = []
    assert prepare(two, said.append).complete, said
    assert any("station a" in line for line in said)


def test_a_ledger_that_is_lost_is_made_again_from_all_bags(two):
    (unfinished(two) / "ledger.jsonl").unlink()
    prepare(two)
    assert done_at(read_ledger(two)) == {0: "a", 1: "a", 2: "b"}


# ---- files that are lost, cut off, doubled or exchanged


def changed(run, kind, station, other, place):
    """Do something to the bag of a station."""
    bag = run / "bag" / station
    path = bag / f"{station}_0.mcap"
    if not path.exists() or (station == other and kind in ("copied", "exchanged")):
        return
    match kind:
        case "lost":
            shutil.rmtree(bag)
        case "cut off":
            os.truncate(path, int(place * path.stat().st_size))
        case "a byte changed":
            content = bytearray(path.read_bytes())
            if content:
                content[int(place * (len(content) - 1))] ^= 1
            path.write_bytes(content)
        case "copied":
            shutil.copytree(bag, run / "bag" / other, dirs_exist_ok=True)
        case "exchanged":
            if (run / "bag" / other).is_dir():
                for source, to in ((bag, "aside"), (run / "bag" / other, station), (run / "bag" / "aside", other)):
                    source.rename(run / "bag" / to)
        case "metadata lost":
            (bag / "metadata.yaml").unlink(missing_ok=True)


CHANGES = ("lost", "cut off", "a byte changed", "copied", "exchanged", "metadata lost")


@pytest.mark.full
@settings(max_examples=15)
@given(
    st.lists(
        st.tuples(st.sampled_from(CHANGES), st.sampled_from("ab"), st.sampled_from("abc"), st.floats(0, 1)),
        min_size=1,
        max_size=3,
    )
)
def test_whatever_happens_to_the_bags_what_is_done_is_as_it_was_or_the_remedy_is_named(complete, tmp_path_factory, ops):
    run = split(complete, tmp_path_factory.mktemp("changed") / "run", {"a": [0, 1], "b": [1, 2]})
    right = load_verdicts(complete)
    for op in ops:
        changed(unfinished(run) if (run / "report.json").exists() else run, *op)
    try:
        found = resume(run)
    except RunError as error:
        absent = {name for name in "ab" if name not in station_bags(run)}
        assert "bow collect" in str(error)
        assert absent
        prepare(run, lost=[name for name in "ab" if f"station {name}: " in str(error)])
        found = resume(run)
    found.run.close()
    done = [block for block in BLOCKS if found.run.ledger.blocks[block].state is State.DONE]
    assert sorted(done_at(read_ledger(run))) == done
    cells = SWEEP.first_blocks.cells_of(done)
    layers = found.layers or {name: np.zeros_like(layer) for name, layer in right.items()}
    for name, layer in right.items():
        assert np.array_equal(layers[name][:, cells], layer[:, cells], equal_nan=layer.dtype.kind == "f"), name
