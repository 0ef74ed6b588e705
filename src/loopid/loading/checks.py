"""What is odd about a robot: features left out, motors, singularities, inertias."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import AccuracyWarning, ModelWarning, warn
from loopid.inertia import body_defect, pseudo_inertia
from loopid.kinematics import mobility
from loopid.kinematics.poses import difference
from loopid.kinematics.rounding import rounding_that_closes
from loopid.loading.free import why_free
from loopid.loading.reference import why_singular
from loopid.loading.tree import TreeSource
from loopid.parameters import KINDS
from loopid.records import record
from loopid.robot.robot import Robot, shortened

UNCLEAR = 1e-4  # of the largest singular value of the closure Jacobian
STILL = 1e-3  # rad or characteristic lengths that no random walk leaves


def place_of_motors(robot: Robot) -> str:
    """Where its user writes which joints have motors."""
    if robot.path is None:
        return "motors=[...]"
    has_yaml = robot.path.suffix in (".yaml", ".yml")
    return "'name_mot'" if has_yaml else "'name_mot' in a YAML beside it"


def warn_of_findings(robot: Robot, around: FloatArray, tree: TreeSource) -> None:
    """Warn of what is odd, with closed configurations ``around`` (n, nq) the reference."""
    path = robot.source
    for note in tree.notes:
        warn(f"{tree.file}: {note}", ModelWarning)
    forces = "; ".join(left.what for left in tree.left_out if left.is_force)
    if forces:
        where = "model of Pinocchio" if robot.path is None else "file"
        warn(f"{tree.file}: in the {where}, not in the model: {forces}", ModelWarning)
    if not robot.motors_known and (robot.redundant or tree.notes):
        follow = ", ".join(robot.redundant)
        though = f", though {follow} follow from the others" if follow else ""
        warn(
            f"{path} does not say which joints have motors: all count as "
            f"actuated{though}; list the motors as {place_of_motors(robot)}",
            ModelWarning,
        )
    for sign in robot.undeclared:
        warn(f"{path}: {sign}", ModelWarning)
    for sentence in why_free(robot, around):
        warn(f"{path}: {sentence}", ModelWarning)
    if robot.rows:
        _warn_of_closures(robot, around)
    # Structure does not depend on the inertias in the file, forces do: warn, do not refuse.
    impossible = [defect for defect in inertia_defects(robot) if defect.impossible]
    if impossible:
        links = shortened([defect.link for defect in impossible])
        warn(f"{path}: no body has the inertias of {links}: {impossible[0]}", ModelWarning)
    if odd := odd_masses(robot):
        warn(f"{path}: {'; '.join(odd)}", ModelWarning)
    for unequal in unequal_links(robot):
        warn(f"{path}: {unequal}", ModelWarning)


def _warn_of_closures(robot: Robot, around: FloatArray) -> None:
    """Warn of a singular reference, and where the rank of the closures is not clear."""
    reason = why_singular(robot, around)
    if reason:
        warn(f"{robot.source}: the reference is singular {reason}", AccuracyWarning)
    walks = difference(robot, np.repeat(around[:1], len(around), axis=0), around)
    if np.abs(walks / robot.coordinate_scales).max() < STILL:
        warn(
            f"{robot.source}: no other closed pose was found near the reference: what seems "
            "free to move there leads nowhere, as where a closure has the wrong axis",
            ModelWarning,
        )
    found = mobility(robot, around=around)
    if found.held:
        warn(
            f"{robot.source}: the loops do not let the motors {shortened(found.held)} move: "
            "look where the frames of their closures are",
            ModelWarning,
        )
    if found.least < UNCLEAR:
        # Equations that nearly follow from others look independent where numbers are rounded.
        rounding = rounding_that_closes(found.least * robot.length, robot.length)
        warn(
            f"{robot.source}: the rank of the closures is not clear: a singular value of "
            f"{found.least:.1e} of the largest is counted (unclear below {UNCLEAR:g}): where "
            f"numbers are rounded, rounding={rounding:g} lets it count as zero",
            AccuracyWarning,
        )


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
def inertia_defects(robot: Robot) -> tuple[InertiaDefect, ...]:
    """Bodies whose inertia, as the robot file gives it, no solid body has [Wensing2018]."""
    found = []
    for body in robot.bodies:
        P = pseudo_inertia(robot.model.inertias[body.joint_id].toDynamicParameters())
        if reason := body_defect(P, tolerance=ROUNDED):
            impossible = bool(body_defect(P, flat_allowed=True, tolerance=ROUNDED) and P.any())
            found.append(InertiaDefect(body.link, impossible, reason))
    return tuple(found)


@checked
def odd_masses(robot: Robot) -> tuple[str, ...]:
    """Which masses look like placeholders, and which joints move nothing that has a mass."""
    model, found = robot.model, []
    masses = {body.link: float(model.inertias[body.joint_id].mass) for body in robot.bodies}
    least = max(PLACEHOLDER * max(masses.values(), default=0.0), LEAST_MASS)
    light = [f"{link} ({mass:.3g} kg)" for link, mass in masses.items() if 0 < mass < least]
    if light:
        found.append(
            f"masses that look like placeholders, below {least:.3g} kg where the heaviest body has "
            f"{max(masses.values()):.3g} kg: {shortened(light)}"
        )
    heavy = {
        body.joint_id
        for body in robot.bodies
        if model.inertias[body.joint_id].toDynamicParameters().any()
    }
    closing = np.any(robot.supports(robot.closure_frames[0]), axis=0).ravel()
    closing |= robot.moving.any(axis=0)
    idle = [
        joint
        for k, joint in enumerate(robot.joints, start=1)
        if not heavy.intersection(model.subtrees[k]) and not closing[model.joints[k].idx_v]
    ]
    if idle:
        found.append(f"joints that move nothing with mass: {shortened(idle)}")
    return tuple(found)


@checked
def unequal_links(robot: Robot) -> tuple[str, ...]:
    """Which groups of links declared identical have inertials that differ, and by how much."""
    joints = {body.link: body.joint_id for body in robot.bodies}
    found = []
    for group in robot.identical:
        inertias = [robot.model.inertias[joints[link]] for link in group.links]
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
