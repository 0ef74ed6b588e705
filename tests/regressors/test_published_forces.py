"""The gravity regressor against closed forms, and forces that the real controllers logged."""

import numpy as np
import pytest

from loopid.kinematics import assemble
from loopid.regressors import gravity_regressor
from real_streams import read_stream

PAPER_LINKS = {
    **{f"{leg}1": f"leg{leg}_cylinder" for leg in range(1, 5)},
    **{f"{leg}2": f"leg{leg}_stem" for leg in range(1, 5)},
    "m": "platform",
}


def label(column):
    """Our label of one of the oracle's columns: ``mx41`` is ``leg4_cylinder.mx``."""
    kind = "m" if column[1] not in "xyz" else column[:2]
    return f"{PAPER_LINKS[column.removeprefix(kind)]}.{kind}"


@pytest.fixture(scope="module", params=["strokes", "pose"])
def regressor(request, mechanism, oracle):
    coordinates = "platform" if request.param == "pose" else None
    q = assemble(mechanism, oracle[request.param], coordinates)
    return gravity_regressor(mechanism, q)


def test_every_parameter_has_its_column(mechanism, oracle):
    labels = {label(str(column)) for column in oracle["columns"]}
    assert labels == set(mechanism.parameters("gravity").labels)


def test_every_column_agrees(mechanism, oracle, regressor):
    ours = mechanism.parameters("gravity").labels
    scale = np.abs(oracle["K"]).max()
    for j, column in enumerate(oracle["columns"]):
        expected, found = oracle["K"][:, :, j], regressor[:, :, ours.index(label(str(column)))]
        # Relative to the column itself, or to round-off of the whole where it is zero.
        tolerance = max(1e-9 * np.abs(expected).max(), 1e-13 * scale)
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance, err_msg=str(column))


def test_forces_of_the_cad_masses_agree(mechanism, oracle, regressor):
    forces = regressor @ mechanism.standard_parameters("gravity")
    scale = np.abs(oracle["force"]).max()
    np.testing.assert_allclose(forces, oracle["force"], rtol=0, atol=1e-9 * scale)


@pytest.fixture(scope="module")
def log(real_log):
    """Logged strokes (m) and the gravity forces (N) of the same control cycles."""
    read_at, strokes = read_stream(real_log / "joint_position.txt.gz")
    written_at, forces = read_stream(real_log / "q_grav.txt.gz")
    following = np.searchsorted(written_at, read_at)
    # Of positions with one next force, the last came before it; the others lost theirs.
    last = np.append(np.diff(following) > 0, True) & (following < len(written_at))
    return strokes[last], forces[following[last]]


def test_logged_strokes_give_the_logged_gravity_forces(mechanism, log):
    strokes, logged = log
    assert len(strokes) > 8000
    strokes, logged = strokes[::4], logged[::4]
    q = assemble(mechanism, strokes, trajectory=True)
    forces = gravity_regressor(mechanism, q) @ mechanism.standard_parameters("gravity")
    errors = np.abs(forces - logged)
    assert np.median(errors) < 1e-3
    assert errors.max() < 5e-3
