"""The YAML beside a URDF: closures, motors, reference and platform.

It extends Gepetto's parallel-robot files (``closed_loop``, ``type``, ``name_mot``,
``joint_name``, ``joint_type``) by ``urdf``, ``reference`` and ``platform``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from loopid.loading.yaml_files import Section, read_yaml


class PlatformDescription(Section):
    """A frame, and the elementary motion of each of its named coordinates."""

    frame: str
    coordinates: dict[str, Literal["x", "y", "z", "rx", "ry", "rz"]]

    @model_validator(mode="after")
    def _motions_differ(self) -> PlatformDescription:
        for motion in self.coordinates.values():
            names = [name for name, other in self.coordinates.items() if other == motion]
            if len(names) > 1:
                raise ValueError(f"motion {motion!r} is listed twice, for {' and '.join(names)}")
        return self


class Description(Section):
    """What a YAML file may say of a robot; all of it may be left out for a serial robot."""

    urdf: str | None = None
    closed_loop: list[tuple[str, str]] = Field(default=[])
    type: list[Literal["3d", "6d"]] = Field(default=[])
    name_mot: list[str] | None = None
    joint_name: list[str] = Field(default=[])
    joint_type: list[Literal["FIXED"]] = Field(default=[])
    reference: dict[str, float] = Field(default={})
    platform: PlatformDescription | None = None

    @model_validator(mode="after")
    def _lists_match(self) -> Description:
        for first, second in (("closed_loop", "type"), ("joint_name", "joint_type")):
            one, two = len(getattr(self, first)), len(getattr(self, second))
            if one != two:
                raise ValueError(f"'{first}' has {one} entries, but '{second}' has {two}")
        for names in (self.name_mot or [], self.joint_name):
            repeated = sorted({name for name in names if names.count(name) > 1})
            if repeated:
                raise ValueError(f"joint {repeated[0]} is listed twice")
        return self


def read_description(path: Path) -> Description:
    """Read and validate the YAML file of a robot.

    Raises
    ------
    RobotFileError
        Naming the key, the value and what is valid.
    """
    return read_yaml(path, Description)
