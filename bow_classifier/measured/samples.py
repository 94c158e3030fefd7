"""The samples in the messages that sensors publish."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

TYPES: dict[str, np.dtype[Any]] = {
    "std_msgs/msg/Float32MultiArray": np.dtype("f4"),
    "std_msgs/msg/Float64MultiArray": np.dtype("f8"),
    "std_msgs/msg/Float32": np.dtype("f4"),
    "std_msgs/msg/Float64": np.dtype("f8"),
}
"""Types of messages that can be judged: blocks of samples, or one sample each."""


CLIPPED = 4
"""Equal samples in a row, at the largest or smallest value, that are said to be clipped."""


class SamplesError(ValueError):
    """A message does not have samples of one string; the text says why."""


def samples_of(message: Any) -> NDArray[np.floating]:
    """Return the samples of a message of one of `TYPES`, (samples,).

    Raises
    ------
    SamplesError
        Where its layout says that there is more than one channel.
    """
    if not hasattr(message, "layout"):
        return np.array([message.data])
    wide = [f"{dim.label or '?'}: {dim.size}" for dim in message.layout.dim if dim.size > 1]
    return _one_row(np.asarray(message.data), wide)[message.layout.data_offset :]


def samples_in(kind: str, data: bytes) -> NDArray[np.floating]:
    """Return the samples of a message of one of `TYPES` from its CDR bytes, (samples,).

    Raises
    ------
    SamplesError
        As :func:`samples_of`, or where the bytes are not such a message.
    """
    dtype = TYPES[kind]
    try:
        body, order = data[4:], "<" if data[1] else ">"
        dtype = dtype.newbyteorder("<" if data[1] else ">")
        if not kind.endswith("MultiArray"):
            return np.frombuffer(body, dtype, 1)
        (dimensions,) = struct.unpack_from(f"{order}I", body, 0)
        at, wide = 4, []
        for _ in range(dimensions):
            at += -at % 4
            (length,) = struct.unpack_from(f"{order}I", body, at)
            label = body[at + 4 : at + 3 + length].decode()
            at += 4 + length
            at += -at % 4
            size, _ = struct.unpack_from(f"{order}II", body, at)
            at += 8
            wide += [f"{label or '?'}: {size}"] if size > 1 else []
        at += -at % 4
        offset, count = struct.unpack_from(f"{order}II", body, at)
        at += 8
        at += -at % dtype.itemsize if count else 0
        samples = np.frombuffer(body, dtype, count, at)
    except (IndexError, ValueError, struct.error) as error:
        raise SamplesError(f"{kind}: not such a message: {error}") from None
    return _one_row(samples, wide)[offset:]


def _one_row(samples: NDArray[np.floating], wide: list[str]) -> NDArray[np.floating]:
    if len(wide) > 1:
        raise SamplesError(f"its layout has {len(wide)} dimensions ({', '.join(wide)}); should be a row of samples")
    return samples


def longest_run(samples: NDArray[np.floating], value: float) -> int:
    """Return how many samples in a row have a value, at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], samples == value, [False]]).astype(np.int8)))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0
