"""What a library says of a damaged file, as one sentence of ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from loopid.errors import LogError, LoopidError, MissingExtraError, MissingFileError

LONGEST_REASON = 200


@contextmanager
def refusals(path: Path, kind: str, *unusual: type[BaseException]) -> Iterator[None]:
    """Turn errors of reading a file into a sentence that names it.

    Parameters
    ----------
    path : Path
    kind : str
        What the file should be, as in "HDF5 file".
    *unusual : type
        Errors of the library that are no ``Exception``.

    Raises
    ------
    MissingFileError, LogError
    """
    # Damaged bytes make libraries fail in any way: assertions, lookups, sizes beyond the memory.
    failures: tuple[type[BaseException], ...] = (Exception, *unusual)
    try:
        yield
    except FileNotFoundError as error:
        raise MissingFileError(f"there is no log {path}") from error
    except (LoopidError, Warning):
        raise
    except failures as error:
        raise LogError(f"{path} is no {kind}, or is damaged: {_reason(error)}") from error


@contextmanager
def optional(package: str) -> Iterator[None]:
    """Name the extra that brings a library which is not installed."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(package, "logs") from error


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError | OverflowError):
        return "a size in it is beyond all memory"
    if isinstance(error, KeyError):
        name = error.args[0] if error.args else ""
        return f"{name.decode() if isinstance(name, bytes) else name!r} is missing"
    said = " ".join(str(error).split()) or type(error).__name__
    return said if len(said) <= LONGEST_REASON else f"{said[:LONGEST_REASON]} ..."
