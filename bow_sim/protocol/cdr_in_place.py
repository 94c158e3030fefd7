"""Sealed messages written in place: what they have in common is encoded once, and arrays are filled where they go out.

The bytes are those of :func:`bow_sim.protocol.cdr.encode`, which encodes every field anew and copies each array once
more. The messages of a block are written in this way: they differ in chunk, stamp, and the arrays at their end.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import xxhash
from numpy.typing import NDArray

from bow_sim.protocol import cdr
from bow_sim.protocol.messages import UNSTAMPED

_LENGTH = struct.Struct("<I")
_START = len(cdr.ENCAPSULATION)


class Template:
    """Sealed messages of one kind that differ in some numbers and stamps, and in the arrays at their end.

    Parameters
    ----------
    name
        Key of :data:`bow_sim.protocol.messages.FIELDS`.
    common
        The other fields, which all of these messages have in common, among them the block; a frame_id may be left out.

    Raises
    ------
    ValueError
        If a field is missing that may not differ.
    """

    def __init__(self, name: str, common: Mapping[str, Any]) -> None:
        head = cdr.Writer()
        self._block = int(common["block"])
        self._numbers: dict[str, tuple[struct.Struct, int]] = {}
        self._stamps: dict[str, tuple[struct.Struct, int]] = {}
        self._arrays: list[cdr.Field] = []
        for field in cdr.LAYOUT[name]:
            given = field.name in common or (field.kind == "string" and field.name in UNSTAMPED)
            if field.kind == "array" and not given:
                self._arrays.append(field)
                continue
            if self._arrays or not (given or field.kind in ("scalar", "time")):
                raise ValueError(f"{name}.{field.name}: should be common to all messages, or an array at their end")
            head.field(field, common.get(field.name, UNSTAMPED.get(field.name, 0)))
            end = _START + head.size
            if not given:
                differing = self._stamps if field.kind == "time" else self._numbers
                differing[field.name] = field.form, end - field.form.size
            if field.name == "checksum":
                self._covered = end
        self._seal, self._seal_at = self._numbers.pop("checksum")
        self._head = b"".join([cdr.ENCAPSULATION, *head.parts])

    def begin(self, lengths: Iterable[int]) -> tuple[memoryview, list[NDArray[Any]]]:
        """Return a new message whose arrays have these lengths, and the arrays, which are to be filled; then seal it.

        Raises
        ------
        WireError
            If an array would be longer than the message permits.
        """
        places, end = [], len(self._head)
        for field, length in zip(self._arrays, lengths, strict=True):
            if length > field.most:
                raise cdr.WireError(f"{field.name}: {length} values, should be {field.most} at most")
            before, item = end, field.form.size
            at = end + -(end - _START) % 4
            first = at + 4
            if length:
                first += -(first - _START) % item
            end = first + length * item
            places.append((field.dtype, length, before, at, first, end))
        memory = np.empty(_START + end, np.uint8)[_START:]  # so that items are aligned in memory, too
        message = memory.data
        message[: len(self._head)] = self._head
        arrays = []
        for dtype, length, before, at, first, end in places:
            message[before:first] = bytes(first - before)
            _LENGTH.pack_into(message, at, length)
            arrays.append(memory[first:end].view(dtype))
        return message, arrays

    def write(self, values: Mapping[str, int], contents: Sequence[NDArray[Any]]) -> tuple[memoryview, int]:
        """Return a message with these numbers and stamps, and these arrays at its end, and its checksum."""
        message, arrays = self.begin(map(len, contents))
        for array, content in zip(arrays, contents, strict=True):
            array[:] = content
        return message, self.seal(message, values)

    def seal(self, message: memoryview, values: Mapping[str, int]) -> int:
        """Write the numbers and stamps that differ, chunk among them, and the checksum, which is returned."""
        for name, (form, at) in self._numbers.items():
            form.pack_into(message, at, values[name])
        for name, (form, at) in self._stamps.items():
            form.pack_into(message, at, *divmod(values[name], 10**9))
        seed = cdr.place_seed(self._block, values["chunk"])
        checksum = xxhash.xxh3_64_intdigest(message[self._covered :], seed=seed)
        self._seal.pack_into(message, self._seal_at, checksum)
        return checksum
