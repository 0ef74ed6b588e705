"""Coordinates that no motor moves: "= 0" is what their rows read, and they tell something."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from closure_robots import X, Y, body, joint
from linkages import LINKAGES
from loopid import Dynamics, random_configurations
from loopid.errors import RankError
from loopid.identification import fit, identify
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import random_motions
from loopid.kinematics.projection import singularity_measure
from loopid.logs import Recording
from loopid.motion import JointMotion
from loopid.report import identification_report
from made_runs import quietly

DRAWS = 16
NOISE = 0.1


def pendulum():
    """Two bars, a motor at the shoulder only."""
    parts = [body("upper"), body("lower", (0.2, -0.05, 0.1), 1.5)]
    parts += [joint("shoulder", "ground", "upper", axis=Y)]
    parts += [joint("elbow", "upper", "lower", (0.4, 0, 0), Y)]
    return parts, {"name_mot": ["shoulder"]}


def cart():
    """A motor pushes a cart, on which a pole falls."""
    parts = [body("cart"), body("pole", (0.05, 0.02, 0.4))]
    parts += [joint("push", "ground", "cart", axis=X, kind="prismatic")]
    parts += [joint("hinge", "cart", "pole", (0, 0, 0.1), Y)]
    return parts, {"name_mot": ["push"]}


def light_rod():
    """The rod between two balls spins freely and has no inertia."""
    parts, description = LINKAGES["ball rssr"]
    return ['<link name="rod"/>' if part == body("rod") else part for part in parts], description


ROBOTS = {
    "pendulum": pendulum(),
    "cart": cart(),
    "rod": LINKAGES["ball rssr"],
    "light rod": light_rod(),
}


@pytest.fixture(scope="module")
def model_of(load_files):
    return cache(lambda name: loopid.force_model(load_files(*ROBOTS[name]), "full", None))


def fall(robot, seed, count=300):
    """Unrelated samples of a motion under random forces of the motors, zero on free coordinates."""
    q = random_configurations(robot, count, seed=seed)
    rates, _ = random_motions(robot, count, seed=seed)
    forces = 10 * np.random.default_rng(seed).uniform(-1, 1, (count, len(robot.actuated)))
    dynamics, none = Dynamics(robot), np.zeros((count, len(robot.free)))
    tau, measure = np.hstack([forces, none]), singularity_measure(robot, q)
    accelerations = dynamics.forward(dynamics.pose(q=q), rates, tau)
    moved = JointMotion(np.arange(count) / 10, q, rates, accelerations, measure)
    return Recording.of_motion(moved, tau, robot.independent, name="fall")


@pytest.fixture(scope="module")
def fallen(model_of):
    """Exact falls of a robot by its name and a seed."""
    return cache(lambda name, seed: fall(model_of(name).robot, seed))


def noisy(recording, motors, generator, scale=NOISE):
    """The same with errors of the motors' forces."""
    force = recording.force.copy()
    force[:, :motors] += generator.normal(scale=scale, size=force[:, :motors].shape)
    return replace(recording, force=force)


def motors_alone(recording, robot):
    return replace(recording, used=recording.used & ~np.isin(recording.actuators, robot.free))


@pytest.mark.parametrize(
    ("name", "estimator"),
    [
        *(("pendulum", "wls"), ("pendulum", "ols"), ("cart", "ols")),
        pytest.param("rod", "wls", marks=pytest.mark.validate),
    ],
)
def test_intervals_cover_the_true_values(model_of, fallen, name, estimator):
    model, generator, errors = model_of(name), np.random.default_rng(7), []
    samples = model.samples(fallen(name, 1))
    for _ in range(DRAWS):
        error = np.zeros_like(samples.force)
        error[:, :1] = generator.normal(scale=NOISE, size=error[:, :1].shape)
        result = quiet_fit(samples.with_force(samples.force + error), estimator)
        errors.append((result.values - model.prior) / result.standard_errors)
    assert np.abs(np.mean(errors, axis=0)).max() < 4 / np.sqrt(DRAWS)
    assert 0.8 < np.std(errors) < 1.2


@pytest.mark.parametrize("name", few_of(["pendulum", "rod"], "pendulum"))
def test_rows_without_a_motor_make_estimates_surer(model_of, fallen, name):
    model = model_of(name)
    robot = model.robot
    recording = noisy(fallen(name, 1), 1, np.random.default_rng(2))
    alone, both = (
        quiet_fit(model.samples(each)).standard_errors
        for each in (motors_alone(recording, robot), recording)
    )
    assert (both < 1.05 * alone).all()
    assert (both / alone).min() < 0.8


def test_rows_without_a_motor_identify_what_no_motor_feels(model_of, fallen):
    # A cart feels how its pole's weight moves, but not what it takes to turn the pole.
    model = model_of("cart")
    recording = noisy(fallen("cart", 1), 1, np.random.default_rng(2))
    with pytest.raises(RankError, match=r"do not excite pole\.Iyy at all"):
        quiet_fit(model.samples(motors_alone(recording, model.robot)))
    found = quiet_fit(model.samples(recording))
    place = found.parameters.labels.index("pole.Iyy")
    assert found.values[place] == pytest.approx(model.prior[place], rel=0.02)
    assert found.relative_std[place] < 2


@pytest.mark.parametrize("noise", [1.0, 1e-6])
@pytest.mark.parametrize("name", ["pendulum", "cart", "rod"])
def test_exact_rows_do_not_drown_the_others(model_of, fallen, name, noise):
    model = model_of(name)
    data = noisy(fallen(name, 1), 1, np.random.default_rng(2), noise)
    samples = model.samples(data)
    found = quiet_fit(samples)
    assert (found.noise.deviation >= 0.99 * samples.least_errors).all()
    errors = np.abs(found.values - model.prior)
    assert (errors < 4.5 * found.standard_errors).all()
    assert errors.max() < 0.1 * noise


@pytest.mark.parametrize("name", ["pendulum", "rod"])
def test_exact_rows_count_as_known_to_a_ten_thousandth_of_their_terms(model_of, fallen, name):
    model = model_of(name)
    samples = model.samples(fallen(name, 1))
    terms = np.sqrt(((samples.regressor * model.prior) ** 2).sum(axis=2).mean(axis=0))
    np.testing.assert_allclose(samples.least_errors, [0.0, 1e-4 * terms[1]])


def test_rows_with_errors_of_the_motion_count_by_these(model_of, fallen):
    # What acceleration sensors get wrong is more than round-off, and weighs accordingly.
    model, generator = model_of("pendulum"), np.random.default_rng(3)
    recording = noisy(fallen("pendulum", 1), 1, generator)
    samples = model.samples(recording)
    wrong = recording.force.copy()
    wrong[:, 1] += generator.normal(scale=0.5, size=len(wrong))
    found = quiet_fit(samples.with_force(wrong))
    assert found.noise.deviation == pytest.approx([NOISE, 0.5], rel=0.15)


@pytest.fixture(scope="module")
def identified(model_of, fallen):
    """Identifications with the robot file's values, or with a rod that is another."""

    @cache
    def found(name):
        model, generator = model_of(name), np.random.default_rng(4)
        data = [[noisy(fallen(name, seed), 1, generator)] for seed in (1, 2)]
        return quietly(identify, model, data[0], validation=data[1])

    return found


@pytest.mark.parametrize("name", few_of(["pendulum", "rod"], "pendulum"))
def test_a_true_robot_file_is_not_beaten_on_exact_rows(identified, name):
    found = identified(name)
    for candidate in found.candidates.values():
        assert candidate.error_ratio[0] == pytest.approx(1, abs=0.15)
        assert not candidate.beats_baseline
        assert candidate.validation.residual_rms[0] == pytest.approx(NOISE, rel=0.2)


def test_reports_hold_rows_without_a_motor(identified):
    found = identified("rod")
    report = identification_report(found)
    assert json.loads(json.dumps(report.data, allow_nan=False))["actuators"] == [
        "crank_joint",
        "ball.wx",
    ]
    assert "</i>ball.wx</h3>" in report.page().html()


@pytest.mark.validate
def test_a_spin_that_moves_no_mass_identifies_nothing(model_of, fallen):
    model = model_of("light rod")
    recording = noisy(fallen("light rod", 1), 1, np.random.default_rng(5))
    samples = model.samples(recording)
    assert model.robot.free == ("ball.wx",)
    assert samples.problem.samples.tolist() == [300, 0]
    found = fit(samples)
    errors = (found.values - model.prior) / found.standard_errors
    assert np.abs(errors).max() < 4.5
