"""Sampled motions from text: read as they are, smoothed without delay, refused by line."""

import gzip

import numpy as np
import pytest
from hypothesis import given, strategies as st

from loopid.errors import FileError, LogError, OptionError
from loopid.motion import LowPass, joint_motion, read_reference, review_motion

NAMES = ("x", "y")
RATE = 100.0
CUTOFF = 2.0
# Two passes of second order answer a step of 1 in velocity with an acceleration of 0.35 ω at most
# (without a filter: the rate), and cut the corner by 0.35 / ω.
STEEPEST, CUT = 0.36 * 2 * np.pi * CUTOFF, 0.36 / (2 * np.pi * CUTOFF)


@pytest.fixture(scope="module")
def write(tmp_path_factory):
    folder = tmp_path_factory.mktemp("references")

    def write(text, name="reference.txt"):
        content = text if isinstance(text, bytes) else text.encode()
        (folder / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
        return folder / name

    return write


def as_text(values, separator=" "):
    return "\n".join(separator.join(map(repr, row)) for row in np.asarray(values).tolist()) + "\n"


def corners(speeds, seconds=3.0):
    """Rest, stretches of constant velocity (m/s), and rest: (N, 2) at 100 Hz."""
    velocity = np.repeat([0.0, *speeds, 0.0], round(seconds * RATE))
    position = np.concatenate([[0.0], np.cumsum(velocity) / RATE])
    return np.column_stack([position, -position])


speeds = st.lists(st.floats(-0.035, 0.035), min_size=1, max_size=4)


@given(speeds, st.sampled_from(["", ".gz"]), st.sampled_from([" ", "\t", "   "]))
def test_a_reference_is_its_table_smoothed(write, speeds, packed, separator):
    table = corners(speeds)
    motion = read_reference(write(as_text(table, separator), f"r.txt{packed}"), NAMES)
    assert motion.names == NAMES
    np.testing.assert_array_equal(motion.time, np.arange(len(table)) / RATE)
    np.testing.assert_array_equal(motion.position, LowPass(CUTOFF).apply(table, RATE))
    np.testing.assert_array_equal(motion.position[:, 0], -motion.position[:, 1])
    # Positions, velocities and accelerations belong to one motion.
    for values, slopes in (
        (motion.position, motion.velocity),
        (motion.velocity, motion.acceleration),
    ):
        near, far = values[3:-1] - values[1:-3], values[4:] - values[:-4]
        np.testing.assert_allclose((8 * near - far) * RATE / 12, slopes[2:-2], atol=1e-12)


@given(speeds)
def test_steps_in_velocity_become_bounded_accelerations(write, speeds):
    motion = read_reference(write(as_text(corners(speeds))), NAMES)
    step = np.abs(np.diff([0.0, *speeds, 0.0])).max()
    assert np.abs(motion.acceleration).max() <= STEEPEST * step + 1e-9
    assert np.abs(motion.position - corners(speeds)).max() <= CUT * step + 1e-9
    # At rest at both ends.
    for values in (motion.velocity, motion.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0, atol=1e-3 * step + 1e-9)


def test_rate_and_filter_can_be_chosen(write):
    file = write(as_text(corners([0.02])))
    motion = read_reference(file, NAMES, rate=50.0, lowpass=LowPass(1.0, 3))
    assert motion.duration == (len(motion) - 1) / 50
    np.testing.assert_array_equal(motion.position, LowPass(1.0, 3).apply(np.loadtxt(file), 50.0))
    usual = read_reference(file, NAMES, rate=100.0, lowpass=LowPass(2.0, 3))
    # Twice as slow: half the velocity, a quarter of the acceleration.
    np.testing.assert_allclose(2 * motion.velocity, usual.velocity, atol=1e-12)
    np.testing.assert_allclose(4 * motion.acceleration, usual.acceleration, atol=1e-12)


GOOD = as_text(corners([0.02]))
LINES = GOOD.splitlines()


def with_line(number, text):
    return "\n".join([*LINES[: number - 1], text, *LINES[number:]])


BROKEN = {
    "too many columns": (as_text(np.ones((300, 3))), ("line 1", "2 finite numbers", "x, y")),
    "too few columns": (as_text(np.ones((300, 1))), ("line 1", "x, y")),
    "ragged": (with_line(7, "1.0"), ("line 7", "'1.0'")),
    "an empty line": (with_line(9, ""), ("line 10", "must follow a row")),
    "NaN": (with_line(8, "1.0 nan"), ("line 8", "nan")),
    "infinite": (with_line(8, "-inf 1.0"), ("line 8", "-inf")),
    "words": (with_line(3, "1.0 far"), ("line 3", "far")),
    "commas": (GOOD.replace(" ", ","), ("line 1", "2 finite")),
    "empty": ("", ("0 samples", "151")),
    "blank": ("\n \n", ("0 samples", "151")),
    "too few": ("\n".join(LINES[:150]), ("150 samples", "2 Hz", "151 at 100 Hz")),
    "no text": (b"\xff\xfe\x00", ("line 1",)),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_file_is_refused_by_line(write, case):
    text, fragments = BROKEN[case]
    with pytest.raises(LogError) as failure:
        read_reference(write(text), NAMES)
    said = str(failure.value)
    assert "\n" not in said
    assert not [f for f in ("reference.txt", *fragments) if f not in said], said


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"rate": 0.0}, "rate"),
        ({"rate": np.nan}, "rate"),
        ({"lowpass": LowPass(50.0)}, "half the sample rate"),
        ({"names": ("x", "x")}, "x, x"),
        ({"names": ()}, "none"),
    ],
)
def test_wrong_options_are_refused(write, arguments, word):
    with pytest.raises(OptionError, match=word):
        read_reference(write(GOOD), **{"names": NAMES} | arguments)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(FileError, match=r"gone\.txt does not exist"):
        read_reference(tmp_path / "gone.txt", NAMES)


# Rests of the laboratory whose strokes are too short, by how much in m.
SHORT = {1: 0.0073, 5: 0.0158}


@pytest.mark.parametrize("number", [1, 2, 5, 8])
def test_the_laboratorys_references_can_be_followed(shared, knee, number):
    file = shared / "data" / "upv" / "references" / f"trr{number}.txt.gz"
    motion = read_reference(file, knee.platform.names)
    table = np.loadtxt(file)
    step = np.abs(np.diff(table, n=2, axis=0)).max() * RATE
    assert step < 0.07
    # Some corners are so close to each other, 0.1 s, that their answers add up.
    assert np.abs(motion.acceleration).max() < 1.05 * STEEPEST * step
    assert np.abs(motion.position - table).max() < 1.05 * CUT * step
    every = slice(None, None, 50)
    thin = type(motion)(
        motion.names,
        *(getattr(motion, n)[every] for n in ("time", "position", "velocity", "acceleration")),
    )
    review = review_motion(knee, joint_motion(knee, thin))
    clearance = min(found.clearance for found in review.ranges)
    assert review.singularity > 0.06
    if number in SHORT:
        assert clearance == pytest.approx(-SHORT[number], abs=2e-4)
        assert all("leg1_stroke" in problem for problem in review.problems)
    else:
        assert review.problems == ()
