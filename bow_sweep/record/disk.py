"""Syncs committed data to the disk in a thread of its own, so that no thread that takes messages waits for the disk.

What is on the disk is dropped from the page cache then, so that a large bag does not fill the memory of the machine:
new memory costs more than memory that was just dropped, on virtual machines several times as much.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence

JOIN_S = 5.0
"""At the end the thread has this long to finish its sync; after that it is left running."""


class DiskSync:
    """Calls fdatasync on a file when there is something new; one call serves all items that wait.

    What was written before the sync before is dropped from the page cache. What came since is not: Linux still has
    hold of some of it. A file system that refuses is not asked again.

    Parameters
    ----------
    descriptor
        Of the file; it is duplicated, so the caller may close it.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = os.dup(descriptor)
        self._condition = threading.Condition()
        self._asked: dict[int, int] = {}
        self._current: dict[int, int] = {}
        self._done: dict[int, int] = {}
        self._error: OSError | None = None
        self._ended = False
        self._written: list[tuple[int, int]] = []
        self._synced: list[tuple[int, int]] = []
        self._drops = True
        self._thread = threading.Thread(target=self._work, name="disk", daemon=True)
        self._thread.start()

    def ask(self, items: dict[int, int]) -> None:
        """Sync all that is committed by now; :meth:`done` returns `items` after that."""
        with self._condition:
            self._asked |= items
            self._condition.notify()

    def wrote(self, places: Sequence[tuple[int, int]]) -> None:
        """Take in what was committed and nobody reads soon: (first, end) in the file, bytes."""
        with self._condition:
            self._written += places

    def done(self) -> dict[int, int]:
        """Return the items that were synced since the last call.

        Raises
        ------
        OSError
            Where a sync failed.
        """
        with self._condition:
            if self._error is not None:
                raise self._error
            done, self._done = self._done, {}
            return done

    def close(self) -> dict[int, int]:
        """End the thread; return all items that :meth:`done` has not returned, synced or not."""
        with self._condition:
            self._ended = True
            self._condition.notify()
        self._thread.join(JOIN_S)
        return {**self._done, **self._current, **self._asked}

    def _work(self) -> None:
        try:
            while True:
                with self._condition:
                    self._condition.wait_for(lambda: self._asked or self._ended)
                    if self._ended:
                        return
                    self._current, self._asked = self._asked, {}
                    written, self._written = self._written, []
                os.fdatasync(self._descriptor)
                with self._condition:
                    self._done |= self._current
                    self._current = {}
                self._drop(self._synced)
                self._synced = written
        except OSError as error:
            with self._condition:
                self._error = error
        finally:
            os.close(self._descriptor)

    def _drop(self, places: Sequence[tuple[int, int]]) -> None:
        """Drop places of the file from the page cache; nothing depends on it."""
        try:
            for first, end in places if self._drops else ():
                os.posix_fadvise(self._descriptor, first, end - first, os.POSIX_FADV_DONTNEED)
        except OSError:
            self._drops = False
