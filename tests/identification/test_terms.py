"""Offsets that data tell are kept, and no others."""

from dataclasses import replace

import pytest

import loopid
from closure_robots import body, urdf
from loopid import JointTerms
from loopid.identification import choose_terms, samples_of
from loopid.identification.fitting import quiet_fit
from loopid.identification.terms import without_offset
from loopid.motion import scaled_bodies
from made_runs import HINGE, record, wander

FRICTION = "Fc=0.1,Fv=0.05"


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


def run(robot, values, seed, noise=0.01, motion=4):
    """A recording of a robot whose bodies are 20 % off its file."""
    wanders = wander(robot, motion, 20.0, 50.0, size=(0.5, 0.5), harmonics=5)
    terms = JointTerms.with_values(robot, values)
    return record(robot, wanders, terms, scaled_bodies(robot, 0.2), noise, seed)


def test_the_usual_terms_are_those_of_the_model(robot):
    motors = dict.fromkeys(robot.actuated, ("Fc", "Fv", "Fo"))
    assert loopid.force_model(robot).joint_terms.of_joints == motors
    full = loopid.force_model(robot, "full")
    assert all(kinds == ("Fc", "Fv", "Fo", "Ia") for kinds in full.joint_terms.of_joints.values())
    assert full.automatic
    assert not loopid.force_model(robot, "full", "Fc,Fv,Fo,Ia").automatic
    more = loopid.force_model(robot, "full", "auto; left*: Ks")
    assert more.automatic
    kinds = more.joint_terms.of_joints
    assert kinds["left_crank_joint"] == ("Fc", "Fv", "Fo", "Ia", "Ks")
    assert kinds["right_crank_joint"] == ("Fc", "Fv", "Fo", "Ia")


def test_terms_that_are_named_are_taken_as_they_are(robot):
    model = loopid.force_model(robot, "gravity", "Fc,Fv,Fo")
    recording = run(robot, FRICTION, 0)
    forwards = (recording.motion.velocities > 0.02).all(axis=1)
    assert choose_terms(model, samples_of(model, [recording.select(forwards)])) is model


def test_offsets_that_data_do_not_tell_are_left_out(robot):
    """A motion in one direction does not tell an offset from Coulomb friction."""
    model = loopid.force_model(robot, "gravity")
    motion = wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5), harmonics=5)
    forwards = (motion.velocities > 0.02).all(axis=1)
    plain = run(robot, FRICTION, 0)
    chosen = choose_terms(model, samples_of(model, [plain.select(forwards)]))
    kinds = {} if chosen.joint_terms is None else chosen.joint_terms.of_joints
    assert all("Fo" not in own for own in kinds.values())


def test_offsets_that_are_there_are_kept(robot):
    for kind in ("gravity", "full"):
        model = loopid.force_model(robot, kind)
        values = f"{FRICTION},Fo=0.5"
        slow = wander(robot, 4, 400.0, 4.0, size=(0.5, 0.5), harmonics=5)
        terms = JointTerms.with_values(robot, values)
        recording = record(robot, slow, terms, None, 0.01, 0)
        chosen = choose_terms(model, samples_of(model, [recording]))
        fit = quiet_fit(chosen.samples(recording))
        for joint in robot.actuated:
            low, high = fit[f"{joint}.Fo"].interval
            assert low - 0.2 <= 0.5 <= high + 0.2
            assert low > 0


def test_motors_that_stand_are_no_failure(robot):
    model = loopid.force_model(robot, "gravity")
    recording = run(robot, FRICTION, 0)
    still = recording.motion.velocities * [1.0, 0.0]
    halted = replace(recording, motion=replace(recording.motion, velocities=still))
    for each in (halted, recording.select(slice(8))):
        assert choose_terms(model, samples_of(model, [each])).automatic


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Two links; the weight of the hand across the wrist is its offset where it hardly moves."""
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(
        urdf(
            body("upper", (0.02, 0.01, 0.2), 3.0),
            body("hand", (0.03, 0.01, 0.05), 0.6),
            HINGE.format("shoulder", "ground", "upper", 0.3, "0 1 0"),
            HINGE.format("wrist", "upper", "hand", 0.3, "0 1 0"),
        )
    )
    return loopid.load(file)


def test_offsets_that_were_left_out_are_named(arm):
    terms, values = JointTerms(arm.actuated, ("Fc", "Fv", "Fo")), [0.3, 0.2, 0.0, 0.3, 0.2, 0.15]
    for size, left_out in (((1.0, 1.2), ()), ((0.05, 0.02), ("wrist",))):
        motion = wander(arm, 1, seconds=20.0, rate=50.0, size=size)
        given = record(arm, motion, (terms, values), noise=0.02, seed=1)
        model = loopid.force_model(arm, "gravity")
        data = samples_of(model, [given])
        chosen = choose_terms(model, data)
        found = without_offset(chosen, samples_of(chosen, [given]))
        assert tuple(name for name in found if name == "wrist") == left_out
    named = loopid.force_model(arm, "gravity", "Fc,Fv")  # as they were asked for
    assert without_offset(named, samples_of(named, [given])) == ()


def test_intervals_hold_an_offset_that_was_left_out(arm):
    """It is a few per cent of the motor's force, as in real ones. Bodies are those of the file."""
    motion = wander(arm, 1, seconds=20.0, rate=50.0, size=(0.05, 0.02))
    terms, off = JointTerms(arm.actuated, ("Fc", "Fv", "Fo")), 0.012
    for sign in (-1, 1):
        values = [0.3, 0.2, 0.0, 0.03, 0.02, sign * off]
        given = record(arm, motion, (terms, values), noise=0.002, seed=1)
        fit = loopid.identify(arm, given).fit
        assert "wrist.Fo" not in fit.parameters.labels
        truth = fit.model.base.values(fit.model.standard_prior)
        bodies = [name for name in fit.parameters.labels if name.startswith("hand")]
        apart = [abs(fit[name].value - truth[fit.parameters.labels.index(name)]) for name in bodies]
        errors = [fit[name].standard_error for name in bodies]
        assert all(a <= 2 * e for a, e in zip(apart, errors, strict=True))
