"""From a path to the streams that hold the positions and forces of the motors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from loopid.errors import LogError
from loopid.logs.bags import BagReader
from loopid.logs.catalogue import Catalogue, Place
from loopid.logs.columns import find_motor_columns, refuse_other_joints
from loopid.logs.hdf5_reader import Hdf5Reader
from loopid.logs.mapping import LogMapping
from loopid.logs.npz_reader import NpzReader
from loopid.logs.parquet_reader import ParquetReader
from loopid.logs.reader import LogReader
from loopid.logs.stream import Channel, Stream
from loopid.logs.stream_making import make_stream
from loopid.logs.text_readers import FolderReader, TextReader
from loopid.logs.time_columns import find_time

READERS: tuple[type[LogReader], ...] = (
    BagReader,
    FolderReader,
    TextReader,
    NpzReader,
    ParquetReader,
    Hdf5Reader,
)
CHOICES = ("topic", "group")


def choose_reader(path: Path, mapping: LogMapping) -> LogReader:
    """The reader of the format that a mapping names, by default of what the path looks like.

    Raises
    ------
    LogError
        When it looks like none, or the mapping chooses what this format does not have.
    """
    for reader in READERS:
        if reader.format == mapping.format or (mapping.format is None and reader.accepts(path)):
            _refuse_other_choices(path, reader, mapping)
            return reader(path, mapping)
    raise LogError(
        f"{path} is of no known format: its name must end in .csv, .txt, .tsv (also .gz), .npz, "
        ".parquet, .h5, .hdf5, .bag, .mcap or .db3, or it must be a folder; otherwise give the "
        f"format in a mapping ({', '.join(sorted(reader.format for reader in READERS))})"
    )


def _refuse_other_choices(path: Path, reader: type[LogReader], mapping: LogMapping) -> None:
    for key in CHOICES:
        if getattr(mapping, key) is not None and reader.choice != key:
            raise LogError(
                f"{path}: {key} {getattr(mapping, key)!r} of the mapping chooses nothing in a log "
                f"of format {reader.format}"
            )


def read_streams(path: Path, joints: tuple[str, ...], mapping: LogMapping) -> list[Stream]:
    """The streams that hold positions or forces, that of the first position first."""
    reader = choose_reader(path, mapping)
    catalogue = Catalogue(str(path), reader.columns(), reader.choice, reader.ordered)
    found = {
        quantity: find_motor_columns(catalogue, joints, quantity, mapping)
        for quantity in ("position", "force")
    }
    _refuse_shared(catalogue, [place for places in found.values() for place in places])
    channels: dict[str, list[Channel]] = {}
    for quantity, places in found.items():
        scales = by_joint(path, f"{quantity}_scale", mapping, joints)
        offsets = by_joint(path, f"{quantity}_offset", mapping, joints)
        for joint, place, scale, offset in zip(joints, places, scales, offsets, strict=True):
            channel = Channel(quantity, joint, place.column, scale, offset)
            channels.setdefault(place.stream, []).append(channel)
    times = {stream: find_time(catalogue, stream, mapping.time) for stream in channels}
    return [
        make_stream(reader.read(stream, [*times[stream].names, *part]), times[stream], of_part)
        for stream, of_stream in channels.items()
        for part, of_part in _parts(reader, stream, of_stream)
    ]


def _parts(
    reader: LogReader, stream: str, channels: list[Channel]
) -> Iterator[tuple[tuple[str, ...], tuple[Channel, ...]]]:
    """Columns of a stream that share their rows, with their channels."""
    for names in reader.together(stream, [channel.column for channel in channels]):
        yield names, tuple(channel for channel in channels if channel.column in names)


def by_joint(path: Path, key: str, mapping: LogMapping, joints: tuple[str, ...]) -> list[float]:
    """Numbers of a mapping in the order of the motors, from one for all or one each."""
    given = getattr(mapping, key)
    if not isinstance(given, Mapping):
        return [given] * len(joints)
    refuse_other_joints(str(path), key, given, joints)
    return [given[joint] for joint in joints]


def _refuse_shared(catalogue: Catalogue, places: list[Place]) -> None:
    shared = [place for place in places if places.count(place) > 1]
    if shared:
        raise LogError(
            f"{catalogue.source}: column {shared[0].column!r} is mapped {places.count(shared[0])} "
            "times: each position and force has a column of its own"
        )
