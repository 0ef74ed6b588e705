"""The projected regressor body by body, for all samples at once.

By virtual power, a body adds to the forces along the independent coordinates what its twist per
unit of each of them, V = J G, makes of its own force and moment [Khalil2004, ch. 12]. These are
linear in its parameters: with a the acceleration of the body's origin less gravity, ω and α its
angular velocity and acceleration,

    force  = m a + α x c + ω x (ω x c),    moment = c x a + I α + ω x I ω

for a mass m, first moments c and an inertia I about the origin, both along the body's axes.
Forces act at the body's origin and twists are at the tree's pole, so moments are taken there.
Arrays hold components first, along the fixed axes, and samples last.
"""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.kinematics.tree import TreeMotion, TreePose, joint_twists
from loopid.kinematics.vectors import by_place, cross, rotated_back

# Forces per unit of the parameters of a body times its motions per unit of the coordinates.
COLUMNS = "ikn,idn->kdn"


def resting_columns(pose: TreePose, places: IntArray, G: FloatArray) -> FloatArray:
    """Columns of masses and first moments at rest.

    Parameters
    ----------
    pose : TreePose
    places : IntArray
        Of the joints that carry the bodies in the joint layout.
    G : FloatArray
        (nv, dof, N).

    Returns
    -------
    FloatArray
        (bodies, 4, dof, N).
    """
    V = joint_twists(pose, G)
    up = -pose.model.gravity.linear
    R = pose.rotation[:, :, places]
    weight = np.broadcast_to(up[:, None, None], (3, *R.shape[2:]))
    moment = by_place(3, 4, *R.shape[2:])
    cross(_arms(pose, places), weight, out=moment[:, 0])
    cross(R, up[:, None, None, None], out=moment[:, 1:])
    columns = np.empty((len(places), 4, *G.shape[1:]))
    for body, place in enumerate(places):
        np.einsum(COLUMNS, moment[:, :, body], V[:3, place], out=columns[body])
        columns[body, 0] += np.einsum("i,idn->dn", up, V[3:, place])
    return columns


def moving_columns(
    pose: TreePose, places: IntArray, G: FloatArray, motion: TreeMotion, accelerations: FloatArray
) -> FloatArray:
    """Columns (bodies, 10, dof, N) of all parameters, in a motion with accelerations (nv, N)."""
    V = joint_twists(pose, np.concatenate([accelerations[:, None], G], axis=1))
    R, arms = pose.rotation[:, :, places], _arms(pose, places)
    twist, acceleration = motion.twist[:, places], motion.bias[:, places] + V[:, places, 0]
    omega, alpha = twist[:3], acceleration[:3]
    velocity = twist[3:] + cross(omega, arms)
    a = acceleration[3:] + cross(alpha, arms) + cross(omega, velocity)
    a -= pose.model.gravity.linear[:, None, None]
    wrench = _wrenches(R, arms, omega, alpha, a)
    moment = _inertial_moments(R, rotated_back(R, omega), rotated_back(R, alpha))
    columns = np.empty((len(places), 10, *G.shape[1:]))
    for body, place in enumerate(places):
        np.einsum(COLUMNS, wrench[:, :, body], V[:, place, 1:], out=columns[body, :4])
        np.einsum(COLUMNS, moment[:, :, body], V[:3, place, 1:], out=columns[body, 4:])
    return columns


def _arms(pose: TreePose, places: IntArray) -> FloatArray:
    """From the pole to the bodies' origins, (3, bodies, N)."""
    return pose.origin[:, places] - pose.pole[:, None]


def _wrenches(
    R: FloatArray, arms: FloatArray, omega: FloatArray, alpha: FloatArray, a: FloatArray
) -> FloatArray:
    """Moments about the pole above forces (6, 4, bodies, N), of masses and first moments."""
    wrench = by_place(6, 4, *a.shape[1:])
    moment, force = wrench[:3], wrench[3:]
    force[:, 0] = a
    np.einsum("ij...,jk...->ik...", _rate_of_points(omega, alpha), R, out=force[:, 1:])
    cross(arms[:, None], force, out=moment)
    moment[:, 1:] += cross(R, a[:, None])
    return wrench


def _rate_of_points(omega: FloatArray, alpha: FloatArray) -> FloatArray:
    """[α] + [ω]² (3, 3, ...): acceleration of a body's points against its origin."""
    (x, y, z), (p, q, r) = omega, alpha
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return np.array(
        [[-yy - zz, xy - r, xz + q], [xy + r, -xx - zz, yz - p], [xz - q, yz + p, -xx - yy]]
    )


def _inertial_moments(R: FloatArray, omega: FloatArray, alpha: FloatArray) -> FloatArray:
    """I α + ω x I ω (3, 6, bodies, N) per unit of Ixx, Ixy, Iyy, Ixz, Iyz, Izz.

    Angular velocities and accelerations (3, bodies, N) are along the body's axes.
    """
    (x, y, z), (p, q, r) = omega, alpha
    xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    entries = (
        (p, q - xz, -yz, r + xy, yy - zz, yz),
        (xz, p + yz, q, zz - xx, r - xy, -xz),
        (-xy, xx - yy, xy, p - yz, q + xz, r),
    )
    moments = by_place(3, 6, *x.shape)
    for moment, row in zip(moments, entries, strict=True):
        for column, entry in zip(moment, row, strict=True):
            column[...] = entry
    turned = by_place(3, 6, *x.shape)
    np.einsum("ij...,jk...->ik...", R, moments, out=turned)
    return turned
