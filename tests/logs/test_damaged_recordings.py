"""Damaged files: one sentence, a warning, or all that was recorded; never a part in silence."""

import re
import shutil
import sqlite3
import warnings
from pathlib import Path

import numpy as np
import pytest
from recorded_logs import write_any

from loopid.errors import LogError, LoopidError, MissingFileError
from loopid.logs import LogMapping, read_log

COUNT = 120
FORMATS = ["parquet", "hdf5", "ros1", "db3", "mcap", "mcap file"]
CASES = 40


@pytest.fixture(scope="session")
def whole(truth, knee, tmp_path_factory):
    """Good files by format."""
    rows = slice(0, COUNT)
    run = truth.time[rows], truth.position[rows], truth.force[rows]
    return {
        kind: write_any(kind, tmp_path_factory.mktemp("whole"), knee.actuated, *run)
        for kind in FORMATS
    }


@pytest.fixture
def copy(whole, tmp_path):
    """A file or folder of a format, to spoil."""

    def make(kind):
        source, place = whole[kind], tmp_path / whole[kind].name
        return Path(
            shutil.copytree(source, place) if source.is_dir() else shutil.copy(source, place)
        )

    return make


def files_of(path):
    return sorted(path.iterdir()) if path.is_dir() else [path]


def spoilt(data, rng):
    """Bytes with some changed, lost, added, or without an end."""
    data, at = bytearray(data), int(rng.integers(len(data)))
    kind = rng.choice(["flip", "flips", "cut", "zeros", "add", "lose"])
    if kind == "flip":
        data[at] ^= int(rng.integers(1, 256))
    elif kind == "flips":
        for k in rng.integers(len(data), size=4):
            data[k] ^= int(rng.integers(1, 256))
    elif kind == "cut":
        del data[at:]
    elif kind == "zeros":
        data[at : at + 64] = bytes(len(data[at : at + 64]))
    elif kind == "add":
        data[at:at] = rng.bytes(int(rng.integers(1, 20)))
    else:
        del data[at : at + int(rng.integers(1, 50))]
    return bytes(data)


@pytest.mark.parametrize("kind", FORMATS)
def test_spoilt_bytes(knee, copy, kind):
    path, rng = copy(kind), np.random.default_rng(FORMATS.index(kind))
    good = {file: file.read_bytes() for file in files_of(path)}
    log, refusals = read_log(path, knee), []
    for _ in range(CASES):
        file = list(good)[rng.integers(len(good))]
        file.write_bytes(spoilt(good[file], rng))
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                there = read_log(path, knee)
            except LoopidError as error:
                refusals.append(str(error))
            else:
                assert said or len(there) == len(log)
        file.write_bytes(good[file])
    assert len(refusals) > CASES / 4
    assert all(path.name in sentence and "\n" not in sentence for sentence in refusals)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("part", [0.0, 0.01, 0.5, 0.9, 0.999])
def test_files_without_an_end_are_refused(knee, copy, kind, part):
    path = copy(kind)
    file = max(files_of(path), key=lambda file: file.stat().st_size)
    data = file.read_bytes()
    file.write_bytes(data[: int(part * len(data))])
    with pytest.raises(LogError, match=re.escape(str(path))):
        read_log(path, knee)


@pytest.mark.parametrize("name", ["run.parquet", "run.h5", "run.bag", "run.mcap", "run.db3"])
@pytest.mark.parametrize("content", [b"time,position\n0,1\n", bytes(1000), b"PK\x03\x04" * 99])
def test_files_of_another_kind_are_refused(knee, tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=rf"{name} is no .*, or is damaged: "):
        read_log(tmp_path / name, knee)
    with pytest.raises(MissingFileError):
        read_log(tmp_path / f"no_{name}", knee)


@pytest.mark.parametrize(
    ("kind", "old", "new", "message"),
    [
        (
            "ros1",
            rb"index_pos=.{8}",
            b"index_pos=" + bytes(8),
            "Bag is not indexed, reindex before reading",
        ),
        ("ros1", rb"V2\.0", b"V1.2", "Bag version 102 is not supported"),
        (
            "ros1",
            rb"compression=none",
            b"compression=blosc"[:16],
            "Compression 'blos' is not supported",
        ),
        ("ros1", rb"md5sum=3066", b"md5sum=3067", "JointState' hash mismatch"),
        (
            "mcap",
            rb"\x04\x00\x00\x00ros2",
            b"\x04\x00\x00\x00ros1",
            "Profile is not ros2",
        ),
        (
            "mcap",
            rb"message_count: 120",
            b"message_count: 121",
            "has 120 messages, but .* says 121",
        ),
        ("db3", rb"message_count: 120", b"message_count: 119", "has 120 messages, but .* says 119"),
        ("db3", rb"RIHS01_a", b"RIHS01_b", "JointState' hash mismatch"),
        ("db3", rb"serialization_format: cdr", b"serialization_format: xdr", "'xdr'} is not supp"),
        (
            "db3",
            rb"storage_identifier: sqlite3",
            b"storage_identifier: tape",
            "'tape' not supported",
        ),
    ],
)
def test_what_is_wrong_with_a_bag_is_said(knee, copy, kind, old, new, message):
    path, changed = copy(kind), 0
    for file in files_of(path):
        data, count = re.subn(old, lambda _: new, file.read_bytes(), flags=re.DOTALL)
        file.write_bytes(data)
        changed += count
    assert changed
    with pytest.raises(LogError, match=message):
        read_log(path, knee)


def test_encrypted_bags_are_refused(knee, copy):
    path = copy("ros1")
    data = path.read_bytes()
    # A field more in the first header, of 16 bytes, for 16 fewer of the padding behind.
    field = (12).to_bytes(4, "little") + b"encryptor=ab"
    start = len(b"#ROSBAG V2.0\n")
    length = int.from_bytes(data[start : start + 4], "little")
    body = start + 4 + length
    padding = int.from_bytes(data[body : body + 4], "little")
    header = (length + 16).to_bytes(4, "little") + data[start + 4 : body] + field
    rest = (padding - 16).to_bytes(4, "little") + data[body + 20 :]
    path.write_bytes(data[:start] + header + rest)
    with pytest.raises(LogError, match="Bag encryption 'ab' is not supported"):
        read_log(path, knee)


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_bags_without_their_description_are_refused(knee, copy, kind):
    path = copy(kind)
    (path / "metadata.yaml").unlink()
    with pytest.raises(LogError, match=r"has no metadata\.yaml: recording was not finished"):
        read_log(path, knee)


def test_messages_that_sqlite_has_not_brought_in_are_not_forgotten(knee, copy):
    path = copy("db3")
    database = sqlite3.connect(path / "run.db3")
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("DELETE FROM messages WHERE id > 60")
    database.commit()
    for place in (path, path / "run.db3"):
        with pytest.raises(LogError, match=r"was not closed: run\.db3-wal holds messages"):
            read_log(place, knee)
    database.close()


@pytest.mark.parametrize("mark", ["#", "?", "%41"])
def test_names_that_sqlite_takes_for_something_else(knee, copy, mark):
    path = copy("db3")
    path = path.rename(path.with_name(f"run{mark}"))
    with pytest.raises(LogError, match=f"SQLite takes '{re.escape(mark[0])}' in a path for someth"):
        read_log(path, knee)
    file = (path / "run.db3").rename(path.parent / f"{mark}.db3")
    with pytest.raises(LogError, match="SQLite takes"):
        read_log(file, knee)


@pytest.mark.parametrize(
    ("kind", "name"), [("parquet", "hdf5"), ("hdf5", "bag"), ("ros1", "parquet")]
)
def test_the_wrong_format_in_a_mapping(knee, whole, kind, name):
    with pytest.raises(LogError, match="or is damaged: "):
        read_log(whole[kind], knee, LogMapping(format=name))
