"""Gravity forces against those that the real robots' controllers logged.

The controller computed them from its own model, in the same cycle as it read the strokes.
"""

import gzip

import numpy as np
import pytest

from loopid import assemble, gravity_regressor

LOGS = {"3ups_rpu": "exp_18_12_2020-12_36_29", "5p": "exp_20_01_2021-16_15_33"}


def read_stream(file):
    """Times (N,) in ns and values (N, 4) of one stream of a log."""
    with gzip.open(file, "rt") as lines:
        table = np.loadtxt(lines, skiprows=1)
    return table[:, 0].astype(np.int64) * 10**9 + table[:, 1].astype(np.int64), table[:, 2:]


@pytest.fixture(scope="module")
def log(mechanism, shared):
    """Logged strokes (m) and the gravity forces (N) of the same control cycles."""
    folder = shared / "data" / "upv" / "logs" / LOGS[mechanism.name]
    read_at, strokes = read_stream(folder / "joint_position.txt.gz")
    written_at, forces = read_stream(folder / "q_grav.txt.gz")
    following = np.searchsorted(written_at, read_at)
    # Of positions with one next force, the last came before it; the others lost theirs.
    last = np.append(np.diff(following) > 0, True) & (following < len(written_at))
    return strokes[last], forces[following[last]]


def test_logged_strokes_give_the_logged_gravity_forces(mechanism, log):
    strokes, logged = log
    assert len(strokes) > 8000
    q = assemble(mechanism, strokes, trajectory=True)
    forces = gravity_regressor(mechanism, q) @ mechanism.standard_parameters("gravity")
    errors = np.abs(forces - logged)
    assert np.median(errors) < 1e-3
    assert errors.max() < 5e-3
