"""The messages of the graph as tables of their fields.

``tests/sim/protocol/test_cdr.py`` compares the tables with the .msg files.
"""

from __future__ import annotations

import numpy as np

from bow_sim.protocol.verdict_fields import VERDICT_FIELDS

FORMAT = 3
"""Version of the messages, and so of bags and ledgers. A recorded message that changes needs a new one, and older bags
are read by :mod:`bow_sweep.record.old_messages`. 3: stamps and headers; topics in a bag do not have the run's name.
2: complete blocks have receipts."""

STREAMS = {"bridge_force": "BridgeForce", "stick_slip": "StickSlip"}
"""Topic -> message, of the two messages of a chunk."""

LETTERS = {"uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "float32": "f", "float64": "d"}
"""Type of a number -> its letter in :mod:`struct`."""

SHORT_TEXT = "uint8[16]"
"""A text as an array of bytes: ASCII, 16 characters at most."""

TIME = "builtin_interfaces/Time"
"""A stamp; here one number, nanoseconds since 1970."""

FRAME = "bow"
"""The `frame_id` of every header: what is measured belongs to the bowed string, and that has no frame of its own."""

HEADER = {"header.stamp": TIME, "header.frame_id": "string"}
"""The fields of ``std_msgs/Header header``."""

UNSTAMPED: dict[str, int | str] = {"stamp": 0, "header.stamp": 0, "header.frame_id": FRAME}
"""What is written where a message is given no stamp: to ROS, a time that is not known."""

_IDENTITY = {
    "run_id": "string",
    "sweep_id": "string",
    "block": "uint32",
    "chunk": "uint32",
    "attempt": "uint32",
    "incarnation": "string",
    "checksum": "uint64",
}

FIELDS: dict[str, dict[str, str]] = {
    "BridgeForce": {
        "stamp": TIME,
        **{field: kind.replace("string", SHORT_TEXT) for field, kind in _IDENTITY.items()},
        "cells": "uint32[<=1024]",
        "first_sample": "uint32",
        "samples": "uint32",
        "data": "float32[<=400000]",
    },
    "StickSlip": {
        **HEADER,
        **_IDENTITY,
        "cells": "uint32[]",
        "first_sample": "uint32",
        "samples": "uint32",
        "slipping": "uint8[]",
        "offsets": "uint32[]",
        "onset": "uint32[]",
        "duration": "uint32[]",
        "slip": "float64[]",
    },
    "InspectedCell": {
        **HEADER,
        **_IDENTITY,
        "cell": "uint32",
        "name": "string",
        "first_sample": "uint32",
        "sample_rate": "float64",
        "periods": "float32[]",
        "bridge_force": "float32[]",
    },
    "Verdicts": {
        **HEADER,
        **_IDENTITY,
        "chunk_checksum": "uint64",
        "classifier": "string",
        "cells": "uint32[]",
        **{name: f"{np.dtype(field.kind)}[]" for name, field in VERDICT_FIELDS.items()},
    },
    "Receipt": {
        "run_id": "string",
        "sweep_id": "string",
        "incarnation": "string",
        "kind": "uint8[]",
        "block": "uint32[]",
        "chunk": "uint32[]",
        "attempt": "uint32[]",
        "checksum": "uint64[]",
    },
    "Plan": {
        "run_id": "string",
        "sweep_id": "string",
        "epoch": "uint32",
        "state": "uint8",
        "spec.preset": "string",
        "spec.settings": "string[]",
        "fingerprint": "string",
        "classifier": "string",
        "block_states": "uint8[]",
        "rounds": "uint8[]",
        "incarnation": "string",
    },
    "Block": {
        "run_id": "string",
        "sweep_id": "string",
        "coordinator": "string",
        "simulator": "string",
        "epoch": "uint32",
        "fingerprint": "string",
        "spec.preset": "string",
        "spec.settings": "string[]",
        "block": "uint32",
        "attempt": "uint32",
        "cells": "uint32[]",
        "x": "float64[]",
        "y": "float64[]",
    },
    "BasinMap": {
        "run_id": "string",
        "sweep_id": "string",
        "x_name": "string",
        "y_name": "string",
        "x": "float64[]",
        "y": "float64[]",
        "transient_periods": "float32[]",
        "regime": "uint8[]",
        "tests": "uint16[]",
        "correlation": "float32[]",
        "slips": "uint16[]",
        "corners": "uint16[]",
        "regime_names": "string[]",
        "cells_done": "uint32",
        "cells_quarantined": "uint32",
        "cells_outstanding": "uint32",
    },
}
"""Message -> its fields in order; the fields of nested messages are written with a dot."""


ADDED: dict[str, tuple[str, ...]] = {"Plan": ("incarnation",), "Verdicts": ("beat", "transient")}
"""Message -> its last fields, which older versions of bow did not write. A string is then read as "", the field of a
verdict as its empty value for each cell."""


def is_sealed(name: str) -> bool:
    """Return whether a message carries its own checksum; such messages are always encoded by this package."""
    return FIELDS[name].get("checksum") == "uint64"
