"""Every code block of the documentation runs: those of a page one after the other, in one directory of their own.

Sybil finds the blocks, and what the comment ``<!-- skip: next "reason" -->`` above one leaves out.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import SkipTest, mock

import pytest
from doc_pages import PAGES, RUN, SHOWN, blocks, name
from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser, SkipParser

LIMIT_S = 600
"""A block that takes longer hangs."""

PRELUDE = Path(__file__).with_name("small.sh")


def run_in_shell(example: Example) -> str | None:
    """Run a block as a script of bash; return what is wrong."""
    with tempfile.TemporaryFile("w+") as said:
        script = ["bash", "-c", f"source {PRELUDE}\n{example.parsed}"]
        shell = subprocess.Popen(
            script, stdin=subprocess.DEVNULL, stdout=said, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            status = shell.wait(LIMIT_S)
        finally:
            with contextlib.suppress(ProcessLookupError):  # what a failed block has left in the background
                os.killpg(shell.pid, signal.SIGTERM)
            shell.wait()
        said.seek(0)
        return f"exit status {status}\n{said.read()}" if status else None


GRAPHS = ("docs/howto.md",)
"""Pages with so many sweeps that these go through one standing graph, as they may: it takes half of the time."""


@contextlib.contextmanager
def graph_of(page: Path) -> Iterator[None]:
    """Keep a graph for the sweeps of a page, if it has many."""
    if name(page) not in GRAPHS:
        yield
        return
    bow = [sys.executable, "-m", "bow_sweep"]
    subprocess.run([*bow, "up", "--no-dashboard"], check=True, timeout=LIMIT_S)
    try:
        with mock.patch.dict(os.environ, {"PAGE_GRAPH": "1"}):
            yield
    finally:
        subprocess.run([*bow, "down"], check=True, timeout=LIMIT_S)


DOCUMENTS = Sybil([CodeBlockParser("bash", run_in_shell), PythonCodeBlockParser(), SkipParser()])


def pages_by_cost() -> list[object]:
    """The pages that have blocks to run; those with commands, which start graphs, in the full tier."""
    found = []
    for page in PAGES:
        languages = {block.language for block in blocks(page)}
        if languages & set(RUN):
            marks = [pytest.mark.full] if "bash" in languages else []
            found.append(pytest.param(page, id=name(page), marks=marks))
    return found


@pytest.mark.timeout(900)
@pytest.mark.parametrize("page", pages_by_cost())
def test_every_block_of_a_page_runs(
    page: Path, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("MPLBACKEND", "agg")
    run = skipped = 0
    with mock.patch.dict(os.environ), graph_of(page):  # a sweep in this process leaves variables for its children
        for example in DOCUMENTS.parse(page).examples():
            try:
                example.evaluate()
            except SkipTest:
                skipped += 1
            else:
                run += not isinstance(example.parsed, tuple)
    assert run + skipped == sum(block.language in RUN for block in blocks(page))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_a_block_says_what_it_is(page: Path) -> None:
    for block in blocks(page):
        known = block.language in (*RUN, *SHOWN) or block.language.startswith("{")
        assert known, f"{name(page)}, line {block.line}: {block.language!r} should be one of {(*RUN, *SHOWN)}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_what_is_left_out_has_a_reason(page: Path) -> None:
    for line in page.read_text().splitlines():
        if "skip:" in line and line.startswith("<!--"):
            assert line.startswith('<!-- skip: next "') and line.endswith('" -->'), line


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], list[Example]]:
    """Parses a page of a text."""

    def parse(text: str) -> list[Example]:
        page = tmp_path / "page.md"
        page.write_text(text)
        return list(DOCUMENTS.parse(page).examples())

    return parse


def test_a_command_that_fails_is_found(written: Callable[[str], list[Example]]) -> None:
    (example,) = written("```bash\nfalse\ntrue\n```\n")
    with pytest.raises(AssertionError, match="exit status 1"):
        example.evaluate()


def test_python_that_fails_is_found(written: Callable[[str], list[Example]]) -> None:
    first, second = written("```python\nx = 1\n```\n\n```python\nassert x == 2\n```\n")
    first.evaluate()
    with pytest.raises(AssertionError):
        second.evaluate()
