"""However a log is spoilt, the command ends with one sentence, or says what it left out."""

from pathlib import Path

import numpy as np
import pytest

LOG = Path(__file__).parents[2] / "urdf" / "logs" / "five_bar.csv"
POSITIONS = range(1, 3)


@pytest.fixture(scope="module")
def table():
    """Header, and rows (N, 5) of time, positions and forces."""
    head, *rows = LOG.read_text().splitlines()
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
        return run("identify", "five_bar", tmp_path / "spoilt.csv", *options)

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


def times(columns, factor):
    def change(rows):
        rows[:, columns] *= factor

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
        (times(POSITIONS, 1e3), ["outside its limits", "0.001"]),
        (times([0], 1e3), ["median step", "unit: ms"]),
    ],
)
def test_a_log_that_says_nothing_is_refused(identify, table, change, words):
    rows = table[1].copy()
    change(rows)
    done = identify(rows)
    assert done.code == 2
    assert all(word in said(done) for word in words)


def test_what_looks_wrong_is_said(identify, table):
    rows = table[1][:1200].copy()
    times([4], -1.0)(rows)
    put(slice(200, 203), 2, np.nan)(rows)
    done = identify(rows, "--cutoff", "8", "--terms", "Fc,Fv")
    assert (
        "no number in right_crank_joint.position in rows 202, 203, 204 of 1200: left out"
        in said(done)
    )
    assert done.code == 0
    shown = " ".join(done.out.split())
    title = "the force of right_crank_joint has the wrong sign"
    do = "set force_scale: {right_crank_joint: -1}"
    assert f"Not fit for use: {title}" in shown
    assert f"mistake: {title} {do}" in shown
    assert shown.count("mistake: ") == 1


@pytest.mark.parametrize("text", ["", "time\n", "not a log at all", "\x00\x01\x02", "a,b\n1"])
def test_what_is_no_table_is_refused(identify, text):
    done = identify(text)
    assert done.code == 2
    assert "spoilt" in said(done)
