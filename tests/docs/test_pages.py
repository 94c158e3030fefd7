"""The pages say what is there: links, files and modules that exist, pictures of the current text, lines that fit."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import pytest
from doc_pages import PAGES, ROOT, blocks, name, prose

sys.path.insert(0, str(ROOT / "tools"))
import diagrams

PACKAGES = ("bow", "bow_sim", "bow_classifier", "bow_sweep", "bench", "studies")
LINK = re.compile(r"\]\(([^)\s]+)\)")
CODE = re.compile(r"`([^`\n]+)`")
FILE = re.compile(r"[a-z][\w./-]*\.(?:py|msg|action|yaml|xml|toml|txt|csv|dot|sh|cfg)")
MODULE = re.compile(rf"(?<![\w/])(?:{'|'.join(PACKAGES)})(?:\.\w+)+")
LEFT_BY_RUNS = {"metadata.yaml", "mine.txt", "study.yaml", "bench.json", "bow.missing", "bow.record", "bow.version"}
"""Files that a command writes, and records in a bag: they are not in the repository."""


def is_there(path: str) -> bool:
    """Whether a file of that path, or of that end of a path, is in the repository."""
    return (ROOT / path).exists() or any(ROOT.glob(f"docs/{path}")) or ("/" not in path and found_anywhere(path))


def found_anywhere(file: str) -> bool:
    folders = (*PACKAGES, "tests", "config", "launch", "msg_defs", "tools")
    return any(next((ROOT / folder).rglob(file), None) for folder in folders)


def resolves(dotted: str) -> bool:
    """Whether a dotted name is a module, or something in one."""
    parts = dotted.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found = importlib.util.find_spec(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        if found:
            thing = importlib.import_module(".".join(parts[:length])) if length < len(parts) else None
            for part in parts[length:]:
                thing = getattr(thing, part, None)
            return length == len(parts) or thing is not None
    return False


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_lines_fit_a_screen(page: Path) -> None:
    long = [line for line in prose(page).splitlines() if len(line) > 120 and not line.startswith(("|", "<!--"))]
    long += [line for block in blocks(page) for line in block.text.splitlines() if len(line) > 120]
    assert not long


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_to_files(page: Path) -> None:
    for link in LINK.findall(page.read_text()):
        if not link.startswith(("http", "#", "mailto")):
            target = page.parent / link.partition("#")[0]
            assert target.exists() or "reference/generated" in link, f"{name(page)}: {link}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_files_and_modules_that_a_page_names_exist(page: Path) -> None:
    words = CODE.findall(prose(page))
    files = [word for word in words if FILE.fullmatch(word) and "NAME" not in word]
    files = [file for file in files if file not in LEFT_BY_RUNS]
    modules = [module for word in words for module in MODULE.findall(word) if module not in LEFT_BY_RUNS]
    assert [file for file in files if not is_there(file)] == []
    assert [module for module in modules if not resolves(module)] == []


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_parts_that_a_script_writes_name_a_script_that_exists(page: Path) -> None:
    scripts = re.findall(r"<!-- (?:begin|end): written by (\S+) -->", page.read_text())
    assert [script for script in scripts if not (ROOT / script).exists()] == []


def test_diagrams_are_drawn_from_their_sources() -> None:
    assert diagrams.problems() == []
