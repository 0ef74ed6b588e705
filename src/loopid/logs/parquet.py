"""Logs in Parquet: one table of numbers, read by Polars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from loopid.errors import LogError
from loopid.files import require_plausible
from loopid.logs.formats import LogFormat, Table, common_length, refusals, stream_name

if TYPE_CHECKING:
    import polars


class ParquetFormat(LogFormat):
    """One table."""

    endings = (".parquet", ".pq")

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        with refusals(self.path, "Parquet file"):
            return {stream_name(self.path): tuple(self._scan().collect_schema())}

    def tables(self, stream: str, names: Sequence[str]) -> Sequence[Table]:
        import polars

        with refusals(self.path, "Parquet file"):
            frame = self._scan().select(names)
            for name, kind in frame.collect_schema().items():
                if kind in (polars.String, polars.Binary):  # a few bytes may stand for gigabytes
                    raise LogError(
                        f"{self.path}: column {name!r} holds {kind}, not numbers",
                        file=self.path,
                        column=name,
                    )
            count = frame.select(polars.len()).collect().item()
            common_length(self.path, dict.fromkeys(names, count))
            require_plausible(self.path, 8 * count * len(names), self.path.stat().st_size)
            cells = frame.collect()
            if cells.height < count:
                raise LogError(
                    f"{self.path} is damaged: it has fewer rows than it says, {count}",
                    file=self.path,
                )
            return [Table(cells, np.arange(1, count + 1))]

    def _scan(self) -> polars.LazyFrame:
        import polars

        # Names of files may hold what else would stand for several files.
        return polars.scan_parquet(self.path, glob=False, hive_partitioning=False)
