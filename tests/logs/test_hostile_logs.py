"""Small files that stand for more than any memory, or for other files, are refused before."""

import bz2
import gzip
import io
import os
import resource
import sqlite3
import time
import zipfile
import zlib
from contextlib import closing
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from recorded_logs import STATE, STORES, joint_state, write_ros2
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import storage_mcap as mcap, writer as rosbag2_writer

import loopid
from loopid.errors import LogError
from loopid.logs import read_log

h5py = pytest.importorskip("h5py")
lz4 = pytest.importorskip("lz4.frame")
polars = pytest.importorskip("polars")
NAMES = ("time", "crank_joint.position", "crank_joint.force")
HEAD = ",".join(NAMES)
ROWS = "".join(f"{k / 100},{k / 1000},{k % 7}\n" for k in range(300))
ZEROS = b"\n0,0,0" * 2**18
ARABIC = ROWS.replace("1", "\u0661")


def npy(shape, content=b"", dtype="<f8", fortran=False):
    """The bytes of an array that says to have a shape."""
    stream = io.BytesIO()
    header = {"descr": dtype, "fortran_order": fortran, "shape": shape}
    np.lib.format.write_array_header_1_0(stream, header)
    return stream.getvalue() + content


def npz(**arrays):
    def write(path):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in arrays.items():
                with archive.open(f"{name}.npy", "w") as member:
                    for part in content if isinstance(content, list) else [content]:
                        member.write(part)

    return write


def bomb(rows):
    return [npy((rows,)), *[bytes(2**20)] * (rows * 8 // 2**20)]


def twice(path):
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("time", "position", "force"):
            archive.writestr(f"{name}.npy", npy((9,), bytes(72)))
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr("force.npy", npy((9,), bytes(72)))


def packed(*parts):
    def write(path):
        with gzip.open(path, "wb", 1) as file:
            for part in parts:
                file.write(part)

    return write


def hdf5(**options):
    def write(path):
        with h5py.File(path, "w") as file:
            for name in NAMES:
                file.create_dataset(name, dtype="f8", **options)

    return write


def external(path):
    place = path.parent / "pipe"
    os.mkfifo(place)
    with h5py.File(path, "w") as file:
        for name in NAMES:
            file.create_dataset(name, (1000,), "f8", external=[(str(place), 0, 8000)])


def linked(path):
    with h5py.File(path, "w") as file:
        file["run"] = h5py.ExternalLink(str(path.parent / "other.h5"), "/")


def parquet(path):
    zeros = polars.select(polars.repeat(0.0, 10**6)).to_series()
    polars.DataFrame(dict.fromkeys(NAMES, zeros)).write_parquet(path, row_group_size=10**6)


def false_page(path):
    """The first page says to be of 2 GB, in its second number."""
    polars.DataFrame({name: np.arange(300.0) for name in NAMES}).write_parquet(path)
    content = path.read_bytes()
    size = b"\xfe\xff\xff\xff\x0f"
    path.write_bytes(content[:7] + size + content[content.index(b"\x15", 7) :])


def folder(make):
    def write(path):
        path.mkdir()
        (path / "force.csv").write_text(f"{HEAD}\n{ROWS}")
        make(path / "position.csv")

    return write


def long_texts(path):
    text = ["1" * 10**6] * 50  # some KB, and as many rows as one likes
    polars.DataFrame(dict.fromkeys(NAMES, text)).write_parquet(path)


def text(content):
    return lambda path: path.write_text(content)


ZERO_MB = 64  # that a bomb is of, above the 16 MB of any file


def ros1_bomb(packed):
    """A chunk that says to be of its own size."""
    content = {"BZ2": bz2.compress, "LZ4": lz4.compress}[packed](bytes(ZERO_MB * 2**20))

    def write(path):
        writer = Ros1Writer(path)
        writer.set_compression(Ros1Writer.CompressionFormat[packed])
        writer.compressor = lambda _: content
        with writer:
            store, kind = STORES["ros1"], STATE
            connection = writer.add_connection("/joint_states", kind, typestore=store)
            message = joint_state("ros1", 0, ["crank_joint"], [0.0], (), [0.0])
            writer.write(connection, 0, store.serialize_ros1(message, kind))

    return write


def ros2_bomb(storage, packed):
    def write(path):
        bomb = mcap.zstd.compress(bytes(ZERO_MB * 2**20))
        state = joint_state("ros2", 0, ["crank_joint"], [0.0], (), [0.0])
        packing = SimpleNamespace(compress=lambda _: bomb)
        with patch.object(rosbag2_writer, "zstd", packing), patch.object(mcap, "zstd", packing):
            write_ros2(path, [(0, "/joint_states", state)], storage, packed)

    return write


def packed_file(path):
    state = joint_state("ros2", 0, ["crank_joint"], [0.0], (), [0.0])
    write_ros2(path, [(0, "/joint_states", state)], "db3", "file")
    (file,) = path.glob("*.zstd")
    file.write_bytes(mcap.zstd.compress(bytes(ZERO_MB * 2**20)))


def generated(path):
    """A table whose messages are made as they are read."""
    state = joint_state("ros2", 0, ["crank_joint"], [0.0], (), [0.0])
    write_ros2(path, [(0, "/joint_states", state)], "db3")
    (file,) = path.glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.executescript(
            f"""CREATE TABLE other(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
            data BLOB GENERATED ALWAYS AS (zeroblob({ZERO_MB * 2**20})));
            INSERT INTO other(id, topic_id, timestamp) SELECT id, topic_id, timestamp FROM messages;
            DROP TABLE messages; ALTER TABLE other RENAME TO messages;"""
        )


def false_chunks(**options):
    """Chunks of 8 KB that unpack to more."""

    def write(path):
        with h5py.File(path, "w") as file:
            for name in NAMES:
                array = file.create_dataset(name, (1000,), "f8", chunks=(1000,), **options)
                array.id.write_direct_chunk((0,), zlib.compress(bytes(ZERO_MB * 2**20)))

    return write


def packed_twice(path):
    with h5py.File(path, "w") as file:
        for name in NAMES:
            made = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            made.set_chunk((1000,))
            made.set_deflate(9)
            made.set_deflate(9)
            place = h5py.h5s.create_simple((1000,)), made
            h5py.h5d.create(file.id, name.encode(), h5py.h5t.NATIVE_DOUBLE, *place)


def one_text(path):
    with h5py.File(path, "w") as file:
        for name in NAMES:
            file.create_dataset(name, (1000,), h5py.string_dtype())


def other_zip(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as archive:
        for name, content in {**SMALL, "force_0": npy((9,), bytes(72))}.items():
            archive.writestr(f"{name}.npy", content)


LONG_HEADER = b"\x93NUMPY\x02\x00" + (ZERO_MB * 2**20).to_bytes(4, "little")
SMALL = {"time": npy((9,), bytes(72)), "position_0": npy((9,), bytes(72))}
HOSTILE = {
    "a header of 1e7 rows": ("log.npz", npz(**SMALL, force_0=npy((10**7,))), "200 times"),
    "a header of 1e10 rows": ("log.npz", npz(**SMALL, force_0=npy((10**10,))), "200 times"),
    "a header of 1e30 rows": ("log.npz", npz(**SMALL, force_0=npy((10**30,))), "200 times"),
    "a matrix of 1e10 columns": ("log.npz", npz(**SMALL, force_0=npy((9, 10**10))), "no force"),
    "a bomb of 40 MB": ("log.npz", npz(**SMALL, force_0=bomb(5 * 2**20)), "up to 200 times"),
    "an array twice": ("log.npz", twice, "has column 'force' in force and force"),
    "objects": ("log.npz", npz(**SMALL, force_0=npy((9,), bytes(72), "|O")), "bject arrays"),
    "1e12 rows that are not there": ("log.h5", hdf5(shape=(10**12,), chunks=(1024,)), "200 times"),
    "chunks of 1.6 GB": ("log.h5", hdf5(shape=(2 * 10**8,), chunks=(2 * 10**8,)), "200 times"),
    "false chunks": ("log.h5", false_chunks(compression="gzip"), "another size than it says"),
    "chunks packed twice": ("log.h5", packed_twice, "otherwise than once by gzip or lzf"),
    "texts": ("log.h5", one_text, "holds object, not numbers"),
    "a zip by bzip2": ("log.npz", other_zip, "packed in another way than NumPy's"),
    "a long header": (
        "log.npz",
        npz(**SMALL, force_0=[LONG_HEADER, *[bytes(2**20)] * ZERO_MB]),
        "array header",
    ),
    "a bag by bz2": ("log.bag", ros1_bomb("BZ2"), "up to 200 times"),
    "a bag by lz4": ("log.bag", ros1_bomb("LZ4"), "up to 200 times"),
    "packed messages": ("log", ros2_bomb("db3", "message"), "up to 200 times"),
    "packed chunks": ("log", ros2_bomb("mcap", "storage"), "up to 200 times"),
    "a packed bag": ("log", packed_file, "up to 200 times"),
    "messages of nothing": ("log", generated, "too big"),
    "numbers in a pipe": ("log.h5", external, "in another file"),
    "another file": ("log.h5", linked, "holds no arrays"),
    "a group of another file": ("log.h5", linked, "has no group 'run': it has no groups"),
    "one long text": ("log.parquet", long_texts, "holds String, not numbers"),
    "a page of 2 GB": ("log.parquet", false_page, "reported the wrong page size"),
    "rows of one value": ("log.parquet", parquet, "up to 200 times"),
    "a packed line of 40 MB": (
        "log.csv.gz",
        packed(HEAD.encode(), *[b"1," * 2**19] * 40),
        "a line of more than 200,000 bytes",
    ),
    "a line of 40 MB": ("log.csv", text("1," * 2**24), "a line of more than 200,000 bytes"),
    "a line of 40 MB below others": (
        "log.csv",
        text(f"{HEAD}\n{ROWS}{'1,' * 2**24}"),
        "a line of more than 200,000 bytes",
    ),
    "rows of 20,000 cells": ("log.csv", text(f"{'1,' * 20_000}\n" * 30), "at most 10,000 are read"),
    "rows of 2,000 cells": ("log.csv", text(f"{'1,' * 2_000}\n" * 30), "starts with numbers"),
    "a bomb of 1 MB": ("log.csv.gz", packed(HEAD.encode(), *[ZEROS] * 150), "200 times"),
    "zeros of 18 MB": ("log.csv.gz", packed(HEAD.encode(), *[ZEROS] * 12), "200 times"),
    "a link to /dev/zero": ("log", folder(lambda p: p.symlink_to("/dev/zero")), "position.csv"),
    "a pipe": ("log", folder(os.mkfifo), "position.csv"),
    "digits of another script": ("log.csv", text(f"{HEAD}\n{ARABIC}"), "no n"),
    "numbers of Python": ("log.csv", text(f"{HEAD}\n{ROWS.replace('.', '_0.')}"), "no number in"),
}


@pytest.mark.skipif(os.name != "posix", reason="makes pipes")
@pytest.mark.parametrize("kind", HOSTILE)
def test_hostile_files_are_refused_in_one_sentence(kind, tmp_path):
    name, write, said = HOSTILE[kind]
    write(tmp_path / name)
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text("group: run\n" if "group" in kind else "{}\n")
    robot = loopid.load("four_bar")
    start, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(LogError) as refusal:
        read_log(tmp_path / name, robot, mapping=mapping)
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert time.process_time() - start < (2 if ".csv" in name else 30)
    assert more < 2e5  # kB


def test_a_log_to_be_trusted_is_read_however_well_it_is_packed(tmp_path):
    robot, (path, plain) = (
        loopid.load("four_bar"),
        (tmp_path / "log.csv.gz", tmp_path / "log.csv"),
    )
    wide = ROWS.replace("\n", " " * 60_000 + "\n")
    packed(f"{HEAD}\n{wide}".encode())(path)
    plain.write_text(f"{HEAD}\n{ROWS}")
    with pytest.raises(LogError, match="'unpacked_ratio' in a mapping") as refusal:
        read_log(path, robot)
    assert refusal.value.facts["tolerance"] == 200
    (tmp_path / "mapping.yaml").write_text("unpacked_ratio: 2000")
    log = read_log(path, robot, mapping=tmp_path / "mapping.yaml")
    np.testing.assert_array_equal(log.force, read_log(plain, robot).force)


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_in_any_order_are_read(order, tmp_path):
    table = np.loadtxt(io.StringIO(ROWS), delimiter=",")
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{ROWS}")
    columns = np.asarray(table[:, [1, 1]], order=order)
    np.savez_compressed(tmp_path / "log.npz", time=table[:, 0], state=columns, force_0=table[:, 2])
    (tmp_path / "mapping.yaml").write_text("position: {crank_joint: state_1}\n")
    robot = loopid.load("four_bar")
    given = read_log(tmp_path / "log.npz", robot, mapping=tmp_path / "mapping.yaml")
    np.testing.assert_array_equal(given.position, read_log(tmp_path / "log.csv", robot).position)


def test_a_time_that_is_also_a_position_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text(f"{HEAD}\n{ROWS}")
    (tmp_path / "mapping.yaml").write_text("position: {crank_joint: time}\n")
    robot = loopid.load("four_bar")
    with pytest.raises(LogError) as refusal:
        read_log(tmp_path / "log.csv", robot, mapping=tmp_path / "mapping.yaml")
    assert refusal.value.facts["column"] == "time"
