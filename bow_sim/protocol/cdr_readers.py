"""Functions that read messages of the usual form, each made of source text when this module is imported.

The texts of a message about chunks are identifiers of one length, so all fields up to its first array have fixed
places. They are read at once, and the lengths of the texts are compared with the usual ones. What is not of this form
is left to :func:`bow_sim.protocol.cdr.decode`, which follows a message field by field: that takes three times as long,
and says what is wrong.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from bow_sim.protocol.messages import FIELDS, FRAME, LETTERS, SHORT_TEXT, TIME, is_sealed

IDENTIFIER = 16
"""Characters of an identifier: of a run, a sweep, an incarnation, or thresholds."""

Reader = Callable[[Any], "tuple[dict[str, Any], int] | None"]
"""Returns what `cdr.decode` returns of a message in CDR, and the first byte that its checksum covers, 0 without one.

None where the message has another form, or is damaged. Some damage raises ValueError or struct.error.
"""

_START = 4
"""Bytes of the encapsulation; alignment counts from its end."""


class _Source:
    """The text of a reader and the names that it uses. A struct is read at once: items are put in it one by one."""

    def __init__(self) -> None:
        self.names: dict[str, Any] = {}
        self.lines = ["def read(data):", " at = 0"]
        self._format, self._variables = "<", ""
        self._checks: list[str] = []

    @property
    def size(self) -> int:
        """Bytes of the struct so far."""
        return struct.calcsize(self._format)

    def name(self, value: Any) -> str:
        """Return a name for a value in the text."""
        name = f"given_{len(self.names)}"
        self.names[name] = value
        return name

    def put(self, letter: str, align: int, variable: str, should: object = None) -> None:
        """Put an item in the struct, to be read to a variable; `should`: what its value has to be."""
        self._format += f"{(_START - self.size) % align}x{letter}"
        self._variables += f"{variable}, "
        if should is not None:
            self._checks.append(f" if {variable} != {should!r}: return None")

    def read(self) -> None:
        """Read the struct, and begin another one behind it."""
        unpack = self.name(struct.Struct(self._format).unpack_from)
        self.lines += [f" {self._variables}= {unpack}(data, at)", f" at += {self.size}", *self._checks]
        self._format, self._variables, self._checks = "<", "", []

    def array(self, variable: str, item: str, bound: str) -> None:
        """Read an array, whose length is the last item of the struct."""
        kind = np.dtype(item).newbyteorder("<")
        self.put("I", 4, "n")
        self.read()
        if bound:
            self.lines.append(f" if n > {bound}: return None")
        if kind.itemsize > _START:
            self.lines.append(f" if n: at += ({_START} - at) % {kind.itemsize}")
        array = f"{self.name(np.frombuffer)}(data, {self.name(kind)}, n, at)"
        self.lines += [f" {variable} = {array}", f" at += {kind.itemsize} * n"]


def _reader(name: str) -> Reader:
    """Return the function that reads message `name`, whose texts all come before its arrays."""
    source, covered, ragged = _Source(), 0, False
    values: list[str] = []
    source.put("2s2x", 1, "mark", b"\0\1")
    for i, (field, declared) in enumerate(FIELDS[name].items()):
        item, _, bound = declared.partition("[")
        variable = value = f"v{i}"
        if ragged:
            source.lines.append(" at += -at % 4")
            ragged = False
        if declared == SHORT_TEXT:
            source.put("16s", 1, variable)
            value += r".rstrip(b'\0').decode('ascii')"
        elif declared == TIME:
            source.put("i", 4, variable)
            source.put("I", 4, "nanoseconds")
            value += " * 10**9 + nanoseconds"
        elif declared == "string":
            length = len(FRAME) if field == "header.frame_id" else IDENTIFIER
            source.put("I", 4, f"length_{i}", length + 1)
            source.put(f"{length}s", 1, variable)
            source.put("B", 1, f"end_{i}", 0)
            value += ".decode()"
        elif bound:
            source.array(variable, item, bound.strip("<=]"))
            ragged = np.dtype(item).itemsize < _START
        else:
            source.put(LETTERS[item], np.dtype(item).itemsize, variable)
        values.append(f"{field!r}: {value}")
        if field == "checksum" and is_sealed(name):
            covered = source.size
    source.lines += [" if at != len(data): return None", f" return {{{', '.join(values)}}}, {covered}"]
    exec("\n".join(source.lines), source.names)
    return cast(Reader, source.names["read"])


READERS: dict[str, Reader] = {name: _reader(name) for name in ("BridgeForce", "StickSlip", "Verdicts", "Receipt")}
"""Message -> its reader."""
