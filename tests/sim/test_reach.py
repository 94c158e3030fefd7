"""A graph stays on its machine unless the environment asks for more; then the profile goes with it."""

import subprocess
import sys

import pytest

from bow_sim import reach


def test_without_a_word_it_is_this_machine_alone() -> None:
    said = reach.defaults({})
    assert said[reach.RANGE] == "LOCALHOST"
    assert said[reach.PROFILE].endswith("/config/fastdds.xml")
    assert not reach.goes_beyond(said)


@pytest.mark.parametrize(
    "asked",
    [{reach.RANGE: "SUBNET"}, {reach.PEERS: "10.0.0.2"}, {reach.SERVER: "10.0.0.1:11811"}, {reach.RANGE: "subnet"}],
)
def test_who_asks_for_more_gets_the_profile_for_it(asked: dict[str, str]) -> None:
    assert reach.goes_beyond(asked)
    said = reach.defaults(asked)
    assert said[reach.PROFILE].endswith("/config/fastdds_network.xml")
    assert reach.RANGE not in asked or reach.RANGE not in said


def test_what_the_user_has_set_stays() -> None:
    assert reach.defaults({reach.RANGE: "OFF", reach.PROFILE: ""}) == {}
    assert reach.defaults({reach.PROFILE: "mine.xml", reach.PEERS: "10.0.0.2"}) == {reach.RANGE: "LOCALHOST"}


def test_both_profiles_name_the_same_shared_memory_and_only_one_the_loopback() -> None:
    texts = {}
    for name in (reach.LOOPBACK_PROFILE, reach.NETWORK_PROFILE):
        found = reach.find_profile(name)
        assert found is not None
        texts[name] = found.read_text()
    assert all("<segment_size>8388608</segment_size>" in text for text in texts.values())
    assert ["127.0.0.1</address>" in text for text in texts.values()] == [True, False]


def test_a_network_is_a_subnet_or_machines() -> None:
    assert reach.asked("subnet") == {reach.RANGE: "SUBNET"}
    assert reach.asked("127.0.0.1, localhost") == {reach.RANGE: "LOCALHOST", reach.PEERS: "127.0.0.1;localhost"}
    for wrong in ("", "10.0.0.1,,10.0.0.2", "a b", "$(reboot)", "no.such.machine.invalid"):
        with pytest.raises(reach.ReachError, match="should be SUBNET, or machines"):
            reach.asked(wrong)


def test_the_command_for_other_machines_says_what_they_must_ask_for() -> None:
    end = "bow simulator --ros-args -r __ns:=/bow/a1"
    assert reach.joining("/bow/a1", {reach.RANGE: "SUBNET"}) == f"ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET {end}"
    assert reach.joining("/bow/a1", {reach.RANGE: "SUBNET", "ROS_DOMAIN_ID": "7"}).startswith(
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET ROS_DOMAIN_ID=7 bow"
    )
    server = reach.joining("/bow/a1", {reach.SERVER: "10.0.0.1:11811"})
    assert server == f"ROS_DISCOVERY_SERVER=10.0.0.1:11811 ROS_SUPER_CLIENT=TRUE {end}"
    assert reach.joining("/bow/a1", {reach.PEERS: "127.0.0.1"}).startswith("ROS_STATIC_PEERS=")


def test_it_is_known_without_ros() -> None:
    code = "import sys, bow_sim.reach; assert not {'rclpy', 'numpy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_messages_are_lent_with_our_profile_where_shared_memory_has_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reach, "_free", lambda _: reach.SHARED_ROOM)
    assert reach.defaults({})[reach.LEND] == "1"
    assert reach.LEND not in reach.defaults({reach.LEND: "0"})
    assert reach.LEND not in reach.defaults({reach.PROFILE: "mine.xml"})
    monkeypatch.setattr(reach, "_free", lambda _: reach.SHARED_ROOM - 1)
    assert reach.defaults({})[reach.LEND] == "0"


def test_the_middleware_is_told_this_machine_by_our_profile_alone() -> None:
    """With LOCALHOST, rmw_fastrtps adds transports on every interface."""
    loaded = reach.as_loaded({})
    assert loaded[reach.RANGE] == "SYSTEM_DEFAULT"
    assert loaded[reach.PROFILE].endswith("/config/fastdds.xml")
    assert loaded[reach.OWN_FILE_ONLY] == "1"
    assert not reach.goes_beyond(loaded)
    assert reach.as_loaded(loaded) == {}, "a child is loaded as its parent"
    assert reach.as_loaded({reach.RANGE: "localhost"})[reach.RANGE] == "SYSTEM_DEFAULT"


def test_only_our_loopback_profile_stands_for_localhost() -> None:
    assert reach.as_loaded({reach.PROFILE: "mine.xml"}) == {reach.RANGE: "LOCALHOST"}
    assert reach.as_loaded({reach.PROFILE: "mine.xml", reach.RANGE: "LOCALHOST"}) == {}
    assert reach.RANGE not in reach.as_loaded({reach.RANGE: "OFF"})
    assert reach.as_loaded({reach.PEERS: "10.0.0.2"})[reach.RANGE] == "LOCALHOST"
    assert reach.goes_beyond({reach.RANGE: "SYSTEM_DEFAULT"})


def test_an_empty_range_is_none() -> None:
    assert not reach.goes_beyond({reach.RANGE: ""})
    assert reach.defaults({reach.RANGE: ""})[reach.RANGE] == "LOCALHOST"


def test_the_loopback_profile_needs_no_multicast() -> None:
    found = reach.find_profile(reach.LOOPBACK_PROFILE)
    assert found is not None
    text = found.read_text()
    assert "<metatrafficUnicastLocatorList>" in text
    assert "<initialPeersList>" in text
