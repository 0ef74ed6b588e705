"""What a format of logs is: named streams, each a table of cells, and what cells say.

A format is a file with a class, registered by its name in ``loopid.registry.log_formats``. Those of
this room are text, NumPy and Parquet.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import FloatArray, IntArray, number
from loopid.errors import LogError, LoopidError, MissingExtraError
from loopid.registry import log_formats

if TYPE_CHECKING:  # slow to import, and only needed to read a log
    import polars

PACKED = ".gz"
AROUND_CELLS = " \t\r\"'"
# Larger numbers (in the file's units) are no measurements, and would overflow later.
LARGEST_NUMBER = 1e15
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # in ns
NO_STAMP = np.iinfo(np.int64).min
LARGEST_STAMP = 9 * 10**18  # ns: 1e19 would overflow, and 9e18 is the year 2255
MOST_LISTED = 30  # columns or topics in a message
LONGEST_REASON = 200  # characters that a library says of a file


class Table(NamedTuple):
    """Columns of a stream that share their rows."""

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


class LogFormat(ABC):
    """A log of some format; of one with a ``choice``, perhaps only the chosen stream."""

    endings: ClassVar[tuple[str, ...]] = ()  # of the files' names, lower case
    choice: ClassVar[str | None] = None  # the key of a mapping that chooses: topic or group
    ordered: ClassVar[bool] = True  # whether the order of the columns says something

    def __init__(self, path: Path, chosen: str | None = None) -> None:
        self.path = path
        self.chosen = chosen

    @classmethod
    def accepts(cls, path: Path) -> bool:
        """Whether a path looks like a log of this format."""
        return path.name.lower().endswith(cls.endings) and not path.is_dir()

    @abstractmethod
    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the columns of each stream; a LogError when the file is not of this format."""

    @abstractmethod
    def tables(self, stream: str, names: Sequence[str]) -> Sequence[Table]:
        """Some columns of a stream, the times in each table; by default all share their rows."""

    def source(self, stream: str) -> str:
        """What a stream is called in messages."""
        return str(self.path)


def format_of(path: Path, name: str | None = None) -> tuple[str, type[LogFormat]]:
    """The format of a log by its name, or that of those registered which accepts the path."""
    for known in [name] if name is not None else reversed([*log_formats]):
        kind: type[LogFormat] = log_formats[known]
        if name is not None or kind.accepts(path):
            return known, kind
    endings = dict.fromkeys(end for known in log_formats for end in log_formats[known].endings)
    raise LogError(
        f"{path} is of no known format: its name must end in {', '.join(endings)}, or it must be a "
        f"folder; otherwise give the format in a mapping ({', '.join(sorted(log_formats))})",
        file=path,
        valid=tuple(endings),
    )


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

    if column.dtype == polars.String:
        column = column.str.strip_chars(AROUND_CELLS)
    elif not column.dtype.is_numeric():
        raise _other_kind(source, column.name, column.dtype, "numbers")
    values = column.cast(polars.Float64, strict=False).fill_null(np.nan).to_numpy()
    return np.where(np.abs(values) <= LARGEST_NUMBER, values, np.nan)


def stamps_in(source: str, column: polars.Series, unit: int) -> IntArray:
    """A column of times as whole nanoseconds (R,), exact; ``NO_STAMP`` for other cells.

    The unit is in nanoseconds; dates and durations know theirs.
    """
    import polars

    kind = column.dtype
    if kind in (polars.Datetime, polars.Duration, polars.Time):
        whole, unit = column.to_physical(), UNITS[getattr(kind, "time_unit", "ns")]
    elif kind.is_integer():
        whole = column
    elif kind == polars.String or kind.is_numeric():
        # Epoch times have more digits than a float. Polars' decimals take no exponents.
        text = column.cast(polars.String).str.strip_chars(AROUND_CELLS)
        if text.str.contains("[eE]").any():
            return np.array([_exact(cell, unit) for cell in text.to_list()], dtype=np.int64)
        decimals = text.cast(polars.Decimal(38, len(str(unit)) - 1), strict=False)
        whole, unit = decimals.to_physical(), 1
    else:
        raise _other_kind(source, column.name, kind, "times")
    whole = whole.cast(polars.Int64, strict=False).fill_null(NO_STAMP)
    cells, largest = whole.to_numpy(), LARGEST_STAMP // unit
    valid = (cells >= -largest) & (cells <= largest)
    return np.where(valid, np.where(valid, cells, 0) * unit, NO_STAMP)


def _exact(cell: str | None, unit: int) -> int:
    try:
        stamp = Decimal("nan" if np.isnan(number(cell or "")) else cell or "") * unit
        return round(stamp) if abs(stamp) <= LARGEST_STAMP else int(NO_STAMP)
    except ArithmeticError:  # no number, or too large for any
        return int(NO_STAMP)


def array_table(
    source: str | Path, columns: Mapping[str, NDArray[Any]], rows: IntArray | None = None
) -> Table:
    """Columns (R,) of numbers or times as a table; their rows are counted from 1 by default."""
    import polars

    cells, count = {}, common_length(source, {name: len(c) for name, c in columns.items()})
    for name, column in columns.items():
        if column.dtype.kind not in "biufUmM":
            raise _other_kind(source, name, column.dtype, "numbers")
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
            columns=(short, long),
        )
    return lengths[long]


def _other_kind(source: str | Path, name: str, kind: object, wanted: str) -> LogError:
    said = f"{source}: column {name!r} holds {kind}, not {wanted}"
    return LogError(said, file=source, column=name, given=str(kind))


# ---- errors of libraries ----------------------------------------------------------------------


@contextmanager
def refusals(path: Path, kind: str) -> Iterator[None]:
    """Turn errors of reading a file, which should be of a kind, into a sentence that names it.

    Damaged bytes make libraries fail in any way: assertions, lookups, sizes beyond the memory.
    """
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
        said = said if len(said) <= LONGEST_REASON else f"{said[:LONGEST_REASON]} ..."
        raise LogError(f"{path} is no {kind}, or is damaged: {said}", file=path) from error


@contextmanager
def optional(package: str) -> Iterator[None]:
    """Name the extra that brings a library which is not installed."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError.of(package, "logs") from error
