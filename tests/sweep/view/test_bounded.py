"""A file of a recording that takes in nothing more holds nobody up."""

from __future__ import annotations

import threading

import pytest

from bow_sweep.view import bounded


class Stuck:
    """Stands for a RecordingStream of rerun whose file cannot be closed, or can after some time."""

    def __init__(self) -> None:
        self.flushed = 0.0
        self.closable = threading.Event()

    def flush(self, *, timeout_sec: float) -> None:
        self.flushed = timeout_sec

    def disconnect(self) -> None:
        self.closable.wait(60)


def test_a_file_that_cannot_be_closed_is_given_up_after_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded, "FILE_S", 0.1)
    record = bounded.opened(Stuck())
    assert not bounded.disconnect(record, 0.1)
    with pytest.raises(TimeoutError, match=r"not closed within 0\.1 s"):
        bounded.finish(record)
    assert record.flushed == 0.1
    assert record in bounded._open, "to delete it could take for ever"
    record.closable.set()
    assert bounded.disconnect(record, 10)
    assert record not in bounded._open
    bounded.finish(record)
