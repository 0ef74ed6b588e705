"""Records: what functions return and options are, compared and printed by one rule."""

from __future__ import annotations

import copyreg
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from functools import wraps
from html import escape
from reprlib import Repr
from typing import (
    TYPE_CHECKING,
    Any,
    Concatenate,
    Literal,
    ParamSpec,
    TypeVar,
    dataclass_transform,
    overload,
)

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import checked, checked_outside
from loopid.errors import MissingExtraError

if TYPE_CHECKING:
    import polars

Class = TypeVar("Class", bound=type)
P = ParamSpec("P")
R = TypeVar("R")

LINES = 10  # of a repr at most
WIDTH = 88  # characters of a repr that stands in one line, and of a field
SHOWN = 8  # entries of an array that are printed

_texts = Repr()
_texts.maxother, _texts.maxstring, _texts.maxtuple, _texts.maxlist, _texts.maxdict = 70, 60, 4, 4, 4


@overload
def record(cls: Class) -> Class: ...
@overload
def record(
    *, kw_only: bool = False, checked: bool | Literal["outside"] = False
) -> Callable[[Class], Class]: ...
@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def record(
    cls: Any = None, *, kw_only: bool = False, checked: bool | Literal["outside"] = False
) -> Any:
    """Make a class a frozen dataclass of values.

    Its arrays are read-only; those that are not yet are copied. Records are equal when their
    compared fields are, entry by entry, NaN included; equal records have equal hashes. They can be
    pickled, and print in ten lines at most. Methods that the class defines or inherits are kept.
    With ``checked`` fields, and arguments of public methods, are checked against their annotations,
    as ``arguments.checked`` does; "outside" as ``checked_outside``, for results.

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
        return lambda decorated: _record(decorated, kw_only, checked)
    return _record(cls, kw_only, checked)


def _record(cls: type, kw_only: bool, checks: bool | Literal["outside"]) -> type:
    made: Any = dataclass(frozen=True, eq=False, repr=False, kw_only=kw_only)(cls)
    if checks:
        made = (checked_outside if checks == "outside" else checked)(made)
    init = made.__init__

    @wraps(init)
    def initialise(self: Any, *args: Any, **kwargs: Any) -> None:
        init(self, *args, **kwargs)
        _protect(self.__dict__)

    made.__init__ = initialise
    made._compared = [each.name for each in fields(made) if each.compare]
    own: dict[str, Any] = {"__repr__": _repr, "_repr_html_": _html, "__reduce__": _reduce}
    if made.__eq__ is object.__eq__:  # who compares by a rule of its own hashes by it, too
        own |= {"__eq__": _eq, "__hash__": _hash}
    for name, method in own.items():
        if getattr(made, name, None) is getattr(object, name, None):
            setattr(made, name, method)
    return made  # type: ignore[no-any-return]


def _protect(state: dict[str, Any]) -> None:
    """Put read-only arrays in the place of those that can be written to."""
    for name, value in state.items():
        if isinstance(value, np.ndarray) and value.flags.writeable:
            state[name] = read_only(value)
        elif type(value) is tuple and any(isinstance(each, np.ndarray) for each in value):
            state[name] = tuple(
                read_only(each) if isinstance(each, np.ndarray) else each for each in value
            )


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The array, or a copy of one that can be written to."""
    if not array.flags.writeable:
        return array
    copy = array.copy()
    copy.setflags(write=False)
    return copy


def derived(make: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Any, P], R]:
    """Make what follows from a record, and from arguments that hash, once a record.

    What a function of another file keeps so is what ``cached_property`` is inside a class. Copies
    make it anew.
    """

    @wraps(make)
    def found(record: Any, /, *args: P.args, **kwargs: P.kwargs) -> R:
        known = vars(record).setdefault("_derived", {})
        key = make, args, *kwargs.items()
        if key not in known:
            known[key] = make(record, *args, **kwargs)
        made: R = known[key]
        return made

    return found


def _reduce(self: Any) -> tuple[Any, ...]:
    state = {name: value for name, value in self.__dict__.items() if name != "_derived"}
    return _restored, (type(self), state)


def _restored(cls: type, state: dict[str, Any]) -> Any:
    """A record with a state; pickling has forgotten which arrays are read-only."""
    made = copyreg.__newobj__(cls)  # type: ignore[attr-defined]
    for value in state.values():  # in place: nobody else has them, and they may be large
        for array in value if type(value) is tuple else (value,):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
    made.__dict__.update(state)
    return made


def _eq(self: Any, other: Any) -> Any:
    if self is other:
        return True
    if type(other) is not type(self):
        return NotImplemented
    return all(same(getattr(self, name), getattr(other, name)) for name in self._compared)


def _hash(self: Any) -> int:
    """By texts alone: numbers and arrays are equal in many words, and some objects by a rule."""
    texts = (each for name in self._compared if isinstance(each := getattr(self, name), str))
    return hash((type(self).__name__, *texts))


def _repr(self: Any) -> str:
    """Of options only what is not as by default: a signature, as ``help`` shows it, has a line."""
    shown = {each.name: getattr(self, each.name) for each in fields(self) if each.repr}
    if all(_optional(each) for each in fields(self)):
        usual = type(self)()
        shown = {name: x for name, x in shown.items() if not same(x, getattr(usual, name))}
    parts = [f"{name}={_short(value)}" for name, value in shown.items()]
    line = ", ".join(parts)
    if len(line) > WIDTH:
        if len(parts) > LINES - 2:
            parts = [*parts[: LINES - 3], "..."]
        line = "\n  " + ",\n  ".join(parts) + "\n"
    return f"{type(self).__name__}({line})"


def _optional(field: Field[Any]) -> bool:
    given = field.default is not MISSING or field.default_factory is not MISSING
    return field.kw_only and given


def _html(self: Any) -> str:
    """For notebooks: a table of the fields, or what the record prints by a rule of its own."""
    own: Any = type(self).__repr__
    if own is not _repr:
        return f"<pre>{escape(repr(self))}</pre>"
    shown = ((each.name, _short(getattr(self, each.name))) for each in fields(self) if each.repr)
    rows = "\n".join(f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in shown)
    return f"<p>{type(self).__name__}</p><table>\n{rows}\n</table>"


class Tabular:
    """What a data frame can hold."""

    def _table(self) -> Any:
        """Rows, each a mapping of names; or columns by their names."""
        raise NotImplementedError

    def to_polars(self) -> polars.DataFrame:
        """The table as a data frame of Polars."""
        import polars

        return polars.DataFrame(self._table())

    def to_pandas(self) -> Any:
        """The table as a data frame of pandas; a MissingExtraError where that is not installed."""
        try:
            import pandas  # type: ignore[import-untyped]
        except ImportError as error:
            raise MissingExtraError(
                "pandas is not installed: pip install pandas, or take to_polars()",
                package="pandas",
            ) from error
        return pandas.DataFrame(self._table())


def columns_of(
    names: Iterable[str], time: NDArray[Any], **quantities: NDArray[Any] | None
) -> dict[str, NDArray[Any]]:
    """Columns of a table: the time, then those of each quantity (N, names) that is known."""
    columns = {"time": time}
    for what, values in quantities.items():
        if values is not None:
            own = zip(names, values.T, strict=True)
            columns |= {f"{name}.{what}": column for name, column in own}
    return columns


def same(one: Any, other: Any) -> bool:
    """Whether two values are equal, arrays entry by entry, NaN as a value like others."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if {one.dtype.kind, other.dtype.kind} & set("OV"):
            return one.shape == other.shape and all(map(same, one.flat, other.flat))
        real = all(each.dtype.kind in "fc" for each in (one, other))
        return bool(np.array_equal(one, other, equal_nan=real))
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return False
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if _is_nan(one) and _is_nan(other):
        return True
    return bool(one == other)


def json_value(value: Any, *, nulls: bool = True) -> Any:
    """Lists, dicts of records' fields, numbers, texts; null for infinity and NaN.

    Without ``nulls`` keys of what is None are left out.
    """
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if is_dataclass(value):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        kept = (item for item in value.items() if nulls or item[1] is not None)
        return {key: json_value(each, nulls=nulls) for key, each in kept}
    if isinstance(value, list | tuple):
        return [json_value(each, nulls=nulls) for each in value]
    return value


def _is_nan(value: Any) -> bool:
    return isinstance(value, float | complex | np.inexact) and bool(value != value)


def _short(value: object) -> str:
    """A field in one line; of large arrays only the shape."""
    if isinstance(value, np.ndarray):
        if value.ndim != 1 or value.size > SHOWN or value.dtype.hasobject:
            return f"<array of shape {value.shape}>"
        return np.array2string(value, precision=4, separator=", ", max_line_width=1000)
    text = " ".join(_texts.repr(value).split())
    return text if len(text) <= WIDTH else f"{text[: WIDTH - 3]}..."
