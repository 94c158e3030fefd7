"""Two machines in one: network namespaces joined by a cable, each with its own loopback, name and /dev/shm."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ADDRESSES = ("10.99.0.1", "10.99.0.2")
NEAR, FAR = 0, 1

INSIDE = "mount -t tmpfs tmpfs /dev/shm && hostname {} && ip link set lo up && echo up && exec sleep 600"


@dataclass
class Machines:
    """The two; each is held by a process that sleeps in it."""

    holders: tuple[int, int]

    def command(self, where: int, *words: str) -> list[str]:
        """Return the command that runs `words` on a machine, as the user who joined them."""
        enter = ["nsenter", "-t", str(self.holders[where]), "-U", "--preserve-credentials", "-n", "-m", "-u"]
        return [*enter, f"--wd={Path.cwd()}", "--", *words]

    def run(self, where: int, *words: str) -> str:
        """Run a command on a machine and return what it prints."""
        result = subprocess.run(self.command(where, *words), capture_output=True, text=True, timeout=120, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout


def _boot(name: str, *outer: str) -> subprocess.Popen[bytes]:
    holder = subprocess.Popen([*outer, "sh", "-c", INSIDE.format(name)], stdout=subprocess.PIPE)
    assert holder.stdout is not None
    if holder.stdout.readline() != b"up\n":
        holder.wait()
        raise OSError("no namespaces for this user")
    return holder


@contextlib.contextmanager
def machines() -> Iterator[Machines]:
    """Boot two machines and join them.

    Raises
    ------
    OSError
        Where this user, or this machine, cannot: no unshare, nsenter or ip, or no right to them.
    """
    holders: list[subprocess.Popen[bytes]] = []
    try:
        yield _joined(holders)
    finally:
        for holder in reversed(holders):
            with contextlib.suppress(ProcessLookupError):
                os.kill(holder.pid, signal.SIGKILL)
            holder.wait()
            if holder.stdout is not None:
                holder.stdout.close()


def _joined(holders: list[subprocess.Popen[bytes]]) -> Machines:
    holders.append(_boot("near", "unshare", "-Urnmu"))
    first = Machines((holders[0].pid, holders[0].pid))
    holders.append(_boot("far", *first.command(NEAR, "unshare", "-nmu")))
    both = Machines((holders[0].pid, holders[1].pid))
    try:
        ends = ["cable0", "type", "veth", "peer", "name", "cable1", "netns", str(holders[1].pid)]
        both.run(NEAR, "ip", "link", "add", *ends)
        for where, address in enumerate(ADDRESSES):
            both.run(where, "ip", "address", "add", f"{address}/24", "dev", f"cable{where}")
            both.run(where, "ip", "link", "set", f"cable{where}", "up")
        deadline = time.monotonic() + 10
        while "UP" not in both.run(FAR, "ip", "-brief", "link", "show", "cable1").split():
            assert time.monotonic() < deadline, "the cable does not come up"
            time.sleep(0.05)
    except AssertionError as error:
        raise OSError(str(error)) from None
    return both
