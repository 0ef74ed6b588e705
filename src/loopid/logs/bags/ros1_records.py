"""Records of a bag of ROS 1, format 2.0: a header of fields name=value, then data."""

from __future__ import annotations

import bz2
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import IO

CHUNK = 5
LENGTH, STAMP, COUNTS, PLACE = (struct.Struct(f"<{code}") for code in ("L", "LL", "LL", "Q"))

Fields = dict[bytes, bytes]


def chunk_records(file: IO[bytes], place: int) -> Iterator[tuple[Fields, bytes]]:
    """The records in the chunk at a place of the file."""
    file.seek(place)
    fields, data = record(file, CHUNK)
    content = _unpacked(data, fields[b"compression"].decode())
    if len(content) != number_in(fields, b"size"):
        raise ValueError("a chunk has another size than it says")
    records = BytesIO(content)
    while records.tell() < len(content):
        yield record(records)


def _unpacked(data: bytes, compression: str) -> bytes:
    if compression == "none":
        return data
    if compression == "bz2":
        return bz2.decompress(data)
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        return bytes(lz4.frame.decompress(data))
    raise ValueError(f"its chunks are packed by {compression!r}")


def record(file: IO[bytes], kind: int | None = None) -> tuple[Fields, bytes]:
    """The next record, of a kind."""
    fields = parsed(_sized(file))
    if kind is not None and fields[b"op"][0] != kind:
        raise ValueError(f"a record is of type {fields[b'op'][0]}, not {kind}")
    return fields, _sized(file)


def _sized(file: IO[bytes]) -> bytes:
    (count,) = LENGTH.unpack(_exactly(file, LENGTH.size))
    return _exactly(file, count)


def _exactly(file: IO[bytes], count: int) -> bytes:
    data = file.read(count)
    if len(data) < count:
        raise ValueError("it ends in the middle of a record")
    return data


def parsed(header: bytes) -> Fields:
    """The fields of a header."""
    fields, at = {}, 0
    while at < len(header):
        (count,) = LENGTH.unpack_from(header, at)
        at += LENGTH.size
        name, _, value = header[at : at + count].partition(b"=")
        fields[name] = value
        at += count
    return fields


def number_in(fields: Fields, name: bytes) -> int:
    """A field that holds a whole number."""
    (number,) = LENGTH.unpack(fields[name])
    return int(number)


def nanoseconds(stamp: bytes) -> int:
    """A time in seconds and nanoseconds."""
    seconds, rest = STAMP.unpack(stamp)
    return int(seconds * 10**9 + rest)
