"""Drive inertia, friction and offsets of joints, as the motors feel them."""

import numpy as np
import pytest

import loopid
from closure_robots import body, joint, urdf
from loopid import JointTerms, random_configurations
from loopid.base_parameters import find_base
from loopid.errors import OptionError
from loopid.kinematics import closed_motion, random_motions
from loopid.observation import Observation
from loopid.parameters import ParameterSet
from loopid.regressors import (
    JOINT_TERMS,
    JointState,
    JointTerm,
    gravity_regressor,
    motion_regressor,
    structural_observation,
)


def test_motors_pay_for_the_power_lost_in_every_joint(moving, motion, joint_signals):
    robot, _, rates, _ = moving
    signals = joint_signals
    terms = JointTerms(robot.joints, tuple(signals))
    phi = np.random.default_rng(1).normal(size=len(terms.parameters(robot)))
    forces = terms.columns(robot, motion) @ phi
    each = np.stack(list(signals.values()), axis=2)
    in_joints = np.einsum("njk,jk->nj", each, phi.reshape(-1, len(signals)))
    lost = np.einsum("nj,nj->n", in_joints, motion.velocities)
    np.testing.assert_allclose(np.einsum("ni,ni->n", forces, rates), lost, rtol=1e-9)


def test_an_actuated_joint_feels_its_own_terms_only(moving, motion, joint_signals):
    robot, signals = moving[0], joint_signals
    for row, name in enumerate(robot.actuated):
        columns = JointTerms((name,), tuple(signals)).columns(robot, motion)
        (index,) = robot.velocity_indices([name])
        own = np.stack([signal[:, index] for signal in signals.values()], axis=1)
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
    q = random_configurations(knee, 150, seed=5)
    v, a = random_motions(knee, 150, seed=3)
    motion = closed_motion(knee, q, v, a)
    terms = JointTerms(knee.actuated, ("Fc", "Fv", "Fo"))
    rigid = motion_regressor(knee, closed_motion(knee, q, v, a))
    both = np.concatenate([rigid, terms.columns(knee, motion)], axis=2)
    names = knee.parameters() + terms.parameters(knee)
    of_bodies = Observation.from_matrix(rigid, knee.parameters(), length=knee.length)
    alone = find_base(of_bodies)
    found = find_base(Observation.from_matrix(both, names, length=knee.length))
    assert len(found) == len(alone) + 12
    assert set(terms.parameters(knee).labels) <= set(found.names)
    assert found.reconstruction_error(both) < 1e-9


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        ({"kinds": ("Fq",)}, {"given": "Fq"}),
        ({"dead_zone": -1.0}, {"argument": "dead_zone", "given": -1.0}),
        ({"joints": ("elbow",)}, {"given": "elbow"}),
        ({"joints": ("leg1_stroke", "leg1_stroke")}, {"joints": ["leg1_stroke"]}),
        ({"kinds": (("Fc",), ("Fv",))}, {"given": 2, "valid": 4}),
    ],
)
def test_wrong_terms_are_refused(knee, arguments, facts):
    with pytest.raises(OptionError) as error:
        JointTerms(**({"joints": knee.actuated} | arguments)).parameters(knee)
    assert facts.items() <= error.value.facts.items()


@pytest.mark.parametrize("name", ["dead_zone", "smoothing"])
def test_rates_that_are_no_numbers_are_refused(knee, name):
    with pytest.raises(OptionError, match=name):
        JointTerms(knee.actuated, **{name: float("nan")})


def test_a_term_of_ones_own_is_one_entry(knee):
    """Registered from outside, it has columns, units, labels, and a place in choices."""

    def law(joint, at):
        return joint.rate * joint.math.fabs(joint.rate)

    JOINT_TERMS.register("Fd", JointTerm("drag", ("N s²/m²", "N m s²/rad²"), law, ("rate",)))
    q = random_configurations(knee, 5, seed=5)
    motion = closed_motion(knee, q, *random_motions(knee, 5))
    terms = JointTerms.of(knee, "none; leg1_stroke: Fd; platform_yaw: Fd")
    assert [p.unit for p in terms.parameters(knee)] == ["N s²/m²", "N m s²/rad²"]
    columns = terms.columns(knee, motion)
    for k, index in enumerate(knee.velocity_indices(terms.joints)):
        v = motion.velocities[:, index, None]
        expected = motion.projection.G[:, index] * v * np.abs(v)
        np.testing.assert_allclose(columns[:, :, k], expected, rtol=1e-14)


@pytest.mark.parametrize("kind", JOINT_TERMS)
def test_a_law_needs_what_it_says_and_no_more(kind):
    """It fails without any one thing that it needs, and nothing else changes it."""
    term = JOINT_TERMS[kind]
    at = 0.3 if kind.endswith(("RATE", "POSITION")) else 0.0
    given = {"position": 0.7, "rate": 1.1, "acceleration": -0.4, "load": 2.0}
    usual = term.law(JointState(**given, math=np), at)
    for name, value in given.items():
        needed = name in term.needs or (name == "rate" and "sign" in term.needs)
        if needed:
            with pytest.raises(TypeError):
                term.law(JointState(**given | {name: None}, math=np), at) + 0.0
        else:
            other = JointState(**given | {name: 3 * value}, math=np)
            assert term.law(other, at) == usual


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
    [("none", None), ("file", None), ("Fc", ("Fc",)), (" Ks , file", ("Ks",))],
)
def test_choices_of_terms_are_words(knee, choice, kinds):
    terms = JointTerms.of(knee, choice)
    assert terms == (None if kinds is None else JointTerms(knee.actuated, kinds))


@pytest.mark.parametrize(
    "choice",
    [
        "Fc,Fv",
        "Fc+,Fc-,Fo; passive: Fv",
        "Ia; right_crank_joint: Ks3,Ks2,Ks,Fo; left_coupler_joint: Ks@-0.2,Fc~1e-05",
    ],
)
def test_choices_are_written_as_they_are_read(load_once, choice):
    robot = load_once("five_bar")
    terms = JointTerms.of(robot, choice)
    assert terms.choice(robot) == choice
    names = terms.parameters(robot)
    assert ParameterSet.from_labels(names.labels) == names


def test_later_parts_of_a_choice_add_to_joints_that_they_name(load_once):
    robot = load_once("five_bar")
    terms = JointTerms.of(robot, "Fv; *_crank*: Fc; left*: Fo; passive: none")
    assert terms.of_joints == {
        "left_crank_joint": ("Fv", "Fc", "Fo"),
        "right_crank_joint": ("Fv", "Fc"),
        "left_coupler_joint": ("Fo",),
    }
    values = JointTerms.with_values(robot, "Fv=2; left_crank_joint: Ks=3; passive: Fv=0.5")
    assert dict(zip(values[0].parameters(robot).labels, values[1], strict=True)) == {
        "left_crank_joint.Fv": 2.0,
        "left_crank_joint.Ks": 3.0,
        "left_crank_joint.Fo": 0.0,
        "right_crank_joint.Fv": 2.0,
        "left_coupler_joint.Fv": 0.5,
        "right_coupler_joint.Fv": 0.5,
    }


@pytest.mark.parametrize(
    ("choice", "given", "valid"),
    [
        ("Fc,Fq", "Fq", {"Ia", "file", "none"}),
        ("elbow: Fc", "elbow", {"leg1_stroke", "passive"}),
        ("Ks@up", "Ks@up", set()),
        ("Fc~0", "Fc~0", set()),
        ("Ks@inf", "Ks@inf", set()),
    ],
)
def test_unknown_words_of_a_choice_are_refused(knee, choice, given, valid):
    with pytest.raises(OptionError) as error:
        JointTerms.of(knee, choice)
    assert error.value.facts["given"] == given
    assert valid <= {*error.value.facts.get("valid", ())}


def test_friction_by_direction_is_no_constant_force_at_rest(load_once):
    """In motion it is; base parameters that fold them would have it hold the robot at rest."""
    robot = load_once("four_bar")
    terms = JointTerms(robot.actuated, ("Fc+", "Fc-", "Fo"))
    model = loopid.force_model(robot, "gravity", terms, search="qr")
    standard = np.random.default_rng(0).normal(size=len(model.base.parameters))
    values = model.base.values(standard)
    dynamics, pose = loopid.Dynamics(model, values), robot.reference
    weight = gravity_regressor(robot, pose) @ standard[:-3]
    found = [dynamics.regressor(dynamics.pose(q=pose)) @ values]
    found.append(dynamics.inverse(dynamics.pose(q=pose)))
    np.testing.assert_allclose(found, 2 * [weight + standard[-1:]], atol=1e-9)


def test_terms_that_no_force_tells_apart_are_folded(tmp_path):
    """A constant force with the weight of a vertical slide."""
    slide = joint("lift", "ground", "load", axis=(0, 0, 1), kind="prismatic")
    (tmp_path / "lift.urdf").write_text(urdf(body("load"), slide))
    lift = loopid.load(tmp_path / "lift.urdf")
    observation = structural_observation(lift, joint_terms=JointTerms(("lift",), ("Ks",)))
    base = find_base(observation)
    assert [set(each) for each in base.terms] == [{"load.m", "lift.Fo"}, {"lift.Ks"}]


def test_friction_near_standstill_is_told_from_coulomb_friction(load_once):
    """Random motions would hardly ever be as slow."""
    robot = load_once("five_bar")
    terms = JointTerms.of(robot, "Fc,Fv,Fs~0.001,Fc~0.002; passive: Fc,Fs~1e-4")
    found = find_base(structural_observation(robot, joint_terms=terms))
    assert set(terms.parameters(robot).labels) <= set(found.names)


@pytest.mark.parametrize("text", ["", " ", " ; ,"])
def test_a_choice_without_a_word_is_refused(load_once, text):
    """As of a variable of a shell that is not set."""
    robot = load_once("five_bar")
    assert JointTerms.of(robot, JointTerms(()).choice(robot)) is None
    for use in (JointTerms.of, lambda *given: loopid.force_model(given[0], "gravity", given[1])):
        with pytest.raises(OptionError, match=r"^terms must be kinds .*'none', not '"):
            use(robot, text)
    with pytest.raises(OptionError, match="terms must be kinds"):
        loopid.FitOptions(terms=text)
