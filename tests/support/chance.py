"""Odd values by chance: bytes that were right once, numbers at the ends of their range, texts nobody expects."""

from __future__ import annotations

import contextlib
import random
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bow_sim.protocol import cdr

Chance = random.Random

NUMBERS = (
    *("0", "1", "-1", "5", "8", "15", "100", "128", "0.5", "2", "1e-9", "-0.0", "nan", "inf", "-inf", "1e308", "1e400"),
    *("4096", "65536", "1000000", "1e6", "4194304", "4294967295", "9223372036854775808", "9" * 400, "9" * 5000),
    *("1_000", "0x10", " 7 ", "٣", "1e", "", "--1", "True", "1/0"),
)

TEXTS = ("", "=", "a=b", "../../etc/passwd", "/etc/passwd", "@/etc/passwd", "\0", "é", "\ud7ff", "%s%n", "x" * 10_000)

SIZES = (0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1)

ROOM_FOR_A_CASE = 512 << 20
"""Bytes of address space that a case may take beyond what is there: no case's bytes fill so much."""


def odd_number(chance: Chance) -> str:
    """Return the text of a number, or of something like one."""
    if chance.random() < 0.3:
        return repr(chance.uniform(-1, 1) * 10 ** chance.randint(-12, 12))
    return chance.choice(NUMBERS)


def odd_text(chance: Chance) -> str:
    """Return a text."""
    if chance.random() < 0.5:
        return chance.choice(TEXTS)
    return "".join(chr(chance.randrange(1, 0xD800)) for _ in range(chance.randrange(12)))


def odd_json(chance: Chance, depth: int = 0) -> Any:
    """Return anything that JSON can say."""
    kind = chance.randrange(9 if depth < 3 else 6)
    if kind == 0:
        return chance.choice([None, True, False])
    if kind == 1:
        return chance.choice([0, 1, -1, 3, 2**31, 2**32, 2**63, 10**400])
    if kind == 2:
        return chance.choice([0.5, 1e308, float("nan"), float("inf"), -0.0])
    if kind <= 5:
        return odd_text(chance)
    if kind == 6:
        return [odd_json(chance, depth + 1) for _ in range(chance.randrange(4))]
    if kind == 7:
        return {odd_text(chance): odd_json(chance, depth + 1) for _ in range(chance.randrange(4))}
    return [[[[[[]]]]]]


def odd_array(chance: Chance, count: int, kind: Any) -> np.ndarray:
    """Return `count` values of a type, some of them at its ends."""
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        ends = [0.0, 1.0, -1.0, np.nan, np.inf, -np.inf, 1e308, 1e-320, 5.5]
        values = np.array([chance.choice(ends) for _ in range(min(count, 8))])
        with np.errstate(over="ignore"):
            return np.resize(values, count).astype(dtype) if count else np.zeros(0, dtype)
    top = int(np.iinfo(dtype).max)
    if chance.random() < 0.5:
        return np.arange(count).astype(dtype)
    small = [chance.choice([0, 1, 2, 5, 7, top, top // 2]) for _ in range(min(count, 8))]
    return np.resize(np.array(small, dtype), count) if count else np.zeros(0, dtype)


def mutated(chance: Chance, data: bytes) -> bytes:
    """Return bytes changed in one to four ways: flipped, cut, moved, repeated, with other lengths written in."""
    out = bytearray(data)
    for _ in range(chance.choice([1, 1, 1, 2, 3, 4])):
        at = chance.randrange(len(out) + 1)
        some = chance.choice([1, 4, 8, 40, 1000])
        match chance.randrange(8):
            case 0 if at < len(out):
                out[at] ^= 1 << chance.randrange(8)
            case 1 if at < len(out):
                out[at] = chance.randrange(256)
            case 2:
                del out[at:]
            case 3:
                del out[at : at + some]
            case 4:
                out[at:at] = chance.randbytes(min(some, 40))
            case 5:
                out[at:at] = out[at : at + some]
            case 6:
                at -= at % 4
                out[at : at + 4] = chance.choice(SIZES).to_bytes(4, "little")
            case 7:
                out[at : at + 8] = chance.choice([*SIZES, 2**63, 2**64 - 1]).to_bytes(8, "little")
    return bytes(out)


def sealed(chance: Chance, name: str, data: bytes) -> bytes:
    """Return a sealed message with other contents, and a checksum that holds: sent by one who knows how."""
    values = cdr.decode(name, data)
    for field, kind in cdr.FIELDS[name].items():
        if chance.random() < 0.75 or field in ("run_id", "sweep_id"):
            continue
        if kind.endswith("[]"):
            old = values[field]
            count = chance.choice([len(old), len(old), len(old), 0, len(old) + 1])
            new = odd_array(chance, count, kind[:-2])
            if len(old) and len(new) == len(old) and chance.random() < 0.6:
                place = chance.randrange(len(old))
                new = np.concatenate([old[:place], new[place : place + 1], old[place + 1 :]])
            values[field] = new
        elif kind == "uint32":
            values[field] = chance.choice([values[field], 0, 1, 695, 2**32 - 1])
    return cdr.encode(name, values)


@contextlib.contextmanager
def bounded_memory() -> Iterator[None]:
    """Let a large allocation fail: what an attacker's number asks for is then a MemoryError and not a slow machine."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + ROOM_FOR_A_CASE, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
