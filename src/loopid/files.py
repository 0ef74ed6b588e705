"""Files: written whole or not at all; texts in blocks of lines."""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
import stat
import tempfile
import zlib
from collections.abc import Generator, Mapping, Sequence
from errno import EISDIR
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from loopid.errors import FileError, LogError, OptionError, near

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

BLOCK_BYTES = 2**20  # of text that are read at a time
MOST_BESIDE = 1000  # files in a folder that are looked at for the one that was meant
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


def near_file(path: Path, others: Sequence[str] = ()) -> str:
    """Which file beside a path, or which of other names, likely was meant; empty if none is near.

    A name without its ending is that of the file.
    """
    try:
        beside = [each.name for each in islice(path.parent.iterdir(), MOST_BESIDE)]
    except (OSError, ValueError):
        return ""
    whole = next((name for name in sorted(beside) if Path(name).stem == path.name), path.name)
    return near(whole, [name for name in (*others, *beside) if name != path.name])


def text_blocks(path: Path) -> Generator[bytes]:
    """A text, packed with gzip or not, in blocks of whole lines; the last one may lack its end."""
    if reason := why_no_file(path):
        raise LogError(f"{path} {reason}", file=path)
    try:
        with path.open("rb") as file:
            packed = file.peek(2).startswith(b"\x1f\x8b")
            content: io.BufferedIOBase = gzip.GzipFile(fileobj=file) if packed else file
            rest = b""
            while part := content.read(BLOCK_BYTES):
                lines, end, rest = (rest + part).rpartition(b"\n")
                if end:
                    yield lines + end
                if len(rest) > LONGEST_LINE:
                    raise LogError(
                        f"{path} has a line of more than {LONGEST_LINE:,} bytes: it is no table "
                        "with a sample a line",
                        file=path,
                        tolerance=LONGEST_LINE,
                    )
            if rest:
                yield rest
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(f"{path} cannot be read: {error}", file=path) from error


def write_files(folder: str | Path, contents: Mapping[str, bytes | str]) -> list[Path]:
    """Write files into a folder, made where it is missing.

    Each is written beside its place and moved there once all are complete. So a stop in the middle
    leaves the old files as they were.

    Names are without folders. A FileError says why the folder or a file cannot be written.
    """
    directory, waiting = Path(folder), dict[Path, Path]()
    require_folder(folder)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name in contents:
            # Known beforehand, lest some files be replaced and others not.
            if (directory / name).is_dir():
                raise IsADirectoryError(
                    EISDIR, "it is a folder: name a file", str(directory / name)
                )
        for name, content in contents.items():
            waiting[directory / name] = _write_beside(directory / name, content)
        for place, draft in waiting.items():
            draft.replace(place)
    except OSError as error:
        reason = error.strerror or str(error)
        target = directory / next(iter(contents)) if len(contents) == 1 else directory
        raise FileError(f"cannot write to {error.filename or target}: {reason}") from error
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
        raise FileError(f"cannot write to {folder}: {existing} is a file: name another folder")
    if not os.access(existing, os.W_OK):
        raise FileError(f"cannot write to {folder}: no permission in {existing}")


def require_name(path: str | Path, what: str) -> None:
    """Refuse an empty text, which would stand for the folder that one is in."""
    if isinstance(path, str) and not path.strip():
        raise FileError(f"{what} has no name: give a path, not {path!r}", given=path)


def require_ending(path: str | Path, endings: Sequence[str]) -> str:
    """The ending of a path, by which files of its kind are known; an OptionError of another."""
    ending = Path(path).suffix.lower()
    if ending not in endings:
        raise OptionError.unknown("ending", ending, endings, f" of {path}")
    return ending


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
