"""Files: written whole or not at all, and read within limits that no real one meets."""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
import stat
import tempfile
import zlib
from collections.abc import Callable, Generator, Mapping, Sequence
from errno import EISDIR
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from loopid.errors import FileError, LogError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

BLOCK_BYTES = 2**20  # of text that are read at a time
# The one limit of sizes. What stands for more bytes than this, and for this many times as many as
# its file has, is no measurement but a bomb.
UNPACKED_BYTES, UNPACKED_RATIO = 2**24, 200.0
GZIP_SIZE = 4  # bytes at the end of a packed file
LONGEST_LINE = 200_000  # bytes; a thousand columns with all digits take 25,000
PLAIN_NAME = re.compile(r"""[^\s,;"']+""")  # of a column: nothing that separates or quotes


def why_no_file(path: Path) -> str:
    """What keeps a path from being a file, as the end of a sentence; empty where it is one."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return "does not exist"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    except ValueError as error:  # as of names with null characters
        return f"is no path: {error}"
    if stat.S_ISDIR(mode):
        return "is a folder"
    return "" if stat.S_ISREG(mode) else "is no regular file"


class Ceiling:
    """How many bytes a file, or a folder of files, may stand for; counts those that are unpacked.

    The way out, for files to be trusted, ends the sentence of a refusal.
    """

    def __init__(self, path: Path, ratio: float = UNPACKED_RATIO, way_out: str = "") -> None:
        files = filter(Path.is_file, path.iterdir()) if path.is_dir() else [path]
        self.path, self.ratio, self.way_out = path, ratio, way_out
        self.stored, self.content = sum(file.stat().st_size for file in files), 0

    def count(self, content: int) -> None:
        """Add bytes to those that the file stands for; a LogError where these are too many."""
        self.content += content
        if self.content > max(UNPACKED_BYTES, self.ratio * self.stored):
            raise LogError(
                f"{self.path} stores {self.stored:,} bytes, but they stand for {self.content:,} or "
                f"more: files are read up to {self.ratio:g} times their size{self.way_out}",
                file=self.path,
                stored=self.stored,
                content=self.content,
                tolerance=self.ratio,
            )

    def unpack(self, kind: Callable[[], Any], data: bytes) -> bytes:
        """Packed data of one frame after another, by a kind of decompressor, in blocks."""
        parts: list[bytes] = []
        while data:
            one = kind()
            while not one.eof:
                parts.append(one.decompress(data, BLOCK_BYTES))
                self.count(len(parts[-1]))
                if not parts[-1] and one.needs_input:
                    raise EOFError("packed data end too early")
                data = b""
            data = one.unused_data
        return b"".join(parts)


def text_blocks(path: Path, ceiling: Ceiling | None = None) -> Generator[bytes]:
    """A text, packed with gzip or not, in blocks of whole lines; the last one may lack its end."""
    reason = why_no_file(path)
    if reason:
        raise LogError(f"{path} {reason}", file=path)
    ceiling = ceiling or Ceiling(path)
    try:
        with path.open("rb") as file:
            packed = file.peek(2).startswith(b"\x1f\x8b")
            content: io.BufferedIOBase = gzip.GzipFile(fileobj=file) if packed else file
            parts: list[bytes] = []
            while part := content.read(BLOCK_BYTES):
                ceiling.count(len(part))
                end = part.rfind(b"\n") + 1
                if end:
                    yield _lines(path, b"".join([*parts, part[:end]]))
                    parts.clear()
                parts.append(part[end:])
                if sum(map(len, parts)) > LONGEST_LINE:
                    break
            if any(parts):
                yield _lines(path, b"".join(parts))
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(f"{path} cannot be read: {error}", file=path) from error


def _lines(path: Path, block: bytes) -> bytes:
    """A block of lines; a LogError for one that is longer than those of tables."""
    # A line that is too long leaves a window of half its length without an end.
    half = LONGEST_LINE // 2
    for start in range(0, len(block), half):
        if block.find(b"\n", start, start + half) < 0:
            first = block.rfind(b"\n", 0, start) + 1
            last = block.find(b"\n", start)
            if (last if last >= 0 else len(block)) - first > LONGEST_LINE:
                raise LogError(
                    f"{path} has a line of more than {LONGEST_LINE:,} bytes: it is no table with a "
                    "sample a line",
                    file=path,
                    tolerance=LONGEST_LINE,
                )
    return block


def count_unpacked(path: Path, ceiling: Ceiling) -> None:
    """Refuse a text packed with gzip that is too large, before anything is made of it."""
    with path.open("rb") as file:
        if file.peek(2).startswith(b"\x1f\x8b"):
            try:
                # The end states the size of the last part modulo 2³²: most bombs are found at once.
                file.seek(-min(GZIP_SIZE, ceiling.stored), os.SEEK_END)
                Ceiling(path, ceiling.ratio, ceiling.way_out).count(
                    int.from_bytes(file.read(GZIP_SIZE), "little")
                )
                file.seek(0)
                content = gzip.GzipFile(fileobj=file)
                while part := content.read(BLOCK_BYTES):
                    ceiling.count(len(part))
            except (OSError, EOFError, zlib.error) as error:
                raise LogError(f"{path} cannot be read: {error}", file=path) from error


def write_files(folder: str | Path, contents: Mapping[str, bytes | str]) -> list[Path]:
    """Write files into a folder, made where it is missing.

    Each is written beside its place and moved there once all are complete, so that a stop in the
    middle leaves the old files as they were.

    Names are without folders. A FileError says why the folder or a file cannot be written.
    """
    directory, waiting = Path(folder), dict[Path, Path]()
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name in contents:
            # Known beforehand, lest some files be replaced and others not.
            if (directory / name).is_dir():
                raise IsADirectoryError(EISDIR, "it is a folder", str(directory / name))
        for name, content in contents.items():
            waiting[directory / name] = _write_beside(directory / name, content)
        for place, draft in waiting.items():
            draft.replace(place)
    except OSError as error:
        reason = error.strerror or str(error)
        raise FileError(f"cannot write to {error.filename or directory}: {reason}") from error
    except ValueError as error:  # as of names with null characters
        raise FileError(f"cannot write to {directory}: {error}") from error
    finally:
        for draft in waiting.values():
            draft.unlink(missing_ok=True)
    return list(waiting)


def csv_text(names: Sequence[str], *columns: ArrayLike, digits: int = 9) -> str:
    """Columns (N,) or (N, k) of numbers as a table of text below their names."""
    import numpy as np  # here, as the command line imports this file at once

    text = io.StringIO()
    plain = all(map(PLAIN_NAME.fullmatch, names))  # else one would be split, or lose its quotes
    quoting: Literal[0, 1] = csv.QUOTE_MINIMAL if plain else csv.QUOTE_ALL
    csv.writer(text, quoting=quoting, lineterminator="\n").writerow(names)
    np.savetxt(text, np.column_stack(columns), f"%.{digits}g", ",")
    return text.getvalue()


def require_folder(folder: str | Path) -> None:
    """Refuse a folder that cannot be written to before the work whose results it is for."""
    place = Path(folder).absolute()
    there = ("", "is a folder", "is no regular file")
    existing = next(path for path in (place, *place.parents) if why_no_file(path) in there)
    if not existing.is_dir():
        raise FileError(f"cannot write to {folder}: {existing} is not a folder")
    if not os.access(existing, os.W_OK):
        raise FileError(f"cannot write to {folder}: no permission in {existing}")


def require_name(path: str | Path, what: str) -> None:
    """Refuse an empty text, which would stand for the folder that one is in."""
    if isinstance(path, str) and not path.strip():
        raise FileError(f"{what} has no name: give a path, not {path!r}", given=path)


def require_own_kind(path: str | Path, endings: Sequence[str]) -> None:
    """Refuse to write over a file of another kind, by its ending."""
    place = Path(path)
    if place.exists() and not place.name.lower().endswith(tuple(endings)):
        raise FileError(
            f"{path} exists, and is of another kind than {', '.join(endings)}: name another file",
            file=str(path),
            valid=tuple(endings),
        )


def require_other_file(path: str | Path, *inputs: str | Path) -> None:
    """Refuse to write over a file that the result is made from."""
    place = Path(path)
    for given in map(Path, inputs):
        if place.exists() and given.exists() and place.samefile(given):
            raise FileError(f"{path} is {given.name}, which this is made from: name another file")


def write_file(path: str | Path, content: bytes | str) -> None:
    """Write one file whole or not at all; see ``write_files``."""
    write_files(Path(path).parent, {Path(path).name: content})


def _write_beside(place: Path, content: bytes | str) -> Path:
    # Names of files need not be text that can be encoded.
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    handle, draft = tempfile.mkstemp(dir=place.parent, prefix=f".{place.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        umask = os.umask(0)
        os.umask(umask)
        Path(draft).chmod(0o666 & ~umask)
    except BaseException:
        Path(draft).unlink(missing_ok=True)
        raise
    return Path(draft)
