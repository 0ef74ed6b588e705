"""What a log supports: dark combinations, their lights, and a refusal that names both."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import JointTerms
from loopid.errors import DataError
from loopid.experiment import data_support, find_force_model, lighting_motion
from loopid.experiment.excited import Excited
from loopid.experiment.prior_size import body_sizes
from loopid.experiment.repertoire import Reach
from loopid.identification import FitSamples, quiet_fit
from loopid.kinematics import measured_coordinates
from loopid.logs import Recording
from loopid.trajectories import Motion, joint_motion
from made_runs import modelled, wander

UR10 = "ur_description/urdf/ur10_robot.urdf"
# Robot, model, whether joints have friction, the joint that moves, and how far in m or rad.
CASES = {
    "knee at one pose": ("3ups_rpu", "gravity", False, 0, 0.0),
    "knee with friction": ("3ups_rpu", "gravity", True, 3, 0.02),
    "five bar": ("five_bar", "full", True, 0, 0.4),
    "arm of six": (UR10, "full", False, 1, 0.8),
}


def one_joint(robot, joint, size, seconds=6.0, rate=20.0):
    """A motion of one motor, the others stand."""
    middle = measured_coordinates(robot).read(robot.reference[None].copy())[0]
    time, omega = np.arange(int(seconds * rate)) / rate, 2 * np.pi * 0.4
    position, velocity, acceleration = (np.zeros((len(time), len(middle))) for _ in range(3))
    position += middle
    position[:, joint] += size * np.sin(omega * time)
    velocity[:, joint] = size * omega * np.cos(omega * time)
    acceleration[:, joint] = -size * omega**2 * np.sin(omega * time)
    return joint_motion(robot, Motion(robot.measured, time, position, velocity, acceleration))


def recorded(model, motion):
    """A recording whose forces are the robot file's, with a little noise."""
    return modelled(model, motion, model.prior, noise=0.01)


@pytest.fixture(scope="module", params=CASES)
def case(request, load_once, robot_data):
    """A force model, a log of one moving joint, and what it supports."""
    name, kind, friction, joint, size = CASES[request.param]
    robot = load_once(robot_data / name if name.endswith(".urdf") else name)
    terms = JointTerms(robot.actuated) if friction else None
    model = find_force_model(robot, kind, terms)
    recording = recorded(model, one_joint(robot, joint, size))
    return model, recording, data_support(model, [recording])


def weighted(model, recording, support):
    """Rows of the regressor, in parts of the motors' forces, of parameters in their sizes."""
    W = model.regressor(recording.motion) * support.excited.weights[:, None]
    return W.reshape(-1, W.shape[-1]) @ support.excited.factor


def in_sizes(support, directions):
    changes = np.array([direction.change for direction in directions])
    return np.linalg.solve(support.excited.factor, changes.T)


def test_the_spectrum_is_that_of_the_rows_of_the_log(case):
    model, recording, support = case
    rows = weighted(model, recording, support)
    expected = np.linalg.svd(rows, compute_uv=False) / np.sqrt(len(rows))
    np.testing.assert_allclose(support.excited.effects, expected, atol=1e-12 * expected[0])
    assert support.rank == np.linalg.matrix_rank(rows, tol=1e-10 * np.sqrt(len(rows)))
    assert support.rank < support.structural_rank == len(model.parameters)
    # Over all that the robot can do, every combination has an effect.
    assert support.excited.structural.min() > 1e-8 * support.excited.structural.max()


def test_what_is_dark_changes_no_force_and_is_all_that_does_not(case):
    model, recording, support = case
    x = in_sizes(support, support.dark)
    assert x.shape[1] == support.structural_rank - support.rank
    np.testing.assert_allclose(np.linalg.norm(x, axis=0), 1)
    effects = np.linalg.norm(weighted(model, recording, support) @ x, axis=0)
    assert effects.max() < 1e-9 * support.excited.effects[0] * np.sqrt(recording.force.size)
    assert np.linalg.matrix_rank(x, tol=1e-6) == x.shape[1]


def test_each_dark_combination_is_led_by_a_parameter_of_its_own(case):
    _, _, support = case
    leads = [next(iter(direction.terms)) for direction in support.dark]
    assert len(set(leads)) == len(leads)
    for direction in support.dark:
        others = set(leads) - set(direction.terms)
        assert len(others) == len(leads) - 1
        named = {label: direction.change[support.parameters.labels.index(label)] for label in leads}
        assert named[next(iter(direction.terms))] != 0
        assert not any(named[label] for label in others)
        assert set(direction.terms) <= set(support.assumed)


def combined_effects(model, recording, support, motions):
    """Effects of the dark combinations on a log that has these motions too."""
    rows = [weighted(model, recording, support)]
    for motion in motions:
        rows.append(weighted(model, recorded(model, motion), support))
    rows = np.concatenate(rows)
    return np.linalg.norm(rows @ in_sizes(support, support.dark), axis=0) / np.sqrt(len(rows))


def test_the_motion_that_lights_a_combination_does(case):
    model, recording, support = case
    robot = model.mechanism
    before = combined_effects(model, recording, support, [])
    for k, direction in enumerate(support.dark):
        motion = lighting_motion(robot, direction.lighting)
        after = combined_effects(model, recording, support, [motion])
        assert after[k] > 1e-7 * support.excited.effects[0] > 100 * before[k]
        # Most of what the light promises is in the motion.
        W = model.regressor(motion) * support.excited.weights[:, None]
        forces = np.linalg.norm(W @ direction.change, axis=1)
        assert forces.max() > 0.5 * direction.lighting.effect


def test_all_lights_together_leave_nothing_dark(case):
    model, recording, support = case
    motions = [lighting_motion(model.mechanism, dark.lighting) for dark in support.dark]
    lit = data_support(model, [recording, *(recorded(model, motion) for motion in motions)])
    assert lit.rank == lit.structural_rank
    assert not lit.dark
    assert not lit.assumed


def test_no_other_direction_of_acceleration_shows_more(case):
    model, _, support = case
    generator, reach = np.random.default_rng(1), Reach.of(model.mechanism).acceleration
    for direction in support.dark:
        light = direction.lighting
        if light.kind != "acceleration" or light.approach.any():
            continue
        a = generator.normal(size=(200, len(reach)))
        a *= reach / np.linalg.norm(a, axis=1, keepdims=True)
        q = np.repeat(light.configuration[None], len(a), axis=0)
        K = model.base.regressor(model.standard_regressor(q, np.zeros_like(a), a))
        forces = np.linalg.norm(support.excited.weights * (K @ direction.change), axis=1)
        assert forces.max() <= light.effect * (1 + 1e-6)


def test_no_other_velocity_shows_more(case):
    model, _, support = case
    generator = np.random.default_rng(2)
    for direction in support.dark:
        light = direction.lighting
        kinds = {label.rpartition(".")[2] for label in direction.terms}
        if light.kind != "velocity" or kinds & {"Fc", "Fv"}:
            continue
        x = generator.normal(size=(300, len(light.joints)))
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        v = x * Reach.of(model.mechanism).velocity
        q = np.repeat(light.configuration[None], len(v), axis=0)
        K = model.base.regressor(model.standard_regressor(q, v, np.zeros_like(v)))
        forces = np.linalg.norm(support.excited.weights * (K @ direction.change), axis=1)
        assert forces.max() <= light.effect * (1 + 1e-3)


def test_friction_that_did_not_show_is_lit_by_moving_its_joint(load_once):
    robot = load_once("five_bar")
    model = find_force_model(robot, "full", JointTerms(robot.actuated))
    support = data_support(model, [recorded(model, one_joint(robot, 1, 0.4))])
    lights = {direction.text: direction.lighting for direction in support.dark}
    for kind in ("Fc", "Fv"):
        light = lights[f"left_crank_joint.{kind}"]
        assert light.kind == "velocity"
        np.testing.assert_allclose(np.abs(light.direction), [1, 0], atol=1e-12)
        assert light.text.startswith("velocity of left_crank_joint ")


def test_the_choice_of_base_parameters_does_not_matter(knee):
    motion = one_joint(knee, 1, 0.02)
    found = []
    for search in ("exact", "qr"):
        model = find_force_model(knee, "gravity", search=search)
        found.append(data_support(model, [recorded(model, motion)]))
    assert found[0].parameters != found[1].parameters
    for name in ("effects", "structural"):
        one, other = (getattr(support.excited, name) for support in found)
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-10 * one[0])


def test_sizes_are_those_of_the_bodies_whatever_the_link_frame_is_turned(knee):
    sizes = body_sizes(knee, "full").reshape(-1, 10)
    values = knee.standard_parameters().reshape(-1, 10)
    np.testing.assert_allclose(sizes[:, 0], values[:, 0])
    np.testing.assert_allclose(sizes[:, 1:4] ** 2, sizes[:, :1] * sizes[:, 4:7])
    # ∫ |x|² dm is half the trace of the inertia.
    np.testing.assert_allclose(2 * sizes[:, 4], values[:, [4, 6, 9]].sum(axis=1))
    # No body's first moment is larger than its mass times how far it reaches.
    assert (np.linalg.norm(values[:, 1:4], axis=1) <= sizes[:, 1] * (1 + 1e-12)).all()
    np.testing.assert_array_equal(body_sizes(knee, "gravity"), sizes[:, :4].ravel())


@pytest.fixture(scope="module")
def little(knee_model, motions, truth):
    """A short way with noise: everything shows, but some of it hardly."""
    short = motions[0].select(np.arange(80))
    return [modelled(knee_model, short, truth, noise=noise, seed=7) for noise in (1.0, 0.5)]


def test_doubtful_combinations_have_larger_errors_than_the_robot_file(knee_model, little):
    recording = little[0]
    samples, support = knee_model.samples(recording), data_support(knee_model, [recording])
    assert not support.dark
    assert 0 < len(support.doubtful) < 23
    # Whatever way the covariance is looked at: it is that of the fit.
    inverse = np.linalg.inv(support.excited.factor)
    spread = inverse @ quiet_fit(samples).covariance @ inverse.T
    errors = np.sqrt(np.linalg.eigvalsh(spread))
    np.testing.assert_allclose(support.standard_errors, errors, rtol=1e-4)
    assert len(support.doubtful) == (errors > 1).sum()
    assert support.well_determined == (errors <= 1).sum()
    told = [direction.standard_error for direction in support.doubtful]
    np.testing.assert_allclose(told, errors[::-1][: len(told)], rtol=1e-4)
    for direction, error in zip(support.doubtful, told, strict=True):
        x = np.linalg.solve(support.excited.factor, direction.change)
        np.testing.assert_allclose(spread @ x, error**2 * x, rtol=0, atol=1e-3 * error**2)
        assert f"{error:.2g}" in support.doubt or direction not in support.doubtful[:3]


def test_the_motion_for_a_doubtful_combination_tells_it(knee, knee_model, truth, little):
    support = data_support(knee_model, little[:1])
    for direction in support.doubtful[:2]:
        motion = lighting_motion(knee, direction.lighting)
        more = modelled(knee_model, motion, truth, noise=1.0, seed=8)
        x = np.linalg.solve(support.excited.factor, direction.change)
        spreads = []
        for recordings in (little[:1], [little[0], more]):
            parts = [knee_model.samples(recording) for recording in recordings]
            found = quiet_fit(FitSamples.combined(parts))
            inverse = np.linalg.inv(support.excited.factor)
            spreads.append(x @ inverse @ found.covariance @ inverse.T @ x)
        assert np.sqrt(spreads[1]) < 0.7 * np.sqrt(spreads[0])


def test_forces_count_in_parts_of_what_each_motor_gave(knee_model, little):
    recording = little[0]
    louder = np.array([1.0, 10.0, 1.0, 1.0])
    samples = knee_model.samples(recording)
    scaled = replace(
        samples,
        regressor=samples.regressor * louder[:, None],
        force=samples.force * louder,
    )
    one, other = (Excited.of(knee_model, each.problem) for each in (samples, scaled))
    np.testing.assert_allclose(other.effects, one.effects, rtol=1e-6)
    size = np.sqrt((recording.force**2).mean(axis=0))
    np.testing.assert_allclose(one.weights, 1 / size)


def test_half_the_noise_is_half_the_doubt(knee_model, little):
    errors = [data_support(knee_model, [recording]).standard_errors for recording in little]
    np.testing.assert_allclose(errors[0], 2 * errors[1], rtol=0.02)


def test_motors_whose_forces_never_count_must_move(load_once):
    robot = load_once("five_bar")
    model = find_force_model(robot, "full")
    whole = recorded(model, wander(robot, 2, seconds=10.0, rate=20.0, size=(0.4, 0.4)))
    used = whole.used.copy()
    used[:, 1] = False
    support = data_support(model, [replace(whole, used=used)])
    assert support.dark
    for direction in support.dark:
        light = direction.lighting
        assert abs(light.direction[1]) > 0.1
        assert light.effect > 0


def test_a_log_without_anything_in_it_shows_nothing(knee):
    model = find_force_model(knee, "gravity", JointTerms(knee.actuated))
    motion = one_joint(knee, 0, 0.02)
    force = np.zeros((len(motion.time), 4))
    nothing = Recording.of_motion("nothing", knee.actuated, motion, force)
    nothing = replace(nothing, used=np.zeros_like(nothing.used))
    support = data_support(model, [nothing])
    assert support.rank == 0
    assert len(support.dark) == 23
    assert set(support.assumed) == set(model.parameters.labels)


def test_some_of_the_parameters_alone_are_looked_at(knee_model, motions, truth):
    recording = modelled(knee_model, motions[0], truth)
    bodies = knee_model.samples(recording).select(knee_model.body_columns)
    support = data_support(knee_model, [recording], bodies)
    assert support.parameters == bodies.parameters
    whole = Excited.of(knee_model, knee_model.samples(recording).problem)
    assert support.structural_rank == 15 < len(whole.effects) == 23


def test_no_recordings_are_refused(knee_model):
    with pytest.raises(DataError, match="no recordings"):
        data_support(knee_model, [])
