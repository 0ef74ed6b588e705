"""Logs in Parquet files, read by Polars some rows at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from loopid.errors import LogError
from loopid.logs.reader import LogReader
from loopid.logs.refusals import optional, refusals
from loopid.logs.table import NO_STAMP, Table, common_length
from loopid.logs.text_lines import stream_name
from loopid.scratch import row_blocks

if TYPE_CHECKING:
    import polars

# Rows that are decoded at a time: each time costs a look into every row group that they touch.
SLICE_ROWS = 2**16


class ParquetReader(LogReader):
    """One table, with columns of numbers, dates or durations; empty cells are no numbers."""

    format = "parquet"

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.suffix.lower() in (".parquet", ".pq") and not path.is_dir()

    def columns(self) -> dict[str, tuple[str, ...]]:
        with self._opened() as frame:
            return {stream_name(self._path): tuple(frame.collect_schema())}

    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        path = self._path
        with self._opened() as frame:
            import polars

            schema = frame.collect_schema()
            for name in names:
                _refuse_strange(path, name, schema[name])
            count = frame.select(polars.len()).collect().item()
            common_length(path, dict.fromkeys(names, count))
            for rows in row_blocks(count, SLICE_ROWS):
                part = frame.select(names).slice(rows.start, rows.stop - rows.start).collect()
                if part.height < rows.stop - rows.start:
                    raise LogError(f"{path} is damaged: it has fewer rows than it says, {count}")
                cells = {name: _cells(part[name]) for name in names}
                for block in row_blocks(part.height):
                    columns = {name: column[block] for name, column in cells.items()}
                    yield Table.of_rows(str(path), columns, rows.start + block.start)

    @contextmanager
    def _opened(self) -> Iterator[polars.LazyFrame]:
        with optional("polars"):
            import polars
        # An error of its compiled part that it did not expect is no Exception.
        with refusals(self._path, "Parquet file", polars.exceptions.PanicException):
            # Names of files may hold what else would stand for several files.
            yield polars.scan_parquet(self._path, glob=False, hive_partitioning=False)


def _refuse_strange(path: Path, name: str, kind: polars.DataType) -> None:
    import polars

    times = (polars.Datetime, polars.Duration, polars.Time)
    if not kind.is_numeric() and kind not in times:
        raise LogError(f"{path}: column {name!r} holds {kind}, not numbers")


def _cells(column: polars.Series) -> NDArray[Any]:
    """Its numbers, or dates and durations in a type that knows their unit."""
    import polars

    if column.dtype.is_temporal():
        unit = getattr(column.dtype, "time_unit", "ns")
        kind = "M8" if column.dtype == polars.Datetime else "m8"
        whole = column.to_physical().fill_null(int(NO_STAMP)).to_numpy()
        typed: NDArray[Any] = whole.view(f"{kind}[{unit}]")
        return typed
    if column.dtype.is_integer() and column.null_count():
        # As floats, stamps would lose digits.
        cells = [np.nan if cell is None else cell for cell in column.to_list()]
        return np.array(cells, dtype=object)
    plain = column.cast(polars.Float64) if column.dtype.is_decimal() else column
    numbers: NDArray[Any] = plain.to_numpy()
    return numbers
