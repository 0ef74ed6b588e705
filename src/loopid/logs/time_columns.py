"""Which columns of a stream are its time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import IntArray
from loopid.errors import LogError
from loopid.logs.catalogue import Catalogue
from loopid.logs.mapping import UNITS, TimeColumns
from loopid.logs.table import NO_STAMP, Table

# Names that are known without a mapping, whatever their case.
PAIRS = (("time_sec", "time_nanosec"), ("sec", "nanosec"), ("secs", "nsecs"))
SINGLES = {"time": "s", "t": "s", "timestamp": "s"} | {f"time_{unit}": unit for unit in UNITS}


@dataclass(frozen=True)
class TimeColumn:
    """A column of times, and how many nanoseconds its unit has.

    Attributes
    ----------
    name : str
    unit : int
    rest : str or None
        A second column, which adds whole nanoseconds below one second.
    """

    name: str
    unit: int
    rest: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The one or two columns."""
        return (self.name,) if self.rest is None else (self.name, self.rest)

    def stamps(self, table: Table) -> IntArray:
        """Whole nanoseconds (R,), ``NO_STAMP`` where there is no time."""
        stamps = table.stamps(self.name, self.unit)
        if self.rest is None:
            return stamps
        rest = table.stamps(self.rest, 1)
        valid = (stamps != NO_STAMP) & (rest >= 0) & (rest < UNITS["s"])
        return np.where(valid, stamps + np.where(valid, rest, 0), NO_STAMP)


def find_time(catalogue: Catalogue, stream: str, given: TimeColumns | None) -> TimeColumn:
    """The time of a stream, as the mapping gives it or by its usual names.

    Raises
    ------
    LogError
        When it is not found, or there are several.
    """
    if given is not None:
        return _given(catalogue, stream, given)
    names = {name.casefold(): name for name in catalogue.of_stream(stream)}
    for seconds, nanoseconds in PAIRS:
        if seconds in names and nanoseconds in names:
            return TimeColumn(names[seconds], UNITS["s"], names[nanoseconds])
    found = [name for name in SINGLES if name in names]
    if len(found) == 1:
        return TimeColumn(names[found[0]], UNITS[SINGLES[found[0]]])
    problem = f"several columns for the time ({', '.join(found)})" if found else "no time"
    raise LogError(
        f"{catalogue.source}: {stream} has {problem}: call one column time, or name it in a "
        f"mapping; {catalogue.choices()}"
    )


def _given(catalogue: Catalogue, stream: str, given: TimeColumns) -> TimeColumn:
    names = [n for n in (given.column, given.seconds, given.nanoseconds) if n is not None]
    missing = [name for name in names if name not in catalogue.of_stream(stream)]
    if missing:
        raise LogError(
            f"{catalogue.source}: {stream} has no column {missing[0]!r} for the time: "
            f"{catalogue.choices()}"
        )
    if given.column is not None:
        return TimeColumn(given.column, UNITS[given.unit])
    return TimeColumn(names[0], UNITS["s"], names[1])
