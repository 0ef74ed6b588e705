"""Frames of trees of any joints: where they are and how they move, as Pinocchio has it."""

import numpy as np
import pinocchio as pin
import pytest
from every_joint import random_states, random_tree
from hypothesis import given, settings, strategies as st

from loopid.errors import DataError
from loopid.kinematics import displaced, torque_regressors
from loopid.kinematics.poses import frame_motions, frame_poses

seeds = st.integers(0, 2**32 - 1)
AXES = pin.LOCAL_WORLD_ALIGNED


def by_pinocchio(model, frames, q, v):
    """Rotations, origins, Jacobians and accelerations of frames at one state."""
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    places = [pin.updateFramePlacement(model, data, k).copy() for k in frames]
    return (
        np.array([place.rotation for place in places]),
        np.array([place.translation for place in places]),
        np.array([pin.getFrameJacobian(model, data, k, AXES) for k in frames]),
        np.array([pin.getFrameClassicalAcceleration(model, data, k, AXES).vector for k in frames]),
    )


@pytest.mark.parametrize("base", [0.0, 1e4])
@settings(max_examples=15)
@given(seed=seeds)
def test_frames_are_where_pinocchio_has_them(base, seed):
    # Among the joints are those whose axes change in their own frame, which data.dJ leaves out.
    generator = np.random.default_rng(seed)
    tree, frames = random_tree(seed, base)
    q, v = random_states(tree, 3, generator)
    poses = frame_poses(tree, q, frames)
    moving = frame_motions(tree, q, v, poses)
    jacobians = np.concatenate([poses.linear, poses.angular], axis=2)
    accelerations = np.concatenate([moving.acceleration, moving.turning], axis=2)
    velocities = np.concatenate([moving.velocity, moving.turn], axis=2)
    for k in range(len(q)):
        expected = by_pinocchio(tree.model, frames, q[k], v[k])
        found = (poses.rotation[k], poses.origin[k], jacobians[k], accelerations[k])
        for ours, theirs in zip(found, expected, strict=True):
            scale = max(1.0, np.abs(theirs).max(), base)
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12 * scale)
        scale = max(1.0, np.abs(jacobians[k]).max(), base)
        np.testing.assert_allclose(velocities[k], expected[2] @ v[k], rtol=0, atol=1e-12 * scale)


def test_arrays_of_another_shape_are_refused(load_once):
    robot = load_once("five_bar")
    q = robot.reference
    with pytest.raises(DataError, match=r"q must have shape \(samples, 4\), not \(4,\)"):
        torque_regressors(robot, q)
    with pytest.raises(DataError, match=r"a must have shape \(samples, 4\), not \(2, 4\)"):
        torque_regressors(robot, q[None], a=np.zeros((2, 4)))
    with pytest.raises(DataError, match=r"steps must have shape \(samples, 2\)"):
        displaced(robot, q[None], np.zeros((1, 4)))
