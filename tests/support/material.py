"""Settings, presets and archives that are odd, but not so odd that the first look refuses them."""

from __future__ import annotations

import dataclasses
import io
import random
import zipfile

import numpy as np
import yaml
from chance import mutated, odd_json, odd_number, odd_text

from bow_classifier.verdict.thresholds import Thresholds
from bow_sim.physics.parameters import FIELDS

Chance = random.Random

WORDS = [*FIELDS, *(f"{a}.{n}" for a in "xy" for n in ("name", "scale", "first", "last", "count")), "block_cells"]
WORDS += [f"classifier.{field.name}" for field in dataclasses.fields(Thresholds)]
"""Names of settings."""


def odd_settings(chance: Chance) -> list[str]:
    """Return a few settings, some of them right."""
    lines = []
    for _ in range(chance.randrange(5)):
        name = chance.choice(WORDS) if chance.random() < 0.95 else odd_text(chance)
        field = FIELDS.get(name)
        value = chance.choice([odd_number(chance), odd_number(chance), odd_text(chance)])
        if field is not None and "choices" in field.metadata and chance.random() < 0.8:
            value = chance.choice(field.metadata["choices"])
        elif name.endswith("_function") or (name.endswith(".name") and chance.random() < 0.8):
            value = chance.choice(sorted(FIELDS)) if name.endswith(".name") else odd_function(chance)
        lines.append(f"{name}={value}" if chance.random() < 0.98 else odd_text(chance))
    return lines


def odd_function(chance: Chance) -> str:
    """Return the text of a reflection function that may be one."""
    taps = ",".join(chance.choice(["-0.5", "0.1", "nan", "1e308", "", "x"]) for _ in range(chance.choice([1, 1, 3])))
    words = [f"first={odd_number(chance)}", f"taps={taps}", f"tail={odd_number(chance)}", f"pole={odd_number(chance)}"]
    return " ".join(words[: chance.randrange(1, 5)])


def odd_yaml(chance: Chance) -> bytes:
    """Return YAML that is no preset, or one that multiplies itself."""
    if chance.random() < 0.2:
        lines = ["a0: &a0 {x: 1}"] + [f"a{n}: &a{n} {{p: *a{n - 1}, q: *a{n - 1}, r: *a{n - 1}}}" for n in range(1, 40)]
        return "\n".join(lines).encode()
    if chance.random() < 0.1:
        return b"[" * chance.randrange(20_000)
    return yaml.safe_dump(odd_json(chance)).encode()


def odd_archive(chance: Chance, whole: bytes) -> bytes:
    """Return an archive in which arrays are replaced by others, or claim a size that they don't have."""
    with np.load(io.BytesIO(whole)) as file:
        arrays = dict(file.items())
    for _ in range(chance.randrange(1, 4)):
        name = chance.choice(sorted(arrays))
        arrays[name] = chance.choice(
            [np.zeros(3), np.array("text"), np.zeros((2, 2, 2), np.uint8), np.array(0), np.full(4, np.nan)]
        )
    out = io.BytesIO()
    np.savez(out, **arrays)
    data = out.getvalue()
    if chance.random() < 0.6:
        header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (%d, %d), }" % (
            chance.choice([10**6, 10**12, 2**63, -1, 10**30]),
            chance.choice([1, 0, 4096, 10**9]),
        )
        header += b" " * (-(len(header) + 11) % 64) + b"\n"
        header = mutated(chance, header) if chance.random() < 0.5 else header
        lie = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(64)
        with zipfile.ZipFile(out, "a") as archive:
            archive.writestr(f"{chance.choice(['liar', 'bomb'])}.npy", lie)
        data = out.getvalue()
    return data
