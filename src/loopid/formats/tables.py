"""Tables that Polars reads: Parquet, lines of JSON, the first sheet of a workbook of Excel."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import ClassVar

import numpy as np
import polars

from loopid.errors import optional
from loopid.logs.table import LogFormat, Table, common_length, refusals, stream_name


class TableFormat(LogFormat):
    """One table."""

    kind: ClassVar[str]

    @property
    @abstractmethod
    def _cells(self) -> polars.LazyFrame: ...

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        with refusals(self.path, self.kind):
            return {stream_name(self.path): tuple(self._cells.collect_schema())}

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        with refusals(self.path, self.kind):
            cells = self._cells.select([*dict.fromkeys((*times, *values))]).collect()
            common_length(self.path, dict.fromkeys(cells.columns, len(cells)))
            return [Table(cells, np.arange(1, len(cells) + 1))]


class ParquetFormat(TableFormat):
    """Only what is needed is read."""

    endings = (".parquet", ".pq")
    kind = "Parquet file"

    @cached_property
    def _cells(self) -> polars.LazyFrame:
        # Names of files may hold what else would stand for several files.
        return polars.scan_parquet(self.path, glob=False, hive_partitioning=False)


class JsonLinesFormat(TableFormat):
    """An object a line; lists are columns ``x_0``, ``x_1``, ..., and objects ``x.field``."""

    endings = (".jsonl", ".ndjson")
    kind = "table of JSON lines"

    @cached_property
    def _cells(self) -> polars.LazyFrame:
        frame = polars.read_ndjson(self.path, infer_schema_length=None)
        columns = [part for column in frame.get_columns() for part in _parts(column)]
        return polars.DataFrame(columns).lazy()


class ExcelFormat(TableFormat):
    """The first sheet, with names in its first row."""

    endings = (".xlsx", ".xls")
    kind = "workbook of Excel"

    @cached_property
    def _cells(self) -> polars.LazyFrame:
        with optional("fastexcel", "logs"):
            import fastexcel  # noqa: F401 - Polars asks for it
        return polars.read_excel(self.path).lazy()


def _parts(column: polars.Series) -> Iterator[polars.Series]:
    """A column, or those of its lists or objects."""
    if isinstance(column.dtype, polars.Struct):
        for part in column.struct.unnest().get_columns():
            yield from _parts(part.alias(f"{column.name}.{part.name}"))
    elif isinstance(column.dtype, polars.List):
        for k in range(int(column.list.len().max() or 0)):
            yield from _parts(column.list.get(k, null_on_oob=True).alias(f"{column.name}_{k}"))
    else:
        yield column
