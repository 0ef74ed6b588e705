"""Records: what functions return and options are, compared and printed by one rule."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import wraps
from pathlib import Path
from reprlib import Repr
from typing import Any, TypeVar, dataclass_transform, overload

import numpy as np

Class = TypeVar("Class", bound=type)

LINES = 10  # of a repr at most
WIDTH = 88  # characters of a repr that stands in one line
SHOWN = 8  # entries of an array that are printed
HASHED = 16  # entries of an array that its hash depends on

_texts = Repr()
_texts.maxother, _texts.maxtuple, _texts.maxdict = 70, 4, 4


@overload
def record(cls: Class) -> Class: ...
@overload
def record(*, kw_only: bool = False) -> Callable[[Class], Class]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def record(cls: Any = None, *, kw_only: bool = False) -> Any:
    """Make a class a frozen dataclass of values.

    Its arrays are read-only; those that are not yet are copied. Records are equal when their
    compared fields are, entry by entry, NaN included; equal records have equal hashes. They can be
    pickled, and print in ten lines at most. Methods that the class defines itself are kept.

    Examples
    --------
    >>> import numpy as np
    >>> from loopid.records import record
    >>> @record
    ... class Line:
    ...     points: np.ndarray
    >>> Line(np.zeros(2)) == Line(np.zeros(2)), Line(np.zeros(2))
    (True, Line(points=[0., 0.]))
    """
    if cls is None:
        return lambda decorated: _record(decorated, kw_only)
    return _record(cls, kw_only)


def _record(cls: type, kw_only: bool) -> type:
    made: Any = dataclass(frozen=True, eq=False, repr=False, kw_only=kw_only)(cls)
    init = made.__init__

    @wraps(init)
    def initialise(self: Any, *args: Any, **kwargs: Any) -> None:
        init(self, *args, **kwargs)
        for each in fields(made):
            value = getattr(self, each.name)
            if isinstance(value, np.ndarray) and value.flags.writeable:
                copy = value.copy()
                copy.setflags(write=False)
                object.__setattr__(self, each.name, copy)

    made.__init__ = initialise
    for method in (_eq, _hash, _repr):
        name = f"__{method.__name__[1:]}__"
        if name not in cls.__dict__ or cls.__dict__[name] is None:
            setattr(made, name, method)
    return cls


def _compared(instance: Any) -> list[Any]:
    return [getattr(instance, each.name) for each in fields(instance) if each.compare]


def _eq(self: Any, other: object) -> Any:
    if type(other) is not type(self):
        return NotImplemented
    return all(map(same, _compared(self), _compared(other)))


def _hash(self: Any) -> int:
    return hash((type(self).__name__, *map(digest, _compared(self))))


def _repr(self: Any) -> str:
    parts = [
        f"{each.name}={_short(getattr(self, each.name))}" for each in fields(self) if each.repr
    ]
    line = ", ".join(parts)
    if len(line) > WIDTH or "\n" in line:
        if len(parts) > LINES - 2:
            parts = [*parts[: LINES - 3], "..."]
        line = "\n  " + ",\n  ".join(parts) + "\n"
    return f"{type(self).__name__}({line})"


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal, arrays entry by entry, NaN as a value like others."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        both = np.asarray(one), np.asarray(other)
        real = all(each.dtype.kind in "fc" for each in both)
        return bool(np.array_equal(*both, equal_nan=real))
    if isinstance(one, float) and isinstance(other, float):
        return bool(one == other or (np.isnan(one) and np.isnan(other)))
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    return bool(one == other)


def digest(value: Any) -> int:
    """A hash that is the same for values that are ``same``."""
    if isinstance(value, np.ndarray):
        first = value.ravel()[:HASHED]
        first = np.nan_to_num(first) if value.dtype.kind in "fc" else first
        return hash((value.size, *first.tolist()))
    if isinstance(value, float) and np.isnan(value):
        return 0
    if isinstance(value, tuple | list):
        return hash(tuple(map(digest, value)))
    if isinstance(value, Mapping):
        return hash(frozenset(value))
    known = isinstance(value, str | int | float | bytes | Path | type(None))
    own = getattr(type(value), "__hash__", None) is _hash
    return hash(value) if known or own else hash(type(value).__name__)


def _short(value: object) -> str:
    """A field in one line; of large arrays only the shape."""
    if not isinstance(value, np.ndarray):
        return _texts.repr(value).replace("\n", " ")
    if value.ndim == 1 and value.size <= SHOWN:
        return np.array2string(value, precision=4, separator=", ", max_line_width=1000)
    return f"<array of shape {value.shape}>"
