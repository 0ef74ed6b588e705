"""Streams that start, stop, jitter and lose rows on their own come out on one even grid."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import LogError
from loopid.logs import read_log
from loopid.logs.grid import GAP, Stream, align as align_joints
from loopid.logs.signals import Channel

EPOCH = 1_608_291_576 * 10**9
PERIOD = 10**7  # ns
OMEGA = 3.0  # rad/s of all signals below, of amplitude 1


def signal(seconds):
    return np.stack([np.sin(OMEGA * seconds), np.cos(OMEGA * seconds)], axis=1)


def stream(stamps, name="a"):
    stamps = np.asarray(stamps, dtype=np.int64)
    channels = tuple(Channel("position", f"{name}{k}", f"{name}{k}", 1.0, 0.0) for k in range(2))
    values = signal((stamps - EPOCH) / 1e9)
    return Stream(name, channels, np.arange(len(stamps)) + 2, stamps, values)


def align(streams):
    return align_joints(streams, tuple(c.joint for s in streams for c in s.channels))


def check(aligned, streams, longest=1):
    """All values are those of the signal but for a straight line over the longest step."""
    zero = (streams[0].stamps[0] - EPOCH) / 1e9
    bound = (longest * PERIOD / 1e9 * OMEGA) ** 2 / 8
    expected = np.tile(signal(aligned.time + zero), len(streams))
    assert np.abs(aligned.signals["position"] - expected).max() < bound
    for number in np.unique(aligned.segments):
        steps = np.diff(aligned.time[aligned.segments == number])
        np.testing.assert_allclose(steps, steps.mean(), rtol=1e-9)
        assert steps.mean() == pytest.approx(PERIOD / 1e9, rel=0.05)


def test_equal_stamps_pass_unchanged():
    stamps = EPOCH + PERIOD * np.arange(500)
    streams = [stream(stamps), stream(stamps, "b")]
    aligned = align(streams)
    # To the bit: values that are held would seem to change.
    np.testing.assert_array_equal(aligned.signals["position"][:, :2], streams[0].values)
    np.testing.assert_array_equal(aligned.time, np.arange(500) / 100)
    assert aligned.dropped == ()


def test_only_the_overlap_is_kept_and_the_rest_reported():
    stamps = EPOCH + PERIOD * np.arange(500)
    streams = [stream(stamps[:450]), stream(stamps[50:] + 3_000_000, "b")]
    aligned = align(streams)
    check(aligned, streams)
    assert aligned.time[0] == pytest.approx(0.51)
    assert aligned.time[-1] == pytest.approx(4.49)
    assert [(part.reason, part.count) for part in aligned.dropped] == [("not in all streams", 51)]


@given(seed=st.integers(0, 10**6), jitter=st.floats(0, 0.3), lost=st.floats(0, 0.1))
def test_jitter_and_lost_rows(seed, jitter, lost):
    generator = np.random.default_rng(seed)
    streams = []
    for name, shift in (("a", 0), ("b", 4_000_000)):
        wobble = generator.uniform(-jitter, jitter, 600) * PERIOD
        stamps = EPOCH + shift + PERIOD * np.arange(600) + wobble.astype(np.int64)
        kept = generator.random(600) >= lost
        kept[[0, 1, -2, -1]] = True
        streams.append(stream(stamps[kept], name))
    aligned = align(streams)
    check(aligned, streams, longest=GAP + 1)
    assert len(aligned.time) > 450


def test_a_lost_row_moves_no_other_sample():
    stamps = EPOCH + PERIOD * np.arange(500)
    aligned = align([stream(np.delete(stamps, [100, 101, 300]))])
    np.testing.assert_allclose(aligned.time, 0.01 * np.arange(500), atol=1e-12)


@pytest.mark.parametrize("of_first", [True, False])
def test_a_gap_in_any_stream_starts_a_new_segment(of_first):
    stamps = EPOCH + PERIOD * np.arange(500)
    broken = np.delete(stamps, np.arange(200, 230))
    streams = [stream(broken if of_first else stamps), stream(stamps if of_first else broken, "b")]
    aligned = align(streams)
    check(aligned, streams)
    np.testing.assert_array_equal(aligned.segments, np.repeat([0, 1], [200, 270]))
    (gap,) = aligned.dropped
    assert str(gap) == "gap in the time stamps: 30 samples between 1.99 and 2.30 s"


def test_a_step_that_is_just_no_gap_is_bridged():
    stamps = EPOCH + PERIOD * np.arange(500)
    few = int(GAP)
    assert not align([stream(np.delete(stamps, np.arange(200, 199 + few)))]).segments.any()
    assert align([stream(np.delete(stamps, np.arange(200, 200 + few)))]).segments.any()


def test_a_slower_stream_is_interpolated():
    fast, slow = EPOCH + PERIOD * np.arange(500), EPOCH + 4 * PERIOD * np.arange(120)
    streams = [stream(fast), stream(slow, "b")]
    check(align(streams), streams, longest=4)


def test_short_segments_are_left_out():
    stamps = EPOCH + PERIOD * np.arange(500)
    stamps = np.delete(stamps, [*range(200, 230), *range(233, 260)])
    aligned = align([stream(stamps)])
    np.testing.assert_array_equal(np.bincount(aligned.segments), [200, 240])


def test_streams_that_never_meet_are_refused():
    stamps = EPOCH + PERIOD * np.arange(500)
    message = r"no 4 samples in a row.*: a from 0\.000 to 4\.990 s, b from 6\.000 to 10\.990 s"
    with pytest.raises(LogError, match=message):
        align([stream(stamps), stream(stamps + 600 * PERIOD, "b")])


def test_whole_folders_are_aligned(knee, truth, write_folder):
    stamps = EPOCH + np.round(truth.time * 1e9).astype(np.int64)
    positions = (np.delete(stamps, [70, 71]), np.delete(truth.position, [70, 71], axis=0))
    middle = 0.5 * (truth.force[1:] + truth.force[:-1])
    log = read_log(write_folder(position=positions, force=(stamps[1:] - PERIOD // 2, middle)), knee)
    np.testing.assert_allclose(log.time, truth.time[1:-1], atol=1e-9)
    np.testing.assert_allclose(log.position, truth.position[1:-1], rtol=0, atol=0.05 * 0.03**2 / 8)
    smooth = np.abs(np.diff(truth.force, 2, axis=0)).max(axis=1) < 1
    assert np.abs(log.force - truth.force[1:-1])[smooth].max() < 0.25
    assert smooth.mean() > 0.98
