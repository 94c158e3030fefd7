"""What may keep nodes from receiving each other's messages, as far as this machine shows it."""

from __future__ import annotations

import socket
from collections.abc import Mapping

from bow_sim.graph.discovery import LOOPBACK_PROFILE, NETWORK_PROFILE, PEERS, PROFILE, RANGE, SERVER, find_profile

LOOPBACK = "127.0.0.1"


def network_hints(environment: Mapping[str, str]) -> list[str]:
    """Return what to check if nodes do not hear each other, likely causes first; each a clause to print."""
    hints = []
    problem = _loopback_problem()
    if problem:
        hints.append(f"{problem} (ip link set lo up; ip address show lo)")
    if environment.get(RANGE, "").upper() == "OFF":
        hints.append(f"{RANGE}=OFF lets no node find another; should be LOCALHOST, SUBNET, or not set")
    if environment.get(SERVER):
        hints.append(f"{SERVER}={environment[SERVER]}: does a discovery server run there?")
    if environment.get(PEERS):
        hints.append(f"{PEERS}={environment[PEERS]}: can these machines be reached?")
    ours = [str(find_profile(name)) for name in (LOOPBACK_PROFILE, NETWORK_PROFILE)]
    if environment.get(PROFILE) and environment[PROFILE] not in ours:
        hints.append(f"{PROFILE}={environment[PROFILE]}: does this profile let nodes of one machine meet?")
    return hints or ["ROS_DOMAIN_ID and namespace should be the same for all nodes, and /dev/shm writable"]


def _loopback_problem() -> str:
    """Return what is wrong with the loopback interface, tested with one datagram; "" if nothing."""
    try:
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here,
        ):
            there.bind((LOOPBACK, 0))
            there.settimeout(0.2)
            here.sendto(b"?", there.getsockname())
            there.recv(1)
    except TimeoutError:
        return f"a datagram to {LOOPBACK} does not arrive"
    except OSError as error:
        return f"{LOOPBACK} cannot be used: {error.strerror}"
    return ""
