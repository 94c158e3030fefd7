"""A bag: a directory in the format of rosbag2. After every interruption recording continues in a new MCAP file.

``bag/metadata.yaml``, ``bag/bag_0.mcap``, ``bag/bag_1.mcap`` ...; of a station NAME ``bag/NAME/metadata.yaml``,
``bag/NAME/NAME_0.mcap`` ... (:mod:`bow_sim.protocol.stations`). The `sequence` field of messages counts through all
files of a bag, so a message that is taken out leaves a gap. :mod:`bow_sweep.record.run_bags` reads all bags of a run as
one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mcap.records import Metadata

from bow_sim.atomic_files import replacing, sync_directory
from bow_sim.protocol.stations import NAME
from bow_sweep.record.mcap_reader import Scan
from bow_sweep.record.mcap_records import Message
from bow_sweep.record.mcap_writer import Contents, McapWriter
from bow_sweep.record.metadata import FileInfo, MetadataError, definitions, others_part, parse, render, with_custom_data
from bow_sweep.record.old_messages import complete, lacks
from bow_sweep.record.topics import Topic, short_name

METADATA = "metadata.yaml"

COLLECTED = "collected"
"""File beside those of a bag that `bow collect` has brought: the station may have recorded more since. It says where
the bag is from."""
FOLDER = "bag"
"""Name of the bag in a run directory, in which those of its stations are, ``bag/NAME``."""


class BagError(ValueError):
    """A bag cannot be used as asked; the message names the file and the place."""


class BagMessage(NamedTuple):
    """A message of a bag; `data` is a view of CDR bytes, `topic` a key of `TOPICS` or "".

    In a bag of an older version `data` has what such messages lack, `lacking`, at its start.
    """

    topic: str
    file: Path
    sequence: int
    log_time: int
    data: memoryview
    offset: int
    type: str = ""
    """Name of its type, without the package."""
    lacking: bytes = b""
    """See :mod:`bow_sweep.record.old_messages`."""
    unread: int = 0
    """Number of bytes at the end of the message that are not in `data`."""

    @property
    def length(self) -> int:
        """Number of bytes in the file."""
        return len(self.data) - len(self.lacking) + self.unread


def bag_folder(run_directory: Path, station: str = "") -> Path:
    """Return where the bag of a station is, or will be: bag/ of the station without a name, bag/NAME/ of others."""
    return run_directory / FOLDER / station if station else run_directory / FOLDER


def station_bags(run_directory: Path) -> dict[str, Path]:
    """Return station -> its bag, for all bags of a run directory; the station without a name is the first."""
    return bags_in(run_directory / FOLDER)


def bag_of(run_directory: Path) -> Path:
    """Return the folder of a run's bags; or the directory itself if it is a bag, or the folder of some.

    Raises
    ------
    BagError
        Where there is no bag.
    """
    run_directory = Path(run_directory)
    for directory in (run_directory / FOLDER, run_directory):
        if bags_in(directory):
            return directory
    what = "holds no bag" if run_directory.is_dir() else "is no directory"
    raise BagError(f"{run_directory}: {what}; a run directory has {FOLDER}/{FOLDER}_0.mcap, or {FOLDER}/STATION/")


def bags_in(directory: Path) -> dict[str, Path]:
    """Return the bags of a run by their stations, "" first: `directory` itself, and those in it if it is ``bag/``.

    The bag of a station alone, ``bag/NAME``, has the station's name.
    """
    own = station_of_bag(directory)
    bags = {own: directory} if bag_files(directory) else {}
    if not own and directory.name == FOLDER and directory.is_dir():
        inside = {path.name: path for path in sorted(directory.iterdir()) if station_of_bag(path)}
        bags |= {station: path for station, path in inside.items() if bag_files(path)}
    return bags


def station_of_bag(directory: Path) -> str:
    """Return the station of a bag by its place, ``bag/NAME``; "" for that of the coordinator's machine."""
    return directory.name if directory.parent.name == FOLDER and NAME.fullmatch(directory.name) else ""


def run_of_bag(directory: Path) -> Path:
    """Return the run directory of a bag, or of the folder of a run's bags; the directory itself if it is in none."""
    folder = directory.parent if station_of_bag(directory) else directory
    return folder.parent if folder.name == FOLDER else directory


def bag_files(directory: Path) -> list[Path]:
    """Return the MCAP files of a bag in the order they were written."""
    return sorted(directory.glob("*.mcap"), key=lambda path: (_number(path.name), path.name))


def _number(name: str) -> int:
    match = re.fullmatch(r".*_(\d+)\.mcap", name)
    return int(match[1]) if match else 0


def write_metadata(directory: Path, files: Sequence[FileInfo], others: Mapping[str, Any] | None = None) -> None:
    """Write metadata.yaml for the files of a bag, with the entries of `others`."""
    with replacing(directory / METADATA) as file:
        file.write(render(files, others).encode())


def kept_metadata(directory: Path) -> dict[str, Any]:
    """Return the entries of metadata.yaml that others have added; none where it cannot be read."""
    try:
        return others_part(parse((directory / METADATA).read_bytes()))
    except (OSError, MetadataError):
        return {}


def label(contents: Contents, message: Message, path: Path) -> BagMessage:
    """Return a message of a file, whose contents have its channel and schema, with its topic, type and file."""
    channel = contents.channels[message.channel]
    schema = contents.schemas.get(channel.schema_id)
    lacking = lacks(schema)
    return BagMessage(
        short_name(channel.topic),
        path,
        message.sequence,
        message.log_time,
        memoryview(complete(message.data, lacking)),
        message.offset,
        schema.name.rpartition("/")[2] if schema else "",
        lacking,
        message.unread,
    )


def messages(directory: Path) -> Iterator[BagMessage]:
    """Yield every message of a bag in the order in which it was written; all checksums are checked.

    Raises
    ------
    BagError
        At the end of a file that is damaged or torn.
    """
    for path in bag_files(directory):
        scan = Scan(path)
        for message in scan.messages():
            yield label(scan.contents, message, path)
        if scan.damage:
            where = scan.damage[0]
            raise BagError(f"{path}, bytes {where.start} to {where.end}: {where.what}")
        if not scan.finished:
            raise BagError(f"{path}: cut off at byte {scan.good_end}; `bow recover` repairs it")


class BagWriter:
    """Writes the next file of a bag.

    Parameters
    ----------
    directory
        Of the bag; created if it is missing.
    topics
        Full name -> topic, of all messages that will be written.
    before
        The files before it, in order.
    sequence
        Number of the last message in them; 0 for none.
    notes
        Metadata records for its beginning.
    identity
        Of the run, for `custom_data` of metadata.yaml.
    """

    def __init__(
        self,
        directory: Path,
        topics: Mapping[str, Topic],
        before: Sequence[FileInfo] = (),
        sequence: int = 0,
        notes: Sequence[Metadata] = (),
        identity: Mapping[str, str] | None = None,
    ) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self.directory = directory
        self._others = with_custom_data(kept_metadata(directory), identity or {})
        self._before = list(before)
        self._sequence = sequence
        self._time = max((file.end for file in before), default=0)
        schemas, channels = definitions(topics)
        self._channels = {channel.topic: channel.id for channel in channels}
        number = max((_number(file.name) + 1 for file in before), default=0)
        self.path = directory / f"{directory.resolve().name}_{number}.mcap"
        self._file = McapWriter(self.path, schemas, channels, notes)
        write_metadata(directory, self._files(), self._others)
        sync_directory(directory.parent)

    def _files(self) -> list[FileInfo]:
        return [*self._before, FileInfo.of(self.path.name, self._file.contents)]

    @property
    def pending(self) -> int:
        """Bytes added and not yet committed."""
        return self._file.pending

    def add(self, topic: str, data: bytes | memoryview, log_time: int) -> None:
        """Add a message that came at `log_time`, nanoseconds since 1970, by the full name of its topic.

        The time of publishing is unknown: the EventsExecutor of rclpy 7.1.6 crashes where a callback asks for it.
        """
        self._sequence += 1
        self._time = max(self._time, log_time)
        self._file.add(self._channels[topic], self._sequence, self._time, self._time, data)

    def commit(self) -> None:
        """Write the pending messages, as one chunk with its index; see `McapWriter.commit`."""
        self._file.commit()

    def take_bulk(self) -> list[tuple[int, int]]:
        """Return where large messages are that were committed since the last call; see `McapWriter.take_bulk`."""
        return self._file.take_bulk()

    def fileno(self) -> int:
        """Return the descriptor of the file, for syncs; it is closed at the end."""
        return self._file.fileno()

    def finish(self) -> None:
        """Commit, write the end of the file, sync it to the disk, write metadata.yaml."""
        self._file.finish()
        write_metadata(self.directory, self._files(), self._others)

    def abandon(self) -> None:
        """Close the file without its end; :func:`bow_sweep.record.recover.recover` writes that."""
        self._file.abandon()
