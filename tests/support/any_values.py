"""Values for the fields of any message."""

from __future__ import annotations

from typing import Any

import numpy as np

from bow_sim.protocol import cdr


def values_of(name: str, rng: np.random.Generator, length: int) -> dict[str, Any]:
    """Return any values for a message; arrays of `length`."""
    values: dict[str, Any] = {}
    for field, kind in cdr.FIELDS[name].items():
        base, _, bound = kind.partition("[")
        if kind == cdr.SHORT_TEXT:
            values[field] = "ab" * int(rng.integers(0, 9))
        elif kind == cdr.TIME:
            values[field] = int(rng.integers(0, 2**60))
        elif base == "string":
            words = ["b" * int(n) for n in rng.integers(0, 12, length)]
            values[field] = words if kind.endswith("[]") else "µ" * int(rng.integers(0, 9))
        elif bound:
            values[field] = rng.integers(0, 200, length).astype(base)
        else:
            values[field] = int(rng.integers(0, 200))
    return values
