"""The choice of measured coordinates: joints or the platform's, enough to determine the motion."""

from __future__ import annotations

from collections.abc import Sequence

from loopid.arguments import checked
from loopid.errors import MobilityError
from loopid.kinematics.equations import MeasuredCoordinates, scaled_constraint
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured_joints import JointCoordinates
from loopid.kinematics.measured_platform import PlatformCoordinates
from loopid.robot import Mechanism

__all__ = ["MeasuredCoordinates", "measured_coordinates"]


@checked
def measured_coordinates(
    mechanism: Mechanism, coordinates: Sequence[str] | str | None = None
) -> MeasuredCoordinates:
    """Choose the measured coordinates: joints, ``"platform"``, or the independent joints.

    Raises
    ------
    MobilityError
        When they are too few or too many to determine the motion at the reference.
    """
    measured: MeasuredCoordinates
    if coordinates == "platform":
        measured = PlatformCoordinates(mechanism)
    else:
        names = mechanism.measured if coordinates is None else coordinates
        joints = (names,) if isinstance(names, str) else tuple(names)
        measured = JointCoordinates(mechanism, joints)
    _refuse_insufficient(measured)
    return measured


def _refuse_insufficient(measured: MeasuredCoordinates) -> None:
    q = measured.mechanism.reference[None]
    jacobian = measured.linearise(q, measured.read(q)).unknown
    found, unknown = int(Factorisation.of(jacobian).rank[0]), len(measured.unknown)
    if found < unknown:
        raise MobilityError(
            f"the measured coordinates determine {found} of the {unknown} other coordinates of "
            f"{measured.mechanism.name} at its reference: give more, or others, or a reference "
            "that is not singular"
        )
    _, closure = scaled_constraint(measured.mechanism, q)
    if int(Factorisation.of(closure).rank[0]) > found:
        raise MobilityError(
            f"the {measured.width} measured coordinates of {measured.mechanism.name} are not "
            "independent of each other: leave some out"
        )
