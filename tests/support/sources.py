"""Which of our modules a module is made of."""

from __future__ import annotations

import ast
from pathlib import Path

from rooms import modules


def made_of(start: str) -> dict[str, Path]:
    """Return the modules of ours that a module imports, directly or not, with their files; itself too."""
    known, found, open_ = modules(), {}, [start]
    while open_:
        name = open_.pop()
        if name in found or name not in known:
            continue
        found[name] = known[name]
        if known[name].name == "__init__.py":  # imports its public names only when they are used
            continue
        for node in ast.walk(ast.parse(known[name].read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                open_ += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return {name: path for name, path in found.items() if path.name != "__init__.py"}
