"""What is odd about a robot that was loaded: warnings."""

from __future__ import annotations

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import AccuracyWarning, ModelWarning, warn
from loopid.kinematics import mobility
from loopid.kinematics.poses import difference
from loopid.kinematics.rounding import rounding_that_closes
from loopid.loading.reference import why_singular
from loopid.loading.tree import TreeSource
from loopid.robot.checks import inertia_defects, odd_masses, unequal_links
from loopid.robot.mechanism import Mechanism, shortened

UNCLEAR = 1e-4  # of the largest singular value of the closure Jacobian
STILL = 1e-3  # rad or characteristic lengths that no random walk leaves


def warn_of_findings(
    mechanism: Mechanism, around: FloatArray, tree: TreeSource, motors_given: bool
) -> None:
    """Warn of features that are left out, motors, singularities and inertias.

    ``around`` (n, nq) are closed configurations around the reference.
    """
    path = mechanism.path
    for note in tree.notes:
        warn(f"{tree.file}: {note}", ModelWarning)
    forces = "; ".join(left.what for left in tree.left_out if left.is_force)
    if forces:
        warn(f"{tree.file}: in the file, not in the model: {forces}", ModelWarning)
    if not motors_given and (mechanism.redundant or tree.notes):
        follow = ", ".join(mechanism.redundant)
        though = f", though {follow} follow from the others" if follow else ""
        warn(
            f"{path} does not say which joints have motors: all count as "
            f"actuated{though}; list the motors as 'name_mot' in a YAML beside it",
            ModelWarning,
        )
    floating = mechanism.coordinates_of(mechanism.floating)
    free = [name for name in mechanism.free if name not in floating]
    if free:
        warn(
            f"{path}: the motors leave {shortened(free)} free: no force acts there, and "
            "rows '= 0' say so; lock what does not move",
            ModelWarning,
        )
    if mechanism.rows:
        _warn_of_closures(mechanism, around)
    # Structure does not depend on the inertias in the file, forces do: warn, do not refuse.
    impossible = [defect for defect in inertia_defects(mechanism) if defect.impossible]
    if impossible:
        links = shortened([defect.link for defect in impossible])
        warn(f"{path}: no body has the inertias of {links}: {impossible[0]}", ModelWarning)
    if odd := odd_masses(mechanism):
        warn(f"{path}: {'; '.join(odd)}", ModelWarning)
    for unequal in unequal_links(mechanism):
        warn(f"{path}: {unequal}", ModelWarning)


def _warn_of_closures(mechanism: Mechanism, around: FloatArray) -> None:
    """Warn of a singular reference, and where the rank of the closures is not clear."""
    reason = why_singular(mechanism, around)
    if reason:
        warn(f"{mechanism.path}: the reference is singular {reason}", AccuracyWarning)
    walks = difference(mechanism, np.repeat(around[:1], len(around), axis=0), around)
    if np.abs(walks / mechanism.coordinate_scales).max() < STILL:
        warn(
            f"{mechanism.path}: no other closed pose was found near the reference: what seems free "
            "to move there leads nowhere, as where a closure has the wrong axis",
            ModelWarning,
        )
    found = mobility(mechanism, around=around)
    if found.held:
        warn(
            f"{mechanism.path}: the loops do not let the motors {shortened(found.held)} move: look "
            "where the frames of their closures are",
            ModelWarning,
        )
    if found.least < UNCLEAR:
        # Equations that nearly follow from others look independent where numbers are rounded.
        rounding = rounding_that_closes(found.least * mechanism.length, mechanism.length)
        warn(
            f"{mechanism.path}: the rank of the closures is not clear: a singular value of "
            f"{found.least:.1e} of the largest is counted (unclear below {UNCLEAR:g}): where "
            f"numbers are rounded, rounding={rounding:g} lets it count as zero",
            AccuracyWarning,
        )
