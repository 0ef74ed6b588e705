"""Logs in bags of ROS: a stream a topic, a column a joint and quantity."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np

from loopid.arrays import IntArray
from loopid.errors import LogError, LogWarning
from loopid.logs.bags.bag import JOINT_STATE, Bag, Topic
from loopid.logs.bags.joint_states import JointStates, Layout
from loopid.logs.bags.ros1 import open_ros1
from loopid.logs.bags.ros2 import DESCRIPTION, ENDINGS, open_ros2
from loopid.logs.catalogue import MOST_LISTED
from loopid.logs.reader import LogReader
from loopid.logs.refusals import optional, refusals
from loopid.logs.table import Table
from loopid.scratch import row_blocks

ROS1_ENDING = ".bag"
# The columns of the time: as the header says, and as the message was recorded.
STAMP, RECEIVED = "time_ns", "received_ns"


class BagReader(LogReader):
    """Messages of type ``sensor_msgs/JointState``, of ROS 1 or 2.

    All topics are gone through once; what they hold then lies in temporary files.
    """

    format = "bag"
    choice = "topic"
    ordered = False

    @classmethod
    def accepts(cls, path: Path) -> bool:
        if path.is_dir():
            names = [file.name for file in path.iterdir()]
            return DESCRIPTION in names or any(name.endswith(ENDINGS) for name in names)
        return path.suffix.lower() in (ROS1_ENDING, *ENDINGS)

    def columns(self) -> dict[str, tuple[str, ...]]:
        self._topics = _read_topics(self._path, self._mapping.topic)
        return {
            topic: (STAMP, RECEIVED, *dict.fromkeys(c for one in layouts for c in one.columns))
            for topic, layouts in self._topics.items()
        }

    def together(self, stream: str, names: Sequence[str]) -> list[tuple[str, ...]]:
        groups: dict[tuple[bool, ...], list[str]] = {}
        for name in names:
            where = tuple(name in layout.columns for layout in self._topics[stream])
            groups.setdefault(where, []).append(name)
        return [tuple(group) for group in groups.values()]

    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        source = f"{self._path} {stream}"
        values = [name for name in names if name not in (STAMP, RECEIVED)]
        layouts = [one for one in self._topics[stream] if set(values) <= set(one.columns)]
        stamped = any(layout.stamped for layout in layouts)
        if STAMP in names and not stamped:
            warnings.warn(
                f"{source}: no header of {', '.join(values)} has a time: the times of recording "
                "stand in for them",
                LogWarning,
                stacklevel=2,
            )
        last = max(int(layout.numbers[-1]) for layout in layouts)
        for window in row_blocks(slice(1, last + 1)):
            yield _table(source, layouts, window, values, stamped)


def _table(
    source: str, layouts: Sequence[Layout], window: slice, names: Sequence[str], stamped: bool
) -> Table:
    """Messages with numbers in a window, in order."""
    found = [(layout, _within(layout.numbers, window)) for layout in layouts]
    numbers = np.concatenate([layout.numbers[rows] for layout, rows in found])
    order = np.argsort(numbers)
    received = np.concatenate([layout.received[rows] for layout, rows in found])[order]
    stamps = np.concatenate([layout.stamps[rows] for layout, rows in found])[order]
    columns = {STAMP: stamps if stamped else received, RECEIVED: received}
    for name in names:
        cells = [one.values[rows, one.columns.index(name)] for one, rows in found]
        columns[name] = np.concatenate(cells)[order]
    return Table(source, columns, numbers[order], np.empty(0, dtype=np.int64))


def _within(numbers: IntArray, window: slice) -> slice:
    return slice(*np.searchsorted(numbers, [window.start, window.stop]).tolist())


def _read_topics(path: Path, topic: str | None) -> dict[str, list[Layout]]:
    """The joint states of each topic, or of one."""
    with optional("rosbags"):
        import rosbags  # noqa: F401
    with refusals(path, "ROS bag that can be read"), _opened(path) as bag:
        topics = _chosen(path, bag.topics, topic)
        found = {name: JointStates(f"{path} {name}") for name in topics}
        for message in bag.messages(topics):
            found[message.topic].append(bag.joint_state(message.data), message.received)
        for name, states in found.items():
            if states.count != topics[name].messages:
                raise LogError(
                    f"{path} is damaged, or was not closed: {name} has {states.count} messages, "
                    f"but its index says {topics[name].messages}"
                )
    layouts = {name: states.layouts() for name, states in found.items()}
    filled = {name: of_topic for name, of_topic in layouts.items() if of_topic}
    if not filled:
        raise LogError(f"{path} has no joint states in {', '.join(found)}")
    return filled


def _opened(path: Path) -> AbstractContextManager[Bag]:
    return open_ros1(path) if path.suffix.lower() == ROS1_ENDING else open_ros2(path)


def _chosen(path: Path, topics: Mapping[str, Topic], name: str | None) -> dict[str, Topic]:
    """Topics with joint states, or the one that is asked for."""
    suitable = {name: topic for name, topic in topics.items() if topic.kind == JOINT_STATE}
    if not suitable:
        listed = [f"{name} ({topic.kind})" for name, topic in topics.items()][:MOST_LISTED]
        there = ", ".join(listed) if listed else "no topics"
        raise LogError(f"{path} has no topic of type {JOINT_STATE}: it has {there}")
    if name is not None and name not in suitable:
        valid = ", ".join(suitable)
        raise LogError(f"{path} has no joint states in topic {name!r}: choose among {valid}")
    return suitable if name is None else {name: suitable[name]}
