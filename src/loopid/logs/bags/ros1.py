"""Bags of ROS 1, read chunk by chunk.

Libraries for them first make an index of all messages, which grows with the bag. At the end of the
file lies a short one, of the chunks and the connections (publishers of a topic).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

from loopid.errors import LogError
from loopid.logs.bags.bag import JOINT_STATE, Bag, Message, Topic, other_definition
from loopid.logs.bags.ros1_records import (
    COUNTS,
    PLACE,
    STAMP,
    chunk_records,
    nanoseconds,
    number_in,
    parsed,
    record,
)

MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, BAG, CHUNK_INFO, CONNECTION = 2, 3, 6, 7


class Connection(NamedTuple):
    """A publisher of a topic."""

    topic: str
    kind: str
    checksum: str  # of the definition of its messages


class Chunk(NamedTuple):
    """Where a chunk lies, and how many messages of each connection it holds."""

    start: tuple[int, int]
    place: int
    counts: Counter[int]


@contextmanager
def open_ros1(path: Path) -> Iterator[Bag]:
    """Open a bag and read its index.

    Raises
    ------
    LogError
        When it has none, or is encrypted.
    """
    with path.open("rb") as file:
        yield Ros1Bag(path, file)


class Ros1Bag(Bag):
    """An open bag of ROS 1."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._path, self._file = path, file
        self._types = get_typestore(Stores.ROS1_NOETIC)
        self._connections, self._chunks = _read_index(path, file)

    @property
    def topics(self) -> Mapping[str, Topic]:
        counts: Counter[int] = sum((chunk.counts for chunk in self._chunks), Counter())
        found: dict[str, Topic] = {}
        for number, connection in self._connections.items():
            before = found.get(connection.topic, Topic(connection.kind, 0))
            kind = connection.kind if connection.kind == before.kind else "several types"
            found[connection.topic] = Topic(kind, before.messages + counts[number])
        return found

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        self._refuse_other_definitions(topics)
        for chunk in sorted(self._chunks):
            for fields, data in chunk_records(self._file, chunk.place):
                if fields[b"op"][0] != MESSAGE:
                    continue
                topic = self._connections[number_in(fields, b"conn")].topic
                if topic in topics:
                    yield Message(topic, nanoseconds(fields[b"time"]), data)

    def joint_state(self, data: bytes) -> Any:
        return self._types.deserialize_ros1(data, JOINT_STATE)

    def _refuse_other_definitions(self, topics: Collection[str]) -> None:
        _, known = self._types.generate_msgdef(JOINT_STATE)
        for connection in self._connections.values():
            if connection.topic in topics and connection.checksum != known:
                raise LogError(other_definition(self._path, connection.topic))


def _read_index(path: Path, file: IO[bytes]) -> tuple[dict[int, Connection], list[Chunk]]:
    """Connections by number, and chunks."""
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError(f"it does not begin with {MAGIC.decode().strip()!r}")
    fields, _ = record(file, BAG)
    if fields.get(b"encryptor"):
        raise LogError(
            f"{path} is encrypted by {fields[b'encryptor'].decode()!r}: decrypt it first"
        )
    (place,) = PLACE.unpack(fields[b"index_pos"])
    if place == 0:
        raise LogError(f"{path} has no index: recording was not finished, so reindex the bag")
    file.seek(place)
    connections = dict(_connection(file) for _ in range(number_in(fields, b"conn_count")))
    chunks = [_chunk_info(file) for _ in range(number_in(fields, b"chunk_count"))]
    return connections, chunks


def _connection(file: IO[bytes]) -> tuple[int, Connection]:
    outer, data = record(file, CONNECTION)
    inner = parsed(data)
    package, _, name = inner[b"type"].decode().rpartition("/")
    connection = Connection(
        outer[b"topic"].decode(), f"{package}/msg/{name}", inner[b"md5sum"].decode()
    )
    return number_in(outer, b"conn"), connection


def _chunk_info(file: IO[bytes]) -> Chunk:
    fields, data = record(file, CHUNK_INFO)
    counts = Counter(dict(COUNTS.iter_unpack(data)))
    (place,) = PLACE.unpack(fields[b"chunk_pos"])
    return Chunk(STAMP.unpack(fields[b"start_time"]), place, counts)
