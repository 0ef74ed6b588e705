"""One force model of the knee robot, and motions that excite it."""

import pytest

from loopid import load_mechanism
from loopid.experiment import find_force_model
from made_runs import ARM, friction, wander


@pytest.fixture(scope="session")
def terms(knee):
    """Coulomb and viscous friction of the motors, and its values."""
    return friction(knee)


@pytest.fixture(scope="session")
def knee_model(knee, terms):
    return find_force_model(knee, "gravity", terms[0])


@pytest.fixture(scope="session")
def motions(knee):
    """To fit, and to validate."""
    return wander(knee, seed=1), wander(knee, seed=3, seconds=40.0)


@pytest.fixture(scope="session")
def truth(knee_model, terms):
    """Values of the robot file, and those of its friction."""
    values = knee_model.prior.copy()
    values[knee_model.joint_columns] = terms[1]
    return values


@pytest.fixture(scope="session")
def arm(tmp_path_factory):
    """A serial robot with two hinges."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM)
    return load_mechanism(path)
