"""Physical consistency of the inertias in a robot file.

A rigid body of positive density has principal moments of inertia about its centre of mass that
are positive and obey the triangle inequality, each less than the sum of the others
[Wensing2018].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.robot.body import Body
from loopid.robot.mechanism import Mechanism

# Relative to the largest principal moment; robot files are rounded to a few digits.
INERTIA_TOLERANCE = 1e-6
ROUND_OFF = 1e-15  # relative to the mass at the size of the mechanism


@dataclass(frozen=True)
class InertiaDefect:
    """What is wrong with a body's inertia.

    Attributes
    ----------
    link : str
    impossible : bool
        No body has it; otherwise only a body without extent in some direction has.
    reason : str
    """

    link: str
    impossible: bool
    reason: str

    def __str__(self) -> str:
        return f"{self.link}: {self.reason}"


@checked
def inertia_defects(mechanism: Mechanism) -> tuple[InertiaDefect, ...]:
    """Bodies whose inertia, as the robot file gives it, no solid body has."""
    found = (_defect(mechanism, body) for body in mechanism.bodies)
    return tuple(defect for defect in found if defect is not None)


def _defect(mechanism: Mechanism, body: Body) -> InertiaDefect | None:
    inertia, link = mechanism.model.inertias[body.joint_id], body.link
    moments = low, middle, high = tuple(float(m) for m in np.linalg.eigvalsh(inertia.inertia))
    point = ROUND_OFF * inertia.mass * mechanism.length**2
    slack = max(INERTIA_TOLERANCE * max(abs(high), abs(low)), point)
    listed = ", ".join(f"{moment:.3g}" for moment in moments)
    if low < -slack:
        return InertiaDefect(link, True, f"a principal moment is negative ({listed} kg m²)")
    if high > low + middle + slack:
        why = "a principal moment exceeds the sum of the others"
        return InertiaDefect(link, True, f"{why} ({listed} kg m²)")
    if low <= slack:
        return InertiaDefect(link, False, f"a principal moment is zero ({listed} kg m²)")
    return None
