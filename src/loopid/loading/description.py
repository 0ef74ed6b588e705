"""The YAML beside a URDF: closures, motors, reference and platform.

It extends Gepetto's parallel-robot files (``closed_loop``, ``type``, ``name_mot``,
``joint_name``, ``joint_type``) by ``urdf``, ``reference`` and ``platform``.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from loopid.errors import RobotFileError


class PlatformDescription(BaseModel):
    """A frame, and the elementary motion of each of its named coordinates."""

    model_config = ConfigDict(extra="forbid")

    frame: str
    coordinates: dict[str, Literal["x", "y", "z", "rx", "ry", "rz"]]

    @model_validator(mode="after")
    def _motions_differ(self) -> PlatformDescription:
        for motion in self.coordinates.values():
            names = [name for name, other in self.coordinates.items() if other == motion]
            if len(names) > 1:
                raise ValueError(f"motion {motion!r} is listed twice, for {' and '.join(names)}")
        return self


class Description(BaseModel):
    """What a YAML file may say of a robot; all of it may be left out for a serial robot."""

    model_config = ConfigDict(extra="forbid")

    urdf: str | None = None
    closed_loop: list[tuple[str, str]] = []
    type: list[Literal["3d", "6d"]] = []
    name_mot: list[str] | None = None
    joint_name: list[str] = []
    joint_type: list[Literal["FIXED"]] = []
    reference: dict[str, float] = {}
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
    try:
        content = YAML(typ="safe").load(io.StringIO(path.read_text(encoding="utf-8")))
    except (YAMLError, UnicodeDecodeError) as error:
        raise RobotFileError(f"{path} is not YAML: {_yaml_problem(error)}") from error
    if content is None:
        content = {}
    if not isinstance(content, dict):
        raise RobotFileError(f"{path} must hold keys such as closed_loop, not {content!r:.60}")
    try:
        return Description.model_validate(content)
    except ValidationError as error:
        raise RobotFileError(f"{path}: {_first_problem(error)}") from error


def _yaml_problem(error: YAMLError | UnicodeDecodeError) -> str:
    if isinstance(error, MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"{error.problem} (line {mark.line + 1}, column {mark.column + 1})"
    return " ".join(str(error).split())


def _first_problem(error: ValidationError) -> str:
    problem = error.errors()[0]
    key = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        valid = PlatformDescription if key.startswith("platform") else Description
        return f"unknown key {key!r}: choose among {', '.join(valid.model_fields)}"
    message = problem["msg"].removeprefix("Value error, ")
    return f"{key}: {message}, not {problem['input']!r:.60}" if key else message
