"""The YAML that says which columns of a log are what, for logs that do not say it themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from loopid.arguments import checked
from loopid.errors import LogError, MissingFileError, OptionError
from loopid.loading import Section, first_problem, read_yaml

UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # in ns

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class TimeColumns(Section):
    """One column with a unit, or two that add up."""

    column: str | None = None
    unit: Literal["s", "ms", "us", "ns"] = "s"
    seconds: str | None = None
    nanoseconds: str | None = None

    @model_validator(mode="after")
    def _one_way(self) -> TimeColumns:
        pair = [self.seconds, self.nanoseconds]
        if self.column is None and None in pair:
            raise ValueError("give 'column', or both 'seconds' and 'nanoseconds'")
        if self.column is not None and pair != [None, None]:
            raise ValueError("give either 'column', or 'seconds' and 'nanoseconds'")
        return self


class StreamColumns(Section):
    """Columns in the order of the motors; without names, all but those of the time."""

    stream: str | None = None
    columns: list[str] | None = None

    @model_validator(mode="after")
    def _something(self) -> StreamColumns:
        if self.stream is None and self.columns is None:
            raise ValueError("give 'stream', 'columns' or both")
        return self


def _kind(value: Any) -> str:
    if isinstance(value, StreamColumns):
        return "<several>"
    if isinstance(value, dict):
        return "<several>" if {"stream", "columns"} & set(value) else "<by joint>"
    return "<one>"


Columns = Annotated[
    Annotated[StreamColumns, Tag("<several>")] | Annotated[dict[str, str], Tag("<by joint>")],
    Discriminator(lambda value: "<several>" if _kind(value) == "<several>" else "<by joint>"),
]
Scales = Annotated[
    Annotated[Finite, Tag("<one>")] | Annotated[dict[str, Finite], Tag("<by joint>")],
    Discriminator(lambda value: "<by joint>" if isinstance(value, dict) else "<one>"),
]
Limits = Annotated[
    Annotated[Positive, Tag("<one>")] | Annotated[dict[str, Positive], Tag("<by joint>")],
    Discriminator(lambda value: "<by joint>" if isinstance(value, dict) else "<one>"),
]


class LogMapping(Section):
    """Which columns hold time, positions and forces, and in which units.

    All may be left out. ``position`` and ``force`` give the column of each joint, as ``column`` or
    ``stream:column``, or list the columns in the order of the motors. Values times the scale, plus
    the offset, are in m or rad, and N or N m; numbers hold for all joints, or are given by joint.
    ``topic`` chooses among those of a bag, ``group`` among those of an HDF5 file.

    Raises
    ------
    OptionError
        Naming the key, the value and what is valid.
    """

    format: Literal["csv", "npz", "parquet", "hdf5", "bag", "folder"] | None = None
    topic: str | None = None
    group: str | None = None
    time: TimeColumns | None = None
    position: Columns | None = None
    force: Columns | None = None
    position_scale: Scales = 1.0
    position_offset: Scales = 0.0
    force_scale: Scales = 1.0
    force_offset: Scales = 0.0
    saturation: Limits | None = None
    idle_speed: Positive | None = None

    def __init__(self, **content: Any) -> None:
        try:
            super().__init__(**content)
        except ValidationError as error:
            raise OptionError(first_problem(error)) from error

    # Files are validated as before, without passing here.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @model_validator(mode="after")
    def _scales_are_not_zero(self) -> LogMapping:
        for name in ("position_scale", "force_scale"):
            scale = getattr(self, name)
            if 0 in (scale.values() if isinstance(scale, dict) else (scale,)):
                raise ValueError(f"{name} must not be 0")
        return self


@checked
def read_mapping(path: str | Path) -> LogMapping:
    """Read and validate a mapping file.

    Raises
    ------
    MissingFileError
        When it is not there.
    LogError
        Naming the key, the value and what is valid.
    """
    try:
        return read_yaml(Path(path), LogMapping, LogError)
    except FileNotFoundError as error:
        raise MissingFileError(f"there is no mapping {path}") from error
    except OSError as error:
        raise LogError(f"mapping {path} cannot be read: {error.strerror}") from error
