"""Imports of large libraries: without optional ones that nothing here needs, and without what else costs time."""

from __future__ import annotations

import contextlib
import gc
import inspect
import sys
from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class _Refusal:
    """In `sys.meta_path`: what Python asks where a module is."""

    names: tuple[str, ...]

    def find_spec(self, name: str, _path: object = None, _target: object = None) -> None:
        if name in self.names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


@contextlib.contextmanager
def absent(*names: str) -> Iterator[None]:
    """Let imports of modules fail in this context, as if they were not installed; those that are loaded stay.

    For libraries that import another one only to support it: Numba coverage.py, pyarrow pandas.
    """
    refusal = _Refusal(names)
    sys.meta_path.insert(0, refusal)
    try:
        yield
    finally:
        sys.meta_path.remove(refusal)


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Let no garbage be collected in this context: imports make none, and it takes a sixth of their time to look."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def know_files() -> None:
    """Tell `inspect` the files of all modules that are loaded: it looks for each of them at the first line of a log."""
    names = getattr(inspect, "_filesbymodname", {})
    for name, module in sys.modules.copy().items():
        if file := getattr(module, "__file__", None):
            names[name] = file
            inspect.modulesbyfile.setdefault(file, name)
