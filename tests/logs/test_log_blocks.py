"""What a log tells does not depend on how many of its rows are in memory at a time."""

import gzip
import warnings
from dataclasses import fields

import numpy as np
import pytest
from recorded_logs import write_any
from simulated_logs import stream_text, table

import loopid
from block_sizes import set_block_rows
from loopid.logs import read_log
from loopid.motion import JointMotion

__all__ = ["set_block_rows"]


def found(path, robot):
    """Log, recording and what is said of them."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        log = read_log(path, robot)
        recording = loopid.prepare(robot, log)
    return log, recording, [str(warning.message) for warning in said]


def assert_same(one, other):
    (log, recording, said), (log_there, recording_there, said_there) = one, other
    for name in ("time", "position", "force", "segments"):
        np.testing.assert_array_equal(getattr(log, name), getattr(log_there, name))
    for name in ("force", "used", "segments"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(recording_there, name))
    for field in fields(JointMotion):
        mine, theirs = (getattr(r.motion, field.name) for r in (recording, recording_there))
        # Blocks that are multiplied together may round otherwise.
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-12)
    assert (log.dropped, recording.dropped) == (log_there.dropped, recording_there.dropped)
    assert said == said_there


@pytest.mark.parametrize("kind", ["npz", "parquet", "hdf5", "ros1", "mcap"])
def test_whole_runs_in_any_format(knee, truth, tmp_path, set_block_rows, kind):
    rows = slice(0, 400)
    run = truth.time[rows], truth.position[rows], truth.force[rows]
    path = write_any(kind, tmp_path, knee.actuated, *run)
    whole = found(path, knee)
    set_block_rows(37)
    assert_same(found(path, knee), whole)


def spoilt(truth, robot):
    """A run with gaps, glitches, bad cells and rows, and values outside limits."""
    position, force, time = truth.position.copy(), truth.force.copy(), truth.time.copy()
    force[200, 1] = 1e6
    force[700:720] *= 40
    position[300, 0] = 9.0
    position[301, 2] += 0.05
    time[500:] += 0.3
    lines = table(time, position, force, robot.actuated).splitlines()
    lines[151] = lines[151].replace(",", ",x", 1)
    lines[152] += ",1"
    lines[153] = ""
    lines.append("0.1")
    return "\n".join(lines)


@pytest.mark.parametrize(("size", "name"), [(29, "log.csv"), (64, "log.txt.gz")])
def test_spoilt_text(knee, truth, write_text, set_block_rows, size, name):
    path = write_text(spoilt(truth, knee), name)
    whole = found(path, knee)
    assert len(whole[2]) >= 6
    assert len(whole[0].parts()) > 1
    set_block_rows(size)
    assert_same(found(path, knee), whole)


def test_folders_whose_streams_have_other_stamps(knee, truth, tmp_path, set_block_rows):
    rng = np.random.default_rng(0)
    stamps = (truth.time * 1e9).astype(np.int64)
    late = stamps[3:-2] + rng.integers(0, 3_000_000, len(stamps) - 5)
    for name, at, values in (
        ("joint_position", stamps, truth.position),
        ("control_action", late, truth.force[3:-2]),
    ):
        text = stream_text(
            name, np.delete(at, np.s_[400:440]), np.delete(values, np.s_[400:440], 0)
        )
        (tmp_path / f"{name}.txt.gz").write_bytes(gzip.compress(text.encode()))
    whole = found(tmp_path, knee)
    set_block_rows(37)
    assert_same(found(tmp_path, knee), whole)
