"""Runs for the page, and a browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import browser
import explored
import pytest


@pytest.fixture(scope="session")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run of 8 x 6 cells; not to be changed."""
    return explored.make_run(tmp_path_factory.mktemp("explore") / "first")


@pytest.fixture(scope="session")
def second_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole run of the same plane with another friction curve; not to be changed."""
    return explored.make_run(tmp_path_factory.mktemp("explore") / "second", "v_mid=0.7")


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """The browser."""
    if browser.CHROMIUM is None:
        pytest.skip(browser.NEEDED)
    with browser.chromium() as made:
        yield made


@pytest.fixture(scope="module")
def new_tab(chromium: Any) -> Iterator[Callable[..., browser.Tab]]:
    """Make a tab of a size. At the end of the module none has complained, or asked for anything beyond this machine."""
    made: list[browser.Tab] = []
    contexts = []

    def new(width: int = 1280, height: int = 800, offline: bool = False) -> browser.Tab:
        contexts.append(chromium.new_context(viewport={"width": width, "height": height}, offline=offline))
        made.append(browser.Tab(contexts[-1].new_page()))
        return made[-1]

    yield new
    for context in contexts:
        context.close()
    for tab in made:
        assert tab.complaints == []
        here = ("http://127.0.0.1:", "ws://127.0.0.1:", "file://", "data:", "blob:")
        assert [address for address in tab.requests if not address.startswith(here)] == []
