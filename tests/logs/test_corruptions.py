"""However a log is spoilt: a LoopidError, or a warning, or the right result, nothing else."""

import gzip
import io
import warnings

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from loopid.errors import LoopidError
from loopid.logs import prepare_recording, read_log

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
        packed = io.BytesIO()
        np.savez_compressed(packed, time=truth.time, position=truth.position, force=truth.force)
        self.packs = {"log.npz": packed.getvalue(), "log.csv.gz": gzip.compress(text.encode())}

    def __repr__(self):
        return "case"

    def read(self, name, data):
        """The log and its recording; None when there was an error or a warning."""
        (self.folder / name).write_bytes(data)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                log = read_log(self.folder / name, self.robot)
                recording = prepare_recording(self.robot, log)
            except LoopidError:
                return None
        return None if caught else (log, recording)

    def check(self, name, data):
        """Of a log that is read without a word, all that is read is right.

        Over a few lost rows it is a straight line, where friction can jump. The log's time
        starts with its own first sample, which may be another one than the truth's.
        """
        result, truth = self.read(name, data), self.truth
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
        worst = min(errors)
        assert worst[0] < 2e-5
        assert worst[1] < 0.5
        assert np.isfinite(recording.force).all()


@pytest.fixture(scope="module")
def case(knee, truth, good_text, tmp_path_factory):
    return Case(knee, truth, good_text, tmp_path_factory.mktemp("spoilt"))


@settings(max_examples=200)
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
    case.check("log.csv", "\n".join(lines).encode())


@settings(max_examples=100)
@given(
    name=st.sampled_from(["log.npz", "log.csv.gz"]),
    flips=st.lists(st.tuples(places, st.integers(1, 255)), max_size=4),
    end=st.floats(0, 1),
)
def test_damaged_packs(case, name, flips, end):
    data = bytearray(case.packs[name])
    for place, change in flips:
        data[at(place, data)] ^= change
    if not flips:
        del data[at(end, data) :]
    case.check(name, bytes(data))


@settings(max_examples=150)
@given(data=st.binary(max_size=300), name=st.sampled_from(["log.csv", "log.txt.gz", "log.npz"]))
def test_random_bytes_are_no_log(case, data, name):
    assert case.read(name, data) is None
