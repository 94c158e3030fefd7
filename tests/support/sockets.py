"""Which sockets the processes of a graph have, in all of their time."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import threading
from collections.abc import Callable, Iterator
from typing import NamedTuple

import psutil

LOOK_S = 0.05


class Socket(NamedTuple):
    """A socket that was bound."""

    process: str
    kind: str
    address: str

    @property
    def is_loopback(self) -> bool:
        """Whether nobody beyond this machine reaches it."""
        return ipaddress.ip_address(self.address).is_loopback


def family(pid: int) -> list[psutil.Process]:
    """Return a process and all below it."""
    with contextlib.suppress(psutil.NoSuchProcess):
        top = psutil.Process(pid)
        return [top, *top.children(recursive=True)]
    return []


def sockets_of(process: psutil.Process) -> set[Socket]:
    """Return the TCP listeners and UDP sockets of a process; what it has connected is not bound to be reached."""
    found = set()
    with contextlib.suppress(psutil.NoSuchProcess, psutil.AccessDenied):
        name = " ".join(process.cmdline())[:600]
        for one in process.net_connections(kind="inet"):
            kind = "TCP" if one.type == socket.SOCK_STREAM else "UDP"
            if kind == "UDP" or one.status == psutil.CONN_LISTEN:
                found.add(Socket(name, kind, one.laddr.ip))
    return found


@contextlib.contextmanager
def sockets_seen(pid: Callable[[], int]) -> Iterator[set[Socket]]:
    """Collect the sockets of a process and all below it, as long as it lasts, looked at again and again."""
    seen: set[Socket] = set()
    over = threading.Event()

    def look() -> None:
        while not over.wait(LOOK_S):
            for process in family(pid()):
                seen.update(sockets_of(process))

    looker = threading.Thread(target=look)
    looker.start()
    try:
        yield seen
    finally:
        over.set()
        looker.join()
