"""However a log is spoilt, the command ends with one sentence, or says what it left out."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

POSITIONS = range(1, 5)


@pytest.fixture(scope="module")
def table(log_texts):
    """Header, and rows (N, 9) of time, positions and forces."""
    head, *rows = log_texts["run.csv"].splitlines()
    return head, np.array([[float(x) for x in row.split(",")] for row in rows])


@pytest.fixture
def identify(run, table, tmp_path):
    """Run the command on rows, or on a text."""

    def call(rows, *options):
        text = rows
        if not isinstance(rows, str):
            lines = [",".join("" if x is None else f"{x:.9g}" for x in row) for row in rows]
            text = "\n".join([table[0], *lines, ""])
        (tmp_path / "spoilt.csv").write_text(text)
        return run("identify", "3ups_rpu", tmp_path / "spoilt.csv", *options)

    return call


def said(done):
    """All warnings and errors; nothing else may be on the error stream."""
    lines = [line for line in done.err.splitlines() if line]
    assert all(line.startswith(("loopid: warning: ", "loopid: error: ")) for line in lines)
    errors = [line for line in lines if line.startswith("loopid: error: ")]
    assert len(errors) == (done.code == 2)
    assert done.code in (0, 2)
    assert (done.out == "") == (done.code == 2)
    return "\n".join(lines)


def about_the_log(done):
    """Warnings that are not about correlation or excitation, which good logs give too."""
    return [
        line
        for line in said(done).splitlines()
        if "autocorrelated" not in line and "not significant" not in line
    ]


def test_a_good_log_gives_no_warning_about_itself(identify, table):
    done = identify(table[1])
    assert done.code == 0
    assert about_the_log(done) == []


def times(columns, factor):
    def change(rows):
        rows[:, columns] *= factor

    return change


def exchange(one, other):
    def change(rows):
        rows[[one, other]] = rows[[other, one]]

    return change


def put(rows, columns, value):
    def change(table):
        table[rows, columns] = table[0, columns] if value is None else value

    return change


ALL = slice(None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put(slice(200, 900), 2, np.nan), ["spoilt"]),
        (exchange(300, 301), ["time must increase"]),
        (times(POSITIONS, 1e3), ["outside its limits", "0.001"]),
        (times(POSITIONS, 1e-3), ["outside its limits", "1000"]),
        (times([0], 1e3), ["median step", "0.001"]),
        (times([0], 1e6), ["median step", "1e-06"]),
        (put(ALL, POSITIONS, None), ["nothing moves"]),
        (lambda rows: rows.resize((3, 9), refcheck=False), ["spoilt"]),
    ],
)
def test_a_log_that_says_nothing_is_refused(identify, table, change, words):
    rows = table[1].copy()
    change(rows)
    done = identify(rows)
    assert done.code == 2
    assert all(word in said(done) for word in words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (put(slice(200, 203), 2, np.nan), ["spoilt", "3"]),
        (times([8], -1.0), ["the force of leg4_stroke is -", "force_scale"]),
        (put(ALL, 1, None), ["leg1_stroke", "never changes"]),
    ],
)
def test_what_looks_wrong_is_said(identify, table, change, words):
    rows = table[1].copy()
    change(rows)
    lines = about_the_log(identify(rows))
    assert any(all(word in line for word in words) for line in lines)


@pytest.mark.parametrize("text", ["", "time\n", "not a log at all", "\x00\x01\x02", "a,b\n1"])
def test_what_is_no_table_is_refused(identify, text):
    done = identify(text)
    assert done.code == 2
    assert "spoilt" in said(done)


def spoil(rows, kind, place, length, column, factor):
    """Rows with one thing wrong."""
    rows, start = rows.copy(), int(place * len(rows))
    part, column = slice(start, start + length), column % rows.shape[1]
    if kind == "lose":
        return np.delete(rows, part, axis=0)
    if kind == "repeat":
        return np.concatenate([rows[:start], rows[part], rows[start:]])
    if kind == "empty":
        rows[part, column] = np.nan
    elif kind == "hold":
        rows[part, column] = rows[start, column]
    elif kind == "scale":
        rows[part, column] *= factor
    elif kind == "shift":
        rows[start:, column] += factor
    elif kind == "cut":
        return rows[: start + 1]
    else:
        rows[:, column] = rows[:, 1 + column % (rows.shape[1] - 1)]
    return rows


spoilers = st.tuples(
    st.sampled_from(["lose", "repeat", "empty", "hold", "scale", "shift", "cut", "copy"]),
    st.floats(0, 1, exclude_max=True),
    st.integers(1, 600),
    st.integers(0, 8),
    st.sampled_from([1e3, 1e-3, -1.0, 0.0, 1e300, 1.5, float("inf")]),
)


@settings(max_examples=10, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(spoilt=st.lists(spoilers, min_size=1, max_size=3))
def test_no_spoilt_log_ends_in_a_traceback(run, arm_files, tmp_path, spoilt):
    robot, log, _ = arm_files
    head, *lines = Path(log).read_text().splitlines()
    rows = np.array([[float(x) for x in line.split(",")] for line in lines])
    with np.errstate(all="ignore"):
        for change in spoilt:
            if len(rows):
                rows = spoil(rows, *change)
    lines = [",".join(f"{x:.9g}" for x in row) for row in rows]
    (tmp_path / "spoilt.csv").write_text("\n".join([head, *lines, ""]))
    said(run("identify", robot, tmp_path / "spoilt.csv"))
