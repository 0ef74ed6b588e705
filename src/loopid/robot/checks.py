"""What is odd about the inertias of a robot file: none of it changes what can be known."""

from __future__ import annotations

import numpy as np

from loopid.arguments import checked
from loopid.inertia import body_defect, pseudo_inertia
from loopid.parameters import KINDS
from loopid.records import record
from loopid.robot.mechanism import Mechanism, shortened

# Robot files are rounded: part of the largest moment, and of the largest parameter of a group.
ROUNDED = 1e-6
ALIKE = 1e-4
# Masses that only keep a simulator running: part of the heaviest body, and in kg.
PLACEHOLDER, LEAST_MASS = 1e-6, 1e-7


@record
class InertiaDefect:
    """What is wrong with a body's inertia."""

    link: str
    impossible: bool  # no body has it; otherwise a plate, a rod or a point, which fill no volume
    reason: str

    def __str__(self) -> str:
        return f"{self.link}: {self.reason}"


@checked
def inertia_defects(mechanism: Mechanism) -> tuple[InertiaDefect, ...]:
    """Bodies whose inertia, as the robot file gives it, no solid body has [Wensing2018]."""
    found = []
    for body in mechanism.bodies:
        P = pseudo_inertia(mechanism.model.inertias[body.joint_id].toDynamicParameters())
        if reason := body_defect(P, tolerance=ROUNDED):
            impossible = bool(body_defect(P, flat_allowed=True, tolerance=ROUNDED) and P.any())
            found.append(InertiaDefect(body.link, impossible, reason))
    return tuple(found)


@checked
def odd_masses(mechanism: Mechanism) -> tuple[str, ...]:
    """Say which masses look like placeholders, and which joints move nothing that has a mass."""
    model, found = mechanism.model, []
    masses = {body.link: float(model.inertias[body.joint_id].mass) for body in mechanism.bodies}
    least = max(PLACEHOLDER * max(masses.values(), default=0.0), LEAST_MASS)
    light = [f"{link} ({mass:.3g} kg)" for link, mass in masses.items() if 0 < mass < least]
    if light:
        found.append(
            f"masses that look like placeholders, below {least:.3g} kg where the heaviest body has "
            f"{max(masses.values()):.3g} kg: {shortened(light)}"
        )
    heavy = {
        body.joint_id
        for body in mechanism.bodies
        if model.inertias[body.joint_id].toDynamicParameters().any()
    }
    closing = np.any(mechanism.supports(mechanism.closure_frames[0]), axis=0).ravel()
    idle = [
        joint
        for k, joint in enumerate(mechanism.joints, start=1)
        if not heavy.intersection(model.subtrees[k]) and not closing[model.joints[k].idx_v]
    ]
    if idle:
        found.append(f"joints that move nothing with mass: {shortened(idle)}")
    return tuple(found)


@checked
def unequal_links(mechanism: Mechanism) -> tuple[str, ...]:
    """Say which groups of links declared identical have inertials that differ, and by how much."""
    joints = {body.link: body.joint_id for body in mechanism.bodies}
    found = []
    for group in mechanism.identical:
        inertias = [mechanism.model.inertias[joints[link]] for link in group.links]
        values = np.array([inertia.toDynamicParameters() for inertia in inertias])
        size = np.abs(values)
        # Relative to the largest of the same unit.
        units = [size[:, :1].max(), *[size[:, 1:4].max()] * 3, *[size[:, 4:].max()] * 6]
        spread = np.ptp(values, axis=0) / np.maximum(units, 1e-300)
        worst = int(spread.argmax())
        if spread[worst] > ALIKE:
            found.append(
                f"links {', '.join(group.links)} are declared identical, but their "
                f"{KINDS[worst]} differ: {', '.join(f'{x:.4g}' for x in values[:, worst])} "
                f"(tolerance {ALIKE:g})"
            )
    return tuple(found)
