"""Groups of joint terms whose size the evidence chooses, and limits of joint terms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

import loopid
from loopid import JointTerms
from loopid.identification import FitSamples, consistent_fit
from loopid.identification.consistent import _minimised, _most_likely, _Program, _Step
from loopid.identification.fitting import quiet_fit
from loopid.identification.joint_priors import JointPriors, joint_parameters
from loopid.motion import FourierSeries, joint_motion
from loopid.regressors import JOINT_TERMS, JointTerm
from loopid.regressors.joint_laws import PriorGroup

# Waves of a gear over its position: a law of several coefficients, of which one may ask for none.
WAVES = PriorGroup("waves", 0.5)


@pytest.fixture(scope="module", autouse=True)
def _wave():
    JOINT_TERMS.register(
        "Gw@POSITION",
        JointTerm(
            "wave", ("N", "N m"), lambda j, at: j.math.sin(at * j.position), ("position",),
            prior=WAVES,
        ),
    )  # fmt: skip
    yield
    del JOINT_TERMS._entries["Gw@POSITION"]


@pytest.fixture(scope="module")
def waves(load_once):
    """A five-bar of which the left motor alone has waves; their model, samples and coefficients."""
    robot = load_once("five_bar")
    waves = ",".join(f"Gw@{k}" for k in range(30, 210, 15))
    model = loopid.force_model(robot, "full", "Fc,Fv").with_columns(
        JointTerms.of(robot, waves).of_joints
    )
    generator = np.random.default_rng(0)
    sine, cosine = 0.2 * generator.normal(size=(2, 2, 4))
    series = FourierSeries(robot.actuated, 0.2, np.array([1.7, 0.7]), sine, cosine)
    motion = joint_motion(robot, series.motion(50.0, 20.0))
    W = model.regressor(motion)
    truth = np.array(model.prior)
    labels = model.parameters.labels
    own = [k for k, name in enumerate(labels) if name.startswith("left_crank_joint.Gw")]
    truth[own] = 0.3 * generator.normal(size=len(own))
    force = W @ truth + 0.05 * generator.normal(size=(len(W), 2))
    return model, FitSamples.of(model.parameters, robot.independent, W, force), truth, own


def test_a_group_is_as_large_as_its_coefficients_and_another_is_none(waves):
    model, samples, truth, own = waves
    found = consistent_fit(model, samples, quiet_fit(samples).noise)
    told = found.term_deviations
    assert told.names == ("left_crank_joint: waves", "right_crank_joint: waves")
    assert told.own[0] == pytest.approx(np.std(truth[own]), rel=0.5)
    assert told.determined[0] > 10
    assert told.own[1] < 0.02
    assert (np.abs(found.values - truth)[own] < 4.5 * found.standard_errors[own]).all()


def test_deviations_are_those_under_which_the_data_are_most_likely(waves):
    """By differences of the evidence, Laplace's approximation."""
    model, samples, *_ = waves
    sizes = np.full(len(joint_parameters(model)), 10.0)
    known = np.zeros(len(sizes)), sizes, np.full(len(sizes), np.inf)
    priors = JointPriors.of(model, samples.problem, *known)
    program = _Program.of(model, samples.problem.weighted(np.full(2, 20.0)), priors)
    state, _ = _most_likely(program)

    def evidence(logarithm):
        groups = np.array([np.exp(logarithm), state.groups[1]])
        there, step = _minimised(program, replace(state, groups=groups))
        _, size = np.linalg.slogdet(np.eye(len(step.g)) + step.J.T @ step.J)
        return -program.value(there) - size / 2

    middle = np.log(state.groups[0])
    below, at, above = (evidence(middle + change) for change in (-0.1, 0.0, 0.1))
    slope, curvature = (above - below) / 0.2, (above - 2 * at + below) / 0.01
    assert curvature < 0
    assert abs(slope / curvature) < 0.01


def test_known_deviations_leave_a_term_out_of_its_group(waves):
    model, samples, *_ = waves
    errors = [0.1 if p.kind.startswith("Gw") else 0.0 for p in model.parameters]
    known = replace(loopid.Fit.of(model, 0 * model.prior), covariance=np.diag(np.square(errors)))
    found = consistent_fit(model, samples, quiet_fit(samples).noise, known=known)
    assert found.term_deviations is None


@pytest.mark.parametrize("seed", range(5))
def test_a_step_within_limits_is_the_best_one(seed):
    generator = np.random.default_rng(seed)
    J, e, g = (generator.normal(size=size) for size in ((6, 8), 6, 8))
    last = 8 - seed  # entries of z that are limited
    rows, least = generator.normal(size=(12, last)), -0.1 * generator.random(12)
    step = _Step(10.0 * J, 10.0 * e, g)
    z = step.solution(rows, least)

    def value(z):
        return 0.5 * np.sum((step.e - step.J @ z) ** 2) + 0.5 * np.sum((g + z) ** 2)

    slopes = np.pad(rows, ((0, 0), (seed, 0)))
    limits = {"type": "ineq", "fun": lambda z: slopes @ z - least, "jac": lambda z: slopes}
    slope = lambda z: g + z - step.J.T @ (step.e - step.J @ z)  # noqa: E731
    other = minimize(value, np.zeros(8), jac=slope, constraints=[limits], tol=1e-12)
    assert (rows @ z[-last:] >= least - 1e-9).all()
    # SLSQP leaves the limits by some 1e-9, which lowers its value by 1e-8 of it.
    assert value(z) <= value(other.x) * (1 + 1e-7)
