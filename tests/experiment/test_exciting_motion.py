"""Motions that excite what a log does not: they do, and little else would do it better."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import JointTerms
from loopid.errors import OptionError
from loopid.experiment import exciting_motion, find_force_model, identifiability
from loopid.experiment.exciting_motion import Reach
from made_runs import modelled, one_joint, wander


def recorded(model, motion):
    """A recording whose forces are the robot file's, with a little noise."""
    return modelled(model, motion, model.prior, noise=0.01)


def test_it_excites_the_combination(moved_joint, weighted):
    model, recording, found = moved_joint
    rows = weighted(model, recording.motion, found)
    for direction in found.unidentifiable:
        motion = exciting_motion(model.mechanism, direction.exciting_motion)
        x = np.linalg.solve(found.excitation.factor, direction.change)
        both = np.concatenate([rows, weighted(model, motion, found)]) @ x
        effect = np.linalg.norm(both) / np.sqrt(len(both))
        before = np.linalg.norm(rows @ x) / np.sqrt(len(rows))
        assert effect > 1e-7 * found.excitation.effects[0] > 100 * before
        # Most of the effect that is promised is in the motion.
        W = model.regressor(motion) * found.excitation.weights[:, None]
        forces = np.linalg.norm(W @ direction.change, axis=1)
        assert forces.max() > 0.5 * direction.exciting_motion.effect


def test_all_motions_together_leave_nothing_unidentifiable(moved_joint):
    model, recording, found = moved_joint
    motions = [
        exciting_motion(model.mechanism, missing.exciting_motion)
        for missing in found.unidentifiable
    ]
    more = identifiability(model, [recording, *(recorded(model, motion) for motion in motions)])
    assert more.rank == more.structural_rank
    assert not more.unidentifiable
    assert not more.assumed


@pytest.mark.parametrize(("kind", "part"), [("acceleration", 1 - 1e-6), ("velocity", 0.5)])
def test_no_random_direction_is_much_better(moved_joint, kind, part):
    # Forces are linear in accelerations, but of velocities one or two joints at a time are tried.
    model, _, found = moved_joint
    reach, generator = getattr(Reach.of(model.mechanism), kind), np.random.default_rng(1)
    for direction in found.unidentifiable:
        motion = direction.exciting_motion
        if motion.kind != kind or motion.approach.any():
            continue
        moved = generator.normal(size=(300, len(reach)))
        moved *= reach / np.linalg.norm(moved, axis=1, keepdims=True)
        still = np.zeros_like(moved)
        q = np.repeat(motion.configuration[None], len(moved), axis=0)
        states = (q, moved, still) if kind == "velocity" else (q, still, moved)
        K = model.base.regressor(model.standard_regressor(*states))
        forces = np.linalg.norm(found.excitation.weights * (K @ direction.change), axis=1)
        assert part * forces.max() <= motion.effect


def test_friction_is_excited_by_moving_its_joint(load_once):
    robot = load_once("five_bar")
    model = find_force_model(robot, "full", JointTerms(robot.actuated))
    found = identifiability(model, [recorded(model, one_joint(robot, 1, 0.4))])
    motions = {missing.text: missing.exciting_motion for missing in found.unidentifiable}
    for kind in ("Fc", "Fv"):
        motion = motions[f"left_crank_joint.{kind}"]
        assert motion.kind == "velocity"
        np.testing.assert_allclose(np.abs(motion.direction), [1, 0], atol=1e-12)
        assert motion.text.startswith("velocity of left_crank_joint ")
        assert motion.text in repr(motion)


def test_motors_whose_forces_never_count_must_move(load_once):
    robot = load_once("five_bar")
    model = find_force_model(robot, "full")
    whole = recorded(model, wander(robot, 2, seconds=10.0, rate=20.0, size=(0.4, 0.4)))
    used = whole.used.copy()
    used[:, 1] = False
    found = identifiability(model, [replace(whole, used=used)])
    assert found.unidentifiable
    for direction in found.unidentifiable:
        assert abs(direction.exciting_motion.direction[1]) > 0.1
        assert direction.exciting_motion.effect > 0


def test_vibrations_have_what_is_wanted_and_move_as_they_say(moved_joint):
    model, _, found = moved_joint
    for direction in found.unidentifiable:
        wanted = direction.exciting_motion
        motion = exciting_motion(model.mechanism, wanted, samples=200)
        assert len(motion.time) == 201
        if wanted.kind != "pose":
            moves = np.abs(wanted.direction) > 0.1 * np.abs(wanted.direction).max()
            reached = {"velocity": motion.velocities, "acceleration": motion.accelerations}
            peak = np.abs(reached[wanted.kind]).max(axis=0)
            assert np.all(~moves | (peak < 1e-9) | np.isclose(peak, np.abs(wanted.amplitude)))
            assert peak.any()
        steps = np.gradient(motion.velocities, motion.time, axis=0)[1:-1]
        scale = np.abs(motion.accelerations).max()
        np.testing.assert_allclose(steps, motion.accelerations[1:-1], atol=2e-3 * scale)


def test_too_few_samples_are_refused(moved_joint):
    model, _, found = moved_joint
    with pytest.raises(OptionError, match="at least 4 samples, not 3"):
        exciting_motion(model.mechanism, found.unidentifiable[0].exciting_motion, samples=3)
