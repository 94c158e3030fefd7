"""A bridge force out of an MCAP bag: of another program's topic, and of a cell of a run."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from measured import BETA, F0, RATE, blocks, played

import bow
from bow.recorded import read_recording
from bow.recordings import RecordingError
from bow_sweep.cli import main


def multi_array(samples: np.ndarray, dtype: str) -> bytes:
    """CDR bytes of a std_msgs MultiArray with an empty layout."""
    head = b"\x00\x01\x00\x00" + struct.pack("<III", 0, 0, len(samples))
    return head + b"\0" * (-(len(head) - 4) % np.dtype(dtype).itemsize) + samples.astype(dtype).tobytes()


def write(path: Path, topics: dict[str, tuple[str, list[bytes]]]) -> Path:
    with open(path, "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start("ros2", "somebody else's recorder")
        for topic, (kind, messages) in topics.items():
            schema = writer.register_schema(kind, "ros2msg", b"")
            channel = writer.register_channel(topic, "cdr", schema)
            for number, data in enumerate(messages):
                writer.add_message(channel, number, data, number)
        writer.finish()
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag with the force of a string as 32 and as 64 bits, and a topic of text."""
    parts = [block for block, _ in blocks(played(0.4))]
    topics = {
        "/force": ("std_msgs/msg/Float32MultiArray", [multi_array(part, "<f4") for part in parts]),
        "/force64": ("std_msgs/msg/Float64MultiArray", [multi_array(part, "<f8") for part in parts]),
        "/name": ("std_msgs/msg/String", [b"\x00\x01\x00\x00" + struct.pack("<I", 2) + b"g\0"]),
    }
    return write(tmp_path_factory.mktemp("bag") / "take.mcap", topics)


@pytest.mark.parametrize(("topic", "within"), [("/force", 1e-6), ("force64", 0.0)])
def test_a_topic_of_another_program_is_judged_as_its_samples_are(bag: Path, topic: str, within: float) -> None:
    wave = played(0.4)
    assert read_recording(bag, topic=topic).samples == pytest.approx(wave, abs=within)
    found = bow.classify(bag, RATE, F0, beta=BETA, topic=topic)
    assert found.regime.tolist() == bow.classify(wave, RATE, F0, beta=BETA).regime.tolist()
    assert set(found.regime[1:]) == {"helmholtz"}


def test_a_cell_of_a_run_says_its_own_rate_and_string(run: Path, computed: bow.Map) -> None:
    (file,) = (run / "bag").glob("*.mcap")
    cell = computed.cell(5)
    found = read_recording(file, topic="bridge_force", cell=5)
    assert np.array_equal(found.samples, cell.bridge_force)
    period, bridge = computed.settings["period"], computed.settings["bow_bridge"]
    assert found.sample_rate == cell.sample_rate
    assert found.f0 == pytest.approx(cell.sample_rate / period)
    assert found.beta == pytest.approx(bridge / period)
    judged = bow.classify(file, cell=5)
    assert (
        judged.regime.tolist()
        == bow.classify(cell.bridge_force, cell.sample_rate, found.f0, beta=found.beta).regime.tolist()
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--rate", "48000"], "which topic? There is: /force, /force64"),
        (["--rate", "48000", "--topic", "nothing"], "no topic nothing; there is: /force, /force64"),
        (["--rate", "48000", "--topic", "/name"], "/name is of type std_msgs/msg/String; there is: /force"),
        (["--topic", "/force"], "does not say its sample rate; give it"),
    ],
    ids=["no topic", "unknown", "text", "no rate"],
)
def test_a_topic_that_cannot_be_judged_is_one_line(
    bag: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["classify", str(bag), "--f0", "440", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_what_is_no_whole_bag_is_named(bag: Path, run: Path, tmp_path: Path) -> None:
    cut, text = tmp_path / "cut.mcap", tmp_path / "text.mcap"
    cut.write_bytes(bag.read_bytes()[:-400])
    text.write_text("no bag at all, but long enough to be taken for one at first sight")
    (file,) = (run / "bag").glob("*.mcap")
    for path, known, words in (
        (cut, {"topic": "/force"}, "cut.mcap"),
        (text, {}, "cannot be read"),
        (file, {"cell": 9999}, "cell 9999: the run has"),
    ):
        with pytest.raises(RecordingError, match=words):
            read_recording(path, **known)


def test_a_damaged_message_is_named(tmp_path: Path) -> None:
    whole = multi_array(played(0.1), "<f4")
    bag = write(tmp_path / "a.mcap", {"/force": ("std_msgs/msg/Float32MultiArray", [whole[:-7]])})
    with pytest.raises(
        RecordingError, match=r"a\.mcap: cannot be read: std_msgs/msg/Float32MultiArray: not such a message"
    ):
        read_recording(bag)
