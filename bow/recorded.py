"""Recordings of a bridge force in files: WAV, NumPy, and topics of MCAP bags."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bow_classifier.measured.samples import TYPES, SamplesError, samples_in
from bow_classifier.measured.tuning import RecordingError
from bow_sim.protocol import cdr
from bow_sim.protocol.sweep_outline import SweepOutline

FORCE = "bow_msgs/msg/BridgeForce"
"""Type of the stream of a run."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A bridge force from a file.

    Attributes
    ----------
    samples
        (samples,).
    sample_rate, f0, beta
        Hz, Hz, and the bow position; None where the file does not say it.
    name
        What it is of: the file, and the channel where there are several.
    notes
        What a reader should know of it, a sentence each.
    """

    samples: NDArray[np.floating]
    sample_rate: float | None = None
    f0: float | None = None
    beta: float | None = None
    name: str = ""
    notes: tuple[str, ...] = ()


def read_recording(path: str | Path, channel: int = 0, topic: str | None = None, cell: int = 0) -> Recording:
    """Return the samples of a file, and what it says of them.

    Parameters
    ----------
    path
        A WAV file; a NumPy file .npy with a row of numbers, or a row for each channel; an MCAP file of a bag.
    channel
        Which one to take of several, from 0.
    topic
        Of an MCAP file, of a type in :data:`bow_classifier.measured.samples.TYPES`; or `bridge_force` of a run of ours.
        None: the only one that there is of these types.
    cell
        Of a run of ours: index of the cell.

    Raises
    ------
    RecordingError
        For another file, topic or channel; says what there is.
    """
    place = Path(path)
    rate: float | None = None
    notes: list[str] = []
    try:
        match place.suffix.lower():
            case ".wav":
                rows, rate, notes = _from_wav(place)
            case ".npy":
                rows = np.atleast_2d(np.load(place, allow_pickle=False))
            case ".mcap":
                return replace(_from_bag(place, topic, cell), name=str(place))
            case _:
                raise RecordingError(f"{place}: should end in .wav, .npy or .mcap")
    except FileNotFoundError:
        raise RecordingError(f"{place}: there is no such file") from None
    except (OSError, ValueError, TypeError, struct.error) as error:
        if isinstance(error, RecordingError):
            raise
        why = "it ends within its header" if isinstance(error, struct.error) else error
        raise RecordingError(f"{place}: cannot be read as a recording: {why}") from None
    if topic is not None:
        raise RecordingError(f"{place}: has no topics; leave {topic!r} out")
    if rows.ndim != 2:
        raise RecordingError(f"{place}: shape {rows.shape}; should be a row of numbers, or a row for each channel")
    if not 0 <= channel < len(rows):
        raise RecordingError(f"{place}: channel {channel}: it has {len(rows)}, from 0 on")
    if len(rows) == 1:
        return Recording(rows[0], rate, name=str(place), notes=tuple(notes))
    notes.append(f"channel {channel} of 0 ... {len(rows) - 1} is judged")
    return Recording(rows[channel], rate, name=f"{place}, channel {channel}", notes=tuple(notes))


def _from_wav(path: Path) -> tuple[NDArray[Any], float, list[str]]:
    """Return a row for each channel, the sample rate, and what there is to say."""
    from scipy.io import wavfile

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            rate, data = wavfile.read(path)
        except ValueError as error:
            if "reshape" not in str(error):
                raise
            raise RecordingError(f"{path}: is cut off, with more samples of one channel than of another") from None
    if not len(data):
        raise RecordingError(f"{path}: holds no samples")
    # of chunks that are no sound (title, date, microphone) it warns too
    is_cut = any("EOF" in str(each.message) for each in caught)
    notes = [f"the file is cut off after {len(data) / rate:.2f} s"] if is_cut else []
    return data.reshape(len(data), -1).T, float(rate), notes


def _from_bag(path: Path, topic: str | None, cell: int) -> Recording:
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    with open(path, "rb") as file:
        try:
            reader = make_reader(file)
            summary = reader.get_summary()
            if summary is None:
                raise RecordingError(f"{path}: has no index: it was cut off, or is being written (bow recover RUN)")
            types = {channel.topic: summary.schemas[channel.schema_id].name for channel in summary.channels.values()}
            name = _chosen(path, topic, types)
            messages = ((at, each.data) for _, at, each in reader.iter_messages([name, _plan_of(name)]))
            if types[name] == FORCE:
                return _of_run(path, cell, [(at.topic == name, data) for at, data in messages])
            parts = [samples_in(types[name], data) for at, data in messages if at.topic == name]
        except (McapError, SamplesError, cdr.WireError) as error:
            raise RecordingError(f"{path}: cannot be read: {error}") from None
    if not parts:
        raise RecordingError(f"{path}: {name}: holds no message")
    return Recording(np.concatenate(parts))


def _plan_of(topic: str) -> str:
    return f"{topic.rpartition('/')[0]}/plan"


def _chosen(path: Path, topic: str | None, types: dict[str, str]) -> str:
    """Return the topic to read; one may be given without the slash at its beginning."""
    fit = sorted(name for name, kind in types.items() if kind in TYPES or kind == FORCE)
    listed = ", ".join(fit) or f"none; it needs a type of {', '.join(sorted(TYPES))}"
    if topic is None:
        if len(fit) == 1:
            return fit[0]
        raise RecordingError(f"{path}: which topic? There is: {listed}")
    for name in (topic, f"/{topic}", f"/bow/{topic}"):
        if name in fit:
            return name
        if name in types:
            raise RecordingError(f"{path}: {name} is of type {types[name]}; there is: {listed}")
    raise RecordingError(f"{path}: no topic {topic}; there is: {listed}")


def _of_run(path: Path, cell: int, messages: list[tuple[bool, bytes]]) -> Recording:
    """Return the bridge force of one cell of a run, from the messages of its streams and plans."""
    plans = [data for is_force, data in messages if not is_force]
    if not plans:
        raise RecordingError(f"{path}: holds no plan of its run")
    outline = SweepOutline.of(cdr.decode("Plan", plans[0]))
    if not 0 <= cell < outline.cells:
        raise RecordingError(f"{path}: cell {cell}: the run has {outline.cells}, from 0 on")
    parts = dict(_parts(cell, (data for is_force, data in messages if is_force)))
    whole = next((chunk for chunk in range(len(parts)) if chunk not in parts), len(parts))
    if not whole:
        raise RecordingError(f"{path}: holds nothing of cell {cell}; a run may have several files")
    found = {name: float(outline.values(name, np.array([cell]))[0]) for name in ("period", "bow_bridge", "sample_rate")}
    return Recording(
        np.concatenate([parts[chunk] for chunk in range(whole)]),
        found["sample_rate"],
        found["sample_rate"] / found["period"],
        found["bow_bridge"] / found["period"],
    )


def _parts(cell: int, messages: Iterator[bytes]) -> Iterator[tuple[int, NDArray[Any]]]:
    for data in messages:
        values = cdr.unseal("BridgeForce", data)
        rows = np.flatnonzero(values["cells"] == cell)
        if rows.size:
            yield values["chunk"], values["data"].reshape(len(values["cells"]), -1)[rows[0]]
