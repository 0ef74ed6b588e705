"""Whether links declared identical have the same inertials in the robot file."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.parameters import KINDS
from loopid.robot.identical import LinkGroup
from loopid.robot.mechanism import Mechanism

ALIKE = 1e-4  # relative to the largest of the group; robot files are rounded


@checked
def unequal_links(mechanism: Mechanism) -> tuple[str, ...]:
    """Say which groups of links have inertials that differ, and by how much."""
    found = (_difference(mechanism, group) for group in mechanism.identical)
    return tuple(text for text in found if text)


def _difference(mechanism: Mechanism, group: LinkGroup) -> str:
    joints = {body.link: body.joint_id for body in mechanism.bodies}
    inertias = [mechanism.model.inertias[joints[link]] for link in group.links]
    values = np.array([inertia.toDynamicParameters() for inertia in inertias])
    spread = _relative_spread(values)
    worst = int(spread.argmax())
    if spread[worst] <= ALIKE:
        return ""
    listed = ", ".join(f"{v:.4g}" for v in values[:, worst])
    return (
        f"links {', '.join(group.links)} are declared identical, but their {KINDS[worst]} differ: "
        f"{listed} (tolerance {ALIKE:g})"
    )


def _relative_spread(values: FloatArray) -> FloatArray:
    """Spread of each parameter (10,), relative to the largest of its unit."""
    size = np.abs(values)
    units = [size[:, :1].max(), *[size[:, 1:4].max()] * 3, *[size[:, 4:].max()] * 6]
    return np.asarray(np.ptp(values, axis=0) / np.maximum(units, 1e-300), dtype=np.float64)
