"""Formats of logs: text, NumPy, Parquet and HDF5 behind one interface (bags of ROS: ``bags``).

A log is one or more named streams; a stream is a table. Text and Parquet are read by Polars, HDF5
by h5py. Where these read damaged files without a word, the checks are here.
"""

from __future__ import annotations

import gzip
import io
import zlib
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from decimal import Decimal
from functools import cached_property
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from loopid.arrays import FloatArray, IntArray
from loopid.errors import LogError, LoopidError, MissingExtraError
from loopid.scratch import row_blocks

if TYPE_CHECKING:  # slow to import, and only needed to read a log
    import h5py
    import polars

TEXT_ENDINGS = (".csv", ".txt", ".tsv")
OTHER_ENDINGS = (".npz", ".parquet", ".pq", ".h5", ".hdf5", ".bag", ".mcap", ".db3")
PACKED = ".gz"
# Rows, and bytes of text, that are read at a time.
BATCH_ROWS, BATCH_BYTES = 2**16, 2**20
COMMENT = "#"
# Of separators that split a header into equally many cells, the first is taken; None is any space.
SEPARATORS = ("\t", ";", ",", None)
AROUND_CELLS = " \t\r\"'"
# Larger numbers (in the file's units) are no measurements, and would overflow later.
LARGEST_NUMBER = 1e15
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # in ns
NO_STAMP = np.iinfo(np.int64).min
LARGEST_STAMP = 9 * 10**18  # ns: 1e19 would overflow, and 9e18 is the year 2255
# Wider matrices of an HDF5 file are pictures or the like, not columns.
WIDEST = 1000
# Bytes of unpacked chunks of an HDF5 file that are kept for each array.
CACHE_BYTES = 2**24
LONGEST_REASON = 200


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
    def batches(self, stream: str, names: Sequence[str]) -> Iterator[Batch]:
        """Some columns of a stream that share their rows; a LogError when they cannot be read."""


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
        stamp = Decimal(cell or "nan") * unit
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
    """One table of text: a header, then one sample a line; packed with gzip or not."""

    name = "csv"
    endings = (*TEXT_ENDINGS, *(f"{ending}{PACKED}" for ending in TEXT_ENDINGS))

    @cached_property
    def _files(self) -> dict[str, Path]:
        return {stream_name(self.path): self.path}

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: read_header(file).names for stream, file in self._files.items()}

    def source(self, stream: str) -> str:
        return str(self._files[stream])

    def batches(self, stream: str, names: Sequence[str]) -> Iterator[Batch]:
        """Some columns as text.

        Polars splits the lines and Python counts their cells: Polars alone fills short rows, cuts
        long ones, passes over blank ones, and numbers none.
        """
        path = self._files[stream]
        header, read, found = read_header(path), 0, 0
        separator, width = (header.separator or " ").encode(), len(header.names)
        places = {name: header.names.index(name) for name in names}
        with closing(_lines(path)) as blocks:
            for lines in blocks:
                numbered = [
                    (row, line)
                    for row, line in enumerate(lines, read + 1)
                    if row > header.lines and line.strip()
                ]
                read, cut_off = read + len(lines), None
                if numbered and not numbered[-1][1].endswith(b"\n"):
                    cut_off, _ = numbered.pop()
                if header.separator is None:
                    numbered = [(row, b" ".join(line.split()) + b"\n") for row, line in numbered]
                fine = [line.count(separator) == width - 1 for _, line in numbered]
                text = b"".join(line for _, line in compress(numbered, fine))
                if header.separator != ",":
                    text = text.replace(b",", b".")  # decimal commas
                rows, whole = np.array([row for row, _ in numbered], np.int64), np.array(fine, bool)
                found += sum(fine)
                cells = _cells(text, separator.decode(), places)
                yield Batch(cells, rows[whole], rows[~whole], cut_off)
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
        files = [f for f in sorted(self.path.glob("*")) if f.name.lower().endswith(self.endings)]
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
    """The first line that is no comment or, above bare numbers, the last comment."""
    first = found = None
    with closing(_lines(path)) as blocks:
        for row, data in enumerate((line for block in blocks for line in block), 1):
            line = data.decode("utf-8", "replace").rstrip("\r\n")
            line = line.removeprefix("\ufeff") if row == 1 else line
            if not line.strip():
                continue
            first = first or (row, line)
            comment = line.startswith(COMMENT)
            if comment or not _is_sample(line):
                found = row, line.lstrip(COMMENT).strip()
            if not comment:
                break
    if first is None:
        raise LogError(f"{path} is empty")
    if found is None:
        raise LogError(f"{path} has no header: row {first[0]} holds numbers, {first[1]!r:.60}")
    row, text = found
    if not text.replace("\t", " ").isprintable():
        raise LogError(f"{path} is no text: its first row is {text!r:.60}")
    separator = _separator(text)
    names = [name.strip(AROUND_CELLS) for name in text.split(separator)]
    repeated = sorted({name for name in names if name and names.count(name) > 1})
    if repeated:
        raise LogError(f"{path}: its header names column {repeated[0]!r} more than once")
    return Header(tuple(names), separator, row)


def _separator(header: str) -> str | None:
    return max(SEPARATORS, key=lambda separator: len(header.strip().split(separator)))


def _is_sample(line: str) -> bool:
    """Whether all cells of a line are numbers or empty."""
    separator = _separator(line)
    line = line if separator == "," else line.replace(",", ".")
    cells = [cell.strip(AROUND_CELLS) for cell in line.split(separator)]
    try:
        return bool([float(cell) for cell in cells if cell])
    except ValueError:
        return False


def _cells(text: bytes, separator: str, places: Mapping[str, int]) -> polars.DataFrame:
    """Columns of lines with equally many cells, as text."""
    import polars

    if not text:
        return polars.DataFrame(schema=dict.fromkeys(places, polars.String))
    table = polars.read_csv(
        text,
        has_header=False,
        separator=separator,
        columns=sorted(places.values()),
        infer_schema=False,
        quote_char=None,
        encoding="utf8-lossy",
    )
    table.columns = sorted(places, key=places.__getitem__)
    return table


def _lines(path: Path) -> Generator[list[bytes]]:
    """Lines with their ends, some at a time."""
    try:
        with path.open("rb") as file:
            packed = file.peek(2).startswith(b"\x1f\x8b")
            content: io.BufferedIOBase = gzip.GzipFile(fileobj=file) if packed else file
            while lines := content.readlines(BATCH_BYTES):
                yield lines
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(f"{path} cannot be read: {error}") from error


# ---- arrays and tables ------------------------------------------------------------------------


class NpzFormat(LogFormat):
    """Arrays (R,) are columns; a matrix ``x`` (R, k) stands for columns ``x_0`` to ``x_k-1``."""

    name = "npz"
    endings = (".npz",)

    @cached_property
    def _columns(self) -> dict[str, NDArray[Any]]:
        columns = {}
        with refusals(self.path, ".npz of numbers"), self.path.open("rb") as file:
            for name, array in np.lib.npyio.NpzFile(file).items():
                if array.ndim == 1:
                    columns[name] = array
                elif array.ndim == 2:
                    columns |= {f"{name}_{k}": column for k, column in enumerate(array.T)}
        if not columns:
            raise LogError(f"{self.path} holds no arrays with one or two axes")
        return columns

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream_name(self.path): tuple(self._columns)}

    def batches(self, stream: str, names: Sequence[str]) -> Iterator[Batch]:
        columns = {name: self._columns[name] for name in names}
        lengths = {name: len(column) for name, column in columns.items()}
        for rows in row_blocks(common_length(self.path, lengths), BATCH_ROWS):
            yield array_batch(self.path, {n: c[rows] for n, c in columns.items()}, numbers(rows))


class ParquetFormat(LogFormat):
    """One table."""

    name = "parquet"
    endings = (".parquet", ".pq")

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        with refusals(self.path, "Parquet file"):
            return {stream_name(self.path): tuple(self._scan().collect_schema())}

    def batches(self, stream: str, names: Sequence[str]) -> Iterator[Batch]:
        import polars

        with refusals(self.path, "Parquet file"):
            frame = self._scan()
            count = frame.select(polars.len()).collect().item()
            common_length(self.path, dict.fromkeys(names, count))
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


class Column(NamedTuple):
    """A column in an HDF5 file: all of an array, a column of a matrix, or a field of a table."""

    array: str
    place: Any = ...  # index behind that of the rows, or name of the field


class Hdf5Format(LogFormat):
    """A stream a group: arrays (R,), columns of matrices (R, k), and fields of tables.

    A matrix ``x`` stands for columns ``x_0`` to ``x_k-1``, or for those that its attribute
    ``columns`` names.
    """

    name = "hdf5"
    endings = (".h5", ".hdf5")
    choice = "group"
    ordered = False  # groups list their arrays by name

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream: tuple(columns) for stream, columns in self._streams.items()}

    def batches(self, stream: str, names: Sequence[str]) -> Iterator[Batch]:
        places = {name: self._streams[stream][name] for name in names}
        with self._opened() as file:
            arrays = {place.array: file[place.array] for place in places.values()}
            lengths = {name: len(arrays[place.array]) for name, place in places.items()}
            for rows in row_blocks(common_length(self.path, lengths), BATCH_ROWS):
                blocks = {array: values[rows] for array, values in arrays.items()}
                columns = {
                    name: block[place if isinstance(place, str) else (slice(None), place)]
                    for name, (array, place) in places.items()
                    for block in (blocks[array],)
                }
                yield array_batch(self.path, columns, numbers(rows))

    @contextmanager
    def _opened(self) -> Iterator[h5py.File]:
        import h5py

        with (
            refusals(self.path, "HDF5 file"),
            h5py.File(self.path, "r", rdcc_nbytes=CACHE_BYTES) as file,
        ):
            yield file

    @cached_property
    def _streams(self) -> dict[str, dict[str, Column]]:
        """Columns by name, for each group that holds any."""
        with optional("h5py"):
            import h5py
        streams: dict[str, dict[str, Column]] = {}
        groups: list[str] = []

        def collect(_: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset) or not item.shape:
                return
            columns = streams.setdefault(item.parent.name, {})
            for name, column in self._columns_of(item).items():
                if name in columns:
                    raise LogError(
                        f"{self.path}: group {item.parent.name} has column {name!r} in "
                        f"{columns[name].array} and {item.name}"
                    )
                columns[name] = column

        with self._opened() as file:
            start = file if self.chosen is None else file.get(self.chosen)
            if not isinstance(start, h5py.Group):
                file.visititems(
                    lambda at, x: groups.append(at) if isinstance(x, h5py.Group) else None
                )
                valid = f"choose among {', '.join(groups)}" if groups else "it has no groups"
                raise LogError(f"{self.path} has no group {self.chosen!r}: {valid}")
            start.visititems(collect)
            place = start.name
        streams = {name: columns for name, columns in streams.items() if columns}
        if not streams:
            raise LogError(f"{self.path} holds no arrays with one or two axes in {place}")
        return streams

    def _columns_of(self, array: h5py.Dataset) -> dict[str, Column]:
        name = array.name.rsplit("/", 1)[-1]
        if array.ndim == 1:
            if array.dtype.names is None:
                return {name: Column(array.name)}
            fields = [field for field in array.dtype.names if not array.dtype[field].shape]
            return {field: Column(array.name, field) for field in fields}
        if array.ndim != 2 or array.shape[1] > WIDEST:
            return {}
        names = [f"{name}_{k}" for k in range(array.shape[1])]
        given = array.attrs.get("columns")
        if given is not None:  # as texts, or as one text with commas
            cells = np.atleast_1d(np.asarray(given, dtype=object)).ravel().tolist()
            texts = [cell.decode() if isinstance(cell, bytes) else str(cell) for cell in cells]
            names = [part.strip() for part in texts[0].split(",")] if len(texts) == 1 else texts
        if len(names) != array.shape[1] or len(set(names)) < len(names):
            raise LogError(
                f"{self.path}: the attribute 'columns' of {array.name} must hold {array.shape[1]} "
                f"different names, not {', '.join(names)}"
            )
        return {name: Column(array.name, k) for k, name in enumerate(names)}


def common_length(path: Path, lengths: Mapping[str, int]) -> int:
    """How many rows columns have; a LogError when they differ, or there are none."""
    if not any(lengths.values()):
        raise LogError(f"{path} has no rows in {', '.join(lengths)}")
    if len(set(lengths.values())) > 1:
        short, long = (pick(lengths, key=lambda name: lengths[name]) for pick in (min, max))
        raise LogError(
            f"{path}: {short!r} has {lengths[short]} rows, but {long!r} has {lengths[long]}"
        )
    return next(iter(lengths.values()))


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
        raise MissingExtraError(package, "logs") from error
