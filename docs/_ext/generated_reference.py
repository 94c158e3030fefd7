"""Writes the pages of reference/generated/ before each build, so that they cannot fall behind the code.

API pages from the docstrings, one for each package and room, found by walking the packages; the command line from
``--help``; the settings from ``bow settings``; the messages from msg_defs/.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import pkgutil
import re
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ("bow", "bow_sim", "bow_classifier", "bow_sweep")
ENTRY = re.compile(r"(\w+) +(.+)")
"""A line of a package's docstring that lists a module: its name, spaces up to a column, what is in it."""


def heading(text: str, line: str = "=") -> str:
    """Return a reStructuredText heading."""
    return f"{text}\n{line * len(text)}\n\n"


def packages(name: str) -> Iterator[str]:
    """Yield the name of a package and those of all packages in it."""
    yield name
    for part in pkgutil.iter_modules(importlib.import_module(name).__path__, f"{name}."):
        if part.ispkg:
            yield from packages(part.name)


def listing(lines: list[str]) -> dict[int, re.Match[str]]:
    """Return the lines of a docstring that list modules, by number: paragraphs in two columns."""
    found: dict[int, re.Match[str]] = {}
    paragraph: dict[int, re.Match[str] | None] = {}
    for number, line in enumerate([*lines, ""]):
        if line:
            paragraph[number] = ENTRY.fullmatch(line)
            continue
        entries = {at: entry for at, entry in paragraph.items() if entry}
        if len(entries) == len(paragraph) and any("  " in entry[0] for entry in entries.values()):
            found |= entries
        paragraph = {}
    return found


def api_page(package: str) -> str:
    """Return the page of one package: its docstring, then its modules in the order of their list in the docstring."""
    module = importlib.import_module(package)
    parts = [part.name for part in pkgutil.iter_modules(module.__path__) if not part.ispkg and part.name != "__main__"]
    listed = [entry[1] for entry in listing((module.__doc__ or "").splitlines()).values()]
    parts.sort(key=lambda part: listed.index(part) if part in listed else len(listed))
    text = heading(package) + f".. automodule:: {package}\n   :no-members:\n\n"
    for name in (f"{package}.{part}" for part in parts):
        text += heading(name, "-") + f".. automodule:: {name}\n\n"
    return text


def help_of(parser: argparse.ArgumentParser) -> str:
    """Return what ``--help`` prints, as a block of text."""
    lines = parser.format_help().rstrip().splitlines()
    return ".. code-block:: text\n\n" + "\n".join(f"   {line}".rstrip() for line in lines) + "\n\n"


def command_page() -> str:
    """Return the page of the command line: ``bow --help``, then each command's."""
    from bow_sweep.cli.parser import parser

    top = parser()
    text = heading("The command bow") + "Printed by ``bow --help`` and ``bow COMMAND --help``.\n\n" + help_of(top)
    (commands,) = (action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        if command.add_help:  # the nodes' own help comes from rclpy: see config/nodes.yaml
            text += heading(f"bow {name}", "-") + help_of(command)
    return text


def settings_page() -> str:
    """Return the page of all settings, what ``bow settings`` prints as a list of definitions."""
    from bow_sweep.cli import main

    with contextlib.redirect_stdout(io.StringIO()) as printed:
        main(["settings"])
    text = heading("Settings") + "Printed by ``bow settings``: name and default; meaning, unit, range and source.\n"
    text += "Any of them can be given as ``--set NAME=VALUE``.\n\n"
    terms: list[str] = []
    for line in printed.getvalue().splitlines():
        if not line.startswith(" "):
            terms.append(f"``{line.strip()}``")
        else:
            text += ", ".join(terms) + "\n" if terms else ""
            text += "    " + re.sub(r"([\\\\*`|_])", r"\\\1", line.strip()) + "\n"
            terms = []
    return text


def messages_page() -> str:
    """Return the page of all messages and actions: their definitions, with units and shapes in the comments."""
    text = heading("Messages and actions") + "The ROS package ``bow_msgs``, built from ``msg_defs/``.\n\n"
    kinds = ("msg/*.msg", "srv/*.srv", "action/*.action")
    for path in (path for kind in kinds for path in sorted((ROOT / "msg_defs").glob(kind))):
        text += heading(f"bow_msgs/{path.parent.name}/{path.stem}", "-")
        text += f".. literalinclude:: /../msg_defs/{path.parent.name}/{path.name}\n   :language: text\n\n"
    return text


def index_page(names: list[str]) -> str:
    """Return the page that lists the API pages."""
    entries = "".join(f"   {name}\n" for name in names)
    text = heading("Python packages") + "Made from the docstrings; one page for each package and room.\n\n"
    return text + f".. toctree::\n   :maxdepth: 1\n\n{entries}"


def write(folder: Path) -> None:
    """Write all pages; a page that has not changed keeps its date, so that Sphinx does not read it again."""
    os.environ["COLUMNS"] = "100"  # argparse takes the width of its lines from here
    names = [name for package in PACKAGES for name in packages(package)]
    pages = {f"api/{name}.rst": api_page(name) for name in names}
    pages["api/index.rst"] = index_page(names)
    pages |= {"command.rst": command_page(), "settings.rst": settings_page(), "messages.rst": messages_page()}
    for path in folder.rglob("*.rst"):
        if path.relative_to(folder).as_posix() not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def list_modules(_app: Any, _what: str, name: str, thing: Any, _options: Any, lines: list[str]) -> None:
    """Turn the lines of a package's docstring that list its modules, ``name  what is in it``, into a list of links."""
    for number, entry in listing(lines).items() if hasattr(thing, "__path__") else ():
        lines[number] = f"- :py:mod:`{entry[1]} <{name}.{entry[1]}>`: {entry[2]}"


def skip_aliases(_app: Any, _what: str, _name: str, thing: Any, skip: bool, _options: Any) -> bool | None:
    """Leave out names of types such as ``Key = tuple[int, int]``, of which Sphinx tries to write a signature."""
    return True if isinstance(thing, types.GenericAlias) else None


def link_to_included_pages(_app: Any, _page: str, source: list[str]) -> None:
    """Send links to files at the root of the repository, which GitHub follows, to the pages that include them."""
    for name in ("CONTRIBUTING", "CHANGELOG"):
        source[0] = source[0].replace(f"](../{name}.md", f"]({name.lower()}.md")


def setup(app: Any) -> dict[str, bool]:
    """Sphinx calls this when it loads the extension."""
    from bow_sim.graph import environment

    environment.prepare()
    app.connect("autodoc-process-docstring", list_modules, priority=100)
    app.connect("autodoc-skip-member", skip_aliases)
    app.connect("source-read", link_to_included_pages)
    app.connect("builder-inited", lambda app: write(Path(app.srcdir) / "reference" / "generated"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
