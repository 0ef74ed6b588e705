"""Terms that data ask for: friction with more shape, offsets that they tell, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import (
    JointTerms,
    find_force_model,
    friction_curve,
    identify,
    prepare_recording,
    read_log,
)
from loopid.errors import DataError, OptionError
from loopid.identification import TermOptions, choose_terms, quiet_fit
from loopid.logs import Recording
from loopid.motion import scaled_bodies
from made_runs import logged, quietly, record, wander

FRICTION, STRIBECK = "Fc=0.1,Fv=0.05", "Fc=0.1,Fv=0.05,Fs~0.1=0.03"


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


def run(robot, values, seed, noise=0.01, motion=4):
    """A recording of a robot whose bodies are 20 % off its file."""
    wanders = wander(robot, motion, 20.0, 50.0, size=(0.5, 0.5), harmonics=5)
    terms = JointTerms.with_values(robot, values)
    return record(robot, wanders, terms, scaled_bodies(robot, 0.2), noise, seed)


def shapes(model):
    """Kinds of Stribeck friction of each joint that has some."""
    every = {} if model.joint_terms is None else model.joint_terms.of_joints
    found = {joint: [kind for kind in kinds if "Fs" in kind] for joint, kinds in every.items()}
    return {joint: kinds for joint, kinds in found.items() if kinds}


def test_the_usual_terms_are_those_of_the_model(robot):
    motors = dict.fromkeys(robot.actuated, ("Fc", "Fv", "Fo"))
    assert find_force_model(robot).joint_terms.of_joints == motors
    full = find_force_model(robot, "full")
    assert all(kinds == ("Fc", "Fv", "Fo", "Ia") for kinds in full.joint_terms.of_joints.values())
    assert full.automatic
    assert not find_force_model(robot, "full", "Fc,Fv,Fo,Ia").automatic


def test_stribeck_friction_is_found_where_it_is(robot):
    model, one = find_force_model(robot, "full"), robot.actuated[0]
    only_one = f"{FRICTION}; {one}: Fs~0.1=0.03"
    for values, joints in ((FRICTION, set()), (only_one, {one}), (STRIBECK, {*robot.actuated})):
        chosen = choose_terms(model, [run(robot, values, 0)])
        assert {*shapes(chosen)} == joints
        if not joints:
            assert chosen is model
        for kinds in shapes(chosen).values():
            assert {"Fs~0.05", "Fs~0.1"} <= {*kinds}


def test_terms_that_are_named_are_taken_as_they_are(robot):
    model = find_force_model(robot, "full", "Fc,Fv")
    assert choose_terms(model, [run(robot, STRIBECK, 0)]) is model
    automatic = find_force_model(robot, "full")
    never = TermOptions(false_alarm=0.0)
    assert choose_terms(automatic, [run(robot, STRIBECK, 0)], options=never) is automatic


def test_base_parameters_stay_the_same_beside_further_terms(robot):
    model = find_force_model(robot, "full")
    chosen = choose_terms(model, [run(robot, STRIBECK, 0)])
    own = model.parameters.labels
    assert [label for label in chosen.parameters.labels if "Fs" not in label] == list(own)
    for label in own:
        assert dict(chosen.base[label].factors) == pytest.approx(dict(model.base[label].factors))


@pytest.mark.parametrize("draws", [8, pytest.param(200, marks=pytest.mark.validate)])
def test_no_shape_is_invented(robot, draws):
    model = find_force_model(robot, "full")
    found = [shapes(choose_terms(model, [run(robot, FRICTION, seed)])) for seed in range(draws)]
    assert np.mean([bool(each) for each in found]) <= 0.025


def test_curves_lie_within_their_bands(robot):
    """Of friction whose law no term has: it falls off exponentially."""
    motion = wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5), harmonics=5)
    terms = JointTerms.with_values(robot, FRICTION)
    model, covered = find_force_model(robot, "full"), []

    def law(rate):
        return 0.05 * np.exp(-np.abs(rate) / 0.1) * np.sign(rate)

    rates = np.linspace(-0.5, 0.5, 40)
    for seed in range(6):
        plain = record(robot, motion, terms, scaled_bodies(robot, 0.2), 0.02, seed)
        force = plain.force + law(motion.velocities)
        recording = Recording.of_motion(motion, force, robot.actuated)
        found = quietly(identify, model, [recording])
        assert {*shapes(found.force_model)} == {*robot.actuated}
        for joint in robot.actuated:
            curve = friction_curve(found.fit, joint, rates)
            true = 0.1 * np.sign(rates) + 0.05 * rates + law(rates)
            covered.append((curve.band[:, 0] <= true) & (true <= curve.band[:, 1]))
    assert np.mean(covered) >= 0.8


def test_offsets_that_data_do_not_tell_are_left_out(robot):
    """A motion in one direction does not tell an offset from Coulomb friction."""
    model = find_force_model(robot, "gravity")
    motion = wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5), harmonics=5)
    forwards = (motion.velocities > 0.02).all(axis=1)
    plain = run(robot, FRICTION, 0)
    chosen = choose_terms(model, [plain.select(forwards)])
    kinds = {} if chosen.joint_terms is None else chosen.joint_terms.of_joints
    assert all("Fo" not in own for own in kinds.values())


def test_offsets_that_are_there_are_kept(robot):
    for kind in ("gravity", "full"):
        model = find_force_model(robot, kind)
        values = f"{FRICTION},Fo=0.5"
        slow = wander(robot, 4, 400.0, 10.0, size=(0.5, 0.5), harmonics=5)
        terms = JointTerms.with_values(robot, values)
        recording = record(robot, slow, terms, None, 0.01, 0)
        chosen = choose_terms(model, [recording])
        fit = quiet_fit(chosen.samples(recording))
        for joint in robot.actuated:
            low, high = fit[f"{joint}.Fo"].interval
            assert low - 0.2 <= 0.5 <= high + 0.2
            assert low > 0


def test_motors_that_stand_or_move_one_way_are_no_failure(robot):
    model = find_force_model(robot, "gravity")
    recording = run(robot, FRICTION, 0)
    still = recording.motion.velocities * [1.0, 0.0]
    halted = replace(recording, motion=replace(recording.motion, velocities=still))
    chosen = choose_terms(model, [halted])
    assert robot.actuated[1] not in shapes(chosen)
    assert not shapes(choose_terms(model, [recording.select(slice(8))]))


def test_a_curve_is_the_sum_of_its_terms(robot):
    model = find_force_model(robot, "full", "Fc,Fv,Fs~0.1,Fo,Ia; left_crank_joint: Fc~0.05")
    fit = quiet_fit(model.samples(run(robot, STRIBECK, 0)))
    rates = np.array([-0.4, -0.05, 0.05, 0.4])
    curve = friction_curve(fit, "left_crank_joint", rates)
    names = ("Fc", "Fv", "Fs~0.1", "Fc~0.05")
    laws = np.sign(rates), rates, np.exp(-((rates / 0.1) ** 2)) * np.sign(rates)
    laws = np.stack([*laws, np.tanh(rates / 0.05)])
    values = np.array([fit[f"left_crank_joint.{name}"].value for name in names])
    np.testing.assert_allclose(curve.values, values @ laws, rtol=1e-12)
    columns = [fit.parameters.labels.index(f"left_crank_joint.{name}") for name in names]
    spread = fit.covariance[np.ix_(columns, columns)]
    variance = np.einsum("ik,ij,jk->k", laws, spread, laws)
    half = np.ptp(curve.band, axis=1) / 2
    np.testing.assert_allclose(half, 1.96 * np.sqrt(variance), rtol=0.02)
    np.testing.assert_allclose(curve.band.mean(axis=1), curve.values, rtol=1e-12)


def test_curves_of_joints_without_friction_are_refused(robot):
    model = find_force_model(robot, "full", "none; left_crank_joint: Fc; right_crank_joint: Fo")
    fit = quiet_fit(model.samples(run(robot, FRICTION, 0)))
    for joint in ("right_crank_joint", "elbow"):
        with pytest.raises(OptionError) as refused:
            friction_curve(fit, joint, np.zeros(3))
        assert refused.value.facts["valid"] == ("left_crank_joint",)
    with pytest.raises(DataError):
        friction_curve(fit, "left_crank_joint", np.zeros((2, 2)))


@pytest.mark.parametrize("name", ["false_alarm", "further", "known_offset"])
def test_levels_out_of_range_are_refused(name):
    for wrong in (-0.1, 1.0):
        with pytest.raises(OptionError, match=name):
            TermOptions(**{name: wrong})


def test_logs_with_filtered_steps_are_asked_too(robot, tmp_path):
    """Stribeck friction that passes the filter of the log is found beside Coulomb friction."""
    motion = wander(robot, 4, 20.0, 500.0, size=(0.5, 0.5), harmonics=5)
    for values, joints in ((FRICTION, set()), (STRIBECK, {*robot.actuated})):
        terms = JointTerms.with_values(robot, values)
        text = logged(robot, motion, terms, 0.02, 0, scaled_bodies(robot, 0.2))
        (tmp_path / "run.csv").write_text(text)
        log = quietly(read_log, tmp_path / "run.csv", robot)
        recording = quietly(prepare_recording, robot, log)
        assert recording.history is not None
        found = quietly(identify, find_force_model(robot, "full"), [recording])
        assert {*shapes(found.force_model)} == joints
