"""Bags of ROS 1 and 2, read by rosbags: a stream a topic, a column a joint and quantity."""

from __future__ import annotations

import sqlite3
from array import array
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import IntArray
from loopid.errors import (
    DataWarning,
    LogError,
    warn,
)
from loopid.files import why_no_file
from loopid.logs.formats import (
    LARGEST_STAMP,
    MOST_COLUMNS,
    MOST_LISTED,
    NO_STAMP,
    Batch,
    LogFormat,
    array_batch,
    optional,
    refusals,
    require_few_rows,
)
from loopid.yaml_files import load_yaml

JOINT_STATE = "sensor_msgs/msg/JointState"
QUANTITIES = ("position", "velocity", "effort")
# The columns of the time: as the header says, and as the message was recorded.
STAMP, RECEIVED = "time_ns", "received_ns"
DESCRIPTION = "metadata.yaml"
# What SQLite leaves beside a file that was not closed, with messages that are not yet in it.
JOURNALS = ("-wal", "-journal")
# Views and generated columns of SQLite, which can be without end.
COMPUTED = """SELECT m.name FROM sqlite_master m LEFT JOIN pragma_table_xinfo(m.name) c
WHERE m.type = 'view' OR c.hidden"""


class Topic:
    """Joint states of a topic: their times, and the values of each column with their messages."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.stamps, self.received = array("q"), array("q")
        self.columns: dict[str, tuple[array[int], array[float]]] = {}

    def append(self, state: Any, received: int) -> None:
        """Add a message; joints may come in any order, and any of them."""
        number = len(self.stamps)
        stamp = state.header.stamp
        for column, time in (
            (self.stamps, stamp.sec * 10**9 + stamp.nanosec),
            (self.received, received),
        ):
            column.append(time if 0 <= time <= LARGEST_STAMP else int(NO_STAMP))
        parts = {what: getattr(state, what) for what in QUANTITIES}
        parts = {what: values for what, values in parts.items() if len(values)}
        names = [f"{joint}.{what}" for what in parts for joint in state.name]
        values = [value for part in parts.values() for value in part.tolist()]
        if len(values) != len(names) or len(set(names)) < len(names):
            raise LogError(
                f"{self.source}: message {number + 1} has {len(values)} values for "
                f"{len(set(names))} columns, from {len(state.name)} joints"
            )
        for name, value in zip(names, values, strict=True):
            messages, cells = self.columns.setdefault(name, (array("q"), array("d")))
            messages.append(number)
            cells.append(value)
        if len(self.columns) > MOST_COLUMNS:
            raise LogError(f"{self.source} has more than {MOST_COLUMNS:,} columns")


class BagFormat(LogFormat):
    """Messages of type ``sensor_msgs/JointState``, of ROS 1 or 2."""

    name = "bag"
    endings = (".bag", ".mcap", ".db3")
    choice = "topic"
    ordered = False

    @classmethod
    def accepts(cls, path: Path) -> bool:
        if not path.is_dir():
            return super().accepts(path)
        return any(
            f.name == DESCRIPTION or f.name.endswith(cls.endings[1:]) for f in path.iterdir()
        )

    @cached_property
    def _topics(self) -> dict[str, Topic]:
        """The joint states of each topic, or of the chosen one."""
        with optional("rosbags"):
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        with refusals(self.path, "ROS bag that can be read"):
            _refuse_unfinished(self.path)
            # The message has been the same in all distributions.
            usual = get_typestore(Stores.ROS2_HUMBLE)
            with AnyReader([self.path], default_typestore=usual) as bag:
                counts = self._chosen(bag.topics)
                require_few_rows(self.path, sum(counts.values()))
                topics = {name: Topic(f"{self.path} {name}") for name in counts}
                connections = [c for c in bag.connections if c.topic in topics]
                for connection, received, data in bag.messages(connections):
                    state = bag.deserialize(data, connection.msgtype)
                    topics[connection.topic].append(state, received)
        for name, topic in topics.items():
            if len(topic.stamps) != counts[name]:
                raise LogError(
                    f"{self.path} is damaged, or was not closed: {name} has {len(topic.stamps)} "
                    f"messages, but its index says {counts[name]}"
                )
        filled = {name: topic for name, topic in topics.items() if topic.columns}
        if not filled:
            raise LogError(f"{self.path} has no joint states in {', '.join(topics)}")
        return filled

    def _chosen(self, topics: Mapping[str, Any]) -> dict[str, int]:
        """Topics with joint states, or the one that is asked for, and how many messages."""
        counts = {n: topic.msgcount for n, topic in topics.items() if topic.msgtype == JOINT_STATE}
        if not counts:
            listed = [f"{n} ({t.msgtype or 'several types'})" for n, t in topics.items()]
            there = ", ".join(listed[:MOST_LISTED]) or "no topics"
            raise LogError(f"{self.path} has no topic of type {JOINT_STATE}: it has {there}")
        if self.chosen is None:
            return counts
        if self.chosen not in counts:
            raise LogError(
                f"{self.path} has no joint states in topic {self.chosen!r}: choose among "
                f"{', '.join(counts)}"
            )
        return {self.chosen: counts[self.chosen]}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {name: (STAMP, RECEIVED, *sorted(t.columns)) for name, t in self._topics.items()}

    def source(self, stream: str) -> str:
        return self._topics[stream].source

    def together(self, stream: str, names: Sequence[str]) -> list[tuple[str, ...]]:
        groups: dict[bytes, list[str]] = {}
        for name in names:
            messages, _ = self._topics[stream].columns[name]
            groups.setdefault(messages.tobytes(), []).append(name)
        return [tuple(group) for group in groups.values()]

    def batches(self, stream: str, names: Sequence[str]) -> Generator[Batch]:
        topic = self._topics[stream]
        values = [name for name in names if name not in (STAMP, RECEIVED)]
        messages: IntArray = np.array(topic.columns[values[0]][0], dtype=np.int64)
        stamps, received = (np.array(t, dtype=np.int64) for t in (topic.stamps, topic.received))
        if STAMP in names and not stamps[messages].any():
            warn(
                f"{topic.source}: no header of {', '.join(values)} has a time: the times of "
                "recording stand in for them",
                DataWarning,
            )
            stamps = received
        columns = {STAMP: stamps[messages], RECEIVED: received[messages]}
        columns |= {name: np.array(topic.columns[name][1]) for name in values}
        yield array_batch(topic.source, columns, messages + 1)


def _refuse_unfinished(path: Path) -> None:
    """Refuse what rosbags would read in part, or fail to open with another reason than the true."""
    if path.is_dir():
        _refuse_elsewhere(path)
        files = sorted(path.iterdir())
    else:
        files = [path, *(Path(f"{path}{end}") for end in JOURNALS)]
    for file in files:
        if file.name.endswith(JOURNALS) and file.exists() and file.stat().st_size:
            raise LogError(
                f"{path} was not closed: {file.name} holds messages that are not in it "
                "yet; open and close it with SQLite to bring them in"
            )
    odd = [mark for mark in "#?%" if mark in str(path)]
    if odd and any(".db3" in file.suffixes for file in files):  # packed ones, too
        raise LogError(f"{path}: SQLite takes {odd[0]!r} in a path for something else: rename it")
    for file in files:
        if file.suffix == ".db3":
            with closing(sqlite3.connect(f"file:{file}?immutable=1", uri=True)) as database:
                computed = database.execute(COMPUTED).fetchone()
            if computed is not None:
                raise LogError(f"{file}: {computed[0]!r} is computed, and no table of a bag")


def _refuse_elsewhere(path: Path) -> None:
    """Refuse a folder whose description is missing, no such thing, or names files elsewhere."""
    description = path / DESCRIPTION
    if not description.exists():
        raise LogError(
            f"{path} has no {DESCRIPTION}: recording was not finished, so reindex the bag, or "
            "give one of the files in it"
        )
    content = load_yaml(description, LogError, any_text=True)  # rosbags reads any size
    about = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    names = about.get("relative_file_paths") if isinstance(about, dict) else None
    if not isinstance(names, list):
        raise LogError(f"{description} does not list the files of a bag")
    for name in map(str, names):
        reason = why_no_file(path / name) if Path(name).name == name else "is not in the folder"
        if reason:
            raise LogError(f"{description}: {name} {reason}")
