"""Messages written in place have the bytes of the encoder that knows all messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from any_values import values_of
from hypothesis import given
from hypothesis import strategies as st

from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_in_place import Template

SEALED = [name for name in cdr.FIELDS if cdr.is_sealed(name)]
DIFFERING = ("chunk", "stamp", "header.stamp", "first_sample", "chunk_checksum", "checksum")


def arrays_at_the_end(name: str) -> list[str]:
    """Return the last fields of a message that are arrays of numbers."""
    kinds = list(cdr.FIELDS[name].items())
    start = max(i for i, (_, kind) in enumerate(kinds) if not kind.endswith("]"))
    return [field for field, _ in kinds[start + 1 :]]


@pytest.mark.parametrize("name", SEALED)
@given(data=st.data())
def test_bytes_are_those_of_the_encoder(name: str, data: st.DataObject) -> None:
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    values = values_of(name, rng, data.draw(st.integers(0, 9)))
    last = arrays_at_the_end(name)
    differing = {field for field in DIFFERING if field in values}
    template = Template(name, {field: x for field, x in values.items() if field not in {*last, *differing}})
    for _ in range(2):
        values |= {field: x for field, x in values_of(name, rng, 1).items() if field in differing}
        lengths = data.draw(st.lists(st.integers(0, 9), min_size=len(last), max_size=len(last)))
        values |= {
            field: rng.integers(0, 200, length).astype(values[field].dtype)
            for field, length in zip(last, lengths, strict=True)
        }
        message, checksum = template.write(values, [values[field] for field in last])
        assert bytes(message) == cdr.encode(name, values)
        assert checksum == cdr.decode(name, message)["checksum"]


def common(name: str, *without: str) -> dict[str, Any]:
    return {field: x for field, x in values_of(name, np.random.default_rng(1), 2).items() if field not in without}


def test_arrays_are_filled_where_they_are() -> None:
    template = Template("BridgeForce", common("BridgeForce", "chunk", "data", "checksum"))
    message, (data,) = template.begin([6])
    data[:] = np.arange(6)
    template.seal(message, {"chunk": 3})
    back = cdr.decode("BridgeForce", message)
    assert back["data"].tolist() == list(range(6))
    assert back["chunk"] == 3
    assert np.shares_memory(back["data"], data)


def test_an_array_that_is_too_long_is_refused() -> None:
    template = Template("BridgeForce", common("BridgeForce", "data", "checksum"))
    with pytest.raises(cdr.WireError, match="data: 400001 values, should be 400000 at most"):
        template.begin([400_001])


@pytest.mark.parametrize(("name", "without"), [("BridgeForce", "cells"), ("StickSlip", "run_id")])
def test_what_cannot_differ_is_named(name: str, without: str) -> None:
    with pytest.raises(ValueError, match=rf"{name}\.\w+: should be common to all messages"):
        Template(name, common(name, without, "checksum"))
