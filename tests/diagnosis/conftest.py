"""Full and gravity models of robots, with data whose truth is known."""

from dataclasses import dataclass

import numpy as np
import pytest

from block_sizes import set_block_rows
from loopid import JointTerms, load_mechanism
from loopid.diagnosis.consistent_prior import sound_prior
from loopid.diagnosis.consistent_program import Whitening
from loopid.identification import (
    FitSamples,
    WeightedLeastSquares,
    find_force_model,
)
from made_runs import ARM, friction, wander

__all__ = ["set_block_rows"]


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
        bodies = self.model.mechanism.standard_parameters(self.model.model)
        return np.concatenate([bodies, np.zeros(len(self.truth) - len(bodies))])

    def samples(self, noise, seed=0, truth=None):
        values = self.base.values(self.truth if truth is None else truth)
        error = np.random.default_rng(seed).normal(size=self.regressor.shape[:2])
        force = self.regressor @ values + noise * error
        actuators = self.model.mechanism.actuated
        return FitSamples.of(self.model.parameters, actuators, self.regressor, force)

    def fitted(self, noise, seed=0, truth=None):
        """Problem and fit of noisy samples."""
        problem = self.samples(noise, seed, truth).problem
        return problem, WeightedLeastSquares().fit(problem)


def make_case(robot, model, kinds=("Fc", "Fv"), **motion):
    terms, values = friction(robot, kinds)
    found = find_force_model(robot, model, terms if kinds else None)
    W = found.regressor(wander(robot, seed=1, **motion))
    truth = np.concatenate([robot.standard_parameters(model), values])
    return Case(found, W, truth)


@pytest.fixture(scope="session")
def knee_case(knee):
    """Ninety body parameters and eight of friction, in a lively motion."""
    return make_case(knee, "full", seconds=10.0, rate=60.0)


@pytest.fixture(scope="session")
def knee_gravity(knee):
    return make_case(knee, "gravity", rate=5.0)


@pytest.fixture(scope="session")
def arm_case(tmp_path_factory):
    """Two hinges with drive inertia and friction: small enough for slow solvers."""
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM)
    arm = load_mechanism(path)
    terms = JointTerms(arm.actuated, ("Ia", "Fc", "Fv"))
    found = find_force_model(arm, "full", terms)
    W = found.regressor(wander(arm, seed=1, seconds=10.0, rate=20.0, size=(1.0, 1.0)))
    values = np.array([0.02, 0.5, 0.3, 0.01, 0.4, 0.2])
    return Case(found, W, np.concatenate([arm.standard_parameters(), values]))


@pytest.fixture(scope="session")
def whitened():
    """Whitened unknowns of a case about a prior."""

    def make(case, prior=None, margin=1e-3):
        values = case.prior if prior is None else prior
        sound = sound_prior(case.base.parameters, values)
        return Whitening.about(case.base, sound, margin)

    return make
