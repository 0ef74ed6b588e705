"""Whether the inertias in a robot file can be: physically consistent, and equal where declared so.

A rigid body of positive density has principal moments of inertia about its centre of mass that
are positive and obey the triangle inequality, each less than the sum of the others
[Wensing2018].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arguments import checked
from loopid.parameters import KINDS
from loopid.robot.mechanism import Body, LinkGroup, Mechanism

# Relative to the largest principal moment; robot files are rounded to a few digits.
INERTIA_TOLERANCE = 1e-6
ROUND_OFF = 1e-15  # relative to the mass at the size of the mechanism
ALIKE = 1e-4  # relative to the largest of the group; robot files are rounded


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


@checked
def unequal_links(mechanism: Mechanism) -> tuple[str, ...]:
    """Say which groups of links declared identical have inertials that differ, and by how much."""
    found = (_difference(mechanism, group) for group in mechanism.identical)
    return tuple(text for text in found if text)


def _difference(mechanism: Mechanism, group: LinkGroup) -> str:
    joints = {body.link: body.joint_id for body in mechanism.bodies}
    inertias = [mechanism.model.inertias[joints[link]] for link in group.links]
    values = np.array([inertia.toDynamicParameters() for inertia in inertias])
    size = np.abs(values)
    # Relative to the largest of the same unit.
    units = [size[:, :1].max(), *[size[:, 1:4].max()] * 3, *[size[:, 4:].max()] * 6]
    spread = np.ptp(values, axis=0) / np.maximum(units, 1e-300)
    worst = int(spread.argmax())
    if spread[worst] <= ALIKE:
        return ""
    listed = ", ".join(f"{value:.4g}" for value in values[:, worst])
    return (
        f"links {', '.join(group.links)} are declared identical, but their {KINDS[worst]} differ: "
        f"{listed} (tolerance {ALIKE:g})"
    )
