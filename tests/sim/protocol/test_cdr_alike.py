"""Messages that are alike are unsealed as any others are: the same values, and refused where they are damaged."""

from typing import Any

import numpy as np
import pytest

from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_alike import MOST_FORMS, MOST_TEXTS, AlikeReader
from bow_sim.protocol.verdict_fields import VERDICT_FIELDS


def message(rng: np.random.Generator, cells: int = 3, **changes: Any) -> bytes:
    values: dict[str, Any] = {name: rng.integers(0, 9, cells) for name in ("cells", *VERDICT_FIELDS)}
    values |= {"run_id": "a" * 16, "sweep_id": "b" * 16, "incarnation": "c" * 16, "classifier": "d" * 16}
    values |= {"header.stamp": int(rng.integers(2**60)), "block": int(rng.integers(2**32)), "chunk": 5, "attempt": 2}
    return cdr.encode("Verdicts", {**values, "chunk_checksum": int(rng.integers(2**63)), **changes})


def assert_equal(found: dict[str, Any], right: dict[str, Any]) -> None:
    assert found.keys() == right.keys()
    for name, value in right.items():
        assert type(found[name]) is type(value), name
        if isinstance(value, np.ndarray):
            assert found[name].dtype == value.dtype, name
        assert np.array_equal(found[name], value), name


def test_any_messages_give_what_unseal_gives() -> None:
    rng, reader = np.random.default_rng(1), AlikeReader("Verdicts")
    for number in range(300):  # most are alike, some are not: in size, in texts, in texts of another length
        changes = {} if rng.random() < 0.6 else {"run_id": "e" * 16, "incarnation": f"{number:016}"}
        changes |= {} if rng.random() < 0.8 else {"classifier": "µ" * int(rng.integers(9))}
        data = message(rng, int(rng.choice([3, 3, 3, 4, 0])), **changes)
        assert_equal(reader.read(data), cdr.unseal("Verdicts", data))


def test_a_message_like_the_one_before_is_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, reader, slow = np.random.default_rng(2), AlikeReader("Verdicts"), []
    genuine = cdr.unseal
    monkeypatch.setattr(cdr, "unseal", lambda name, data: slow.append(data) or genuine(name, data))
    two = {"incarnation": "f" * 16}
    for number in range(20):
        reader.read(message(rng, 512, **two if number % 2 else {}))
    assert len(slow) == 2, "each of two senders is new once"
    for number in range(3 * MOST_TEXTS):
        reader.read(message(rng, 512, incarnation=f"{number:016}"))
        (form,) = reader._forms.values()
        assert len(form._known) <= MOST_TEXTS


def test_messages_of_several_lengths_in_turn_are_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, reader, slow = np.random.default_rng(5), AlikeReader("Verdicts"), []
    genuine = cdr.unseal
    monkeypatch.setattr(cdr, "unseal", lambda name, data: slow.append(data) or genuine(name, data))
    for number in range(20):
        reader.read(message(rng, 3 + number % 4))
    assert len(slow) == 4
    for cells in range(2 * MOST_FORMS):
        reader.read(message(rng, cells))
        assert len(reader._forms) <= MOST_FORMS


def test_messages_without_a_seal_give_what_decode_gives() -> None:
    rng, reader = np.random.default_rng(6), AlikeReader("Receipt")
    for _ in range(200):
        values = {name: rng.integers(0, 2, int(rng.integers(3))) for name in ("kind", "block", "chunk")}
        count = int(rng.integers(3))
        values |= {"attempt": rng.integers(9, size=count), "checksum": rng.integers(2**63, size=count)}
        data = cdr.encode("Receipt", {"run_id": "a" * 16, "sweep_id": "b", "incarnation": "c" * 16, **values})
        assert_equal(reader.read(data), cdr.decode("Receipt", data))
        padded = data + bytes(int(rng.integers(cdr.SLACK)))
        assert_equal(reader.read(padded), cdr.decode("Receipt", padded))
        with pytest.raises(cdr.WireError):
            reader.read(data[:-9])


def test_a_message_with_any_byte_changed_is_treated_as_unseal_does() -> None:
    rng = np.random.default_rng(3)
    data = message(rng, 1)
    for at in range(len(data)):
        reader = AlikeReader("Verdicts")
        reader.read(data)
        changed = bytearray(data)
        changed[at] ^= 1 + int(rng.integers(255))
        try:
            right = cdr.unseal("Verdicts", bytes(changed))
        except cdr.WireError as error:
            with pytest.raises(cdr.WireError) as raised:
                reader.read(bytes(changed))
            assert str(raised.value) == str(error)
        else:
            assert_equal(reader.read(bytes(changed)), right)


@pytest.mark.parametrize("cut", [1, 4, 40])
def test_a_message_that_is_cut_off_is_refused(cut: int) -> None:
    reader, data = AlikeReader("Verdicts"), message(np.random.default_rng(4))
    reader.read(data)
    with pytest.raises(cdr.WireError):
        reader.read(data[:-cut])
    assert_equal(reader.read(data), cdr.unseal("Verdicts", data))
