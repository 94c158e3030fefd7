"""On which machines nodes find each other: on this one only, unless the environment names more.

The variables of ROS do that: ``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` (all machines that multicast reaches),
``ROS_STATIC_PEERS=HOST;HOST`` (these machines), ``ROS_DISCOVERY_SERVER=HOST:PORT``. They must be set on each machine of
a graph.
"""

from __future__ import annotations

import ipaddress
import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path

from bow_sim.config_files import find_config
from bow_sim.graph.exposure import objection, own_addresses

RANGE, PEERS, SERVER = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"
PROFILE, DATA_SHARING = "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_FASTRTPS_USE_QOS_FROM_XML"
DOMAIN = "ROS_DOMAIN_ID"

OWN_FILE_ONLY = "SKIP_DEFAULT_XML_FILE"
"""If it is 1, Fast DDS does not read DEFAULT_FASTRTPS_PROFILES.xml in the working directory too."""

SUBNET, LOCALHOST, AS_PROFILE = "SUBNET", "LOCALHOST", "SYSTEM_DEFAULT"

LOOPBACK_PROFILE, NETWORK_PROFILE = "fastdds.xml", "fastdds_network.xml"
"""Profiles of the middleware, in config/: UDP on 127.0.0.1 only, and on every interface; both with shared memory."""

SHARED_MEMORY = Path("/dev/shm")

SHARED_MEMORY_NEEDED = 256 << 20
"""Free bytes of shared memory from which on data sharing is used: a simulator reserves 27 MB for its messages, and
containers often have 64 MB in all. Without data sharing messages are copied, as between machines."""

_HOST = re.compile(r"[0-9A-Za-z]([0-9A-Za-z.-]*[0-9A-Za-z])?")


class NetworkError(ValueError):
    """A machine that does not exist, or a network that is open to all; the text says which, and what would be right."""


def goes_beyond(environment: Mapping[str, str]) -> bool:
    """Return whether an environment extends the graph to other machines."""
    given = (environment.get(RANGE) or LOCALHOST).upper()
    if given == AS_PROFILE and _is_loopback_profile(environment):
        given = LOCALHOST
    return given not in (LOCALHOST, "OFF") or bool(environment.get(PEERS) or environment.get(SERVER))


def network_of(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables of an environment that say which machines a graph reaches."""
    return {name: environment[name] for name in (RANGE, PEERS, SERVER) if environment.get(name)}


def _is_loopback_profile(environment: Mapping[str, str]) -> bool:
    profile = find_profile(LOOPBACK_PROFILE)
    return profile is not None and environment.get(PROFILE) == str(profile)


def defaults(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables to set where an environment does not: range of discovery, profile, data sharing."""
    out = {} if environment.get(RANGE) else {RANGE: LOCALHOST}
    if PROFILE not in environment:
        profile = find_profile(NETWORK_PROFILE if goes_beyond(environment) else LOOPBACK_PROFILE)
        if profile is not None:
            out[PROFILE] = str(profile)
            if DATA_SHARING not in environment:
                out[DATA_SHARING] = str(int(_free(SHARED_MEMORY) >= SHARED_MEMORY_NEEDED))
    return out


def _free(directory: Path) -> int:
    """Return the free bytes of a file system; 0 if the directory does not exist."""
    try:
        there = os.statvfs(directory)
    except OSError:
        return 0
    return there.f_bavail * there.f_frsize


def find_profile(name: str) -> Path | None:
    """Return the file of one of our profiles, in config/."""
    return find_config(name)


def variables_for(network: str, trusted: bool = False) -> dict[str, str]:
    """Return the variables that ``--network WHERE`` stands for.

    Parameters
    ----------
    network
        "SUBNET", or the names or IPv4 addresses of other machines, separated by commas.
    trusted
        Whether the user has said that public addresses are all right.

    Raises
    ------
    NetworkError
        If a machine is not known; or if it, or this one, has a public address and that is not `trusted`.
    """
    hosts = [] if network.upper() == SUBNET else [host.strip() for host in network.split(",")]
    peers = []
    for host in hosts:
        try:
            if not _HOST.fullmatch(host):
                raise OSError("not the name of a machine")
            found = socket.getaddrinfo(host, None, socket.AF_INET)
        except OSError as error:
            reason = error.strerror or error
            raise NetworkError(f"{host!r}: {reason}; should be SUBNET, or machines: 10.0.0.2,10.0.0.3") from None
        peers += [(host, str(address[0])) for *_, address in found]
    why = "" if trusted else objection(peers, own_addresses())
    if why:
        raise NetworkError(why)
    return {RANGE: LOCALHOST, PEERS: ";".join(hosts)} if hosts else {RANGE: SUBNET}


def join_command(namespace: str, environment: Mapping[str, str]) -> str:
    """Return the command that starts a simulator on another machine, for the graph in `namespace`."""
    return " ".join([*_join_variables(environment), "bow", "simulator", "--ros-args", "-r", f"__ns:={namespace}"])


def station_command(run_id: str, environment: Mapping[str, str]) -> str:
    """Return the command that starts a station on another machine; `NAME` is for the user to choose."""
    return " ".join([*_join_variables(environment), "bow", "station", "NAME", "--run", run_id])


def _join_variables(environment: Mapping[str, str]) -> list[str]:
    """Return the variables with which another machine reaches the graph of this one."""
    words = []
    if environment.get(SERVER):
        words += [f"{SERVER}={environment[SERVER]}", "ROS_SUPER_CLIENT=TRUE"]
    elif environment.get(PEERS):
        words.append(f"{PEERS}={_own_address(environment[PEERS].split(';')[0])}")
    else:
        words.append(f"{RANGE}={environment.get(RANGE, SUBNET)}")
    if environment.get(DOMAIN):
        words.append(f"{DOMAIN}={environment[DOMAIN]}")
    return words


def _own_address(peer: str) -> str:
    """Return the address under which another machine reaches this one: that of the interface that routes to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((peer, 9))  # for UDP this sends nothing
            address = probe.getsockname()[0]
        except OSError:
            return socket.gethostname()
    return socket.gethostname() if ipaddress.ip_address(address).is_loopback else str(address)


def apply_defaults() -> None:
    """Set the variables of this process that it needs before it loads the middleware."""
    os.environ.update(as_loaded(os.environ))


def as_loaded(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables to set before the middleware is loaded.

    With our loopback profile the range of discovery is SYSTEM_DEFAULT: with LOCALHOST, rmw_fastrtps would add to the
    transports of the profile a UDP transport on every interface, and a second one in shared memory.
    """
    out = defaults(environment)
    result = {**environment, **out}
    if PROFILE in out:
        out.setdefault(OWN_FILE_ONLY, "1")
    if result[RANGE].upper() == LOCALHOST and not goes_beyond(result) and _is_loopback_profile(result):
        out[RANGE] = AS_PROFILE
    return out
