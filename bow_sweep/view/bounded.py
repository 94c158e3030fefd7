"""Flushing and closing the file of a recording, each for a limited time.

Where a disk is full, rerun 0.41 may wait for ever for the thread that should write the file and has ended.
"""

from __future__ import annotations

import threading
from typing import Any

import rerun as rr

FILE_S = 8.0
"""Time that a file has to take in what was drawn since the last flush, and to be closed."""


_open: list[Any] = []


def opened(record: Any) -> Any:
    """Return a RecordingStream, which stays until `disconnect`: to delete one that has failed may take for ever."""
    _open.append(record)
    return record


def clean_up() -> None:
    """Let rerun free the data of deleted recordings, which it keeps until then; not where one has failed, as above."""
    if not _open:
        rr.bindings.flush_and_cleanup_orphaned_recordings()


def flush(record: Any, seconds: float = FILE_S) -> None:
    """Write what was drawn into the file of a RecordingStream. rerun raises an error where that takes longer."""
    record.flush(timeout_sec=seconds)


def disconnect(record: Any, seconds: float = FILE_S) -> bool:
    """Close the sinks of a RecordingStream; return whether all of them were closed in time."""
    leaving = threading.Thread(target=record.disconnect, daemon=True)
    leaving.start()
    leaving.join(seconds)
    if leaving.is_alive():
        return False
    _open[:] = [other for other in _open if other is not record]
    return True


def close(record: Any) -> None:
    """Close the file of a RecordingStream.

    Raises
    ------
    TimeoutError
        Where it is not closed in time.
    """
    if not disconnect(record, FILE_S):
        raise TimeoutError(f"the file is not closed within {FILE_S:g} s")


def finish(record: Any) -> None:
    """Write all into the file of a RecordingStream and close it; errors as of `flush` and `close`."""
    flush(record, FILE_S)
    close(record)
