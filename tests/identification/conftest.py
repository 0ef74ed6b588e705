"""Force models, and motions that excite them or do not."""

from dataclasses import dataclass

import numpy as np
import pytest

import loopid
from block_sizes import set_block_rows
from loopid import JointTerms, random_configurations
from loopid.identification import FitSamples, WeightedLeastSquares, identifiability
from loopid.kinematics import random_motions
from made_runs import ARM, friction, modelled, one_joint, wander

__all__ = ["set_block_rows"]

UR10 = "ur_description/urdf/ur10_robot.urdf"
# Robot, model, whether joints have friction, the joint that moves, and how far in m or rad.
CASES = {
    "knee at one pose": ("3ups_rpu", "gravity", False, 0, 0.0),
    "knee with friction": ("3ups_rpu", "gravity", True, 3, 0.02),
    "five bar": ("five_bar", "full", True, 0, 0.4),
    "arm of six": (UR10, "full", False, 1, 0.8),
}


@pytest.fixture(scope="session")
def terms(knee):
    """Coulomb and viscous friction of the motors, and its values."""
    return friction(knee)


@pytest.fixture(scope="session")
def knee_model(knee, terms):
    return loopid.force_model(knee, "gravity", terms[0])


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
    return loopid.load(path)


@pytest.fixture(scope="session", params=CASES)
def moved_joint(request, load_once, robot_data):
    """A force model, a log of one moving joint, and what it identifies."""
    name, kind, has_friction, joint, size = CASES[request.param]
    robot = load_once(robot_data / name if name.endswith(".urdf") else name)
    model = loopid.force_model(robot, kind, JointTerms(robot.actuated) if has_friction else None)
    recording = modelled(model, one_joint(robot, joint, size), model.prior, noise=0.01)
    return model, recording, identifiability(model, [recording])


@pytest.fixture(scope="session")
def weighted():
    """Rows of the regressor, in parts of the motors' forces, of parameters in their sizes."""

    def rows(model, motion, found):
        W = model.regressor(motion) * found.excitation.weights[:, None]
        return W.reshape(-1, W.shape[-1]) @ found.excitation.factor

    return rows


@pytest.fixture(scope="session")
def crank_model(load_once):
    robot = load_once("five_bar")
    return loopid.force_model(robot, "full", JointTerms(robot.actuated))


@pytest.fixture(scope="session")
def crank_truth(crank_model):
    """Not quite the robot file, and friction."""
    generator = np.random.default_rng(3)
    values = crank_model.prior * (1 + 0.05 * generator.normal(size=len(crank_model.prior)))
    values[crank_model.joint_columns] = (2.0, 1.0, 3.0, 0.5)
    return values


@pytest.fixture(scope="session")
def crank_runs(crank_model):
    """One crank moves; both do, to validate."""
    robot = crank_model.robot
    return one_joint(robot, 0, 0.4), wander(robot, 4, 8.0, 20.0, size=(0.4, 0.4))


@pytest.fixture(scope="session")
def crank_data(crank_model, crank_truth, crank_runs):
    return [
        [modelled(crank_model, run, crank_truth, noise=0.02, seed=k)]
        for k, run in enumerate(crank_runs)
    ]


@dataclass(frozen=True)
class Case:
    """A force model, its regressor over a motion, and true standard parameters."""

    model: object
    regressor: np.ndarray
    truth: np.ndarray

    @property
    def base(self):
        return self.model.base

    @property
    def prior(self):
        """What the robot file knows: nothing of joints."""
        bodies = self.model.robot.standard_parameters(self.model.model)
        return np.concatenate([bodies, np.zeros(len(self.truth) - len(bodies))])

    def samples(self, noise, seed=0, truth=None):
        values = self.base.values(self.truth if truth is None else truth)
        error = np.random.default_rng(seed).normal(size=self.regressor.shape[:2])
        force = self.regressor @ values + noise * error
        actuators = self.model.robot.independent
        return FitSamples.of(self.model.parameters, actuators, self.regressor, force)

    def fitted(self, noise, seed=0, truth=None):
        """Problem and fit of noisy samples."""
        problem = self.samples(noise, seed, truth).problem
        return problem, WeightedLeastSquares().fit(problem)


def make_case(robot, model, kinds=("Fc", "Fv"), **motion):
    terms, values = friction(robot, kinds)
    found = loopid.force_model(robot, model, terms if kinds else None)
    W = found.regressor(wander(robot, seed=1, **motion))
    truth = np.concatenate([robot.standard_parameters(model), values])
    return Case(found, W, truth)


@pytest.fixture(scope="session")
def knee_case(knee):
    """Ninety body parameters and eight of friction, in a lively motion."""
    return make_case(knee, "full", seconds=10.0, rate=60.0)


@pytest.fixture(scope="session")
def tied_case():
    """Three legs alike, with one set of parameters."""
    return make_case(loopid.load("3rrr", tied=True), "full", seconds=10.0, rate=20.0)


@pytest.fixture(scope="session")
def floating_case(arm_case):
    """A floating base, with all that acts on it measured as well as its motors' forces."""
    robot = loopid.load(arm_case.model.robot.path, floating_base=True)
    found = loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Ia", "Fc", "Fv")))
    q, rates = random_configurations(robot, 200), random_motions(robot, 200)
    W = found.base.regressor(found.standard_regressor(q, *rates))
    values = arm_case.truth[-6:]
    return Case(found, W, np.concatenate([robot.standard_parameters(), values]))


@pytest.fixture(scope="session")
def knee_gravity(knee):
    return make_case(knee, "gravity", rate=5.0)


@pytest.fixture(scope="session")
def arm_case(tmp_path_factory):
    """Two hinges with drive inertia and friction: small enough for slow solvers."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM)
    arm = loopid.load(path)
    terms = JointTerms(arm.actuated, ("Ia", "Fc", "Fv"))
    found = loopid.force_model(arm, "full", terms)
    W = found.regressor(wander(arm, seed=1, seconds=10.0, rate=20.0, size=(1.0, 1.0)))
    values = np.array([0.02, 0.5, 0.3, 0.01, 0.4, 0.2])
    return Case(found, W, np.concatenate([arm.standard_parameters(), values]))
