"""Bags of ROS 2: MCAP or SQLite, with or without the folder that describes them."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from loopid.errors import LogError
from loopid.logs.bags.bag import JOINT_STATE, Bag, Message, Topic, other_definition

DESCRIPTION = "metadata.yaml"
ENDINGS = (".mcap", ".db3")
ODD_MARKS = "#?%"
# What SQLite leaves beside a file that was not closed, with messages that are not yet in it.
JOURNALS = ("-wal", "-journal")
# The first record of an MCAP file is its header, whose first text is the profile.
MCAP_START, MCAP_MAGIC = struct.Struct("<8sBQL"), b"\x89MCAP0\r\n"
LONGEST_PROFILE = 100


@contextmanager
def open_ros2(path: Path) -> Iterator[Bag]:
    """Open a file, or a folder with its description.

    Raises
    ------
    LogError
        When recording was not finished.
    """
    from rosbags.rosbag2 import Reader

    if path.is_dir() and not (path / DESCRIPTION).exists():
        raise LogError(
            f"{path} has no {DESCRIPTION}: recording was not finished, so reindex the bag, or "
            "give one of the files in it"
        )
    _refuse_odd_names(path)
    _refuse_unclosed(path)
    _refuse_other_profiles(path)
    with Reader(path) as reader:
        yield Ros2Bag(path, reader)


class Ros2Bag(Bag):
    """An open bag of ROS 2."""

    def __init__(self, path: Path, reader: Any) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._path = path
        self._reader = reader
        # The message has been the same in all distributions.
        self._types = get_typestore(Stores.ROS2_HUMBLE)

    @property
    def topics(self) -> Mapping[str, Topic]:
        return {
            name: Topic(topic.msgtype or "several types", topic.msgcount)
            for name, topic in self._reader.topics.items()
        }

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        connections = [c for c in self._reader.connections if c.topic in topics]
        known = self._types.hash_rihs01(JOINT_STATE)
        for connection in connections:
            encoding = connection.ext.serialization_format
            if encoding != "cdr":
                raise LogError(
                    f"{self._path}: {connection.topic} is encoded by {encoding!r}, but only 'cdr' "
                    "can be read"
                )
            if connection.digest not in ("", known):
                raise LogError(other_definition(self._path, connection.topic))
        for connection, received, data in self._reader.messages(connections):
            yield Message(connection.topic, received, data)

    def joint_state(self, data: bytes) -> Any:
        return self._types.deserialize_cdr(data, JOINT_STATE)


def _refuse_odd_names(path: Path) -> None:
    odd = [mark for mark in ODD_MARKS if mark in str(path)]
    if odd and (path.suffix == ".db3" or (path.is_dir() and any(path.glob("*.db3*")))):
        raise LogError(f"{path}: SQLite takes {odd[0]!r} in a path for something else: rename it")


def _refuse_unclosed(path: Path) -> None:
    beside = path.iterdir() if path.is_dir() else (Path(f"{path}{end}") for end in JOURNALS)
    for file in sorted(beside):
        if file.name.endswith(JOURNALS) and file.exists() and file.stat().st_size:
            raise LogError(
                f"{path} was not closed: {file.name} holds messages that are not in it "
                "yet; open and close it with SQLite to bring them in"
            )


def _refuse_other_profiles(path: Path) -> None:
    for file in path.glob("*.mcap") if path.is_dir() else [path]:
        with file.open("rb") as content:
            start = content.read(MCAP_START.size)
            if not start.startswith(MCAP_MAGIC) or len(start) < MCAP_START.size:
                continue
            profile = content.read(min(MCAP_START.unpack(start)[-1], LONGEST_PROFILE)).decode()
        if profile != "ros2":
            raise LogError(
                f"{file} holds messages of profile {profile!r}, but of MCAP files only those of "
                "profile 'ros2' can be read"
            )
