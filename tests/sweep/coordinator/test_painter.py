"""The picture of a run, drawn by a process of its own; where that dies or hangs, by the coordinator."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from example_maps import map_file

from bow_sim.graph.environment import PAINTER_SOCKET
from bow_sweep.coordinator import results
from bow_sweep.coordinator.painter import Painter, serve
from bow_sweep.processes.fork import Forked

MAP = map_file()


@pytest.fixture
def pair() -> Iterator[tuple[Painter, socket.socket]]:
    """What the coordinator has, and the process."""
    here, there = socket.socketpair(type=socket.SOCK_SEQPACKET)
    painter = Painter(here.detach())
    yield painter, there
    painter.close()
    there.close()


def written(directory: Path, painter: Painter | None, monkeypatch: pytest.MonkeyPatch) -> str:
    """Write the results of a run into a directory that may be new; return what is said of the picture."""
    directory.mkdir(exist_ok=True)
    monkeypatch.setattr(results, "map_of", lambda *_: MAP)
    return results.write_results(cast(Any, SimpleNamespace(directory=directory)), cast(Any, None), painter)()


def test_it_draws_the_picture_that_the_coordinator_would_draw_until_that_has_ended(
    tmp_path: Path, pair: tuple[Painter, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    painter, there = pair
    painter._channel.settimeout(60)  # on a busy machine too
    assert written(tmp_path / "d", None, monkeypatch) == ""  # a copy cannot use the fonts that are open now
    process = Forked(lambda: serve(there.fileno()), tmp_path / "log", there.fileno())
    there.close()
    with monkeypatch.context() as own:
        own.setattr(results, "draw", None)  # not by this process
        assert written(tmp_path / "a", painter, own) == ""
        assert written(tmp_path / "b", painter, own) == ""
        (tmp_path / "c" / "map.png").mkdir(parents=True)
        assert "map.png: " in written(tmp_path / "c", painter, own)
    assert len({(tmp_path / name / "map.png").read_bytes() for name in "abd"}) == 1
    painter.close()
    assert process.wait(20) == 0, (tmp_path / "log").read_text()


@pytest.mark.parametrize("ends_before", [True, False])
def test_the_coordinator_draws_the_picture_itself_if_the_process_dies(
    ends_before: bool, tmp_path: Path, pair: tuple[Painter, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    painter, there = pair
    if ends_before:
        there.close()
    else:
        asked = painter.ask

        def ask(written: Path, picture: Path) -> bool:
            found = asked(written, picture)
            there.close()
            return found

        monkeypatch.setattr(painter, "ask", ask)
    assert written(tmp_path, painter, monkeypatch) == ""
    assert (tmp_path / "map.png").exists()


def test_the_coordinator_draws_the_picture_itself_if_the_process_does_not_answer(
    tmp_path: Path, pair: tuple[Painter, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    painter, there = pair
    painter._channel.settimeout(0.01)
    assert written(tmp_path, painter, monkeypatch) == ""
    assert not painter.ask(tmp_path / "map.npz", tmp_path / "map.png"), "its answer could be that to the first"
    (tmp_path / "map.png").unlink()
    assert serve(there.detach()) == 0  # it goes on, and draws for nobody
    assert [each.name for each in tmp_path.iterdir()] == ["map.npz"]
    assert written(tmp_path, painter, monkeypatch) == ""
    assert (tmp_path / "map.png").exists()


def test_a_coordinator_takes_the_socket_that_its_parent_names_and_passes_it_to_nobody(
    pair: tuple[Painter, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(PAINTER_SOCKET, raising=False)
    assert Painter.given() is None
    first, there = pair
    monkeypatch.setenv(PAINTER_SOCKET, str(os.dup(first._channel.fileno())))
    painter = Painter.given()
    assert painter is not None
    assert PAINTER_SOCKET not in os.environ
    assert painter.ask(Path("map.npz"), Path("map.png"))
    assert there.recv(1000) == b'["map.npz", ".map.drawn.png"]'
    painter.close()
