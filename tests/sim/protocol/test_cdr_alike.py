"""Messages that are alike are unsealed as any others are: the same values, and refused where they are damaged."""

from typing import Any

import numpy as np
import pytest

from bow_sim.protocol import cdr
from bow_sim.protocol.cdr_alike import MOST_TEXTS, Unsealer
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
    rng, unsealer = np.random.default_rng(1), Unsealer("Verdicts")
    for number in range(300):  # most are alike, some are not: in size, in texts, in texts of another length
        changes = {} if rng.random() < 0.6 else {"run_id": "e" * 16, "incarnation": f"{number:016}"}
        changes |= {} if rng.random() < 0.8 else {"classifier": "µ" * int(rng.integers(9))}
        data = message(rng, int(rng.choice([3, 3, 3, 4, 0])), **changes)
        assert_equal(unsealer.unseal(data), cdr.unseal("Verdicts", data))


def test_a_message_like_the_one_before_is_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, unsealer, slow = np.random.default_rng(2), Unsealer("Verdicts"), []
    genuine = cdr.unseal
    monkeypatch.setattr(cdr, "unseal", lambda name, data: slow.append(data) or genuine(name, data))
    two = {"incarnation": "f" * 16}
    for number in range(20):
        unsealer.unseal(message(rng, 512, **two if number % 2 else {}))
    assert len(slow) == 2, "each of two senders is new once"
    for number in range(3 * MOST_TEXTS):
        unsealer.unseal(message(rng, 512, incarnation=f"{number:016}"))
        assert len(unsealer._form._known) <= MOST_TEXTS


def test_a_message_with_any_byte_changed_is_treated_as_unseal_does() -> None:
    rng = np.random.default_rng(3)
    data = message(rng, 1)
    for at in range(len(data)):
        unsealer = Unsealer("Verdicts")
        unsealer.unseal(data)
        changed = bytearray(data)
        changed[at] ^= 1 + int(rng.integers(255))
        try:
            right = cdr.unseal("Verdicts", bytes(changed))
        except cdr.WireError as error:
            with pytest.raises(cdr.WireError) as raised:
                unsealer.unseal(bytes(changed))
            assert str(raised.value) == str(error)
        else:
            assert_equal(unsealer.unseal(bytes(changed)), right)


@pytest.mark.parametrize("cut", [1, 4, 40])
def test_a_message_that_is_cut_off_is_refused(cut: int) -> None:
    unsealer, data = Unsealer("Verdicts"), message(np.random.default_rng(4))
    unsealer.unseal(data)
    with pytest.raises(cdr.WireError):
        unsealer.unseal(data[:-cut])
    assert_equal(unsealer.unseal(data), cdr.unseal("Verdicts", data))
