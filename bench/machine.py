"""Which machine, which versions: what a figure needs beside it to mean anything."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import re
import subprocess
import time
from pathlib import Path
from typing import Any

from bow_sim.kernel.sources import program
from bow_sweep.run.directory import VERSIONS_OF

ROOT = Path(__file__).resolve().parent.parent


def _read(path: str) -> str:
    try:
        return Path(path).read_text()
    except OSError:
        return ""


def _field(text: str, name: str) -> str:
    found = re.search(rf"^{name}\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1].strip() if found else ""


def commit() -> str:
    """Return the commit of this checkout, with "+" where files differ from it; "" outside of git."""

    def git(*words: str) -> str:
        done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        name = git("rev-parse", "--short", "HEAD")
        return name + ("+" if name and git("status", "--porcelain", "--untracked-files=no") else "")
    except OSError:
        return ""


def versions() -> dict[str, str]:
    """Return the versions of Python and of what a run is made with."""
    found = {"python": platform.python_version()}
    for name in VERSIONS_OF:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return found


def describe() -> dict[str, Any]:
    """Return the machine, its load now, and the versions, as plain data."""
    cpu = _read("/proc/cpuinfo")
    system = _field(_read("/etc/os-release").replace("=", ":").replace('"', ""), "PRETTY_NAME")
    memory = _field(_read("/proc/meminfo"), "MemTotal").split()
    governor = _read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor").strip()
    virtual = "hypervisor" in _field(cpu, "flags").split()
    return {
        "cpu": f"{_field(cpu, 'model name')} (family {_field(cpu, 'cpu family')}, model {_field(cpu, 'model')})",
        "cores": len(os.sched_getaffinity(0)),
        "memory_gb": round(int(memory[0]) * 1024 / 1e9, 1) if memory else None,
        "virtual": virtual,
        "governor": governor or "not to be seen from here",
        "system": f"{system}, {platform.system()} {platform.release()}",
        "load": os.getloadavg()[0],
        "date": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
        "commit": commit(),
        "kernel": program(),
        "versions": versions(),
    }


def line(machine: dict[str, Any]) -> str:
    """Return a description as one line for people."""
    kind = "a virtual machine" if machine["virtual"] else f"governor {machine['governor']}"
    return (
        f"{machine['cpu']}, {machine['cores']} cores, {machine['memory_gb']} GB, {kind}; {machine['system']}; "
        f"load {machine['load']:.1f} at the start; {machine['date']}; commit {machine['commit'] or 'unknown'}"
    )
