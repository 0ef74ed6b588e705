"""Drive inertia, friction and offsets of joints, as the motors feel them."""

import numpy as np
import pytest

from loopid import (
    JointTerms,
    Observation,
    closed_motion,
    dynamic_regressor,
    find_base_parameters,
    random_configurations,
)
from loopid.errors import OptionError
from loopid.kinematics import random_motions
from loopid.robot import JOINT_TERMS, JointTerm


@pytest.fixture
def motion(moving):
    return closed_motion(*moving)


def all_terms(robot, **options):
    return JointTerms(robot.joints, tuple(JOINT_TERMS), **options)


@pytest.fixture
def signals(moving, motion, joint_positions):
    """What the kinds multiply at each joint, by definition; (N, nv, kinds)."""
    v, a, q = motion.velocities, motion.accelerations, motion.configurations
    return np.stack([a, np.sign(v), v, np.ones_like(v), joint_positions(moving[0], q)], axis=2)


def test_motors_pay_for_the_power_lost_in_every_joint(moving, motion, signals):
    robot, _, rates, _ = moving
    terms = all_terms(robot)
    phi = np.random.default_rng(1).normal(size=len(terms.parameters(robot)))
    forces = terms.columns(robot, motion) @ phi
    in_joints = np.einsum("njk,jk->nj", signals, phi.reshape(-1, len(JOINT_TERMS)))
    lost = np.einsum("nj,nj->n", in_joints, motion.velocities)
    np.testing.assert_allclose(np.einsum("ni,ni->n", forces, rates), lost, rtol=1e-9)


def test_an_actuated_joint_feels_its_own_terms_only(moving, motion, signals):
    robot = moving[0]
    for row, joint in enumerate(robot.actuated):
        columns = JointTerms((joint,), tuple(JOINT_TERMS)).columns(robot, motion)
        own = signals[:, robot.velocity_indices([joint])[0]]
        np.testing.assert_allclose(columns[:, row], own, atol=1e-12)
        np.testing.assert_allclose(np.delete(columns, row, axis=1), 0, atol=1e-12)


def test_coulomb_friction_vanishes_in_the_dead_zone_only(moving, motion):
    robot = moving[0]
    speed = np.abs(motion.velocities)
    zone = float(np.median(speed))
    terms = JointTerms(robot.actuated, ("Fc",), dead_zone=zone)
    moved = np.abs(terms.columns(robot, motion)).sum(axis=2) > 0
    index = robot.velocity_indices(robot.actuated)
    np.testing.assert_array_equal(moved, speed[:, index] > zone)


def test_smoothing_tends_to_the_sign(moving, motion):
    robot = moving[0]
    sharp = JointTerms(robot.joints, ("Fc",)).columns(robot, motion)
    slow = np.abs(motion.velocities[np.abs(motion.velocities) > 1e-9]).min()
    nearly = JointTerms(robot.joints, ("Fc",), smoothing=slow / 40).columns(robot, motion)
    np.testing.assert_allclose(nearly, sharp, atol=1e-9)
    smooth = JointTerms(robot.joints, ("Fc",), smoothing=1e9).columns(robot, motion)
    viscous = JointTerms(robot.joints, ("Fv",)).columns(robot, motion)
    np.testing.assert_allclose(1e9 * smooth, viscous, rtol=1e-6, atol=1e-9)


def test_labels_and_units_say_slide_or_turn(knee):
    names = JointTerms(("leg1_stroke", "leg4_revolute"), ("Fc", "Fv")).parameters(knee)
    assert names.labels == (
        "leg1_stroke.Fc",
        "leg1_stroke.Fv",
        "leg4_revolute.Fc",
        "leg4_revolute.Fv",
    )
    assert [name.unit for name in names] == ["N", "N s/m", "N m", "N m s/rad"]


def test_drives_and_friction_of_the_motors_are_base_parameters_of_their_own(knee):
    q = random_configurations(knee, 150, seed=2)
    motion = closed_motion(knee, q, *random_motions(knee, 150, seed=3))
    terms = JointTerms(knee.actuated, ("Fc", "Fv", "Fo"))
    rigid = dynamic_regressor(knee, q, *random_motions(knee, 150, seed=3))
    both = np.concatenate([rigid, terms.columns(knee, motion)], axis=2)
    names = knee.parameters() + terms.parameters(knee)
    alone = find_base_parameters(Observation.from_matrix(rigid, knee.parameters(), knee.length))
    found = find_base_parameters(Observation.from_matrix(both, names, knee.length))
    assert len(found) == len(alone) + 12
    assert set(terms.parameters(knee).labels) <= set(found.names)
    assert found.reconstruction_error(both) < 1e-9


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"kinds": ("Fq",)}, "Fq"),
        ({"dead_zone": -1.0}, "dead_zone"),
        ({"smoothing": float("nan")}, "smoothing"),
        ({"joints": ("elbow",)}, "elbow"),
        ({"joints": ("leg1_stroke", "leg1_stroke")}, "repeated"),
    ],
)
def test_wrong_terms_are_refused(knee, arguments, word):
    with pytest.raises(OptionError, match=word):
        JointTerms(**({"joints": knee.actuated} | arguments)).parameters(knee)


def test_a_new_term_is_one_class_and_one_entry(knee, monkeypatch):
    class Quadratic(JointTerm):
        name = "drag"
        units = ("N s²/m²", "N m s²/rad²")

        @staticmethod
        def signal(joint, terms, math):
            return joint.rate * math.fabs(joint.rate)

    monkeypatch.setitem(JOINT_TERMS, "Fq", Quadratic)
    q = random_configurations(knee, 5)
    motion = closed_motion(knee, q, *random_motions(knee, 5))
    terms = JointTerms(("leg1_stroke", "platform_yaw"), ("Fq",))
    assert [p.unit for p in terms.parameters(knee)] == ["N s²/m²", "N m s²/rad²"]
    columns = terms.columns(knee, motion)
    for k, index in enumerate(knee.velocity_indices(terms.joints)):
        v = motion.velocities[:, index, None]
        expected = motion.projection.G[:, index] * v * np.abs(v)
        np.testing.assert_allclose(columns[:, :, k], expected, rtol=1e-14)


def test_each_joint_may_have_terms_of_its_own(moving, motion):
    robot = moving[0]
    one, other = robot.joints[:2]
    terms = JointTerms((one, other), (("Ks",), ("Fc", "Fv")))
    labels = (f"{one}.Ks", f"{one}.Fo", f"{other}.Fc", f"{other}.Fv")
    assert terms.parameters(robot).labels == labels
    every = JointTerms((one, other), ("Fc", "Fv", "Ks"))
    columns = every.columns(robot, motion)
    places = [every.parameters(robot).labels.index(label) for label in labels]
    np.testing.assert_array_equal(terms.columns(robot, motion), columns[..., places])


@pytest.mark.parametrize(
    ("choice", "kinds"),
    [("none", None), ("file", None), ("Fc", ("Fc",)), (" Ks , file", ("Ks",)), ("", None)],
)
def test_choices_of_terms_are_words(knee, choice, kinds):
    terms = JointTerms.of(knee, choice)
    assert terms == (None if kinds is None else JointTerms(knee.actuated, kinds))


def test_an_unknown_word_of_a_choice_is_refused(knee):
    with pytest.raises(OptionError, match=r"unknown joint term 'Fq': choose one of Ia, .*, file"):
        JointTerms.of(knee, "Fc,Fq")
