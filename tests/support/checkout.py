"""The checkout under test, for the tests that build or install it."""

from __future__ import annotations

import ast
import shutil
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]


@cache
def assigned(name: str) -> Any:
    """The value of a literal in setup.py."""
    for statement in ast.parse((ROOT / "setup.py").read_text()).body:
        if isinstance(statement, ast.Assign) and getattr(statement.targets[0], "id", "") == name:
            return ast.literal_eval(statement.value)
    raise AssertionError(f"setup.py has no {name}")


def copy_sources(target: Path) -> None:
    """Copy the sources: no environment, no builds, no caches, no runs."""
    left_out = (".git", ".venv", "build", "install", "log", "dist", "runs", "*.egg-info", "__pycache__", ".*_cache")
    shutil.copytree(ROOT, target, symlinks=True, ignore=shutil.ignore_patterns(*left_out, ".hypothesis"))
