"""YAML files, checked against a model of what they may say; one sentence for what is wrong."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError

from loopid.errors import LoopidError, MissingFileError, RobotFileError


class Section(BaseModel):
    """Part of a file: known keys only, finite numbers only, names that may look like numbers."""

    model_config = ConfigDict(
        extra="forbid", allow_inf_nan=False, coerce_numbers_to_str=True, frozen=True
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, content: Any) -> Any:
        unknown = [] if not isinstance(content, dict) else set(content) - set(cls.model_fields)
        for key in sorted(unknown, key=str):
            raise ValueError(f"unknown key {key!r}: choose among {', '.join(cls.model_fields)}")
        return content


# A few aliases of aliases would fill the memory.
MOST_VALUES = 1_000_000
ALTERNATIVES = ("float", "str", "list[float]", "list[str]")
Content = TypeVar("Content", bound=BaseModel)


def read_yaml(
    path: Path, model: type[Content], failure: type[LoopidError] = RobotFileError
) -> Content:
    """Read a YAML file of keys and values as a model; an empty file leaves all keys out.

    Raises
    ------
    LoopidError
        Of the kind asked for, naming the place in the file, the value and what is valid.
    """
    try:
        content = YAML(typ="safe").load(io.StringIO(path.read_text(encoding="utf-8")))
        size = _size(content, {})
    except RecursionError as error:
        raise failure(f"{path} is not YAML of keys and values: it is nested too deeply") from error
    except FileNotFoundError as error:
        raise MissingFileError(f"{path} does not exist") from error
    except OSError as error:
        raise failure(f"{path} cannot be read: {error.strerror}") from error
    except (YAMLError, ValueError, ArithmeticError, LookupError) as error:
        raise failure(f"{path} is not YAML: {_yaml_problem(error)}") from error
    if size > MOST_VALUES:
        raise failure(f"{path} holds more than {MOST_VALUES:,} values, aliases (*) written out")
    content = {} if content is None else content
    if not isinstance(content, dict):
        keys = ", ".join(model.model_fields)
        raise failure(f"{path} must hold keys among {keys}, not {content!r:.60}")
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise failure(f"{path}: {first_problem(error)}") from error


def _size(node: Any, known: dict[int, float]) -> float:
    """Values below a node, aliases written out; infinite for a node inside itself."""
    if not isinstance(node, dict | list):
        return 1
    if id(node) not in known:
        known[id(node)] = math.inf
        children = node.values() if isinstance(node, dict) else node
        known[id(node)] = 1 + sum(_size(child, known) for child in children)
    return known[id(node)]


def _yaml_problem(error: Exception) -> str:
    if isinstance(error, MarkedYAMLError) and error.problem_mark is not None:
        mark = error.problem_mark
        return f"{error.problem} (line {mark.line + 1}, column {mark.column + 1})"
    return " ".join(str(error).split())


def first_problem(error: ValidationError) -> str:
    """Where a model's first problem is, what it is, and what was given."""
    problem = error.errors()[0]
    # Tags of alternatives, as in "<hold>" or "float", are no keys of the file.
    parts = [str(part) for part in problem["loc"]]
    place = ".".join(part for part in parts if part[:1] != "<" and part not in ALTERNATIVES)
    before = f"{place}: " if place else ""
    if problem["type"] == "missing":
        return f"{before}is missing"
    message = problem["msg"].removeprefix("Value error, ")
    # Our own sentences name the value themselves.
    given = "" if problem["type"] == "value_error" else f", not {problem['input']!r:.60}"
    return f"{before}{message}{given}"
