"""Formats of logs: text, NumPy, Parquet and HDF5 behind one interface (bags of ROS: ``bags``).

A log is one or more named streams; a stream is a table. Text and Parquet are read by Polars, HDF5
by h5py. Where these read damaged files without a word, the checks are here.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from decimal import Decimal
from functools import cached_property
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from loopid.arguments import (
    FloatArray,
    IntArray,
    number,
)
from loopid.errors import (
    LogError,
    LoopidError,
    MissingExtraError,
)
from loopid.files import (
    require_plausible,
    text_blocks,
    why_no_file,
)
from loopid.scratch import row_blocks

if TYPE_CHECKING:  # slow to import, and only needed to read a log
    import h5py
    import polars

TEXT_ENDINGS = (".csv", ".txt", ".tsv")
OTHER_ENDINGS = (".npz", ".parquet", ".pq", ".h5", ".hdf5", ".bag", ".mcap", ".db3")
PACKED = ".gz"
# Rows, and bytes of them, that are read at a time.
BATCH_ROWS, BATCH_BYTES = 2**16, 2**24
# Rows (14 hours at 1 kHz) and columns of a log, and rows before its samples.
MOST_ROWS, MOST_COLUMNS, LONGEST_HEADER = 50_000_000, 10_000, 10_000
COMMENT = "#"
# Of separators that split a header into equally many cells, the first is taken; None is any space.
SEPARATORS = ("\t", ";", ",", None)
AROUND_CELLS = " \t\r\"'"
NO_NUMBERS = ("", "nan", "+nan", "-nan")
# Larger numbers (in the file's units) are no measurements, and would overflow later.
LARGEST_NUMBER = 1e15
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # in ns
NO_STAMP = np.iinfo(np.int64).min
LARGEST_STAMP = 9 * 10**18  # ns: 1e19 would overflow, and 9e18 is the year 2255
# Wider matrices of an HDF5 file are pictures or the like, not columns.
WIDEST = 1000
DEEPEST = 50  # groups of an HDF5 file in each other
# Bytes of unpacked chunks of an HDF5 file that are kept for each array, and of one of them.
CACHE_BYTES, LARGEST_CHUNK = 2**24, 2**28
LONGEST_REASON = 200
# Columns or topics that a message lists.
MOST_LISTED = 30


class Batch(NamedTuple):
    """Some rows of a stream."""

    cells: polars.DataFrame
    rows: IntArray  # (R,), their numbers in the file, from 1
    garbled: IntArray = np.empty(0, dtype=np.int64)  # rows with another number of cells
    cut_off: int | None = None  # a last row that is left out because its line does not end


class LogFormat(ABC):
    """A log of some format; of one with a ``choice``, perhaps only the chosen stream."""

    name: ClassVar[str]  # in a mapping
    endings: ClassVar[tuple[str, ...]]  # of the files' names
    choice: ClassVar[str | None] = None  # the key of a mapping that chooses among the streams
    ordered: ClassVar[bool] = True  # whether the columns stand in an order that says something

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

    def source(self, stream: str) -> str:
        """What a stream is called in messages."""
        return str(self.path)

    def together(self, stream: str, names: Sequence[str]) -> list[tuple[str, ...]]:
        """Columns of a stream in groups that share their rows; by default all do."""
        return [tuple(names)]

    @abstractmethod
    def batches(self, stream: str, names: Sequence[str]) -> Generator[Batch]:
        """Some columns of a stream that share their rows; a LogError when they cannot be read."""


def rows_between(batches: Iterable[Batch], first: float, last: float) -> Iterator[Batch]:
    """The rows from one number to another."""
    for cells, rows, garbled, cut_off in batches:
        inside = (rows >= first) & (rows <= last)
        garbled = garbled[(garbled >= first) & (garbled <= last)]
        end = cut_off if cut_off is not None and cut_off <= last else None
        yield Batch(cells.filter(inside), rows[inside], garbled, end)
        if len(rows) and rows[-1] >= last:
            return


def stream_name(path: Path) -> str:
    """Name of the stream in a file: the file's name without its endings."""
    name = path.name
    for ending in (PACKED, *TEXT_ENDINGS, *OTHER_ENDINGS):
        if name.lower().endswith(ending):
            name = name[: -len(ending)]
    return name


# ---- cells ------------------------------------------------------------------------------------


def numbers_in(source: str, column: polars.Series) -> FloatArray:
    """A column as floats (R,), NaN for cells that are no finite number of sensible size."""
    import polars

    if column.dtype == polars.String:
        column = column.str.strip_chars(AROUND_CELLS)
    elif not column.dtype.is_numeric():
        raise LogError(f"{source}: column {column.name!r} holds {column.dtype}, not numbers")
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
        raise LogError(f"{source}: column {column.name!r} holds {kind}, not times")
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


# ---- text -------------------------------------------------------------------------------------


class Header(NamedTuple):
    """Names of the columns, what separates cells, and lines before the first sample."""

    names: tuple[str, ...]
    separator: str | None
    lines: int


class TextFormat(LogFormat):
    """One table of text: a header if any, then one sample a line; packed with gzip or not."""

    name = "csv"
    endings = (*TEXT_ENDINGS, *(f"{ending}{PACKED}" for ending in TEXT_ENDINGS))

    @cached_property
    def _files(self) -> dict[str, Path]:
        return {stream_name(self.path): self.path}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: read_header(file).names for stream, file in self._files.items()}

    def source(self, stream: str) -> str:
        return str(self._files[stream])

    def batches(self, stream: str, names: Sequence[str]) -> Generator[Batch]:
        """Some columns as text.

        Polars' reader of CSV would fill short rows, cut long ones, pass over blank ones and number
        none: here it splits lines one by one.
        """
        import polars

        path = self._files[stream]
        header, read, found = read_header(path), 0, False
        separator, width = header.separator, len(header.names)
        places = {name: header.names.index(name) for name in names}
        with closing(text_blocks(path)) as blocks:
            for block in blocks:
                text, whole = block.decode("utf-8", "replace"), block.endswith(b"\n")
                lines = polars.Series(text.removeprefix("\ufeff").removesuffix("\n").split("\n"))
                rows = np.arange(read + 1, read + len(lines) + 1)
                read += len(lines)
                require_few_rows(path, read)
                if separator != ",":
                    lines = lines.str.replace_all(",", ".", literal=True)  # decimal commas
                filled = lines.str.contains(r"\S").to_numpy() & (rows > header.lines)
                cut_off = None if whole or not filled[-1] else int(rows[-1])
                filled[-1] &= whole
                if separator is None:
                    cells = lines.str.extract_all(r"\S+")
                else:
                    cells = lines.str.split(separator)
                fine = filled & (cells.list.len() == width).to_numpy()
                found, cells = found or bool(fine.any()), cells.filter(fine).list
                table = polars.DataFrame({name: cells.get(k) for name, k in places.items()})
                yield Batch(table, rows[fine], rows[filled & ~fine], cut_off)
        if not found:
            raise LogError(f"{path} has no rows of {width} cells below its header")


class FolderFormat(TextFormat):
    """A folder with one table of text a stream, each with time stamps of its own."""

    name = "folder"

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.is_dir()

    @cached_property
    def _files(self) -> dict[str, Path]:
        named = (f for f in sorted(self.path.glob("*")) if f.name.lower().endswith(self.endings))
        files = [file for file in named if not file.is_dir()]
        for file in files:
            if reason := why_no_file(file):
                raise LogError(f"{file} {reason}")
        if not files:
            raise LogError(
                f"{self.path} holds no streams: files that end in .txt, .csv, .tsv or .gz"
            )
        return {stream_name(file): file for file in files}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        found: dict[str, tuple[str, ...]] = dict.fromkeys(self._files, ())
        for stream, file in self._files.items():
            with suppress(LogError):  # matters only if its columns are needed
                found[stream] = read_header(file).names
        return found


def read_header(path: Path) -> Header:
    """The first line that is no comment or, above bare numbers, the last comment.

    A comment with another number of cells names no columns: then they are called 1, 2, 3.
    """
    comment, first = "", None
    with closing(text_blocks(path)) as blocks:
        for row, data in enumerate(chain.from_iterable(map(BytesIO, blocks)), 1):
            line = data.decode("utf-8", "replace").rstrip("\r\n")
            line = line.removeprefix("\ufeff") if row == 1 else line
            if row > LONGEST_HEADER:
                raise LogError(f"{path} has no samples in its first {LONGEST_HEADER:,} rows")
            if not line.replace("\t", " ").isprintable():
                raise LogError(f"{path} is no text: row {row} is {line!r:.60}")
            if line.startswith(COMMENT):
                comment = line.lstrip(COMMENT).strip()
            elif line.strip():
                first = row, line
                break
    if first is None:
        raise LogError(f"{path} is empty{', but for comments' if comment else ''}")
    row, text = first
    separator = _separator(text)
    names = text.split(separator)
    if _are_numbers(text, separator):
        row, named = row - 1, comment.split(_separator(comment))
        names = named if len(named) == len(names) else [str(k + 1) for k in range(len(names))]
    names = [name.strip(AROUND_CELLS) for name in names]
    if len(names) > MOST_COLUMNS:
        raise LogError(f"{path} has {len(names):,} columns (at most {MOST_COLUMNS:,} are read)")
    repeated = sorted(name for name, count in Counter(names).items() if name and count > 1)
    if repeated:
        raise LogError(f"{path}: its header names column {repeated[0]!r} more than once")
    return Header(tuple(names), separator, row)


def _separator(line: str) -> str | None:
    """What splits a line into most cells; into numbers, where one does."""
    line = line.strip()
    numbers = [one for one in SEPARATORS if _are_numbers(line, one)]
    return max(numbers or SEPARATORS, key=lambda separator: len(line.split(separator)))


def _are_numbers(line: str, separator: str | None) -> bool:
    """Whether all cells of a line are numbers or empty."""
    line = line if separator == "," else line.replace(",", ".")
    cells = [cell.strip(AROUND_CELLS) for cell in line.split(separator)]
    return any(cells) and all(
        cell.casefold() in NO_NUMBERS or not np.isnan(number(cell)) for cell in cells
    )


# ---- arrays and tables ------------------------------------------------------------------------


class Column(NamedTuple):
    """A column in a file of arrays: all of one, a column of a matrix, or a field of a table."""

    array: str
    place: Any = ...  # index behind that of the rows, or name of the field


class ArrayFormat(LogFormat):
    """Streams of arrays: one (R,) is a column; a matrix ``x`` (R, k) has ``x_0`` to ``x_k-1``."""

    kind: ClassVar[str]  # for messages

    @property
    @abstractmethod
    def _streams(self) -> dict[str, dict[str, Column]]:
        """Columns by name, for each stream that has any."""

    @abstractmethod
    def _opened(self, arrays: Iterable[str]) -> AbstractContextManager[Mapping[str, Any]]:
        """Arrays (R,) or (R, k) by name, whose rows are read in order."""

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: tuple(columns) for stream, columns in self._streams.items()}

    def batches(self, stream: str, names: Sequence[str]) -> Generator[Batch]:
        places = {name: self._streams[stream][name] for name in names}
        wanted = dict.fromkeys(place.array for place in places.values())
        with refusals(self.path, self.kind), self._opened(wanted) as arrays:
            lengths = {name: arrays[place.array].shape[0] for name, place in places.items()}
            count = common_length(self.path, lengths)
            widest = max(a.dtype.itemsize * math.prod(a.shape[1:]) for a in arrays.values())
            for rows in row_blocks(count, max(1, min(BATCH_ROWS, BATCH_BYTES // widest))):
                blocks = {array: values[rows] for array, values in arrays.items()}
                columns = {
                    name: blocks[array][place if isinstance(place, str) else (slice(None), place)]
                    for name, (array, place) in places.items()
                }
                yield array_batch(self.path, columns, numbers(rows))

    def _collect(self, columns: dict[str, Column], array: str, places: Mapping[str, Any]) -> None:
        """Add columns of an array at their places; none may be there already."""
        for name, place in places.items():
            if name in columns:
                raise LogError(
                    f"{self.path} has column {name!r} in {columns[name].array} and {array}"
                )
            columns[name] = Column(array, place)


class NpzFormat(ArrayFormat):
    """Arrays of NumPy in a ZIP file."""

    name = "npz"
    endings = (".npz",)
    kind = ".npz of numbers"

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        columns: dict[str, Column] = {}
        with refusals(self.path, self.kind), ZipFile(self.path) as archive:
            for name in archive.namelist():
                array, (shape, *_) = name.removesuffix(".npy"), _npy_header(archive, name)
                if len(shape) == 1:
                    self._collect(columns, array, {array: ...})
                elif len(shape) == 2 and shape[1] <= WIDEST:
                    self._collect(columns, array, {f"{array}_{k}": k for k in range(shape[1])})
        if not columns:
            raise LogError(f"{self.path} holds no arrays with one or two axes")
        return {stream_name(self.path): columns}

    @contextmanager
    def _opened(self, arrays: Iterable[str]) -> Iterator[Mapping[str, Any]]:
        """Whole, as they were in the memory of who wrote them."""
        with ZipFile(self.path) as archive, np.load(self.path, allow_pickle=False) as content:
            for name in (n for n in archive.namelist() if n.removesuffix(".npy") in arrays):
                shape, _, dtype = _npy_header(archive, name)
                require_few_rows(self.path, shape[0])
                stored = archive.getinfo(name).compress_size
                require_plausible(self.path, math.prod(shape) * dtype.itemsize, stored)
            yield {array: content[array] for array in arrays}


def _npy_header(archive: ZipFile, name: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether it is stored by columns, and type of an array, which is not read."""
    with archive.open(name) as file:
        old = np.lib.format.read_magic(file) == (1, 0)
        read = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        return read(file)


class Hdf5Format(ArrayFormat):
    """A stream a group: arrays, matrices and tables with fields."""

    name = "hdf5"
    endings = (".h5", ".hdf5")
    choice = "group"
    ordered = False  # groups list their arrays by name
    kind = "HDF5 file"

    @contextmanager
    def _opened(self, arrays: Iterable[str]) -> Iterator[Mapping[str, Any]]:
        with self._file() as file:
            found = {name: file[name] for name in arrays}
            for array in found.values():
                self._require_here(array)
            yield found

    @contextmanager
    def _file(self) -> Iterator[h5py.File]:
        with optional("h5py"):
            import h5py
        with (
            refusals(self.path, self.kind),
            h5py.File(self.path, "r", rdcc_nbytes=CACHE_BYTES) as file,
        ):
            yield file

    def _require_here(self, array: h5py.Dataset) -> None:
        """Refuse what is elsewhere, or would fill the memory."""
        if array.external or array.is_virtual:
            raise LogError(f"{self.path}: the numbers of {array.name} are in another file")
        require_few_rows(self.path, array.shape[0])
        chunk = math.prod(array.chunks or (1,)) * array.dtype.itemsize
        if chunk > LARGEST_CHUNK:
            raise LogError(
                f"{self.path}: chunks of {array.name} have {chunk:,} bytes (at most "
                f"{LARGEST_CHUNK:,} are read): store it in smaller ones"
            )
        require_plausible(self.path, array.nbytes, array.id.get_storage_size())

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        streams: dict[str, dict[str, Column]] = {}
        with self._file() as file:
            import h5py

            groups: list[str] = []

            def collect(_: str, item: Any) -> None:
                if isinstance(item, h5py.Dataset) and item.shape:
                    self._collect_from(item, streams.setdefault(item.parent.name, {}))

            def list_group(name: str, item: Any) -> None:
                if name.count("/") > DEEPEST or len(groups) > MOST_COLUMNS:
                    raise LogError(
                        f"{self.path} has more than {MOST_COLUMNS:,} groups, or {DEEPEST} in "
                        "each other"
                    )
                if isinstance(item, h5py.Group):
                    groups.append(name)

            file.visititems(list_group)
            if self.chosen is not None and self.chosen.strip("/") not in groups:
                valid = f"choose among {', '.join(groups)}" if groups else "it has no groups"
                raise LogError(f"{self.path} has no group {self.chosen!r}: {valid}")
            start = file[self.chosen or "/"]
            start.visititems(collect)
            place = start.name
        streams = {name: columns for name, columns in streams.items() if columns}
        if not streams:
            raise LogError(f"{self.path} holds no arrays with one or two axes in {place}")
        return streams

    def _collect_from(self, array: h5py.Dataset, columns: dict[str, Column]) -> None:
        name = array.name.rsplit("/", 1)[-1]
        if array.ndim == 1:
            fields = array.dtype.names or ()
            singles = {field: field for field in fields if not array.dtype[field].shape}
            self._collect(columns, array.name, singles if fields else {name: ...})
        if array.ndim != 2 or array.shape[1] > WIDEST:
            return
        self._collect(columns, array.name, {f"{name}_{k}": k for k in range(array.shape[1])})


class ParquetFormat(LogFormat):
    """One table."""

    name = "parquet"
    endings = (".parquet", ".pq")

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        with refusals(self.path, "Parquet file"):
            return {stream_name(self.path): tuple(self._scan().collect_schema())}

    def batches(self, stream: str, names: Sequence[str]) -> Generator[Batch]:
        import polars

        with refusals(self.path, "Parquet file"):
            frame = self._scan()
            for name, kind in frame.select(names).collect_schema().items():
                if kind in (polars.String, polars.Binary):  # a few bytes may stand for gigabytes
                    raise LogError(f"{self.path}: column {name!r} holds {kind}, not numbers")
            count = frame.select(polars.len()).collect().item()
            common_length(self.path, dict.fromkeys(names, count))
            require_plausible(self.path, 8 * count * len(names), self.path.stat().st_size)
            for rows in row_blocks(count, BATCH_ROWS):
                size = rows.stop - rows.start
                part = frame.select(names).slice(rows.start, size).collect()
                if part.height < size:
                    raise LogError(
                        f"{self.path} is damaged: it has fewer rows than it says, {count}"
                    )
                yield Batch(part, numbers(rows))

    def _scan(self) -> polars.LazyFrame:
        import polars

        # Names of files may hold what else would stand for several files.
        return polars.scan_parquet(self.path, glob=False, hive_partitioning=False)


def common_length(path: Path, lengths: Mapping[str, int]) -> int:
    """How many rows columns have; a LogError when they differ, or there are none."""
    if not any(lengths.values()):
        raise LogError(f"{path} has no rows in {', '.join(lengths)}")
    if len(set(lengths.values())) > 1:
        short, long = (pick(lengths, key=lambda name: lengths[name]) for pick in (min, max))
        raise LogError(
            f"{path}: {short!r} has {lengths[short]} rows, but {long!r} has {lengths[long]}"
        )
    count = next(iter(lengths.values()))
    require_few_rows(path, count)
    return count


def require_few_rows(path: Path, count: int) -> None:
    """Refuse a log that says, or is seen, to be longer than any."""
    if count > MOST_ROWS:
        raise LogError(f"{path} has more than {MOST_ROWS:,} rows: split it into several logs")


def numbers(rows: slice) -> IntArray:
    """Numbers of rows, from 1."""
    return np.arange(rows.start + 1, rows.stop + 1)


def array_batch(source: str | Path, columns: Mapping[str, NDArray[Any]], rows: IntArray) -> Batch:
    """Columns (R,) of numbers or times, with the numbers of their rows."""
    import polars

    cells = {}
    for name, column in columns.items():
        if column.dtype.kind not in "biufUmM":
            raise LogError(f"{source}: column {name!r} holds {column.dtype}, not numbers")
        # Polars takes neither every size and order of bytes, nor every unit of time.
        kind: Any = np.float64 if column.dtype.kind == "f" else column.dtype.newbyteorder("=")
        if column.dtype.kind in "mM":
            unit = np.datetime_data(kind)[0]
            kind = f"{kind.kind}8[{unit if unit in ('ms', 'us', 'ns') else 'ms'}]"
        cells[name] = column.astype(kind, copy=False)
    return Batch(polars.DataFrame(cells), rows)


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
        raise LogError(f"{path} is no {kind}, or is damaged: {said}") from error


@contextmanager
def optional(package: str) -> Iterator[None]:
    """Name the extra that brings a library which is not installed."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError.of(package, "logs") from error
