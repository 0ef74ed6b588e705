"""The logs of the real robots, whole."""

import numpy as np
import pytest
from logged_runs import LOGS, read_stream

from loopid import platform_coordinates
from loopid.logs import prepare_recording, read_log


@pytest.fixture(scope="module")
def folder(mechanism, shared):
    return shared / "data" / "upv" / "logs" / LOGS[mechanism.name]


@pytest.fixture(scope="module")
def log(mechanism, folder):
    return read_log(folder, mechanism)


@pytest.fixture(scope="module")
def recording(mechanism, log):
    return prepare_recording(mechanism, log)


def test_nearly_all_rows_are_read(log, folder):
    stamps, positions = read_stream(folder / "joint_position.txt.gz")
    assert len(stamps) - 5 < len(log) <= len(stamps)
    assert not log.stretches.any()
    assert {part.reason for part in log.dropped} == {"not in all streams"}
    assert log.rate(slice(None)) == pytest.approx(100, abs=0.01)
    nearest = np.searchsorted((stamps - stamps[0]) / 1e9, log.time - 0.005)
    # Stamps jitter by 0.2 ms at 0.03 m/s, and drift against the even grid by less than half a row.
    assert np.abs(log.position - positions[nearest]).max() < 0.03 * 0.006


def test_strokes_give_the_logged_pose(mechanism, log, folder):
    recording = prepare_recording(mechanism, log, lowpass=None, decimate=False)
    assert len(recording) == len(log)
    found = platform_coordinates(mechanism, recording.motion.configurations)
    read_at, _ = read_stream(folder / "joint_position.txt.gz")
    written_at, poses = read_stream(folder / "x_coord.txt.gz")
    # Of a cycle the position comes first: its pose is the next row.
    nearest = read_at[np.searchsorted((read_at - read_at[0]) / 1e9, log.time - 0.005)]
    following = np.minimum(np.searchsorted(written_at, nearest), len(poses) - 1)
    assert np.median(np.abs(found - poses[following])) < 2e-6


def test_idle_motors_are_named(recording, mechanism):
    reasons = {part.reason: part.count for part in recording.dropped}
    for k, joint in enumerate(mechanism.actuated):
        assert reasons[f"{joint} stands still"] == (~recording.used[:, k]).sum()
    assert (recording.used.mean(axis=0) > 0.5).all()


def test_few_samples_carry_the_same(recording, log):
    rate = 1 / np.median(np.diff(recording.motion.time))
    assert recording.cutoff == pytest.approx(5, rel=1e-3)
    assert rate == pytest.approx(25, rel=1e-3)
    assert len(recording) == pytest.approx(len(log) / 4, abs=25)
