"""Arguments of public functions, checked by pydantic against their annotations; seeds."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from inspect import signature
from typing import ParamSpec, TypeVar

import numpy as np
from pydantic import ConfigDict, ValidationError, validate_call

from loopid.errors import OptionError

P = ParamSpec("P")
R = TypeVar("R")
Class = TypeVar("Class", bound=type)


# What one call may take, by an estimate before it begins.
MOST_SECONDS, MOST_BYTES = 900.0, 2**32


def affordable(name: str, count: int, seconds_each: float = 0.0, bytes_each: float = 0.0) -> None:
    """Refuse a number whose work would take far longer, or more memory, than it can be worth.

    Raises
    ------
    OptionError
        With the estimate and the number that is affordable.
    """
    found = [MOST_SECONDS / seconds_each] if seconds_each else []
    found += [MOST_BYTES / bytes_each] if bytes_each else []
    most = int(min(found))
    if count > most:
        hours, gigabytes = count * seconds_each / 3600, count * bytes_each / 2**30
        needs = [f"some {hours:,.1f} hours"] if seconds_each else []
        needs += [f"{gigabytes:,.1f} GiB of memory"] if bytes_each else []
        raise OptionError(
            f"{name} must be at most {most:,}, not {count:,}, which would take {', '.join(needs)}"
        )


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


def random_generator(seed: int, stream: int = 0) -> np.random.Generator:
    """A generator for a seed; different streams of one seed are independent."""
    return np.random.default_rng([_seed(seed), stream])


def derived_seed(seed: int, *part: int) -> int:
    """A seed for a part of the work: independent of those of other parts and of other seeds."""
    state = np.random.SeedSequence([_seed(seed), *part]).generate_state(1, np.uint64)
    return int(state[0])


def _seed(seed: int) -> int:
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise OptionError(f"seed must be a whole number from 0 on, not {seed!r}")
    return int(seed)
