"""The border: forms of what users write, and one voice for what does not fit them.

Pydantic checks files and arguments. What it finds is worded here alone. A message has the file, the
line and the path of keys. It says what must stand there, what was given, and what was likely meant.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError, PydanticKnownError

from loopid.errors import LoopidError, RobotFileError, near, shown, unknown_word

# In place of pydantic's words, with numbers that one can read.
WORDS = {
    "missing": "is missing",
    "missing_argument": "is missing",
    "too_short": "must have at least {min_length}, not {actual_length}",
    "too_long": "must have at most {max_length}, not {actual_length}",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be {ge:g} or more",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be {le:g} or less",
    "sequence_str": "must be a sequence",
    "path_type": "must be a path",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be keys with values, as {{key: value}}",
}
SHORTER = {
    "an instance of Sequence": "a sequence",
    "Input should be": "must be",
    " a valid integer": " a whole number",
    " a valid ": " a ",
    "an instance of": "of type",
    "of type _": "of type ",
}
UNKNOWN = "unknown_word"
# Their sentences name the value themselves.
COMPLETE = ("missing", "too_short", "too_long", "value_error", UNKNOWN)
Form = TypeVar("Form", bound=BaseModel)


def number_alone(given: Any) -> Any:
    """Refuse text and truth values, which pydantic would read as numbers."""
    if isinstance(given, str | bytes | bool):
        raise PydanticKnownError("float_type")
    return given


class Section(BaseModel):
    """Part of a file: known keys only, finite numbers only, names that may look like numbers."""

    model_config = ConfigDict(
        extra="forbid",
        allow_inf_nan=False,
        coerce_numbers_to_str=True,
        frozen=True,
        defer_build=True,  # importing loopid does not wait for forms that no file asks for
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_are_known(cls, content: Any) -> Any:
        if isinstance(content, cls):
            return content
        if not isinstance(content, dict):
            keys = ", ".join(cls.model_fields)
            raise ValueError(f"must hold keys among {keys}, not {shown(content)}")
        for key in content:
            if key not in cls.model_fields:
                raise unknown("key", key, cls.model_fields)
        return content

    @field_validator("*", mode="before")
    @classmethod
    def _truth_is_no_number(cls, content: Any, field: ValidationInfo) -> Any:
        annotation = cls.model_fields[field.field_name or ""].annotation
        if _has_truth(content) and not _takes_truth(annotation):
            raise ValueError(f"must not be or hold true or false, as {shown(content)} does")
        return content


def _has_truth(content: Any) -> bool:
    """Whether a content is true or false, or holds what is."""
    parts = content.values() if isinstance(content, dict) else content
    listed = isinstance(content, dict | list | tuple)
    return isinstance(content, bool) or (listed and any(map(_has_truth, parts)))


def _takes_truth(annotation: Any) -> bool:
    """Whether an annotation takes true and false, or leaves it to another section."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel | bool):
        return True
    return any(map(_takes_truth, get_args(annotation)))


def unknown(what: str, given: Any, valid: Iterable[str]) -> PydanticCustomError:
    """What a validator raises of a word that is none of the valid ones."""
    known = (*valid,)
    return wrong_word(unknown_word(what, given, known), given, known)


def wrong_word(said: str, given: Any, valid: Iterable[str]) -> PydanticCustomError:
    """As ``unknown``, in a sentence of its own."""
    return PydanticCustomError(UNKNOWN, "{said}", {"said": said, "given": given, "valid": valid})


def worded(detail: ErrorDetails, printed: Callable[[Any], str] = shown) -> str:
    """What is wrong, to follow the name of the value: "must be a number, not 'far'".

    ``printed`` is how the value is printed.
    """
    kind, context, given = detail["type"], detail.get("ctx", {}), detail["input"]
    if kind == "value_error":
        return str(context["error"]).strip()
    if kind == "literal_error":
        valid = re.findall(r"'([^']*)'", context["expected"])
        return f"must be one of {', '.join(valid)}, not {printed(given)}{near(given, valid)}"
    said = WORDS[kind].format(**context) if kind in WORDS else detail["msg"]
    for old, new in SHORTER.items():
        said = said.replace(old, new)
    said = said.partition(", unable")[0].partition(", got")[0]
    return said if kind in COMPLETE else f"{said}, not {printed(given)}"


def refusal(
    error: ValidationError,
    content: Any = None,
    where: object = "",
    kind: type[LoopidError] = RobotFileError,
    line_of: Callable[[Sequence[Any]], int | None] | None = None,
) -> LoopidError:
    """The error that says what is first wrong with a content, and how much more is.

    ``content`` is as its file has it, None where a program made it. ``where`` is the file, or what
    it is of. ``line_of`` gives the line that a path of keys leads to.
    """
    details = error.errors(include_url=False)
    paths = [key_path(detail, content) for detail in details]
    detail, path, more = details[0], paths[0], len({*paths}) - 1
    context = detail.get("ctx", {})
    facts: dict[str, Any] = {"given": detail["input"], "key": ".".join(map(str, path))}
    facts |= {key: context[key] for key in ("given", "valid") if key in context}
    facts |= getattr(context.get("error"), "facts", {})
    key = (*path, facts["given"]) if detail["type"] == UNKNOWN else path
    line = None if line_of is None else line_of(key)
    place = ", ".join(filter(None, (f"line {line}" if line else "", facts["key"])))
    said = worded(detail) + (f" (and {more} more)" if more else "")
    text = ": ".join(filter(None, (str(where), place, said)))
    return kind(text, **facts, **({"line": line} if line else {}))


def validated(
    form: type[Form],
    content: Any,
    where: object = "",
    kind: type[LoopidError] = RobotFileError,
    line_of: Callable[[Sequence[Any]], int | None] | None = None,
) -> Form:
    """A content in its form; the error of ``refusal`` where it does not fit."""
    try:
        return form.model_validate(content)
    except ValidationError as error:
        raise refusal(error, content, where, kind, line_of) from error


def key_path(detail: ErrorDetails, content: Any) -> tuple[Any, ...]:
    """Keys and places in lists that lead to a problem, without the names of alternatives."""
    if content is None:
        return detail["loc"]
    path = []
    for part in detail["loc"]:
        try:
            content = content[part]
        except (KeyError, IndexError, TypeError):
            continue
        path.append(part)
    return (*path, *detail["loc"][-1:]) if detail["type"] == "missing" else (*path,)
