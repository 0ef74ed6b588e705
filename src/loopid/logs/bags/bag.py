"""What a bag of any kind can be asked for: its topics, and their messages one by one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

JOINT_STATE = "sensor_msgs/msg/JointState"


class Topic(NamedTuple):
    """What a bag says of a topic: the type of its messages, and how many there are."""

    kind: str
    messages: int


class Message(NamedTuple):
    """A message as it was recorded."""

    topic: str
    received: int  # ns
    data: bytes


class Bag(ABC):
    """An open bag."""

    @property
    @abstractmethod
    def topics(self) -> Mapping[str, Topic]:
        """All topics by name."""

    @abstractmethod
    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Messages of some topics, in the order in which they were received."""

    @abstractmethod
    def joint_state(self, data: bytes) -> Any:
        """A decoded message of type ``sensor_msgs/JointState``."""


def other_definition(path: Path, topic: str) -> str:
    """A sentence on messages that are called alike, but are not the usual ones."""
    return f"{path}: the messages of {topic} have another definition than {JOINT_STATE}"
