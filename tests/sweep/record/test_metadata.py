"""metadata.yaml is compared by meaning: changes of format by other tools and people are no damage, and are kept."""

import re

import pytest
import recording
import yaml

from bow_sweep.record.bag import METADATA, bag_files
from bow_sweep.record.bag_contents import Survey
from bow_sweep.record.metadata import ROOT, MetadataError, differences, parse
from bow_sweep.record.recover import recover
from bow_sweep.record.replay import replay
from bow_sweep.record.verify import verify

SWEEP = recording.small_sweep()


def whats(result):
    return " | ".join(problem["what"] for problem in result["problems"])


def reordered(text):
    """Return it as another YAML library writes it, with topics and keys in another order."""
    info = yaml.safe_load(text)
    info[ROOT]["topics_with_message_count"].reverse()
    return yaml.safe_dump(info, sort_keys=True)


def of_old(text):
    """Return it as version 5, of ROS 2 Humble: QoS as a string with numbers, no hashes."""
    info = yaml.safe_load(text)[ROOT]
    info["version"] = 5
    for topic in info["topics_with_message_count"]:
        said = topic["topic_metadata"]
        del said["type_description_hash"]
        for profile in said["offered_qos_profiles"]:
            profile["history"] = {"keep_last": 1, "keep_all": 2}[profile["history"]]
            profile["reliability"] = {"reliable": 1, "best_effort": 2}[profile["reliability"]]
            profile["durability"] = {"transient_local": 1, "volatile": 2}[profile["durability"]]
            profile["liveliness"] = 1
        said["offered_qos_profiles"] = yaml.safe_dump(said["offered_qos_profiles"])
    return yaml.safe_dump({ROOT: info})


def without_silent_topics(text):
    info = yaml.safe_load(text)
    topics = info[ROOT]["topics_with_message_count"]
    info[ROOT]["topics_with_message_count"] = [topic for topic in topics if topic["message_count"]]
    return yaml.safe_dump(info)


ALIKE = {
    "a comment": lambda text: "# copied from the lab\n" + text,
    "custom data": lambda text: text.replace("custom_data:\n", "custom_data:\n    note: good\n"),
    "lines of Windows": lambda text: text.replace("\n", "\r\n"),
    "another order": reordered,
    "another distribution": lambda text: text.replace("ros_distro: jazzy", "ros_distro: rolling"),
    "an old version": of_old,
    "no topics without messages": without_silent_topics,
    "endless durations of another middleware": lambda text: text.replace(
        "sec: 9223372036\n              nsec: 854775807", "sec: 2147483647\n              nsec: 4294967295"
    ),
}


@pytest.mark.parametrize("name", ALIKE)
def test_what_means_the_same_is_right_and_is_left_as_it_is(run, name):
    path = run / "bag" / METADATA
    text = ALIKE[name](path.read_text())
    assert text != path.read_text()
    path.write_bytes(text.encode())
    result = verify(run)
    assert result["ok"], whats(result)
    assert replay(run)["ok"]
    assert not recover(run)["metadata_rewritten"]
    assert path.read_bytes() == text.encode()


WRONG = {
    "a count": lambda text: re.sub(r"\n  message_count: \d+", "\n  message_count: 7", text),
    "a topic's count": lambda text: text.replace("      message_count: 12\n", "      message_count: 13\n", 1),
    "a file": lambda text: text.replace("bag_0.mcap", "bag_9.mcap"),
    "a type": lambda text: text.replace("type: bow_msgs/msg/Plan", "type: bow_msgs/msg/Plans"),
    "a hash": lambda text: re.sub("RIHS01_.", "RIHS01_x", text, count=1),
    "a quality of service": lambda text: text.replace("history: keep_all", "history: keep_last"),
    "a time": lambda text: re.sub(r"(nanoseconds_since_epoch: \d)", r"\g<1>1", text, count=1),
    "compression": lambda text: text.replace('compression_mode: ""', "compression_mode: FILE"),
    "a version that is none": lambda text: text.replace("version: 9", "version: nine"),
    "a list for a mapping": lambda text: text.replace("duration:\n    nanoseconds", "duration:\n    - nanoseconds", 1),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_means_something_else_is_named_with_its_remedy_which_works(run, name):
    path = run / "bag" / METADATA
    right = path.read_text()
    text = WRONG[name](right)
    assert text != right
    path.write_text(text)
    result = verify(run)
    assert not result["ok"]
    assert "`bow recover` writes it anew" in whats(result)
    assert recover(run)["metadata_rewritten"]
    assert verify(run)["ok"]
    assert path.read_text() == right


@pytest.mark.parametrize(
    "content", [b"", bytes(500), b"\xff\xfe", b"{", b"- a list", b"rosbag2_bagfile_information: 3"]
)
def test_what_is_no_metadata_is_set_aside_and_written_anew(run, content):
    path = run / "bag" / METADATA
    right = path.read_bytes()
    path.write_bytes(content)
    assert METADATA in [problem.get("file") for problem in verify(run)["problems"]]
    report = recover(run)
    assert (report["ok"], report["metadata_rewritten"]) == (True, True)
    assert (run / "bag_aside" / METADATA).read_bytes() == content
    assert path.read_bytes() == right


def test_what_others_wrote_is_kept_when_a_file_is_added(run):
    path = run / "bag" / METADATA
    ours = parse(path.read_bytes())["custom_data"]
    text = path.read_text().replace("custom_data:\n", "custom_data:\n    note: good\n    by: [me, you]\n")
    path.write_text(text.replace("  ros_distro", "  lab: 12\n  ros_distro"))
    again = recording.session(run, SWEEP, epoch=2)
    recording.finish(again, SWEEP, epoch=2)
    info = parse(path.read_bytes())
    assert info["custom_data"] == {"note": "good", "by": ["me", "you"], **ours}
    assert info["lab"] == 12
    assert info["relative_file_paths"] == ["bag_0.mcap", "bag_1.mcap"]
    assert verify(run)["ok"]


def test_numbers_that_rosbag2_of_old_wrote_are_words_of_today(recorded):
    survey = Survey(recorded / "bag").read()
    text = (recorded / "bag" / METADATA).read_text()
    assert differences(parse(of_old(text).encode()), survey.files) == []
    mixed = of_old(text).replace("version: 5", "version: 9")
    assert "makes no sense" in differences(parse(mixed.encode()), survey.files)[0]


def test_yaml_that_nests_without_end_is_refused(recorded):
    with pytest.raises(MetadataError):
        parse(b"[" * 5000)
    assert len(bag_files(recorded / "bag")) == 1
