"""Tables that Polars reads: Parquet, lines of JSON, the first sheet of a workbook of Excel."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from loopid.errors import optional
from loopid.logs.table import LogFormat, Table, common_length, refusals, stream_name

if TYPE_CHECKING:
    import polars


class ParquetFormat(LogFormat):
    """One table."""

    endings = (".parquet", ".pq")

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        with refusals(self.path, "Parquet file"):
            return {stream_name(self.path): tuple(self._scan().collect_schema())}

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        with refusals(self.path, "Parquet file"):
            cells = self._scan().select((*times, *values)).collect()
            common_length(self.path, dict.fromkeys(cells.columns, len(cells)))
            return [Table(cells, np.arange(1, len(cells) + 1))]

    def _scan(self) -> polars.LazyFrame:
        import polars

        # Names of files may hold what else would stand for several files.
        return polars.scan_parquet(self.path, glob=False, hive_partitioning=False)


class WholeTable(LogFormat):
    """One table; lists are columns ``x_0``, ``x_1``, ..., and objects ``x.field``."""

    kind = ""

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        return {stream_name(self.path): tuple(self._cells.columns)}

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        cells = self._cells.select([*dict.fromkeys((*times, *values))])
        return [Table(cells, np.arange(1, len(cells) + 1))]

    @cached_property
    def _cells(self) -> polars.DataFrame:
        import polars

        with refusals(self.path, self.kind):
            frame = self._frame()
            columns = [part for column in frame.get_columns() for part in _parts(column)]
            if not len(frame):
                raise self.refused("has no rows")
            return polars.DataFrame(columns)

    @abstractmethod
    def _frame(self) -> polars.DataFrame: ...


class JsonLinesFormat(WholeTable):
    """An object a line."""

    endings = (".jsonl", ".ndjson")
    kind = "table of JSON lines"

    def _frame(self) -> polars.DataFrame:
        import polars

        return polars.read_ndjson(self.path, infer_schema_length=None)


class ExcelFormat(WholeTable):
    """The first sheet, with names in its first row."""

    endings = (".xlsx", ".xls")
    kind = "workbook of Excel"

    def _frame(self) -> polars.DataFrame:
        import polars

        with optional("fastexcel", "logs"):
            import fastexcel  # noqa: F401 - Polars asks for it
        return polars.read_excel(self.path)


def _parts(column: polars.Series) -> Iterator[polars.Series]:
    """A column, or those of its lists or objects."""
    import polars

    if isinstance(column.dtype, polars.Struct):
        for part in column.struct.unnest().get_columns():
            yield from _parts(part.alias(f"{column.name}.{part.name}"))
    elif isinstance(column.dtype, polars.List):
        for k in range(int(column.list.len().max() or 0)):
            yield from _parts(column.list.get(k, null_on_oob=True).alias(f"{column.name}_{k}"))
    else:
        yield column
