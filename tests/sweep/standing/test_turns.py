"""Clients of a standing graph are served in the order in which they came, and nobody waits for one that has gone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from bow_sim.graph.process_stat import start_of
from bow_sweep.standing.turns import Turn, tickets


def test_those_who_come_first_are_served_first(tmp_path: Path) -> None:
    with Turn(tmp_path, Path("/one")) as first, Turn(tmp_path, Path("/two")) as second:
        with Turn(tmp_path, Path("/three")) as third:
            assert [ticket.directory for ticket in third.before()] == ["/one", "/two"]
        assert first.before() == []
        assert [ticket.directory for ticket in second.before()] == ["/one"]
    assert tickets(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_the_ticket_of_a_process_that_has_gone_is_removed(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        ticket = tmp_path / f"{1:020}-{process.pid}-{start_of(process.pid)}-0"
        ticket.write_text("/gone")
        with Turn(tmp_path, Path("/here")) as turn:
            assert [other.pid for other in turn.before()] == [process.pid]
            process.kill()
            process.wait()
            assert turn.before() == []
    assert not ticket.exists()


def test_other_files_are_no_tickets(tmp_path: Path) -> None:
    (tmp_path / "0-1-2").write_text("")
    with Turn(tmp_path, Path("/here")) as turn:
        assert turn.before() == []
    assert tickets(tmp_path / "none") == []
