"""How far a graph reaches: this machine and no further, unless the environment asks for more.

ROS's own variables ask: ``ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET`` (all machines that multicast reaches),
``ROS_STATIC_PEERS=HOST;HOST`` (these), ``ROS_DISCOVERY_SERVER=HOST:PORT``. Each machine of a graph has to ask.
"""

from __future__ import annotations

import ipaddress
import os
import re
import socket
from collections.abc import Mapping
from pathlib import Path

from bow_sim.config_files import find_config

RANGE, PEERS, SERVER = "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER"
PROFILE, LEND = "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_FASTRTPS_USE_QOS_FROM_XML"
DOMAIN = "ROS_DOMAIN_ID"

OWN_FILE_ONLY = "SKIP_DEFAULT_XML_FILE"
"""With 1, Fast DDS does not also read DEFAULT_FASTRTPS_PROFILES.xml of the working directory."""

SUBNET, LOCALHOST, AS_PROFILE = "SUBNET", "LOCALHOST", "SYSTEM_DEFAULT"

LOOPBACK_PROFILE, NETWORK_PROFILE = "fastdds.xml", "fastdds_network.xml"
"""Our middleware profiles, in config/: UDP on 127.0.0.1 alone, and on every interface; both with shared memory."""

SHARED_MEMORY = Path("/dev/shm")

SHARED_ROOM = 256 << 20
"""Bytes free in shared memory that a process wants before it lends its messages there: a simulator takes 34 MB for them
at once, and containers often have 64 MB in all. Without, messages are copied, as they are between machines."""

_HOST = re.compile(r"[0-9A-Za-z]([0-9A-Za-z.-]*[0-9A-Za-z])?")


class ReachError(ValueError):
    """A machine that cannot be meant; says which and what would be right."""


def goes_beyond(environment: Mapping[str, str]) -> bool:
    """Return whether an environment asks for more than this machine."""
    given = (environment.get(RANGE) or LOCALHOST).upper()
    if given == AS_PROFILE and _is_loopback_profile(environment):
        given = LOCALHOST
    return given not in (LOCALHOST, "OFF") or bool(environment.get(PEERS) or environment.get(SERVER))


def _is_loopback_profile(environment: Mapping[str, str]) -> bool:
    profile = find_profile(LOOPBACK_PROFILE)
    return profile is not None and environment.get(PROFILE) == str(profile)


def defaults(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that an environment leaves to us: how far, and the profile that goes with it."""
    out = {} if environment.get(RANGE) else {RANGE: LOCALHOST}
    if PROFILE not in environment:
        profile = find_profile(NETWORK_PROFILE if goes_beyond(environment) else LOOPBACK_PROFILE)
        if profile is not None:
            out[PROFILE] = str(profile)
            if LEND not in environment:
                out[LEND] = str(int(_free(SHARED_MEMORY) >= SHARED_ROOM))
    return out


def _free(directory: Path) -> int:
    """Return the bytes that a file system has left; 0 where there is none."""
    try:
        there = os.statvfs(directory)
    except OSError:
        return 0
    return there.f_bavail * there.f_frsize


def find_profile(name: str) -> Path | None:
    """Return the file of one of our profiles, in config/."""
    return find_config(name)


def asked(network: str) -> dict[str, str]:
    """Return the variables that ``--network WHERE`` stands for.

    Parameters
    ----------
    network
        "SUBNET", or the names or IPv4 addresses of other machines, separated by commas.

    Raises
    ------
    ReachError
        Where a machine is not known.
    """
    if network.upper() == SUBNET:
        return {RANGE: SUBNET}
    hosts = [host.strip() for host in network.split(",")]
    for host in hosts:
        try:
            if not _HOST.fullmatch(host):
                raise OSError("no name of a machine")
            socket.getaddrinfo(host, None, socket.AF_INET)
        except OSError as error:
            reason = error.strerror or error
            raise ReachError(f"{host!r}: {reason}; should be SUBNET, or machines: 10.0.0.2,10.0.0.3") from None
    return {RANGE: LOCALHOST, PEERS: ";".join(hosts)}


def joining(namespace: str, environment: Mapping[str, str]) -> str:
    """Return the command that adds a simulator of another machine to the graph in `namespace`."""
    words = []
    if environment.get(SERVER):
        words += [f"{SERVER}={environment[SERVER]}", "ROS_SUPER_CLIENT=TRUE"]
    elif environment.get(PEERS):
        words.append(f"{PEERS}={_own_address(environment[PEERS].split(';')[0])}")
    else:
        words.append(f"{RANGE}={environment.get(RANGE, SUBNET)}")
    if environment.get(DOMAIN):
        words.append(f"{DOMAIN}={environment[DOMAIN]}")
    return " ".join([*words, "bow", "simulator", "--ros-args", "-r", f"__ns:={namespace}"])


def _own_address(peer: str) -> str:
    """Return the address under which another machine reaches this one: that of the interface towards it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((peer, 9))  # sends nothing
            address = probe.getsockname()[0]
        except OSError:
            return socket.gethostname()
    return socket.gethostname() if ipaddress.ip_address(address).is_loopback else str(address)


def apply_defaults() -> None:
    """Fill in the environment of this process, before it loads the middleware."""
    os.environ.update(as_loaded(os.environ))


def as_loaded(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that the middleware is loaded with.

    Our loopback profile says all that LOCALHOST means: where ROS is told LOCALHOST, it adds a UDP transport on every
    interface to those of a profile, and one more in shared memory.
    """
    out = defaults(environment)
    result = {**environment, **out}
    if PROFILE in out:
        out.setdefault(OWN_FILE_ONLY, "1")
    if result[RANGE].upper() == LOCALHOST and not goes_beyond(result) and _is_loopback_profile(result):
        out[RANGE] = AS_PROFILE
    return out
