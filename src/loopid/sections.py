"""Forms of what a file or a caller says: known keys, finite numbers, and the first problem."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

ALTERNATIVES = ("float", "str", "list[float]", "list[str]")


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
            meant = get_close_matches(str(key), cls.model_fields, n=1)
            hint = f" (did you mean {meant[0]!r}?)" if meant else ""
            valid = ", ".join(cls.model_fields)
            raise ValueError(f"unknown key {key!r}: choose among {valid}{hint}")
        return content


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
