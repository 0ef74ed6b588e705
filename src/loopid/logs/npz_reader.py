"""Logs in NumPy's .npz: one array a column, or a matrix for several."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from loopid.errors import LogError, MissingFileError
from loopid.logs.npz_member import Member, column_blocks, read_members
from loopid.logs.reader import LogReader
from loopid.logs.table import Table
from loopid.scratch import row_blocks


class NpzReader(LogReader):
    """Arrays (R,) are columns; a matrix ``x`` (R, k) stands for columns ``x_0`` to ``x_k-1``."""

    format = "npz"

    def accepts(self, path: Path) -> bool:
        return path.suffix.lower() == ".npz" and not path.is_dir()

    def columns(self, path: Path) -> dict[str, tuple[str, ...]]:
        with _refusals(path), zipfile.ZipFile(path) as archive:
            return {path.stem: tuple(_columns(path, archive))}

    def read(self, path: Path, stream: str, names: Sequence[str]) -> Iterator[Table]:
        with _refusals(path), zipfile.ZipFile(path) as archive:
            found = _columns(path, archive)
            count = _common_length(path, {name: found[name][0].rows for name in names})
            blocks = [column_blocks(archive, *found[name]) for name in names]
            for rows in row_blocks(count):
                columns = {name: next(block) for name, block in zip(names, blocks, strict=True)}
                numbers = np.arange(rows.start + 1, rows.stop + 1)
                yield Table(str(path), columns, numbers, np.empty(0, dtype=np.int64))


def _columns(path: Path, archive: zipfile.ZipFile) -> dict[str, tuple[Member, int]]:
    """The array that each column is in, and its place there."""
    columns = {}
    for member in read_members(archive):
        if len(member.shape) == 1:
            columns[member.name] = member, 0
        elif len(member.shape) == 2:
            columns.update((f"{member.name}_{k}", (member, k)) for k in range(member.shape[1]))
    if not columns:
        raise LogError(f"{path} holds no arrays with one or two axes")
    return columns


def _common_length(path: Path, lengths: dict[str, int]) -> int:
    if len(set(lengths.values())) > 1:
        short, long = (pick(lengths, key=lambda name: lengths[name]) for pick in (min, max))
        raise LogError(
            f"{path}: {short!r} has {lengths[short]} rows, but {long!r} has {lengths[long]}"
        )
    return next(iter(lengths.values()))


@contextmanager
def _refusals(path: Path) -> Iterator[None]:
    try:
        yield
    except FileNotFoundError as error:
        raise MissingFileError(f"there is no log {path}") from error
    except LogError:
        raise
    except (OSError, ValueError, EOFError, KeyError, TypeError, AttributeError) as error:
        raise LogError(f"{path} is no .npz of numbers: {error}") from error
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise LogError(f"{path} is damaged: {error}") from error
