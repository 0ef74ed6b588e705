"""Platform coordinates of closed configurations: the forward kinematics people ask for."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray, samples
from loopid.errors import OptionError
from loopid.kinematics.constraint import constraint_drift, constraint_jacobian
from loopid.kinematics.frames import frame_accelerations, frame_kinematics
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.scaling import coordinate_scales, row_scales
from loopid.robot import Mechanism, Platform


@checked
def platform_coordinates(mechanism: Mechanism, configurations: FloatArray) -> FloatArray:
    """Platform coordinates (N, c) that the robot file declares, at configurations (N, nq).

    Raises
    ------
    OptionError
        When the robot file declares none.
    """
    platform = declared_platform(mechanism)
    frame = frame_kinematics(mechanism, configurations, [platform.frame_id])
    return platform.coordinates(frame.rotation[:, 0], frame.origin[:, 0])


def declared_platform(mechanism: Mechanism) -> Platform:
    """The platform of the robot file.

    Raises
    ------
    OptionError
        When the robot file declares none.
    """
    if mechanism.platform is None:
        raise OptionError(f"{mechanism.name} declares no platform coordinates")
    return mechanism.platform


@checked
def platform_motion(
    mechanism: Mechanism,
    configurations: FloatArray,
    rates: FloatArray,
    accelerations: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Velocities and accelerations (N, nv) of all joints from those of the platform coordinates.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed.
    rates, accelerations : FloatArray
        (N, c), first and second derivatives of the platform coordinates by time.
    """
    platform = declared_platform(mechanism)
    configurations = samples(configurations, mechanism.model.nq, "configurations")
    frame, count = [platform.frame_id], len(configurations)
    x = platform_coordinates(mechanism, configurations)
    xd = samples(rates, len(platform.motions), "platform rates", count)
    xdd = samples(accelerations, len(platform.motions), "platform accelerations", count)
    pose = frame_kinematics(mechanism, configurations, frame).jacobian[:, 0]
    jacobian = np.concatenate([constraint_jacobian(mechanism, configurations), pose], axis=1)
    scales = np.append(row_scales(mechanism), [1.0] * 3 + [mechanism.length] * 3)
    factors = Factorisation.of(scales[:, None] * jacobian * coordinate_scales(mechanism))

    def solve(closures: FloatArray, twists: FloatArray) -> FloatArray:
        rows = scales * np.concatenate([closures, twists], axis=1)
        return coordinate_scales(mechanism) * factors.solve(rows[:, :, None])[:, :, 0]

    E = platform.twist_map(x)
    v = solve(np.zeros((count, mechanism.rows)), np.einsum("nij,nj->ni", E, xd))
    twist_rate = np.einsum("nij,nj->ni", E, xdd) + platform.twist_drift(x, xd)
    felt = frame_accelerations(mechanism, configurations, v, frame)[:, 0]
    a = solve(-constraint_drift(mechanism, configurations, v), twist_rate - felt)
    return v, a
