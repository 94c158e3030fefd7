"""A graph stays on its machine unless the environment names more; the profile follows from that."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bow_sim.graph import discovery, exposure


def test_by_default_it_is_this_machine_alone() -> None:
    said = discovery.defaults({})
    assert said[discovery.RANGE] == "LOCALHOST"
    assert said[discovery.PROFILE].endswith("/config/fastdds.xml")
    assert not discovery.goes_beyond(said)


@pytest.mark.parametrize(
    "asked",
    [
        {discovery.RANGE: "SUBNET"},
        {discovery.PEERS: "10.0.0.2"},
        {discovery.SERVER: "10.0.0.1:11811"},
        {discovery.RANGE: "subnet"},
    ],
)
def test_an_environment_that_names_more_machines_gets_the_profile_for_it(asked: dict[str, str]) -> None:
    assert discovery.goes_beyond(asked)
    said = discovery.defaults(asked)
    assert said[discovery.PROFILE].endswith("/config/fastdds_network.xml")
    assert discovery.RANGE not in asked or discovery.RANGE not in said


def test_what_the_user_has_set_stays() -> None:
    assert discovery.defaults({discovery.RANGE: "OFF", discovery.PROFILE: ""}) == {}
    assert discovery.defaults({discovery.PROFILE: "mine.xml", discovery.PEERS: "10.0.0.2"}) == {
        discovery.RANGE: "LOCALHOST"
    }


def test_both_profiles_name_the_same_shared_memory_and_only_one_the_loopback() -> None:
    texts = {}
    for name in (discovery.LOOPBACK_PROFILE, discovery.NETWORK_PROFILE):
        found = discovery.find_profile(name)
        assert found is not None
        texts[name] = found.read_text()
    assert all("<segment_size>8388608</segment_size>" in text for text in texts.values())
    assert ["127.0.0.1</address>" in text for text in texts.values()] == [True, False]


@pytest.mark.parametrize("name", [discovery.LOOPBACK_PROFILE, discovery.NETWORK_PROFILE])
def test_what_the_middleware_says_goes_to_stderr(name: str, tmp_path: Path) -> None:
    found = discovery.find_profile(name)
    assert found is not None
    wrong = tmp_path / "wrong.xml"
    wrong.write_text(found.read_text().replace("<type>SHM</type>", "<type>SHM</type><nonsense/>"))
    environment = {**os.environ, discovery.PROFILE: str(wrong), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    program = "import rclpy; rclpy.init(); rclpy.create_node('one'); print('done'); rclpy.shutdown()"
    command = [sys.executable, "-c", program]
    said = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60, env=environment)
    assert said.stdout == "done\n"
    assert "Invalid element" in said.stderr


def test_a_network_is_a_subnet_or_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "own_addresses", lambda: ["127.0.0.1"])
    assert discovery.variables_for("subnet") == {discovery.RANGE: "SUBNET"}
    assert discovery.variables_for("127.0.0.1, localhost") == {
        discovery.RANGE: "LOCALHOST",
        discovery.PEERS: "127.0.0.1;localhost",
    }
    for wrong in ("", "10.0.0.1,,10.0.0.2", "a b", "$(reboot)", "no.such.machine.invalid"):
        with pytest.raises(discovery.NetworkError, match="should be SUBNET, or machines"):
            discovery.variables_for(wrong)


def test_a_network_with_public_addresses_needs_the_users_word(monkeypatch: pytest.MonkeyPatch) -> None:
    own = ["127.0.0.1", "10.0.0.1", "192.168.1.4", "100.64.3.2", "172.20.0.1"]
    monkeypatch.setattr(discovery, "own_addresses", lambda: own)
    assert discovery.variables_for("10.0.0.2,100.64.3.3")[discovery.PEERS] == "10.0.0.2;100.64.3.3"
    assert discovery.variables_for("SUBNET") == {discovery.RANGE: "SUBNET"}
    with pytest.raises(discovery.NetworkError, match=r"^8\.8\.8\.8: is at 8\.8\.8\.8, a public.*--i-trust-this-net"):
        discovery.variables_for("10.0.0.2,8.8.8.8")
    assert discovery.variables_for("8.8.8.8", trusted=True)[discovery.PEERS] == "8.8.8.8"
    own.append("8.8.4.4")
    for network in ("SUBNET", "10.0.0.2"):
        with pytest.raises(discovery.NetworkError, match=r"this machine has the public address 8\.8\.4\.4"):
            discovery.variables_for(network)
        discovery.variables_for(network, trusted=True)
    with pytest.raises(discovery.NetworkError, match="should be SUBNET"):
        discovery.variables_for("no.such.machine.invalid", trusted=True)


ROUTES = """Main:
  +-- 0.0.0.0/0 3 0 5
     |-- 0.0.0.0
        /0 universe UNICAST
     +-- 10.0.0.0/24 2 0 2
        |-- 10.0.0.0
           /24 link UNICAST
        |-- 10.0.0.7
           /32 host LOCAL
        |-- 10.0.0.255
           /32 link BROADCAST
Local:
        |-- 10.0.0.7
           /32 host LOCAL
        |-- 127.0.0.1
           /32 host LOCAL
"""
"""The form of /proc/net/fib_trie."""


def test_the_addresses_of_this_machine_are_those_that_linux_routes_to_itself() -> None:
    assert exposure.addresses_in(ROUTES) == ["10.0.0.7", "127.0.0.1"]
    assert "127.0.0.1" in exposure.own_addresses()


def test_the_command_for_other_machines_sets_their_variables() -> None:
    end = "bow simulator --ros-args -r __ns:=/bow/a1"
    assert (
        discovery.join_command("/bow/a1", {discovery.RANGE: "SUBNET"}) == f"ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET {end}"
    )
    assert discovery.join_command("/bow/a1", {discovery.RANGE: "SUBNET", "ROS_DOMAIN_ID": "7"}).startswith(
        "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET ROS_DOMAIN_ID=7 bow"
    )
    server = discovery.join_command("/bow/a1", {discovery.SERVER: "10.0.0.1:11811"})
    assert server == f"ROS_DISCOVERY_SERVER=10.0.0.1:11811 ROS_SUPER_CLIENT=TRUE {end}"
    assert discovery.join_command("/bow/a1", {discovery.PEERS: "127.0.0.1"}).startswith("ROS_STATIC_PEERS=")


def test_it_is_known_without_ros() -> None:
    code = "import sys, bow_sim.graph.discovery; assert not {'rclpy', 'numpy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_data_sharing_is_used_with_our_profile_where_shared_memory_is_large_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(discovery, "_free", lambda _: discovery.SHARED_MEMORY_NEEDED)
    assert discovery.defaults({})[discovery.DATA_SHARING] == "1"
    assert discovery.DATA_SHARING not in discovery.defaults({discovery.DATA_SHARING: "0"})
    assert discovery.DATA_SHARING not in discovery.defaults({discovery.PROFILE: "mine.xml"})
    monkeypatch.setattr(discovery, "_free", lambda _: discovery.SHARED_MEMORY_NEEDED - 1)
    assert discovery.defaults({})[discovery.DATA_SHARING] == "0"


def test_only_our_profile_restricts_the_middleware_to_this_machine() -> None:
    """With LOCALHOST, rmw_fastrtps adds transports on every interface."""
    loaded = discovery.as_loaded({})
    assert loaded[discovery.RANGE] == "SYSTEM_DEFAULT"
    assert loaded[discovery.PROFILE].endswith("/config/fastdds.xml")
    assert loaded[discovery.OWN_FILE_ONLY] == "1"
    assert not discovery.goes_beyond(loaded)
    assert discovery.as_loaded(loaded) == {}, "a child is loaded as its parent"
    assert discovery.as_loaded({discovery.RANGE: "localhost"})[discovery.RANGE] == "SYSTEM_DEFAULT"


def test_only_our_loopback_profile_stands_for_localhost() -> None:
    assert discovery.as_loaded({discovery.PROFILE: "mine.xml"}) == {discovery.RANGE: "LOCALHOST"}
    assert discovery.as_loaded({discovery.PROFILE: "mine.xml", discovery.RANGE: "LOCALHOST"}) == {}
    assert discovery.RANGE not in discovery.as_loaded({discovery.RANGE: "OFF"})
    assert discovery.as_loaded({discovery.PEERS: "10.0.0.2"})[discovery.RANGE] == "LOCALHOST"
    assert discovery.goes_beyond({discovery.RANGE: "SYSTEM_DEFAULT"})


def test_an_empty_range_is_none() -> None:
    assert not discovery.goes_beyond({discovery.RANGE: ""})
    assert discovery.defaults({discovery.RANGE: ""})[discovery.RANGE] == "LOCALHOST"


def test_the_loopback_profile_needs_no_multicast() -> None:
    found = discovery.find_profile(discovery.LOOPBACK_PROFILE)
    assert found is not None
    text = found.read_text()
    assert "<metatrafficUnicastLocatorList>" in text
    assert "<initialPeersList>" in text
