"""Readers made for a message read what the decoder that knows all messages reads, or leave the message to it."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from any_values import values_of
from hypothesis import given, settings
from hypothesis import strategies as st

from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_readers import READERS
from bow_sim.protocol.messages import FRAME


def message(name: str, seed: int = 1, length: int = 3, **changes: Any) -> bytes:
    """Return a message of the usual form."""
    identifiers = dict.fromkeys(("run_id", "sweep_id", "incarnation", "classifier"), "f" * 16)
    values = {**values_of(name, np.random.default_rng(seed), length), **identifiers, "header.frame_id": FRAME}
    return cdr.encode(name, {**values, **changes})


def followed(name: str, data: bytes) -> tuple[dict[str, Any], int] | str:
    """Return what the decoder that follows a message field by field says of it."""
    try:
        return cdr._follow(name, data)
    except cdr.WireError as error:
        return str(error)


def read(name: str, data: bytes) -> tuple[dict[str, Any], int] | None:
    try:
        return READERS[name](data)
    except (ValueError, struct.error):
        return None


def same(one: Any, other: Any) -> bool:
    """Return whether two results have the same fields in the same order, and the same bytes and types in arrays."""

    def plain(found: tuple[dict[str, Any], int]) -> object:
        arrays = lambda x: (x.dtype, x.tobytes()) if isinstance(x, np.ndarray) else x
        return found[1], [(field, arrays(value)) for field, value in found[0].items()]

    return not isinstance(other, str) and plain(one) == plain(other)


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("length", [0, 1, 2, 5, 128])
def test_messages_of_the_usual_form_are_read(name: str, length: int) -> None:
    data = message(name, length, length)
    for kind in (bytes, bytearray, memoryview):
        found = read(name, kind(data))
        assert found is not None
        assert same(found, followed(name, data))


@pytest.mark.parametrize("name", READERS)
@given(data=st.data())
@settings(max_examples=300, deadline=None)
def test_a_damaged_message_is_read_as_the_decoder_does_or_left_to_it(name: str, data: st.DataObject) -> None:
    damaged = bytearray(message(name))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(damaged) - 1))
        damaged[place] = data.draw(st.sampled_from([0, 1, 2, 0x7F, 0xFF]) | st.integers(0, 255))
    cut = bytes(damaged[: data.draw(st.integers(0, len(damaged)) | st.just(len(damaged)))])
    whole = cut + data.draw(st.just(b"") | st.binary(max_size=9))
    found = read(name, whole)
    assert found is None or same(found, followed(name, whole))


@pytest.mark.parametrize("name", READERS)
def test_texts_of_other_lengths_are_left_to_the_decoder(name: str) -> None:
    data = message(name, run_id="short")
    assert (read(name, data) is None) == (cdr.FIELDS[name]["run_id"] == "string")
    assert cdr.decode(name, data)["run_id"] == "short"
