"""Frames of trees of any joints: where they are and how they move, as Pinocchio has it."""

import numpy as np
import pinocchio as pin
import pytest
from every_joint import random_states, random_tree
from hypothesis import given, settings
from hypothesis import strategies as st

from loopid.kinematics.blocks import MOST
from loopid.kinematics.frames import frame_accelerations, frame_kinematics

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
@settings(max_examples=30)
@given(seed=seeds)
def test_frames_are_where_pinocchio_has_them(base, seed):
    generator = np.random.default_rng(seed)
    tree, frames = random_tree(seed, base)
    q, v = random_states(tree, 3, generator)
    found = frame_kinematics(tree, q, frames)
    accelerations = frame_accelerations(tree, q, v, frames)
    for k in range(len(q)):
        expected = by_pinocchio(tree.model, frames, q[k], v[k])
        both = (found.rotation[k], found.origin[k], found.jacobian[k], accelerations[k])
        for ours, theirs in zip(both, expected, strict=True):
            scale = max(1.0, np.abs(theirs).max(), base)
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13 * scale)


@given(seed=seeds, count=st.integers(1, 3))
@settings(max_examples=5)
def test_samples_do_not_depend_on_their_neighbours(seed, count):
    generator = np.random.default_rng(seed)
    tree, frames = random_tree(seed)
    q, v = (np.tile(x, (MOST, 1))[: MOST + count] for x in random_states(tree, 2, generator))
    whole = frame_accelerations(tree, q, v, frames)
    parts = [frame_accelerations(tree, q[k], v[k], frames) for k in (slice(0, 2), slice(2, None))]
    scale = np.abs(whole).max()
    np.testing.assert_allclose(whole, np.concatenate(parts), rtol=0, atol=1e-14 * scale)
