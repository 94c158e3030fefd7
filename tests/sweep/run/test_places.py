"""The notes that say where the runs of a standing graph go: a run has a name on the network, and a path only here."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from bow_sweep.run.places import Place, find_place, remove_places, write_place

RUN, OTHER = "a" * 16, "b" * 16


def test_a_note_is_read_as_it_was_written(tmp_path: Path) -> None:
    place = Place(Path("/somewhere/with a space"), resume=True, dashboard=False)
    write_place(tmp_path, RUN, place)
    assert find_place(tmp_path, RUN) == place
    assert find_place(tmp_path, OTHER) is None
    assert find_place(None, RUN) is None


@pytest.mark.parametrize("name", ["../" + RUN, "", RUN.upper(), f"{RUN}/x", RUN + "0", "~" * 16])
def test_what_is_no_run_names_no_file(tmp_path: Path, name: str) -> None:
    inner = tmp_path / "notes"
    inner.mkdir()
    content = json.dumps({"directory": "/etc", "resume": False, "dashboard": True})
    for path in (tmp_path / f"{RUN}.json", inner / ".json", inner / f"{RUN.upper()}.json"):
        path.write_text(content)
    assert find_place(inner, name) is None


def test_a_note_that_is_a_link_or_of_somebody_else_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_place(tmp_path, OTHER, Place(Path("/other")))
    (tmp_path / f"{RUN}.json").symlink_to(tmp_path / f"{OTHER}.json")
    assert find_place(tmp_path, RUN) is None
    assert find_place(tmp_path, OTHER) is not None
    uid = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    assert find_place(tmp_path, OTHER) is None


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b'{"directory": "/x"}', b'{"directory": "relative", "resume": 0, "dashboard": 1}']
)
def test_a_note_that_is_none_is_no_place(tmp_path: Path, content: bytes) -> None:
    (tmp_path / f"{RUN}.json").write_bytes(content)
    assert find_place(tmp_path, RUN) is None


def test_all_notes_but_one_are_removed_and_nothing_else(tmp_path: Path) -> None:
    for run in (RUN, OTHER):
        write_place(tmp_path, run, Place(tmp_path))
    (tmp_path / "notes.json").write_text("mine")
    remove_places(tmp_path, but=RUN)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([f"{RUN}.json", "notes.json"])
