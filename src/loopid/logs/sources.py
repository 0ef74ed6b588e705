"""From a path to the streams that hold the positions and forces of the motors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from loopid.errors import LogError
from loopid.logs.catalogue import Catalogue, Place
from loopid.logs.columns import find_motor_columns, refuse_other_joints
from loopid.logs.mapping import LogMapping
from loopid.logs.npz_reader import NpzReader
from loopid.logs.reader import LogReader
from loopid.logs.stream import Channel, Stream
from loopid.logs.stream_making import make_stream
from loopid.logs.text_readers import FolderReader, TextReader
from loopid.logs.time_columns import find_time

READERS: tuple[LogReader, ...] = (FolderReader(), TextReader(), NpzReader())


def choose_reader(path: Path, name: str | None = None) -> LogReader:
    """The reader of a format, by default of the format that the path looks like.

    Raises
    ------
    LogError
        When it looks like none.
    """
    for reader in READERS:
        if reader.format == name or (name is None and reader.accepts(path)):
            return reader
    raise LogError(
        f"{path} is of no known format: its name must end in .csv, .txt, .tsv (also .gz) or .npz, "
        "or it must be a folder; otherwise give the format in a mapping (folder, csv, npz)"
    )


def read_streams(path: Path, joints: tuple[str, ...], mapping: LogMapping) -> list[Stream]:
    """The streams that hold positions or forces, that of the first position first."""
    reader = choose_reader(path, mapping.format)
    catalogue = Catalogue(str(path), reader.columns(path))
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
    streams = []
    for stream, of_stream in channels.items():
        names = [*times[stream].names, *(channel.column for channel in of_stream)]
        tables = reader.read(path, stream, names)
        streams.append(make_stream(tables, times[stream], tuple(of_stream)))
    return streams


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
