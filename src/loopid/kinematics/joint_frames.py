"""How each joint places and moves its frame, for all joints and samples at once.

Arrays hold components first and samples last, so that every operation runs over all samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.layout import JointLayout
from loopid.kinematics.vectors import rotated


@dataclass(frozen=True)
class OtherJoints:
    """Joints of other kinds than one angle or displacement, as Pinocchio has them.

    Attributes
    ----------
    places : IntArray
        (k,), of the joints.
    coordinates : IntArray
        (c,), positions of their coordinates in the layout's ``coordinates``.
    rotation, translation : FloatArray
        (3, 3, k, N) and (3, k, N), from the frame in which the joint is at rest.
    angular, linear : FloatArray
        (3, c, N), velocity per unit of each coordinate, along the joint's own frame.
    """

    places: IntArray
    coordinates: IntArray
    rotation: FloatArray
    translation: FloatArray
    angular: FloatArray
    linear: FloatArray


def joint_placements(
    layout: JointLayout, q: FloatArray, others: OtherJoints
) -> tuple[FloatArray, FloatArray]:
    """Rotations (3, 3, J, N) and translations (3, J, N) from the parents' frames."""
    rotation, translation = _turned(layout, q), _slid(layout, q)
    k = others.places
    if len(k):
        P, t = layout.rotation[:, :, k], layout.translation[:, k, None]
        rotation[:, :, k] = np.einsum("ijk,jlkn->ilkn", P, others.rotation)
        translation[:, k] = t + np.einsum("ijk,jkn->ikn", P, others.translation)
    return rotation, translation


def _turned(layout: JointLayout, q: FloatArray) -> FloatArray:
    """P (I + sin θ [a] + (1 - cos θ) [a]²), Rodrigues' formula after the joint's placement."""
    weights = np.zeros((len(layout.joint_ids), 3, len(q)))  # sin θ, 1 - cos θ and 1
    angles = q.T[layout.first_q[layout.turning]]
    weights[layout.turning, 0], weights[layout.turning, 1] = np.sin(angles), 1.0 - np.cos(angles)
    cosines = layout.first_q[layout.circular]
    weights[layout.circular, 0] = q.T[cosines + 1]
    weights[layout.circular, 1] = 1.0 - q.T[cosines]
    weights[:, 2] = 1.0
    rotation = (layout.turns @ weights).reshape(len(weights), 3, 3, len(q))
    return rotation.transpose(1, 2, 0, 3)


def _slid(layout: JointLayout, q: FloatArray) -> FloatArray:
    translation = np.empty((3, len(layout.joint_ids), len(q)))
    translation[...] = layout.translation[..., None]
    k = layout.sliding
    translation[:, k] += layout.directions[:, k, None] * q.T[layout.first_q[k]]
    return translation


def coordinate_axes(layout: JointLayout, rotation: FloatArray, others: OtherJoints) -> FloatArray:
    """Velocity (6, nv, N) of each joint's frame per unit of its coordinates.

    Angular above that of the frame's origin, along the fixed axes, with the coordinates in the
    layout's order; from the joints' rotations (3, 3, J, N) in the fixed frame.
    """
    axes = np.zeros((6, len(layout.owners), rotation.shape[3]))
    for part, k in (
        (axes[:3], layout.turning),
        (axes[:3], layout.circular),
        (axes[3:], layout.sliding),
    ):
        if len(k):
            directions = np.einsum("ijkn,jk->ikn", rotation[:, :, k], layout.axes[:, k])
            part[:, layout.starts[k]] = directions
    k = others.coordinates
    if len(k):
        R = rotation[:, :, layout.owners[k]]
        axes[:3, k], axes[3:, k] = rotated(R, others.angular), rotated(R, others.linear)
    return axes


def other_joints(model: pin.Model, layout: JointLayout, q: FloatArray) -> OtherJoints:
    """Ask Pinocchio for the joints of other kinds, sample by sample."""
    k, coordinates = layout.other, layout.other_coordinates
    rotation, translation = np.empty((3, 3, len(k), len(q))), np.empty((3, len(k), len(q)))
    subspace = np.empty((6, len(coordinates), len(q)))
    first = 0
    for place, joint in enumerate(model.joints[int(i)] for i in layout.joint_ids[k]):
        data, columns = joint.createData(), slice(first, first + joint.nv)
        for n, configuration in enumerate(q):
            joint.calc(data, configuration)
            rotation[:, :, place, n] = data.M.rotation
            translation[:, place, n] = data.M.translation
            subspace[:, columns, n] = np.reshape(data.S, (6, joint.nv))
        first += joint.nv
    return OtherJoints(k, coordinates, rotation, translation, subspace[3:], subspace[:3])


def other_accelerations(
    model: pin.Model, layout: JointLayout, q: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Angular and linear (3, k, N) of joints of other kinds, from the change of their subspace.

    Along the joint's own frame, at velocities (N, nv) and zero joint acceleration.
    """
    changes = np.empty((6, len(layout.other), len(q)))
    for place, joint in enumerate(model.joints[int(i)] for i in layout.joint_ids[layout.other]):
        data = joint.createData()
        for n in range(len(q)):
            joint.calc(data, q[n], v[n])
            changes[:, place, n] = np.asarray(getattr(data.c, "vector", data.c))
    return changes[3:], changes[:3]
