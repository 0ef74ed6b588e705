"""Arguments of public functions, checked by pydantic against their annotations."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from inspect import signature
from typing import ParamSpec, TypeVar

from pydantic import ConfigDict, ValidationError, validate_call

from loopid.errors import OptionError

P = ParamSpec("P")
R = TypeVar("R")
Class = TypeVar("Class", bound=type)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse arguments that are not of the annotated types, among numbers also NaN.

    Arrays are left to the function, which knows their shapes.

    Raises
    ------
    OptionError
        Naming the argument, what it must be, and what was given.
    """

    @cache  # made by the first call: importing loopid does not wait for it
    def validated() -> Callable[P, R]:
        config = ConfigDict(arbitrary_types_allowed=True, allow_inf_nan=False)
        validator: Callable[P, R] = validate_call(config=config)(function)
        return validator

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return validated()(*args, **kwargs)
        except ValidationError as error:
            if error.title not in (function.__name__, function.__qualname__):
                raise
            signature(function).bind(*args, **kwargs)  # a TypeError as Python words it
            raise OptionError(_sentence(error, list(signature(function).parameters))) from None

    return call


def checked_fields(cls: Class) -> Class:
    """As ``checked``, for the fields that a dataclass is made of."""
    cls.__init__ = checked(cls.__init__)  # type: ignore[misc]
    return cls


def _sentence(error: ValidationError, names: list[str]) -> str:
    """Say what the first wrong argument must be; a union says it once for each of its types."""
    details = error.errors(include_url=False)
    place, given = details[0]["loc"][0], details[0]["input"]
    name = names[min(place, len(names) - 1)] if isinstance(place, int) else place
    valid = dict.fromkeys(_valid(one["msg"]) for one in details if one["loc"][0] == place)
    shown = repr(given) if isinstance(given, str | int | float | None) else type(given).__name__
    return f"{name} must be {' or '.join(valid)}, not {shown:.60}"


def _valid(message: str) -> str:
    return (
        message.partition(",")[0].removeprefix("Input should be ").replace("a dictionary or ", "")
    )
