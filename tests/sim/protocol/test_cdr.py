"""The streams as bytes: as ROS writes them, and refused where they are not what they say."""

import re
from enum import IntEnum
from pathlib import Path

import numpy as np
import pytest
import xxhash
from any_values import values_of
from bow_msgs.msg import Health, Plan, Receipt, Verdicts
from hypothesis import given, settings
from hypothesis import strategies as st

from bow_classifier.verdict.regimes import REGIMES
from bow_sim.protocol import cdr, limits
from bow_sim.protocol.states import BlockState, NodeState, PlanState, ReceiptKind

MESSAGES = Path(__file__).parents[3] / "msg_defs" / "msg"
DTYPES = {"uint8", "uint16", "uint32", "uint64", "float32", "float64"}


def fields_in_file(name: str) -> dict[str, str]:
    """Return field -> kind as the .msg file declares them, nested messages written out."""
    found: dict[str, str] = {}
    for line in (MESSAGES / f"{name}.msg").read_text().splitlines():
        words = line.split("#")[0].split()
        if len(words) != 2 or "=" in words[1]:
            continue
        kind, field = words
        if kind == "std_msgs/Header":
            found.update({f"{field}.stamp": cdr.TIME, f"{field}.frame_id": "string"})
        elif re.match(r"[A-Z]", kind):
            found.update({f"{field}.{inner}": k for inner, k in fields_in_file(kind).items()})
        else:
            found[field] = kind
    return found


@pytest.mark.parametrize("name", cdr.FIELDS)
def test_tables_are_the_message_definitions(name: str) -> None:
    assert list(cdr.FIELDS[name].items()) == list(fields_in_file(name).items())


def as_ros(name: str, values: dict) -> bytes:
    import bow_msgs.msg
    from rclpy.serialization import serialize_message

    message = getattr(bow_msgs.msg, name)()
    for field, value in values.items():
        owner, _, leaf = field.rpartition(".")
        target = getattr(message, owner) if owner else message
        kind = cdr.FIELDS[name][field]
        if kind == cdr.TIME:
            stamp = getattr(target, leaf)
            stamp.sec, stamp.nanosec = divmod(value, 10**9)
        elif kind == cdr.SHORT_TEXT:
            setattr(target, leaf, np.frombuffer(value.encode().ljust(16, b"\0"), np.uint8))
        else:
            setattr(target, leaf, float(value) if kind.startswith("float") and not np.ndim(value) else value)
    return bytes(serialize_message(message))


@pytest.mark.parametrize("name", cdr.FIELDS)
@pytest.mark.parametrize("length", [0, 1, 2, 5, 128])
def test_bytes_are_those_of_ros(name: str, length: int) -> None:
    values = values_of(name, np.random.default_rng(length), length)
    ours = cdr.encode(name, values)
    if cdr.is_sealed(name):
        values["checksum"] = cdr.decode(name, ours)["checksum"]
    theirs = as_ros(name, values)
    back = cdr.decode(name, theirs[: len(ours)] if cdr.is_sealed(name) else theirs)
    assert len(theirs) - len(ours) in range(cdr.SLACK)
    assert cdr.encode(name, back) == ours
    assert [a for a, b in zip(ours, theirs, strict=False) if a != b].count(0) == sum(
        a != b for a, b in zip(ours, theirs, strict=False)
    )  # Fast CDR leaves what it skips for alignment as it was, here it is zero
    for field, value in values.items():
        np.testing.assert_array_equal(back[field], value)


def chunk(cells: int = 3, samples: int = 20, block: int = 7, number: int = 4) -> dict[str, dict]:
    rng = np.random.default_rng(cells)
    common = {
        "run_id": "a" * 16,
        "sweep_id": "b" * 16,
        "block": block,
        "chunk": number,
        "attempt": 1,
        "incarnation": "c" * 16,
        "cells": np.arange(cells),
        "first_sample": number * samples,
        "samples": samples,
    }
    return {
        "BridgeForce": {**common, "data": rng.normal(size=(cells, samples)).astype(np.float32)},
        "StickSlip": {
            **common,
            "slipping": np.zeros(cells, np.uint8),
            "offsets": np.arange(cells + 1) * 2,
            "onset": np.tile([2, 11], cells),
            "duration": np.tile([3, 9], cells),
            "slip": rng.random(2 * cells),
        },
    }


@pytest.mark.parametrize(
    ("message", "states"),
    [
        (Plan, [*PlanState, *BlockState]),
        (Health, list(NodeState)),
        (Receipt, list(ReceiptKind)),
    ],
)
def test_constants_are_those_of_the_interfaces(message: type, states: list[IntEnum]) -> None:
    assert all(getattr(message, state.name) == state for state in states)


def test_the_regimes_are_constants_of_the_verdicts() -> None:
    codes = {name: getattr(Verdicts, name.upper()) for name in REGIMES}
    assert codes == {name: code for code, name in enumerate(REGIMES)}
    constants = re.findall(r"^uint8 (\w+)=", (MESSAGES / "Verdicts.msg").read_text(), re.MULTILINE)
    assert constants == [name.upper() for name in REGIMES]


def test_a_message_without_a_stamp_has_the_time_that_ros_takes_for_unknown() -> None:
    back = {name: cdr.decode(name, cdr.encode(name, values)) for name, values in chunk().items()}
    assert back["BridgeForce"]["stamp"] == back["StickSlip"]["header.stamp"] == 0
    assert back["StickSlip"]["header.frame_id"] == "bow"
    stamped = cdr.encode("BridgeForce", {**chunk()["BridgeForce"], "stamp": 1_700_000_000_987_654_321})
    assert cdr.decode("BridgeForce", stamped)["stamp"] == 1_700_000_000_987_654_321


@pytest.mark.parametrize("name", ["BridgeForce", "StickSlip"])
def test_a_sealed_message_comes_back(name: str) -> None:
    values = chunk()[name]
    back = cdr.unseal(name, cdr.encode(name, values))
    for field, value in values.items():
        np.testing.assert_array_equal(back[field], np.ravel(value) if np.ndim(value) else value)


@pytest.mark.parametrize("name", ["BridgeForce", "StickSlip"])
def test_attempts_have_the_same_checksum_and_other_places_another(name: str) -> None:
    def checksum(**changes: object) -> int:
        return cdr.decode(name, cdr.encode(name, {**chunk()[name], **changes}))["checksum"]

    stamps = {"stamp": 10**18 + 1, "header.stamp": 10**18 + 1}
    assert checksum() == checksum(attempt=9, incarnation="d" * 16, run_id="e" * 16, **stamps)
    assert len({checksum(), checksum(block=8), checksum(chunk=5), checksum(first_sample=1)}) == 4


@given(st.data())
@settings(max_examples=300, deadline=None)
def test_any_changed_byte_of_the_payload_is_noticed(data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(["BridgeForce", "StickSlip"]))
    message = bytearray(cdr.encode(name, chunk()[name]))
    start = message.index(cdr.decode(name, message)["checksum"].to_bytes(8, "little")) + 8
    place = data.draw(st.integers(start, len(message) - 1))
    message[place] ^= 1 << data.draw(st.integers(0, 7))
    with pytest.raises(cdr.WireError):
        cdr.unseal(name, bytes(message))


@given(st.binary(max_size=400), st.sampled_from(sorted(cdr.FIELDS)))
@settings(max_examples=500, deadline=None)
def test_rubbish_is_refused_without_harm(rubbish: bytes, name: str) -> None:
    for data in (rubbish, cdr.ENCAPSULATION + rubbish):
        try:
            values = cdr.decode(name, data)
        except cdr.WireError:
            continue
        assert sum(np.size(value) for value in values.values()) <= 2 * len(data) + len(values)


@given(st.integers(0, 10**6), st.sampled_from(["BridgeForce", "StickSlip"]))
@settings(max_examples=200, deadline=None)
def test_a_message_cut_anywhere_is_refused(cut: int, name: str) -> None:
    message = cdr.encode(name, chunk()[name])
    with pytest.raises(cdr.WireError):
        cdr.unseal(name, message[: cut % len(message)])


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"offsets": np.array([0, 2, 4, 5])}, "offsets"),
        ({"offsets": np.array([0, 4, 2, 6])}, "offsets"),
        ({"duration": np.full(6, 30)}, "past the chunk"),
        ({"duration": np.zeros(6, int)}, "empty"),
        ({"onset": np.array([2, 4, 2, 11, 2, 11])}, "in order"),
        ({"onset": np.array([2, 11, 2])}, "onsets"),
        ({"slipping": np.zeros(5)}, "slipping"),
    ],
)
def test_slip_intervals_that_cannot_be_are_refused(changes: dict, what: str) -> None:
    message = cdr.encode("StickSlip", {**chunk()["StickSlip"], **changes})
    with pytest.raises(cdr.WireError, match=what):
        cdr.unseal("StickSlip", message)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        (b"a" * 16 + b"\0", b"a" * 17, r"run_id: the string at byte 24 does not end with a zero"),
        (b"a" * 16 + b"\0", b"a" * 15 + b"\xff\0", r"run_id: the string at byte 24 is not UTF-8"),
        (b"\x11\0\0\0" + b"b" * 16, b"\xff" * 4 + b"b" * 16, r"sweep_id: wants bytes"),
    ],
)
def test_a_string_that_is_none_is_refused_by_name_and_place(old: bytes, new: bytes, what: str) -> None:
    message = cdr.encode("StickSlip", chunk()["StickSlip"])
    assert old in message
    with pytest.raises(cdr.WireError, match=what):
        cdr.decode("StickSlip", message.replace(old, new))


def test_what_a_bounded_message_has_no_room_for_is_refused() -> None:
    values = chunk()["BridgeForce"]
    for text in ("c" * 17, "\u00b5", "c\0"):
        with pytest.raises(cdr.WireError, match=r"incarnation = .* should be 16 ASCII characters at most"):
            cdr.encode("BridgeForce", {**values, "incarnation": text})
    with pytest.raises(cdr.WireError, match="cells: 1025 values, should be 1024 at most"):
        cdr.encode("BridgeForce", {**values, "cells": np.zeros(1025)})
    message = cdr.encode("BridgeForce", values)
    with pytest.raises(cdr.WireError, match=r"run_id: .* is not ASCII"):
        cdr.decode("BridgeForce", message.replace(b"a" * 16, b"a" * 15 + b"\xff"))
    count = len(values["cells"]).to_bytes(4, "little")
    with pytest.raises(cdr.WireError, match=r"BridgeForce\.cells: 1025 values, should be 1024 at most"):
        cdr.decode("BridgeForce", message.replace(count, (1025).to_bytes(4, "little")))


def test_bridge_force_is_bounded_and_so_can_be_lent_in_shared_memory() -> None:
    for field, kind in cdr.FIELDS["BridgeForce"].items():
        assert "string" not in kind and "[]" not in kind, field  # the middleware takes every string for unbounded


def test_the_bound_of_the_message_is_that_of_a_chunk() -> None:
    assert cdr.FIELDS["BridgeForce"]["data"] == f"float32[<={limits.MAX_CHUNK_VALUES}]"
    assert cdr.FIELDS["BridgeForce"]["cells"] == f"uint32[<={limits.MAX_BLOCK_CELLS}]"


def test_mismatched_bridge_force_is_refused() -> None:
    message = cdr.encode("BridgeForce", {**chunk()["BridgeForce"], "data": np.zeros(59, np.float32)})
    with pytest.raises(cdr.WireError, match="59 values for 3 cells, should be 60"):
        cdr.unseal("BridgeForce", message)


def test_identity_of_a_message() -> None:
    message = cdr.encode("BridgeForce", chunk()["BridgeForce"])
    assert cdr.identity(cdr.decode("BridgeForce", message)) == cdr.Identity("a" * 16, "b" * 16, 7, 4, 1)


def test_verdicts_from_before_beats_and_transients_are_read_as_without_any() -> None:
    cells = 3
    values = values_of("Verdicts", np.random.default_rng(1), cells)
    today = cdr.encode("Verdicts", values)
    whole = cdr.decode("Verdicts", today)
    before = today[: len(today) - 2 * (4 + 4 * cells)]
    checksum = xxhash.xxh3_64_intdigest(before[covered(today) :], seed=(values["block"] << 32) | values["chunk"])
    before = before[: covered(today) - 8] + checksum.to_bytes(8, "little") + before[covered(today) :]
    back = cdr.unseal("Verdicts", before)
    assert np.isnan(back["beat"]).all() and np.isnan(back["transient"]).all()
    assert (back["beat"].dtype, len(back["beat"])) == (np.float32, cells)
    assert back["confidence"].tobytes() == whole["confidence"].tobytes()
    with pytest.raises(cdr.WireError, match="transient"):
        cdr.unseal("Verdicts", today[:-1])


def covered(data: bytes) -> int:
    """Return the first byte of verdicts that their checksum covers."""
    return cdr._decode("Verdicts", data, whole=False)[1]
