"""Tables of logs, in any format: named streams, each a table of cells.

A format is a class, registered by its name in ``loopid.registry.log_formats``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import FloatArray, IntArray, checked, number
from loopid.errors import LogError, LoopidError
from loopid.registry import log_formats

if TYPE_CHECKING:  # slow to import, and only needed to read a log
    import polars

# All that is read, in this order.
QUANTITIES = ("position", "force", "velocity", "acceleration")
POSE_PERIOD = 1.0  # s for which a pose at rest counts on time axes
# The components of a wrench, in the order of their columns: force, then moment.
COMPONENTS = ("force x", "force y", "force z", "moment x", "moment y", "moment z")
PACKED = ".gz"
AROUND_CELLS = " \t\r\"'"
# Larger numbers (in the file's units) are no measurements, and would overflow later.
LARGEST_NUMBER = 1e15
NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}
LOOKED_AT = 20  # first lines of a text, and cells of a time, that show how it is written
NO_STAMP = np.iinfo(np.int64).min
LARGEST_STAMP = 9 * 10**18  # ns: 1e19 would overflow, and 9e18 is the year 2255
MOST_LISTED = 30  # columns or topics in a message
WIDEST = 1000  # columns of a matrix: wider ones are pictures or the like
# A time of the day, perhaps behind a date.
CLOCK = r"^((?:\d{4}[-/]\d\d?[-/]\d\d?[T ])?\d\d?:\d\d:\d\d(?:[.,]\d+)?)(?:Z|[+-]\d\d:?\d\d)?$"


class Table(NamedTuple):
    """Columns of a stream that share their rows.

    Examples
    --------
    >>> import numpy as np, polars
    >>> from loopid.logs import Table
    >>> cells = polars.DataFrame({"time": [0.0, 0.01], "tau1": [1.2, 1.3]})
    >>> Table(cells, np.array([2, 3])).rows.tolist()
    [2, 3]
    """

    cells: polars.DataFrame
    rows: IntArray  # (R,), their numbers in the file, from 1
    garbled: IntArray = np.empty(0, dtype=np.int64)  # rows with another number of cells
    cut_off: int | None = None  # a last row that is left out because its line does not end

    def between(self, first: int, last: int | None) -> Table:
        """The rows from one number to another, or to the end."""
        end = np.inf if last is None else last
        inside = (self.rows >= first) & (self.rows <= end)
        garbled = self.garbled[(self.garbled >= first) & (self.garbled <= end)]
        cut_off = None if self.cut_off is None or self.cut_off > end else self.cut_off
        return Table(self.cells.filter(inside), self.rows[inside], garbled, cut_off)


@checked
class LogFormat(ABC):
    """A log of some format; of one with a ``choice``, perhaps only the chosen stream.

    Examples
    --------
    >>> from loopid.logs import LogFormat
    >>> class Lines(LogFormat):
    ...     endings = (".lines",)
    >>> issubclass(Lines, LogFormat), Lines.endings
    (True, ('.lines',))
    """

    endings: ClassVar[tuple[str, ...]] = ()  # of the files' names, lower case
    choice: ClassVar[str | None] = None  # the key of a mapping that chooses: topic or group
    ordered: ClassVar[bool] = True  # whether the order of the columns says something

    def __init__(self, path: Path, chosen: str | None = None) -> None:
        self.path, self.chosen = path, chosen

    @classmethod
    def accepts(cls, path: Path) -> bool:
        """Whether a path looks like a log of this format."""
        return path.name.lower().endswith(cls.endings) and not path.is_dir()

    @abstractmethod
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the columns of each stream; a LogError when the file is not of this format."""

    @abstractmethod
    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        """Columns of values of a stream, each in one table with the columns of the times.

        Times are exact: text, whole numbers, dates or durations, or as they are in the file.
        """

    def source(self, stream: str) -> str:
        """What a stream is called in messages."""
        return str(self.path)

    def refused(self, said: str, **facts: object) -> LogError:
        """An error that names the log."""
        return LogError(f"{self.path} {said}", file=self.path, **facts)


def stream_name(path: Path) -> str:
    """Name of the stream in a file: the file's name without its endings."""
    name = path.name
    for known in (PACKED, *(end for kind in log_formats for end in log_formats[kind].endings)):
        name = name[: -len(known)] if name.lower().endswith(known) else name
    return name


# ---- cells ------------------------------------------------------------------------------------


def numbers_in(source: str, column: polars.Series) -> FloatArray:
    """A column as floats (R,), NaN for cells that are no finite number of sensible size."""
    import polars

    if column.dtype != polars.String and not column.dtype.is_numeric():
        raise other_kind(source, column.name, column.dtype, "numbers")
    values = floats(column).fill_null(np.nan).to_numpy()
    return np.where(np.abs(values) <= LARGEST_NUMBER, values, np.nan)


def floats(column: polars.Series) -> polars.Series:
    """A column of numbers or text as floats, null for other cells."""
    import polars

    text = column.dtype == polars.String
    return (column.str.strip_chars(AROUND_CELLS) if text else column).cast(
        polars.Float64, strict=False
    )


def stamps_in(source: str, column: polars.Series, unit: int) -> IntArray:
    """A column of times in a unit (ns) as whole nanoseconds (R,), exact; else ``NO_STAMP``."""
    import polars

    kind = column.dtype
    if kind in (polars.Datetime, polars.Duration, polars.Time):
        own = NANOSECONDS[getattr(kind, "time_unit", "ns")]
        return _within_centuries(column.to_physical(), own)
    if kind.is_integer():
        stamps = _within_centuries(column, unit)
    elif kind == polars.String or kind.is_numeric():
        # Epoch times have more digits than a float. Polars' decimals take no exponents.
        text = column.cast(polars.String).str.strip_chars(AROUND_CELLS)
        if text.head(LOOKED_AT).str.contains(CLOCK).any():
            return _within_centuries(_clock(text), 1)
        if text.str.contains("[eE]").any():
            stamps = np.array([_exact(cell, unit) for cell in text.to_list()], dtype=np.int64)
        else:
            decimals = text.cast(polars.Decimal(38, len(str(unit)) - 1), strict=False)
            stamps = _within_centuries(decimals.to_physical(), 1)
    else:
        raise other_kind(source, column.name, kind, "times")
    if (stamps == NO_STAMP).sum() > len(stamps) / 2:
        _require_possible(source, column, unit)
    return stamps


def _within_centuries(whole: polars.Series, unit: int) -> IntArray:
    """Whole numbers in units as nanoseconds (R,)."""
    import polars

    whole = whole.cast(polars.Int64, strict=False).fill_null(NO_STAMP)
    cells, largest = whole.to_numpy(), LARGEST_STAMP // unit
    valid = (cells >= -largest) & (cells <= largest)
    return np.where(valid, np.where(valid, cells, 0) * unit, NO_STAMP)


def _require_possible(source: str, column: polars.Series, unit: int) -> None:
    """Refuse times of which most are not within centuries of the epoch."""
    usual = floats(column).abs().median()
    if isinstance(usual, float) and usual * unit > LARGEST_STAMP:
        # The longest that fits: times since the epoch are of this century in one unit only.
        fitting = [name for name, each in NANOSECONDS.items() if usual * each <= LARGEST_STAMP]
        best = max(fitting, key=NANOSECONDS.__getitem__, default="ns")
        raise LogError(
            f"{source}: times in column {column.name!r} are some {usual:.3g}, which is too "
            f"much in its unit: give it in a mapping, as time: {{column: NAME, unit: {best}}}",
            file=source,
            given=usual,
        )


def _clock(text: polars.Series) -> polars.Series:
    """Times of the day in nanoseconds, from the dates before them."""
    plain = text.str.extract(CLOCK).str.replace_all("/", "-").str.replace(",", ".")
    dated = plain.str.replace(r"^\d\d?:", "1970-01-01 $0").str.replace("T", " ")
    return dated.str.to_datetime("%F %T%.f", time_unit="ns", strict=False).to_physical()


def _exact(cell: str | None, unit: int) -> int:
    try:
        stamp = Decimal("nan" if np.isnan(number(cell or "")) else cell or "") * unit
        return round(stamp) if abs(stamp) <= LARGEST_STAMP else int(NO_STAMP)
    except ArithmeticError:  # no number, or too large for any
        return int(NO_STAMP)


def array_table(
    source: str | Path,
    columns: Mapping[str, NDArray[Any] | polars.Series],
    rows: IntArray | None = None,
) -> Table:
    """Columns (R,) of numbers or times as a table; their rows are counted from 1 by default."""
    import polars

    cells: dict[str, Any] = {}
    count = common_length(source, {name: len(c) for name, c in columns.items()})
    for name, column in columns.items():
        if isinstance(column, polars.Series):
            cells[name] = column
            continue
        if column.dtype.kind not in "biufUmM":
            raise other_kind(source, name, column.dtype, "numbers")
        # Polars takes neither every size and order of bytes, nor every unit of time.
        kind: Any = np.float64 if column.dtype.kind == "f" else column.dtype.newbyteorder("=")
        if column.dtype.kind in "mM":
            unit = np.datetime_data(kind)[0]
            kind = f"{kind.kind}8[{unit if unit in ('ms', 'us', 'ns') else 'ms'}]"
        cells[name] = column.astype(kind, copy=False)
    return Table(polars.DataFrame(cells), np.arange(1, count + 1) if rows is None else rows)


def common_length(source: str | Path, lengths: Mapping[str, int]) -> int:
    """How many rows columns have; a LogError when they differ, or there are none."""
    short, long = (pick(lengths, key=lambda name: lengths[name]) for pick in (min, max))
    if not lengths[long]:
        raise LogError(f"{source} has no rows in {', '.join(lengths)}", file=source)
    if lengths[short] < lengths[long]:
        raise LogError(
            f"{source}: {short!r} has {lengths[short]} rows, but {long!r} has {lengths[long]}",
            file=source,
        )
    return lengths[long]


def other_kind(source: str | Path, name: str, kind: object, wanted: str) -> LogError:
    """A column that holds something else than it must."""
    said = f"{source}: column {name!r} holds {kind}, not {wanted}"
    return LogError(said, file=source, given=str(kind))


@contextmanager
def refusals(path: Path, kind: str) -> Iterator[None]:
    """Turn errors of reading a file, which should be of a kind, into a sentence that names it."""
    from polars.exceptions import PanicException  # of its compiled part: no Exception

    try:
        yield
    except (LoopidError, Warning):
        raise
    except (Exception, PanicException) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        if isinstance(error, MemoryError | OverflowError):
            said = "a size in it is beyond all memory"
        elif isinstance(error, KeyError) and error.args:
            name = error.args[0]
            said = f"{name.decode() if isinstance(name, bytes) else name!r} is missing"
        raise LogError(f"{path} is no {kind}, or is damaged: {said:.200}", file=path) from error


# ---- formats of arrays --------------------------------------------------------------------------


class ArrayFormat(LogFormat):
    """Streams of arrays by name: one (R,) is a column, a matrix ``x`` the columns x_0, x_1, ...

    The longer axis of a matrix is that of the samples.
    """

    kind: ClassVar[str]  # for messages

    @abstractmethod
    def _arrays(self) -> Iterable[tuple[str, str, NDArray[Any]]]:
        """The stream, the name and the values of each array that ``has_columns``."""

    @cached_property
    def _streams(self) -> dict[str, dict[str, NDArray[Any]]]:
        streams: dict[str, dict[str, NDArray[Any]]] = {}
        with refusals(self.path, self.kind):
            for stream, array, values in self._arrays():
                columns = streams.setdefault(stream, {})
                for name, column in columns_in(array, values):
                    if name in columns:
                        raise self.refused(
                            f"has column {name!r} twice, the second in {array} of {stream}"
                        )
                    columns[name] = column
        return streams

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        found = {name: tuple(columns) for name, columns in self._streams.items() if columns}
        if not found:
            raise self.refused("holds no arrays with one or two axes")
        return found

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        columns = self._streams[stream]
        return [array_table(self.path, {name: columns[name] for name in (*times, *values)})]


def has_columns(shape: tuple[int, ...]) -> bool:
    """Whether an array of a shape may be columns of samples: others are pictures or the like."""
    return len(shape) == 1 or (len(shape) == 2 and min(shape) <= WIDEST)


def columns_in(name: str, array: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Columns (R,) of an array by their names; those of a table are its fields of one number."""
    if array.dtype.names:
        yield from ((f, array[f]) for f in array.dtype.names if not array.dtype[f].shape)
    elif array.ndim == 1 or 1 in array.shape:
        yield name, array.ravel()
    else:
        columns = array.T if len(array) >= array.shape[1] else array
        yield from ((f"{name}_{k}", column) for k, column in enumerate(columns))
