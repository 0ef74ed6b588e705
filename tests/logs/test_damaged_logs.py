"""However a log is spoilt: one sentence, a warning, or all of it; never a part in silence."""

import re
import shutil
import sqlite3
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from recorded_logs import write_any

import loopid
from loopid.errors import FileError, LogError, LoopidError
from loopid.identification import log_faults
from loopid.logs import LogMapping, read_log

POSITIONS, FORCES = (1, 2, 3, 4), (5, 6, 7, 8)


def at(fraction, sequence):
    return int(fraction * len(sequence))


def scale(lines, columns, factor):
    for row, line in enumerate(lines[1:], 1):
        cells = line.split(",")
        for k in columns:
            cells[k] = repr(float(cells[k]) * factor)
        lines[row] = ",".join(cells)


def drop_column(lines, column):
    lines[:] = [",".join(np.delete(line.split(","), column)) for line in lines]


def shuffle(lines, seed):
    order = np.random.default_rng(seed).permutation(len(lines) - 1)
    lines[1:] = [lines[1 + k] for k in order]


def fill(lines, place, length, column, text):
    start = at(place, lines) + 1
    for k in range(start, min(start + length, len(lines))):
        cells = lines[k].split(",")
        cells[column] = text
        lines[k] = ",".join(cells)


def lose(lines, place, length):
    start = at(place, lines) + 1
    del lines[start : start + length]


def repeat(lines, place, length):
    start = at(place, lines)
    lines[start:start] = lines[start : start + length]


def rename(lines, header):
    lines[0] = header.replace("\n", " ")


def cut(lines, place):
    text = "\n".join(lines)
    lines[:] = text[: at(place, text)].split("\n")


def insert(lines, place, garbage):
    text = "\n".join(lines)
    k = at(place, text)
    lines[:] = (text[:k] + garbage + text[k:]).split("\n")


places = st.floats(0, 1, exclude_max=True)
lengths, columns = st.integers(1, 400), st.integers(0, 8)
# No digits: a digit more inside a number leaves a number.
garbage = st.text(alphabet="\x00\x01\x85\u2028é\ufeff\n\r\t#,\"'", min_size=1)
texts = st.sampled_from(["", "nan", "-inf", "1e300", "-1e12", "0x1", "1e", "--", '"', "x" * 999])
spoilers = st.one_of(
    st.tuples(st.just(scale), st.just(POSITIONS), st.sampled_from([1e3, 1e-3, 1e6, 57.3, -1.0])),
    st.tuples(st.just(scale), st.just(FORCES), st.sampled_from([1e3, 1e-3, -1.0])),
    st.tuples(st.just(scale), st.just((0,)), st.sampled_from([1e3, 1e6, 1e9, -1.0, 0.0])),
    st.tuples(st.just(drop_column), columns),
    st.tuples(st.just(shuffle), st.integers(0, 99)),
    st.tuples(st.just(fill), places, lengths, columns, texts | garbage),
    st.tuples(st.just(lose), places, lengths),
    st.tuples(st.just(repeat), places, lengths),
    st.tuples(st.just(rename), st.text(max_size=60)),
    st.tuples(st.just(cut), places),
    st.tuples(st.just(insert), places, garbage),
    st.tuples(st.just(list.clear)),
)


class Case:
    """A good log, and a folder to spoil it in; short in the reports of failing examples."""

    def __init__(self, robot, truth, text, folder):
        self.robot, self.truth, self.text, self.folder = robot, truth, text, folder

    def __repr__(self):
        return "case"

    def read(self, data):
        """The log and its recording; None when there was an error or a warning."""
        path = self.folder / "log.csv"
        path.write_bytes(data)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                log = read_log(path, self.robot)
                recording = loopid.prepare(self.robot, log)
            except LoopidError:
                return None
        return None if caught else (log, recording)

    def check(self, data):
        """Of a log that is read and looked at without a word, all that is read is right.

        Over a few lost rows it is a straight line, where friction can jump. The log's time
        starts with its own first sample, which may be another one than the truth's.
        """
        result, truth = self.read(data), self.truth
        if result is None:
            return
        log, recording = result
        first = np.abs(truth.position - log.position[0]).sum(axis=1)
        errors = []
        for shift in truth.time[first < 1e-7] - log.time[0]:
            rows = log.time + shift
            exact = [np.interp(rows, truth.time, column) for column in truth.position.T]
            force = [np.interp(rows, truth.time, column) for column in truth.force.T]
            strange = np.percentile(np.abs(log.force - np.transpose(force)), 98)
            errors.append((np.abs(log.position - np.transpose(exact)).max(), strange))
        least = min(errors, default=(np.inf, np.inf))
        if not (least[0] < 2e-5 and least[1] < 0.5 and np.isfinite(recording.force).all()):
            judged = log_faults(self.robot, [recording])
            # Little motion does not tell whether forces are those of the robot.
            assert judged.mistakes or not judged.gains


@pytest.fixture(scope="module")
def case(knee, truth, good_text, tmp_path_factory):
    return Case(knee, truth, good_text, tmp_path_factory.mktemp("spoilt"))


@pytest.mark.validate
@settings(max_examples=3)
@given(spoil=st.lists(spoilers, min_size=1, max_size=3))
@example(spoil=[(scale, FORCES, 1e-3)])
@example(spoil=[(lose, 0.0, 1)])
@example(spoil=[(lose, 0.5, 3)])
@example(spoil=[(cut, 0.999)])
@example(spoil=[(scale, FORCES, -1.0), (cut, 0.0625)])
def test_spoilt_tables(case, spoil):
    lines = case.text.splitlines()
    for change, *arguments in spoil:
        try:
            change(lines, *arguments)
        except (ValueError, IndexError):
            continue  # an earlier one left nothing to spoil
    case.check("\n".join(lines).encode())


COUNT = 120
FORMATS = ["csv.gz", "npz", "parquet", "hdf5", "ros1", "db3", "mcap", "mcap file"]
CASES = 16


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


def spoilt_bytes(data, rng):
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


@pytest.mark.validate
@pytest.mark.parametrize("kind", FORMATS)
def test_spoilt_bytes(knee, copy, kind):
    path, rng = copy(kind), np.random.default_rng(FORMATS.index(kind))
    good = {file: file.read_bytes() for file in files_of(path)}
    log, refusals = read_log(path, knee), []
    for _ in range(CASES):
        file = list(good)[rng.integers(len(good))]
        file.write_bytes(spoilt_bytes(good[file], rng))
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
@pytest.mark.parametrize("part", [0.01, 0.5, 0.999])
def test_files_without_an_end_are_refused(knee, copy, kind, part):
    path = copy(kind)
    file = max(files_of(path), key=lambda file: file.stat().st_size)
    data = file.read_bytes()
    file.write_bytes(data[: int(part * len(data))])
    with pytest.raises(LogError, match=re.escape(str(path))):
        read_log(path, knee)


@pytest.mark.parametrize("ending", ["npz", "parquet", "h5", "bag", "mcap", "db3"])
@pytest.mark.parametrize("content", [b"time,position\n0,1\n", bytes(1000), b"PK\x03\x04" * 99])
def test_files_of_another_kind_are_refused(knee, tmp_path, ending, content):
    name = f"run.{ending}"
    (tmp_path / name).write_bytes(content)
    with pytest.raises(LogError, match=rf"{name} is no .*, or is damaged: "):
        read_log(tmp_path / name, knee)
    with pytest.raises(FileError):
        read_log(tmp_path / f"no_{name}", knee)


@pytest.mark.parametrize(
    ("kind", "old", "new", "message"),
    [
        ("ros1", rb"V2\.0", b"V1.2", "Bag version 102 is not supported"),
        ("ros1", rb"md5sum=3066", b"md5sum=3067", "JointState' hash mismatch"),
        (
            "mcap",
            rb"message_count: 120",
            b"message_count: 121",
            "has 120 messages, but .* says 121",
        ),
        ("db3", rb"message_count: 120", b"message_count: 119", "has 120 messages, but .* says 119"),
        ("db3", rb"RIHS01_a", b"RIHS01_b", "JointState' hash mismatch"),
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


def test_empty_folders_and_arrays_are_refused(knee, tmp_path):
    with pytest.raises(LogError, match="holds no streams"):
        read_log(tmp_path, knee)
    np.savez(tmp_path / "log.npz", x=np.float64(3))
    with pytest.raises(LogError, match="holds no arrays with one or two axes"):
        read_log(tmp_path / "log.npz", knee)


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
    with pytest.raises(LogError, match=f"SQLite cannot have '{re.escape(mark[0])}' in a path"):
        read_log(path, knee)
    file = (path / "run.db3").rename(path.parent / f"{mark}.db3")
    with pytest.raises(LogError, match="SQLite cannot"):
        read_log(file, knee)


@pytest.mark.parametrize(
    ("kind", "name"), [("parquet", "hdf5"), ("hdf5", "bag"), ("ros1", "parquet")]
)
def test_the_wrong_format_in_a_mapping(knee, whole, kind, name):
    with pytest.raises(LogError, match="or is damaged: "):
        read_log(whole[kind], knee, mapping=LogMapping(format=name))
