"""Logs in NumPy's .npz: one array a column, or a matrix for several."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from loopid.errors import LogError, MissingFileError
from loopid.logs.npz_member import Member, column_blocks, read_members
from loopid.logs.reader import LogReader
from loopid.logs.table import Table, common_length
from loopid.logs.text_lines import stream_name
from loopid.scratch import row_blocks


class NpzReader(LogReader):
    """Arrays (R,) are columns; a matrix ``x`` (R, k) stands for columns ``x_0`` to ``x_k-1``."""

    format = "npz"

    @classmethod
    def accepts(cls, path: Path) -> bool:
        return path.suffix.lower() == ".npz" and not path.is_dir()

    def columns(self) -> dict[str, tuple[str, ...]]:
        path = self._path
        with _refusals(path), zipfile.ZipFile(path) as archive:
            return {stream_name(path): tuple(_columns(path, archive))}

    def read(self, stream: str, names: Sequence[str]) -> Iterator[Table]:
        path = self._path
        with _refusals(path), zipfile.ZipFile(path) as archive:
            found = _columns(path, archive)
            count = common_length(path, {name: found[name][0].rows for name in names})
            blocks = [column_blocks(archive, *found[name]) for name in names]
            for rows in row_blocks(count):
                columns = {name: next(block) for name, block in zip(names, blocks, strict=True)}
                yield Table.of_rows(str(path), columns, rows.start)


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
