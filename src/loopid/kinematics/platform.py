"""The platform that a robot file declares: its coordinates, and its motion from and to the joints'.

With the twist t = E ẋ of the platform at coordinates x, and its Jacobian J_p by all joints,
E ẋ = J_p G u̇: the platform Jacobian is E⁺ J_p G.
"""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, checked, samples
from loopid.errors import OptionError
from loopid.kinematics.constraint import Constraint
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.poses import blocks, frame_motions, frame_poses
from loopid.robot.mechanism import Mechanism
from loopid.robot.platform import Platform


def declared_platform(mechanism: Mechanism) -> Platform:
    """The platform of the robot file; an OptionError when it declares none."""
    if mechanism.platform is None:
        raise OptionError(
            f"{mechanism.name} declares no platform coordinates", robot=mechanism.name
        )
    return mechanism.platform


@checked
def platform_coordinates(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Platform coordinates (N, c) that the robot file declares, at configurations (N, nq).

    Raises
    ------
    OptionError
        When the robot file declares none.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("3ups_rpu")
    >>> loopid.kinematics.platform_coordinates(robot, robot.reference).shape
    (1, 4)
    """
    declared_platform(mechanism)
    return coordinates_at(mechanism, samples(configurations, mechanism.model.nq, "configurations"))


def coordinates_at(mechanism: Mechanism, q: FloatArray) -> FloatArray:
    """As ``platform_coordinates``, at configurations that are checked."""
    platform = declared_platform(mechanism)
    frame = frame_poses(mechanism, q, [platform.frame_id], jacobians=False)
    return platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])


def platform_jacobian(mechanism: Mechanism, q: FloatArray, G: FloatArray) -> FloatArray:
    """Rates (N, c, dof) of the platform coordinates per unit of each independent coordinate.

    At closed configurations (N, nq) with the projection G (N, nv, dof).
    """
    platform = declared_platform(mechanism)
    frame = frame_poses(mechanism, q, [platform.frame_id])
    twists = np.concatenate([frame.linear[:, 0], frame.angular[:, 0]], axis=1) @ G
    units = np.repeat([1.0, mechanism.length], 3)[:, None]
    E = platform.twist_map(platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0]))
    lengths = np.where([motion.startswith("r") for motion in platform.motions], 1.0, units[-1])
    factors = Factorisation.of(units * E * lengths)
    return np.asarray(lengths[:, None] * factors.solve(units * twists))


@checked
def platform_motion(
    mechanism: Mechanism,
    configurations: FloatArray,
    rates: FloatArray,
    accelerations: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, nv) of all joints from those (N, c) of the platform.

    At closed configurations (N, nq).
    """
    platform = declared_platform(mechanism)
    q = samples(configurations, mechanism.model.nq, "configurations")
    xd = samples(rates, len(platform.motions), "platform rates", len(q))
    xdd = samples(accelerations, len(platform.motions), "platform accelerations", len(q))
    parts = [_platform_motion(mechanism, platform, q[k], xd[k], xdd[k]) for k in blocks(len(q))]
    v, a = zip(*parts, strict=True)
    return np.concatenate(v), np.concatenate(a)


def _platform_motion(
    mechanism: Mechanism, platform: Platform, q: FloatArray, xd: FloatArray, xdd: FloatArray
) -> tuple[FloatArray, FloatArray]:
    constraint = Constraint(mechanism, q)
    frame = frame_poses(mechanism, q, [platform.frame_id])
    x = platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])
    jacobian = [constraint.jacobian(), frame.linear[:, 0], frame.angular[:, 0]]
    scales, units = mechanism.coordinate_scales, np.repeat([1.0, mechanism.length], 3)
    rows = np.append(mechanism.row_scales, units)
    factors = Factorisation.of(rows[:, None] * np.concatenate(jacobian, axis=1) * scales)

    def solve(closures: FloatArray, twists: FloatArray) -> FloatArray:
        wanted = rows * np.concatenate([closures, twists], axis=1)
        return np.asarray(scales * factors.solve(wanted[:, :, None])[:, :, 0])

    E = platform.twist_map(x)
    v = solve(np.zeros((len(q), mechanism.rows)), np.einsum("nij,nj->ni", E, xd))
    moving = frame_motions(mechanism, q, v, frame)
    felt = np.concatenate([moving.acceleration[:, 0], moving.turning[:, 0]], axis=1)
    twist_rate = np.einsum("nij,nj->ni", E, xdd) + platform.twist_drift(x, xd)
    return v, solve(-constraint.drift(v), twist_rate - felt)
