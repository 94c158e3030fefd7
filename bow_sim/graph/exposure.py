"""Whether a network would open the graph to the whole internet.

The wheels of Fast DDS are built without DDS security: nothing is encrypted, and nobody is asked who he is. With a
network, DDS listens on every interface of a machine. So a network is one whose members are trusted, and a public
address is a sign that it is not.
"""

from __future__ import annotations

import contextlib
import ipaddress
import re
from collections.abc import Iterable
from pathlib import Path

TRUST = "--i-trust-this-network"
"""The option that takes the objection back."""

ROUTES = Path("/proc/net/fib_trie")
"""Linux's table of IPv4 routes, with the addresses of this machine; DDS uses IPv4 here."""

_OWN = re.compile(r"\|-- (\S+)\n\s+/32 host LOCAL")


def is_public(address: str) -> bool:
    """Return whether an IPv4 address is a global unicast address: packets from anywhere may reach it."""
    known = ipaddress.IPv4Address(address)
    return known.is_global and not known.is_multicast


def addresses_in(table: str) -> list[str]:
    """Return the addresses of a machine, each once, from the text of its `ROUTES`."""
    return list(dict.fromkeys(_OWN.findall(table)))


def own_addresses() -> list[str]:
    """Return the IPv4 addresses of this machine, of all its interfaces; none where Linux does not tell."""
    with contextlib.suppress(OSError):
        return addresses_in(ROUTES.read_text())
    return []


def objection(peers: Iterable[tuple[str, str]], own: Iterable[str]) -> str:
    """Return why a network is not to be used without the user's word, and what would be right; "" if it may be.

    Parameters
    ----------
    peers
        Pairs of name and IPv4 address of other machines.
    own
        The IPv4 addresses of this machine.
    """
    found = [f"{name}: is at {address}, a public address" for name, address in peers if is_public(address)]
    found += [f"this machine has the public address {address}" for address in own if is_public(address)]
    if not found:
        return ""
    return (
        f"{found[0]}: DDS would send and take unencrypted data there, from and to anybody. Use a private network or a "
        f"VPN; or, if a firewall keeps strangers out, add {TRUST}"
    )
