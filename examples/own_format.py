"""A format of logs that loopid does not know: a class and a line, without a change inside loopid.

Here a controller writes Arrow files. Formats of robot files and dialects of URDF are
registered alike (``loopid.registry``).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import polars

import loopid
from loopid.logs.table import LogFormat, Table
from loopid.registry import log_formats

CSV = Path(__file__).parents[1] / "urdf" / "logs" / "five_bar.csv"


class Arrow(LogFormat):
    """One stream, a sample a row."""

    endings = (".arrow",)

    def columns(self) -> Mapping[str, tuple[str, ...]]:
        """Names of the columns of the stream."""
        return {self.path.name: tuple(polars.read_ipc_schema(self.path))}

    def tables(self, stream: str, times: Sequence[str], values: Sequence[str]) -> Sequence[Table]:
        """The chosen columns, with the numbers of their rows."""
        cells = polars.read_ipc(self.path).select(*times, *values)
        return [Table(cells, np.arange(1, len(cells) + 1))]


log_formats.register("arrow", Arrow)

robot = loopid.load("five_bar")
with TemporaryDirectory() as folder:
    path = Path(folder) / "run.arrow"
    polars.read_csv(CSV).write_ipc(path)
    log = loopid.read_log(path, robot)
print(log)
print(loopid.prepare(robot, log))
