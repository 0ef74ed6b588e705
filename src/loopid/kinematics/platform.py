"""Platform coordinates of closed configurations: the forward kinematics people ask for."""

from __future__ import annotations

from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.kinematics.frames import frame_kinematics
from loopid.mechanism import Mechanism, Platform


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
