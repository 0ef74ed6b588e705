"""Arguments of public functions, checked against their annotations before any work is done."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, wraps
from inspect import signature
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from loopid.errors import OptionError

P = ParamSpec("P")
R = TypeVar("R")
Class = TypeVar("Class", bound=type)
# What a sentence calls the types that are not called by their own names.
WORDS = {int: "a whole number", float: "a number", str: "text", bool: "True or False",
         NoneType: "None", os.PathLike: "a path"}  # fmt: skip
COLLECTIONS = (Sequence, Iterable, Mapping, tuple, list, dict)


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Refuse arguments that are not of the annotated types, among numbers also NaN.

    Arrays are left to the function, which knows their shapes.

    Raises
    ------
    OptionError
        Naming the argument, what it must be, and what was given.
    """
    parameters = signature(function)

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        hints = _hints(function)
        for name, value in parameters.bind(*args, **kwargs).arguments.items():
            if name in hints and not _accepts(hints[name], value):
                raise OptionError(f"{name} must be {_words(hints[name])}, not {_said(value)}")
        return function(*args, **kwargs)

    return call


def checked_fields(cls: Class) -> Class:
    """As ``checked``, for the fields that a dataclass is made of."""
    cls.__init__ = checked(cls.__init__)  # type: ignore[misc]
    return cls


@cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Annotated types; those of ``*args`` and ``**kwargs`` are of single values."""
    kinds = {p.name: p.kind for p in signature(function).parameters.values()}
    hints = get_type_hints(function)
    return {n: hint for n, hint in hints.items() if n in kinds and "VAR" not in kinds[n].name}


def _accepts(hint: Any, value: Any) -> bool:
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_accepts(part, value) for part in inside)
    if origin is Literal:
        return value in inside if isinstance(value, str) else False
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if hint is float:
        return isinstance(value, Real) and not isinstance(value, bool) and value == value
    if origin in COLLECTIONS or hint in COLLECTIONS:
        return _is_collection(origin or hint, inside, value)
    if origin is np.ndarray or isinstance(hint, TypeVar) or hint is Any:
        return True
    return isinstance(value, origin or hint)


def _is_collection(kind: Any, inside: tuple[Any, ...], value: Any) -> bool:
    # Lists and arrays do for tuples; a text is a sequence of names in no one's mind.
    wider = {tuple: Sequence, list: Sequence, dict: Mapping}.get(kind, kind)
    if isinstance(value, str | bytes) or not isinstance(value, wider | np.ndarray):
        return False
    if wider is not Sequence or not inside:
        return True
    alike = len(inside) == 1 or inside[1] is Ellipsis
    types = inside[:1] * len(value) if alike else inside
    return len(value) == len(types) and all(map(_accepts, types, value))


def _words(hint: Any) -> str:
    origin, inside = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_words, inside)))
    if origin is Literal:
        return " or ".join(map(repr, inside))
    if hint is np.ndarray or origin is np.ndarray:
        return "an array"
    if origin in COLLECTIONS:
        named = WORDS.get(inside[0], "") if inside else ""
        return f"several {'names' if named == 'text' else 'values'}"
    name = getattr(origin or hint, "__name__", str(hint))
    return WORDS.get(
        hint, WORDS.get(origin, f"a {name}" if name[0] not in "AEIO" else f"an {name}")
    )


def _said(value: Any) -> str:
    if isinstance(value, str | int | float | complex | NoneType):
        return f"{value!r:.60}"
    return f"of type {type(value).__name__}"
