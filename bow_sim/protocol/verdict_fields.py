"""The fields of a verdict: what the classifier reports of each cell after each test."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

PENDING = 255
"""Regime of a cell that has no verdict."""


class VerdictField(NamedTuple):
    """The type of a field, and its value where there is no verdict."""

    kind: type[np.generic]
    empty: float

    def array(self, shape: tuple[int, ...]) -> NDArray[np.generic]:
        """Return an array of a shape without any verdict."""
        return np.full(shape, self.empty, self.kind)


VERDICT_FIELDS: dict[str, VerdictField] = {
    "correlation": VerdictField(np.float32, np.nan),
    "period": VerdictField(np.float32, np.nan),
    "slips": VerdictField(np.uint16, 0),
    "corners": VerdictField(np.uint16, 0),
    "regime": VerdictField(np.uint8, PENDING),
    "confidence": VerdictField(np.float32, np.nan),
    "beat": VerdictField(np.float32, np.nan),
    "transient": VerdictField(np.float32, np.nan),
}
"""Name -> field, in the order of Verdicts.msg, which documents each. The message, the growing map, ``map.npz`` and the
verdict sets of `bow replay` take their fields from this table."""


def differing(recorded: Mapping[str, Any], again: Mapping[str, Any]) -> list[str]:
    """Return the names of the fields of two verdicts, as arrays, that differ in any byte."""
    return [name for name in VERDICT_FIELDS if recorded[name].tobytes() != again[name].tobytes()]
