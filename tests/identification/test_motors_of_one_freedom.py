"""Two motors at one degree of freedom, as gantries and heavy axes have: default options."""

import numpy as np
import pytest

import loopid
from loopid.report import excitation_report, identification_report
from made_runs import quietly, wander

FRICTION = np.array([0.3, 0.4, 0.2, 0.5])  # Fc, Fv of both


@pytest.fixture(scope="module")
def robot():
    """Its inertia is constant: that of the drives looks the same."""
    return loopid.load("parallelogram", motors=["crank_joint", "rocker_joint"])


@pytest.fixture(scope="module")
def found(robot, once):
    motion = wander(robot, 1, seconds=10.0, rate=50.0, size=(0.4,))
    made = loopid.simulate(
        robot, motion, joint_terms=loopid.JointTerms(robot.actuated), joint_values=FRICTION
    )
    noise = np.random.default_rng(0).normal(scale=0.02, size=made.force.shape)
    columns = robot.velocity_indices(robot.actuated)
    log = loopid.Log.from_arrays(
        motion.time, motion.configurations[:, columns], made.force + noise, robot.actuated
    )
    return once("motors of one freedom", lambda: quietly(loopid.identify, robot, log))


def test_more_joint_terms_than_combinations_are_estimated(robot, found):
    model = found.force_model
    truth = np.zeros(len(model.base.parameters))
    truth[: len(robot.parameters())] = robot.standard_parameters()
    for joint, (coulomb, viscous) in zip(robot.actuated, FRICTION.reshape(2, 2), strict=True):
        labels = model.base.parameters.labels
        truth[labels.index(f"{joint}.Fc")] = coulomb
        truth[labels.index(f"{joint}.Fv")] = viscous
    assert sum(label.startswith(robot.actuated) for label in labels) > len(model.parameters)
    errors = (found.fit.values - model.base.values(truth)) / found.fit.standard_errors
    assert np.abs(errors).max() < 4


def test_friction_of_the_other_motor_is_no_mistake_of_the_time_axis(found):
    assert not [each for each in found.findings if each.severity == "mistake"]


@pytest.mark.validate
def test_reports_number_all_motors(robot, found):
    design = loopid.design_motion(
        loopid.force_model(robot, "gravity"),
        options=loopid.DesignOptions(
            evaluations=0, starts=1, size=2, rate=20.0, duration=4.0, noise=0.1
        ),
    )
    for report in (identification_report(found), excitation_report(design)):
        page = report.page().html()
        assert "1 crank_joint; 2 rocker_joint" in page
