"""Bags of before version 3, without stamps and with the run in the names of topics, are read, checked and continued."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import recording
from mcap.reader import make_reader
from mcap.records import Metadata, Schema
from mcap_ros2.decoder import DecoderFactory
from old_bags import make_old
from small_graph import SmallGraph

from bow_sim.protocol import cdr
from bow_sim.protocol.messages import FORMAT
from bow_sweep.cell.from_bag import BagCells
from bow_sweep.coordinator.resume import resume
from bow_sweep.maps.map_file import read_map_npz
from bow_sweep.record.bag import BagError, bag_files, messages
from bow_sweep.record.bag_contents import Chunks, Survey
from bow_sweep.record.index_contents import IndexSurvey
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_writer import McapWriter
from bow_sweep.record.metadata import parse
from bow_sweep.record.old_messages import complete, lacks
from bow_sweep.record.recover import recover
from bow_sweep.record.replay import load_verdicts, replay, task_of
from bow_sweep.record.topics import STORED_ONCE
from bow_sweep.record.verify import verify
from bow_sweep.run.directory import RunError

SWEEP = recording.small_sweep()
GENUINE = Path(__file__).parents[2] / "data" / "run_version_2"
"""A run of `bow sweep fig11d --nx 2 --ny 2 --set periods=10`, as the last bow before version 3 left it."""


def everything_of(run):
    """Return topic -> the messages that are stored once, by block and chunk, as they are read today."""
    found = {topic: {} for topic in STORED_ONCE}
    for message in messages(run / "bag"):
        if message.topic in STORED_ONCE:
            values = cdr.unseal(STORED_ONCE[message.topic], message.data)
            found[message.topic][values["block"], values["chunk"]] = bytes(message.data)
    return found


def content_of(run):
    return {path: path.read_bytes() for path in run.rglob("*") if path.is_file() and path.suffix != ".lock"}


@pytest.fixture
def genuine(tmp_path):
    return shutil.copytree(GENUINE, tmp_path / "run")


def test_a_run_of_the_last_bow_before_is_verified_and_replayed(genuine):
    survey = Survey(genuine / "bag").read()
    assert survey.version == 2
    same = task_of(survey).thresholds.hash == survey.plan["classifier"]  # else its verdicts are those of another bow
    result = verify(genuine, classify=same)
    assert result["ok"], recording.whats(result)
    assert (result["cells"], result["chunks"], result["verdicts"]) == (4, 2, 2)
    assert verify(genuine, classify=False, index=True)["ok"]
    regimes = read_map_npz(genuine / "map.npz").regimes
    assert np.array_equal(load_verdicts(genuine)["regime"], regimes.reshape(len(regimes), -1))
    if same:
        assert replay(genuine)["equal"] == 2


def test_its_messages_are_those_of_today_and_its_index_gives_their_places(genuine):
    by_index, read = IndexSurvey(genuine / "bag").read(), Survey(genuine / "bag").read()
    assert by_index.places == read.places
    with Chunks() as chunks:
        for topic, places in read.places.items():
            for key, place in places.items():
                values = read.expected.unseal(STORED_ONCE[topic], chunks.read(place))
                assert (values["block"], values["chunk"]) == key
    assert everything_of(genuine)["verdicts"].keys() == read.verdicts.keys()


def test_nothing_is_written_into_an_old_bag_that_is_whole(genuine):
    before = content_of(genuine)
    assert recover(genuine)["ok"]
    assert content_of(genuine) == before


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    run = tmp_path_factory.mktemp("today") / "run"
    SmallGraph(run, SWEEP).run()
    return run


@pytest.mark.parametrize("namespace", [f"/bow/{recording.RUN}", "/bow"], ids=["own_namespace", "by_hand"])
def test_an_old_run_that_was_interrupted_is_resumed_to_the_same_map(undisturbed, tmp_path, namespace):
    run = tmp_path / "run"
    SmallGraph(run, SWEEP, cut_after=5).run()
    make_old(run, namespace)
    before = bag_files(run / "bag")[0].read_bytes()
    SmallGraph(run, SWEEP, again=True).run()
    first, second = bag_files(run / "bag")
    assert first.read_bytes().startswith(before)  # its end is added
    result = verify(run)
    assert result["ok"], recording.whats(result)
    assert result["verdicts_equal"] == result["chunks"] == 12
    assert replay(run)["ok"]
    ours, theirs = (everything_of(one) for one in (run, undisturbed))
    for topic, found in theirs.items():
        assert ours[topic].keys() == found.keys()
        for key in found:
            name = STORED_ONCE[topic]
            assert cdr.decode(name, ours[topic][key])["checksum"] == cdr.decode(name, found[key])["checksum"]
    np.testing.assert_array_equal(read_map_npz(run / "map.npz").regimes, read_map_npz(undisturbed / "map.npz").regimes)
    new = {channel.topic for channel in Scan(second).run().contents.channels.values()}
    assert f"{'/bow' if namespace != '/bow' else f'/bow/{recording.RUN}'}/bridge_force" in new  # one type to a name
    for path in (first, second):  # with the definitions in each file other readers read both
        with open(path, "rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            for _, channel, _, message in reader.iter_decoded_messages():
                if channel.topic.endswith("/bridge_force"):
                    assert bytes(message.run_id).decode() == recording.RUN
                    assert hasattr(message, "stamp") == (path == second)


def test_metadata_and_files_name_run_and_version(undisturbed):
    data = parse((undisturbed / "bag" / "metadata.yaml").read_bytes())["custom_data"]
    assert data == {"bow.version": str(FORMAT), "bow.run_id": recording.RUN, "bow.sweep_id": SWEEP.sweep_id}
    (note,) = Scan(bag_files(undisturbed / "bag")[0]).run().notes
    assert note.metadata == {"version": str(FORMAT), "run_id": recording.RUN, "sweep_id": SWEEP.sweep_id}
    entry = json.loads((undisturbed / "ledger.jsonl").read_text().splitlines()[0])
    assert entry["format"] == FORMAT


def test_metadata_that_are_written_anew_name_the_run_too(undisturbed, tmp_path):
    run = shutil.copytree(undisturbed, tmp_path / "run")
    right = (run / "bag" / "metadata.yaml").read_bytes()
    (run / "bag" / "metadata.yaml").unlink()
    assert recover(run)["metadata_rewritten"]
    assert (run / "bag" / "metadata.yaml").read_bytes() == right


@pytest.fixture
def later(undisturbed, tmp_path):
    """A run whose bag says that a later bow wrote it."""
    run = shutil.copytree(undisturbed, tmp_path / "run")
    (path,) = bag_files(run / "bag")
    scan = Scan(path)
    found = list(scan.messages())
    path.unlink()
    note = Metadata("bow.record", {"version": str(FORMAT + 1)})
    writer = McapWriter(path, scan.contents.schemas.values(), scan.contents.channels.values(), [note])
    for message in found:
        writer.add(message.channel, message.sequence, message.log_time, message.publish_time, message.data)
    writer.finish()
    return run


def test_a_bag_of_a_later_bow_is_refused_by_name_and_left_as_it_is(later):
    content = content_of(later)
    what = f"bag_0.mcap: is of version {FORMAT + 1}, written by a later bow; this one reads versions up to {FORMAT}"
    for attempt in (recover, load_verdicts, lambda run: resume(run, print)):
        with pytest.raises((BagError, RunError), match=what):
            attempt(later)
    with pytest.raises(BagError, match=f"is of version {FORMAT + 1}"):
        replay(later)
    assert f"is of version {FORMAT + 1}" in recording.whats(verify(later))
    assert content_of(later) == content


def test_a_ledger_of_a_later_bow_is_refused_by_name(undisturbed, tmp_path):
    run = shutil.copytree(undisturbed, tmp_path / "run")
    ledger = run / "ledger.jsonl"
    ledger.write_text(ledger.read_text().replace(f'"format": {FORMAT}', f'"format": {FORMAT + 6}'))
    shutil.rmtree(run / "bag")  # which would be believed: a changed bit in the ledger is no other version
    with pytest.raises(RunError, match=rf"line 1: format {FORMAT + 6}, written by a later bow"):
        resume(run, print)


def test_only_messages_that_begin_with_the_run_lack_something():
    def schema(text, name="bow_msgs/msg/StickSlip"):
        return Schema(id=1, name=name, encoding="ros2msg", data=text.encode())

    old = "# words = more words\nuint8 A=1  # a constant\n\nstring run_id\nstring sweep_id\n"
    assert len(lacks(schema(old))) == 16
    assert not lacks(schema("std_msgs/Header header\n" + old))
    assert not lacks(schema(old, "bow_msgs/msg/Receipt"))
    assert not lacks(schema(""))
    assert not lacks(None)
    assert complete(b"\0\1\0\0rest", b"") == b"\0\1\0\0rest"
    assert complete(b"\0\1\0\0rest", b"ab") == b"\0\1\0\0abrest"


def test_a_cell_of_an_old_run_is_found_in_its_bag(genuine):
    with Chunks() as chunks:
        survey = Survey(genuine / "bag").read()
        place = survey.places["bridge_force"][0, 1]
        force = cdr.unseal("BridgeForce", chunks.read(place))
    row, samples = 2, force["samples"]
    bag = BagCells(genuine / "bag")
    waveform = bag.waveform(int(force["cells"][row]))
    bag.close()
    assert waveform.bridge_force[samples:].tobytes() == force["data"].reshape(-1, samples)[row].tobytes()
