"""Which chunks of a sweep have their streams recorded: the setting ``record``. Verdicts are recorded always.

What is not recorded can be computed again to the last bit, and a verdict states the checksum of the streams it judged.
Where none is recorded, each simulator judges what it computes, and nobody needs the streams.
"""

from __future__ import annotations

from bow_sim.physics.errors import ParameterError

RECORD = {
    "all": "the streams of every chunk",
    "last": "the streams of the last chunk of each block: the final motion of every cell",
    "verdicts": "no streams",
}
"""Value of the setting -> what is recorded beside the verdicts."""

DEFAULT = "all"

PROVED_CELLS = 500
"""Cells of a run without all of its streams that `bow verify` computes again, unless another number is asked for."""


def record_of(value: object) -> str:
    """Return the setting ``record``; None stands for the default.

    Raises
    ------
    ParameterError
        For any other value than those of `RECORD`.
    """
    if value is None:
        return DEFAULT
    if str(value) not in RECORD:
        raise ParameterError(f"record = {value!r}: should be one of {', '.join(RECORD)}")
    return str(value)


def judged_at_source(record: str) -> bool:
    """Return whether simulators judge their chunks themselves and publish the verdicts instead of the streams."""
    return record == "verdicts"


def recorded_chunks(record: str, chunks: int) -> range:
    """Return the chunks of each block whose streams are recorded, out of `chunks`."""
    return {"all": range(chunks), "last": range(chunks - 1, chunks), "verdicts": range(0)}[record]
