"""What is worth a warning in a robot that loads nevertheless."""

from __future__ import annotations

from loopid.arrays import FloatArray
from loopid.errors import (
    ClosureWarning,
    InertiaWarning,
    MobilityWarning,
    ModelWarning,
    SingularityWarning,
    warn,
)
from loopid.kinematics import NEAR_SINGULARITY, Mobility, mobility, singularity_measure
from loopid.loading.tree import TreeSource
from loopid.robot import Mechanism, inertia_defects, unequal_links

UNCLEAR = 1e-4  # of the largest singular value of the closure Jacobian


def warn_of_findings(
    mechanism: Mechanism, around: FloatArray, tree: TreeSource, motors_given: bool
) -> None:
    """Warn of features that are left out, motors, singularities and inertias.

    Parameters
    ----------
    around : FloatArray
        (n, nq), closed configurations around the reference.
    """
    for note in tree.notes:
        warn(f"{tree.file}: {note}", ModelWarning)
    _check_motors(mechanism, tree, motors_given)
    if mechanism.rows:
        found = mobility(mechanism, around=around)
        _check_singularity(mechanism, found)
        if found.least < UNCLEAR:
            # Equations that nearly follow from others look independent where numbers are rounded.
            warn(
                f"{mechanism.path}: the rank of the closures is not clear: a singular value of "
                f"{found.least:.1e} of the largest is counted (unclear below {UNCLEAR:g}): are "
                "angles or points rounded?",
                ClosureWarning,
            )
    # Structure does not depend on the inertias in the file, forces do: warn, do not refuse.
    impossible = [str(defect) for defect in inertia_defects(mechanism) if defect.impossible]
    if impossible:
        text = f"no body has these inertias: {'; '.join(impossible)}"
        warn(f"{mechanism.path}: {text}", InertiaWarning)
    for difference in unequal_links(mechanism):
        warn(f"{mechanism.path}: {difference}", InertiaWarning)


def _check_motors(mechanism: Mechanism, tree: TreeSource, motors_given: bool) -> None:
    if not motors_given and (mechanism.redundant or tree.notes):
        follow = ", ".join(mechanism.redundant)
        though = f", though {follow} follow from the others" if follow else ""
        warn(
            f"{mechanism.path} does not say which joints have motors: all count as "
            f"actuated{though}; list the motors as 'name_mot' in a YAML beside it",
            MobilityWarning,
        )
    floating = mechanism.coordinates_of(mechanism.floating)
    free = [name for name in mechanism.free if name not in floating]
    if free:
        warn(
            f"{mechanism.path}: the motors leave {', '.join(free)} free: no force acts there, and "
            "rows '= 0' say so; lock what does not move",
            MobilityWarning,
        )


def _check_singularity(mechanism: Mechanism, found: Mobility) -> None:
    measure = float(singularity_measure(mechanism, mechanism.reference[None])[0])
    if found.singular:
        reason = (
            f"{found.degrees_of_freedom} degrees of freedom there, "
            f"{found.generic_degrees_of_freedom} around it"
        )
    elif measure < NEAR_SINGULARITY:
        loose = ", ".join(name for name in found.undetermined if name not in mechanism.free)
        reason = f"{loose or 'passive joints'} can move there while the motors stand still"
    else:
        return
    warn(
        f"{mechanism.path}: the reference is singular (measure {measure:.1e}): {reason}",
        SingularityWarning,
    )
