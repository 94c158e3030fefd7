"""Readers of other projects open our bags, and the samples are those of the kernel, bit for bit."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import recording
import yaml
from builtin_interfaces.msg import Time
from example_maps import basin_map
from mcap.reader import make_reader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rclpy.serialization import serialize_message
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from bow_sim.protocol import cdr
from bow_sweep.coordinator.standard_messages import image_message, regimes_message
from bow_sweep.record.bag import METADATA, bag_files
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.schema import SchemaError, definition, type_hash
from bow_sweep.record.topics import STORED_ONCE, TOPICS, short_name
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep()
NPM = ("@mcap/core", "@foxglove/rosmsg", "@foxglove/rosmsg2-serialization")


INSPECTED = recording.inspected(recording.chunks(SWEEP, 0)[1])


def pictures():
    """The images of a map of 4 x 3 cells, by topic."""
    values, stamp = basin_map(4, 3), Time(sec=7)
    return {"basin_map/image": image_message(values, stamp), "basin_map/regimes": regimes_message(values, stamp)}


@pytest.fixture(scope="module")
def continued(tmp_path_factory):
    """A run in two files: the recorder was killed in between."""
    run = tmp_path_factory.mktemp("continued") / "run"
    everything = list(recording.everything(SWEEP))
    first = recording.session(run, SWEEP)
    for topic, data in everything[:17]:
        first.take(topic, data, 1_000)
    first.commit(2_000)
    first.abandon()
    second = recording.session(run, SWEEP, epoch=2)
    for topic, data in everything:
        second.take(topic, data, 3_000)
    second.take("inspect", INSPECTED, 3_500)
    for topic, image in pictures().items():
        second.take(topic, serialize_message(image), 3_600)
    recording.finish(second, SWEEP, epoch=2)
    assert len(bag_files(run / "bag")) == 2
    return run


def same_as_kernel(found, topic, names):
    """Assert that messages, as objects, are what was simulated, each chunk once, in every bit."""
    expected = {}
    table = STORED_ONCE[topic]
    for block in range(SWEEP.blocks):
        for chunk, messages in enumerate(recording.chunks(SWEEP, block)):
            expected[block, chunk] = cdr.decode(table, getattr(messages, topic))
    assert sorted((m.block, m.chunk) for m in found) == sorted(expected)
    for message in found:
        values = expected[message.block, message.chunk]
        for name in names:
            given = getattr(message, name)
            if not isinstance(given, bytes):  # mcap-ros2-support reads uint8[] so
                given = np.asarray(given, dtype=values[name].dtype).tobytes()
            assert given == values[name].tobytes(), f"{topic}.{name}"
        run = (
            message.run_id if isinstance(message.run_id, str) else bytes(message.run_id).decode()
        )  # bridge_force's is bytes
        assert (run, message.checksum) == (recording.RUN, values["checksum"])


LAYERS = {
    "bridge_force": ("cells", "data"),
    "stick_slip": ("cells", "slipping", "offsets", "onset", "duration", "slip"),
    "verdicts": ("correlation", "period", "slips", "corners", "regime", "confidence", "beat", "transient"),
}


def what_tools_show_is_there(found):
    """Assert that the inspected cell and the images, as objects, are what was recorded."""
    (shown,), values = found["inspect"], cdr.decode("InspectedCell", INSPECTED)
    assert (shown.cell, shown.name, shown.run_id) == (values["cell"], values["name"], recording.RUN)
    assert shown.header.frame_id == "bow"
    for name in ("periods", "bridge_force"):
        assert np.asarray(getattr(shown, name), np.float32).tobytes() == values[name].tobytes()
    for topic, image in pictures().items():
        (given,) = found[topic]
        assert (given.encoding, given.height, given.width) == (image.encoding, 3, 4)
        assert (given.header.frame_id, given.header.stamp.sec) == ("basin_map", 7)
        assert bytes(given.data) == bytes(image.data)


def test_rosbags_reads_every_topic(continued):
    with AnyReader([continued / "bag"]) as reader:
        assert {c.topic for c in reader.connections} == set(recording.NAMES.values())
        found = {topic: [] for topic in TOPICS}
        for connection, _, data in reader.messages():
            found[short_name(connection.topic)].append(reader.deserialize(data, connection.msgtype))
    for topic, names in LAYERS.items():
        same_as_kernel(found[topic], topic, names)
    what_tools_show_is_there(found)
    assert [plan.state for plan in found["plan"]] == [1, 1, 2]
    assert sum(len(receipt.kind) for receipt in found["receipts"]) >= 24


@pytest.mark.parametrize(("record", "each"), [("last", 3), ("verdicts", 0)])
def test_other_readers_read_a_bag_without_streams(tmp_path, record, each):
    run = recording.record(tmp_path / "run", recording.small_sweep(f"record={record}"))
    with AnyReader([run / "bag"]) as reader:
        counts = {short_name(connection.topic): connection.msgcount for connection in reader.connections}
        assert len(list(reader.messages())) == reader.message_count
    assert (counts["bridge_force"], counts["stick_slip"], counts["verdicts"]) == (each, each, 12)
    with open(bag_files(run / "bag")[0], "rb") as file:
        found = [channel.topic for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages()]
    assert found.count("/bow/bridge_force") == each


@pytest.fixture(scope="module")
def mended(continued, tmp_path_factory):
    """The same run with a damaged chunk in its first file, and resumed: a covered range, and a record that notes it."""
    run = tmp_path_factory.mktemp("mended") / "run"
    shutil.copytree(continued, run)
    path = bag_files(run / "bag")[0]
    content = bytearray(path.read_bytes())
    content[Scan(path).run().contents.chunks[-1].chunk_start_offset + 200] ^= 1
    path.write_bytes(content)
    third = recording.session(run, SWEEP, epoch=3)
    for topic, data in recording.everything(SWEEP):
        third.take(topic, data, 5_000)
    recording.finish(third, SWEEP, epoch=3)
    assert len(bag_files(run / "bag")) == 3
    assert verify(run)["ok"]
    return run


def test_other_readers_read_a_bag_that_was_mended(mended):
    with AnyReader([mended / "bag"]) as reader:
        found = [(short_name(c.topic), reader.deserialize(data, c.msgtype)) for c, _, data in reader.messages()]
    for topic, names in LAYERS.items():
        same_as_kernel([message for name, message in found if name == topic], topic, names)
    numbers, noted = [], []
    for path in bag_files(mended / "bag"):
        with open(path, "rb") as file:
            for record in StreamReader(file, validate_crcs=True).records:  # from the first byte to the last
                noted += [record.name] if isinstance(record, Metadata) else []
        with open(path, "rb") as file:
            reader = make_reader(file, validate_crcs=True)
            numbers += [message.sequence for _, _, message in reader.iter_messages(log_time_order=False)]
            noted += [record.name for record in reader.iter_metadata()]
    assert len(numbers) == len(found) < max(numbers)
    assert noted.count("bow.missing") == 2  # by each of the two ways
    assert noted.count("bow.record") == 6


def test_rosbags_reads_what_the_metadata_say(continued):
    with Reader(continued / "bag") as reader:
        assert reader.message_count == sum(c.msgcount for c in reader.connections)
        assert reader.ros_distro == "jazzy"
        connection = next(c for c in reader.connections if c.topic.endswith("/verdicts"))
        assert connection.digest == type_hash("bow_msgs/msg/Verdicts")
        assert connection.msgtype == "bow_msgs/msg/Verdicts"
        (qos,) = connection.ext.offered_qos_profiles
        assert (qos.history.name, qos.reliability.name) == ("KEEP_ALL", "RELIABLE")


def test_mcap_ros2_support_reads_every_topic(continued):
    found = {topic: [] for topic in TOPICS}
    for path in bag_files(continued / "bag"):
        with open(path, "rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
            assert reader.get_header().profile == "ros2"
            for _, channel, _, message in reader.iter_decoded_messages():
                found[short_name(channel.topic)].append(message)
    what_tools_show_is_there(found)
    for topic, names in LAYERS.items():
        same_as_kernel(found[topic], topic, names)


def test_the_metadata_are_those_of_rosbag2(continued):
    info = yaml.safe_load((continued / "bag" / METADATA).read_text())["rosbag2_bagfile_information"]
    assert (info["version"], info["storage_identifier"], info["ros_distro"]) == (9, "mcap", "jazzy")
    assert info["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]
    assert info["message_count"] == sum(file["message_count"] for file in info["files"])
    counts = {t["topic_metadata"]["name"]: t["message_count"] for t in info["topics_with_message_count"]}
    assert counts[recording.NAMES["bridge_force"]] == 12
    plan = next(
        t["topic_metadata"] for t in info["topics_with_message_count"] if "/plan" in t["topic_metadata"]["name"]
    )
    assert plan["offered_qos_profiles"][0]["durability"] == "transient_local"
    assert plan["type_description_hash"].startswith("RIHS01_")


def test_the_channels_say_what_rosbag2_wants_to_know(recorded):
    with open(bag_files(recorded / "bag")[0], "rb") as file:
        summary = make_reader(file).get_summary()
    for channel in summary.channels.values():
        topic = TOPICS[short_name(channel.topic)]
        schema = summary.schemas[channel.schema_id]
        assert (schema.name, schema.encoding, channel.message_encoding) == (topic.type, "ros2msg", "cdr")
        assert channel.metadata["topic_type_hash"] == type_hash(topic.type)
        (qos,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        assert qos["reliability"] == topic.qos.reliability


def test_schemas_hold_what_they_nest():
    text = definition("bow_msgs/msg/Plan")
    assert text.count("=" * 80) == 1
    assert "MSG: bow_msgs/SweepSpec\n" in text
    assert "string[] settings" in text
    assert "# " in text  # units and shapes are in the comments
    assert definition("sensor_msgs/msg/Image").count("MSG: ") == 2


def test_a_type_that_is_not_installed_is_named():
    with pytest.raises(SchemaError, match=r"Nothing\.msg of package 'bow_msgs': not in share/bow_msgs of"):
        definition("bow_msgs/msg/Nothing")
    with pytest.raises(SchemaError, match="should be of the form package/msg/Type"):
        definition("../../etc/passwd")


def test_topics_are_known_by_the_end_of_their_name():
    assert short_name("/bow/run_1/basin_map/image") == "basin_map/image"
    assert short_name("/bow/run_1/basin_map") == "basin_map"
    assert short_name("/rosout") == "/rosout"
    assert short_name("/elsewhere") == ""


@pytest.mark.full
def test_mcap_core_reads_every_topic(continued, tmp_path):
    """@mcap/core is the reader of Foxglove and other tools; it runs in Node."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip(f"{'node' if node is None else 'npm'} is not installed: @mcap/core was not tried")
    got = subprocess.run(
        [npm, "install", "--no-audit", "--no-fund", *NPM], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    if got.returncode:
        pytest.skip(f"npm install {' '.join(NPM)} did not work, @mcap/core was not tried: {got.stderr[-200:]}")
    script = tmp_path / "read.js"
    shutil.copy(Path(__file__).with_name("read.js"), script)
    files = [str(path) for path in bag_files(continued / "bag")]
    done = subprocess.run(
        [node, str(script), *files], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["counts"][recording.NAMES["bridge_force"]] == 12
    assert result["states"] == [1, 1, 2]
    for block in range(SWEEP.blocks):
        for chunk, messages in enumerate(recording.chunks(SWEEP, block)):
            data = cdr.decode("BridgeForce", messages.bridge_force)["data"]
            assert result["data"][f"{block},{chunk}"] == data.tobytes().hex()
    shown = cdr.decode("InspectedCell", INSPECTED)
    assert result["inspected"] == [[shown["cell"], shown["name"], "bow", shown["bridge_force"].tobytes().hex()]]
    images = {recording.NAMES[topic]: bytes(image.data).hex() for topic, image in pictures().items()}
    assert result["images"] == images
