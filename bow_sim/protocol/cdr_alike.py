"""Messages of one kind that are alike but for their content, read in half the time.

Where a message is as long as one before and its arrays and texts are too, every field is where it was there. So all
that is no array is read at once, and the lengths are compared with those of before instead of being followed field by
field. Whatever differs is left to :mod:`bow_sim.protocol.cdr`, which says what is wrong with it.
"""

from __future__ import annotations

import struct
from operator import itemgetter
from typing import Any

import numpy as np
import xxhash

from bow_sim.protocol import cdr
from bow_sim.protocol.messages import FIELDS, TIME

MOST_FORMS = 64
"""Lengths of messages of which the places of the fields are kept, at most."""

MOST_TEXTS = 256
"""Sets of texts (run, sweep, sender, ...) that are kept as they were decoded, at most."""

_LETTERS = {"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "float32": "f", "float64": "d"}


class AlikeReader:
    """Reads messages of one kind: sealed ones as :func:`bow_sim.protocol.cdr.unseal`, others as `decode` does.

    Parameters
    ----------
    name
        A message whose fields are scalars, texts of any length, arrays and stamps: "Verdicts" or "Receipt".
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._forms: dict[int, _Form] = {}

    def read(self, data: cdr.Buffer) -> dict[str, Any]:
        """Return the fields of a message after checking its checksum, if it has one, and the lengths of its arrays.

        Raises
        ------
        WireError
            As :func:`bow_sim.protocol.cdr.unseal` or :func:`bow_sim.protocol.cdr.decode`.
        """
        form = self._forms.get(len(data))
        if form is not None:
            values = form.read(data)
            if values is not None:
                return values
        values = cdr.unseal(self._name, data) if cdr.is_sealed(self._name) else cdr.decode(self._name, data)
        if form is None or not form.learn(data, values):
            form = _Form(self._name, values)
            if form.learn(data, values):
                if len(self._forms) >= MOST_FORMS:
                    self._forms.clear()
                self._forms[len(data)] = form
        return values


class _Form:
    """Where the fields of a message are, given the lengths of its arrays and texts."""

    def __init__(self, name: str, values: dict[str, Any]) -> None:
        self._scalars: list[tuple[str, int]] = []
        self._arrays: list[tuple[str, np.dtype[Any], int, int]] = []
        self._known: dict[tuple[bytes, ...], dict[str, str]] = {}
        self._stamp, self._text_fields = "", []
        letters, count = ["<2s2x"], 1
        self._covered, at = 0, 0  # `at` counts from after the four bytes of encapsulation
        lengths: dict[int, Any] = {0: cdr.ENCAPSULATION[:2]}
        texts: list[int] = []
        stamp = 0

        def put(letter: str, align: int) -> int:
            nonlocal at, count
            gap, size = -at % align, struct.calcsize(f"<{letter}")
            letters.append(f"{gap}x{letter}")
            at += gap + size
            count += not letter.endswith("x")
            return count - 1

        for field, declared in FIELDS[name].items():
            item, _, bound = declared.partition("[")
            if item == "string":
                size = len(values[field].encode()) + 1
                lengths[put("I", 4)] = size
                texts.append(put(f"{size}s", 1))
                self._text_fields.append(field)
            elif declared == TIME:
                stamp, self._stamp = put("i", 4), field
                put("I", 4)
            elif bound:
                size, dtype = len(values[field]), np.dtype(item).newbyteorder("<")
                lengths[put("I", 4)] = size
                if size:
                    put(f"{size * dtype.itemsize}x", dtype.itemsize)
                self._arrays.append((field, dtype, size, 4 + at - size * dtype.itemsize))
            else:
                self._scalars.append((field, put(_LETTERS[item], np.dtype(item).itemsize)))
                if field == "checksum":
                    self._covered = 4 + at
        self._form = struct.Struct("".join(letters))
        self._lengths, self._expected = itemgetter(*lengths), tuple(lengths.values())
        self._texts = itemgetter(*texts)
        self._stamp_at = stamp

    def learn(self, data: cdr.Buffer, values: dict[str, Any]) -> bool:
        """Note the texts of a message that was unsealed; return whether it has this form."""
        if len(data) != self._form.size:
            return False
        fixed = self._form.unpack(data)
        if self._lengths(fixed) != self._expected:
            return False
        if len(self._known) >= MOST_TEXTS:
            self._known.clear()
        self._known[self._texts(fixed)] = {field: values[field] for field in self._text_fields}
        return True

    def read(self, data: cdr.Buffer) -> dict[str, Any] | None:
        """Return the fields of a message; None if it has another form or unknown texts, or is damaged."""
        if len(data) != self._form.size:
            return None
        fixed = self._form.unpack(data)
        texts = self._known.get(self._texts(fixed))
        if texts is None or self._lengths(fixed) != self._expected:
            return None
        values: dict[str, Any] = texts.copy()
        for field, at in self._scalars:
            values[field] = fixed[at]
        if self._stamp:
            values[self._stamp] = fixed[self._stamp_at] * 10**9 + fixed[self._stamp_at + 1]
        if self._covered:
            seed = cdr.place_seed(values["block"], values["chunk"])
            if values["checksum"] != xxhash.xxh3_64_intdigest(memoryview(data)[self._covered :], seed=seed):
                return None
        for field, dtype, size, at in self._arrays:
            values[field] = np.frombuffer(data, dtype, size, at)
        return values
