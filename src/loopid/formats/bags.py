"""Bags of ROS 1 and 2, read by rosbags: a stream a topic, a column a joint and quantity."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import IntArray
from loopid.errors import DataWarning, LogError, optional, warn
from loopid.logs.table import MOST_LISTED, LogFormat, Table, array_table, refusals

JOINT_STATE = "sensor_msgs/msg/JointState"
QUANTITIES = ("position", "velocity", "effort")
# The columns of the time: as the header says, and as the message was recorded.
STAMP, RECEIVED = "time_ns", "received_ns"
DESCRIPTION = "metadata.yaml"
# What SQLite leaves beside a file that was not closed, with messages that are not yet in it.
JOURNALS = ("-wal", "-journal")


class Topic:
    """Joint states of a topic: their times, and the values of each column with their messages."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.stamps, self.received = array("q"), array("q")
        self.columns: dict[str, tuple[array[int], array[float]]] = {}

    def append(self, state: Any, received: int) -> None:
        """Add a message; joints may come in any order, and any of them."""
        number = len(self.stamps)
        self.stamps.append(state.header.stamp.sec * 10**9 + state.header.stamp.nanosec)
        self.received.append(received)
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


class BagFormat(LogFormat):
    """Messages of type ``sensor_msgs/JointState``, of ROS 1 or 2."""

    endings = (".bag", ".mcap", ".db3")
    choice = "topic"
    ordered = False

    @classmethod
    def accepts(cls, path: Path) -> bool:
        if not path.is_dir():
            return super().accepts(path)
        names = [file.name for file in path.iterdir()]
        return DESCRIPTION in names or any(name.endswith(cls.endings[1:]) for name in names)

    @cached_property
    def _topics(self) -> dict[str, Topic]:
        """The joint states of each topic, or of the chosen one."""
        with optional("rosbags", "logs"):
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        with refusals(self.path, "ROS bag that can be read"):
            _refuse_unfinished(self.path)
            # The message has been the same in all distributions.
            usual = get_typestore(Stores.ROS2_HUMBLE)
            with AnyReader([self.path], default_typestore=usual) as bag:
                counts = self._chosen(bag.topics)
                topics = {name: Topic(f"{self.path} {name}") for name in counts}
                connections = [c for c in bag.connections if c.topic in topics]
                for connection, received, data in bag.messages(connections):
                    state = bag.deserialize(data, connection.msgtype)
                    topics[connection.topic].append(state, received)
        for name, topic in topics.items():
            if len(topic.stamps) != counts[name]:
                raise self.refused(
                    f"is damaged, or was not closed: {name} has {len(topic.stamps)} messages, but "
                    f"its index says {counts[name]}"
                )
        filled = {name: topic for name, topic in topics.items() if topic.columns}
        if not filled:
            raise self.refused(f"has no joint states in {', '.join(topics)}")
        return filled

    def _chosen(self, topics: Mapping[str, Any]) -> dict[str, int]:
        """Topics with joint states, or the one that is required, and how many messages."""
        counts = {n: topic.msgcount for n, topic in topics.items() if topic.msgtype == JOINT_STATE}
        if not counts:
            listed = [f"{n} ({t.msgtype or 'several types'})" for n, t in topics.items()]
            there = ", ".join(listed[:MOST_LISTED]) or "no topics"
            raise self.refused(f"has no topic of type {JOINT_STATE}: it has {there}")
        if self.chosen is None:
            return counts
        LogError.require("topic", self.chosen, counts, f" of joint states in {self.path}")
        return {self.chosen: counts[self.chosen]}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {name: (STAMP, RECEIVED, *sorted(t.columns)) for name, t in self._topics.items()}

    def source(self, stream: str) -> str:
        return self._topics[stream].source

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        topic, groups = self._topics[stream], dict[bytes, list[str]]()
        for name in values:  # those in the same messages
            groups.setdefault(topic.columns[name][0].tobytes(), []).append(name)
        return [self._table(topic, times, group) for group in groups.values()]

    def _table(self, topic: Topic, times: Sequence[str], names: Sequence[str]) -> Table:
        """Columns that are in the same messages, with times of these."""
        messages: IntArray = np.array(topic.columns[names[0]][0], dtype=np.int64)
        stamps, received = (np.array(t, dtype=np.int64) for t in (topic.stamps, topic.received))
        if STAMP in times and not stamps[messages].any():
            warn(
                f"{topic.source}: no header of {', '.join(names)} has a time: the times of "
                "recording stand in for them",
                DataWarning,
            )
            stamps = received
        at = {STAMP: stamps[messages], RECEIVED: received[messages]}
        columns = {name: at[name] for name in times}
        columns |= {name: np.array(topic.columns[name][1]) for name in names}
        return array_table(topic.source, columns, messages + 1)


def _refuse_unfinished(path: Path) -> None:
    """Refuse what rosbags would read in part, or fail to open with another reason than the true."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    if path.is_dir() and not (path / DESCRIPTION).exists():
        raise LogError(
            f"{path} has no {DESCRIPTION}: recording was not finished, so reindex the bag, or "
            "give one of the files in it",
            file=path,
        )
    for journal in (Path(f"{file}{end}") for file in files for end in JOURNALS):
        if journal.exists() and journal.stat().st_size:
            raise LogError(
                f"{path} was not closed: {journal.name} holds messages that are not in it "
                "yet; open and close it with SQLite to bring them in",
                file=journal,
            )
    odd = [mark for mark in "#?%" if mark in str(path)]
    if odd and any(".db3" in file.suffixes for file in files):  # packed ones, too
        raise LogError(f"{path}: SQLite cannot have {odd[0]!r} in a path: rename it", file=path)
