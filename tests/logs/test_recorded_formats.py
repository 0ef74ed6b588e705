"""The same run in every format is the same log and the same recording."""

import sys
import warnings
from dataclasses import fields

import numpy as np
import pytest
from recorded_logs import states as joint_states
from recorded_logs import write_any, write_ros1, write_ros2
from simulated_logs import table

from block_sizes import set_block_rows
from loopid.errors import MissingExtraError
from loopid.logs import prepare_recording, read_log
from loopid.trajectories import JointMotion

__all__ = ["set_block_rows"]

FORMATS = ["npz", "parquet", "hdf5", "ros1", "db3", "mcap", "mcap file"]
ROWS = slice(0, 900)


@pytest.fixture(scope="session")
def run(truth):
    return truth.time[ROWS], truth.position[ROWS], truth.force[ROWS]


@pytest.fixture(scope="session")
def written(run, knee, tmp_path_factory):
    """Paths of the run by format."""
    return {
        kind: write_any(kind, tmp_path_factory.mktemp("run"), knee.actuated, *run)
        for kind in FORMATS
    }


@pytest.fixture(scope="session")
def from_text(run, knee, tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.csv"
    path.write_text(table(*run, knee.actuated))
    return read_both(path, knee)


def read_both(path, robot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        log = read_log(path, robot)
        return log, prepare_recording(robot, log)


def assert_alike(one, other):
    (log, recording), (log_there, recording_there) = one, other
    assert (log.name, log.joints) == (log_there.name, log_there.joints)
    for name in ("time", "position", "force", "stretches"):
        mine, theirs = getattr(log, name), getattr(log_there, name)
        np.testing.assert_allclose(mine, theirs, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(recording.used, recording_there.used)
    np.testing.assert_allclose(recording.force, recording_there.force, 1e-9, 1e-9)
    for field in fields(JointMotion):
        mine, theirs = (getattr(r.motion, field.name) for r in (recording, recording_there))
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-11)
    assert log.dropped == log_there.dropped


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_is_the_same_log(knee, written, from_text, kind):
    assert_alike(read_both(written[kind], knee), from_text)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("size", [7, 100])
def test_rows_in_memory_change_nothing(knee, written, set_block_rows, kind, size):
    whole = read_log(written[kind], knee)
    set_block_rows(size)
    there = read_log(written[kind], knee)
    for name in ("time", "position", "force", "stretches"):
        np.testing.assert_array_equal(getattr(there, name), getattr(whole, name))


@pytest.mark.parametrize("packed", ["BZ2", "LZ4"])
def test_packed_bags_of_ros1(knee, run, tmp_path, from_text, packed):
    stamps = np.round(run[0] * 1e9).astype(np.int64)
    messages = joint_states("ros1", knee.actuated, stamps, *run[1:])
    assert_alike(read_both(write_ros1(tmp_path / "run.bag", messages, packed), knee), from_text)


@pytest.mark.parametrize(
    ("storage", "packed"),
    [
        ("db3", "file"),
        ("db3", "message"),
        ("mcap", "file"),
        ("mcap", "message"),
        ("mcap", "storage"),
    ],
)
def test_packed_bags_of_ros2(knee, run, tmp_path, from_text, storage, packed):
    stamps = np.round(run[0] * 1e9).astype(np.int64)
    messages = joint_states("ros2", knee.actuated, stamps, *run[1:])
    bag = write_ros2(tmp_path / "run", messages, storage, packed)
    assert_alike(read_both(bag, knee), from_text)


def test_a_file_of_sqlite_without_its_folder(knee, written, from_text):
    assert_alike(read_both(written["db3"] / "run.db3", knee), from_text)


@pytest.mark.parametrize(
    ("kind", "package"),
    [("hdf5", "h5py"), ("ros1", "rosbags"), ("mcap", "rosbags")],
)
def test_missing_libraries_are_named_with_their_extra(knee, written, monkeypatch, kind, package):
    module = "rosbags.highlevel" if package == "rosbags" else package
    monkeypatch.setitem(sys.modules, module, None)
    message = rf"{package} is not installed: pip install 'loopid\[logs\]' brings it"
    with pytest.raises(MissingExtraError, match=message):
        read_log(written[kind], knee)
