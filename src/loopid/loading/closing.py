"""Closing the loops at the reference configuration."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import ClosureWarning, ReferenceWarning, RobotFileError
from loopid.kinematics.closing import constraint_gap
from loopid.kinematics.independent import independent_coordinates
from loopid.kinematics.measured import scaled_constraint
from loopid.kinematics.nearby import nearby_configurations
from loopid.kinematics.path_following import CLOSURE_TOLERANCE
from loopid.kinematics.projection import NEAR_SINGULARITY, singularity_measure
from loopid.loading.starts import attempts
from loopid.mechanism import Mechanism

ENOUGH = 24  # closed configurations to choose the best of, where none suits
LIMIT_TOLERANCE = 1e-6  # rad or m
# Fractions of the characteristic length. Redundant equations of a file with rounded numbers
# contradict each other: up to the first the rank of the closures is still clear, up to the second
# rounding is the likely reason.
ROUNDING = 1e-9
LIKELY_ROUNDING = 1e-4


def close_reference(mechanism: Mechanism, given: Collection[str]) -> Mechanism:
    """The mechanism with its loops closed at the reference.

    Motors with a given value stay. From what the file writes, passive joints move first, then also
    motors that it leaves out; then several seeded starts of all joints left out are tried, for
    a regular configuration inside the limits.

    Raises
    ------
    RobotFileError
        With the residual that is left and the closure that stays open most.

    Warns
    -----
    ReferenceWarning
        When the closed configuration is outside the limits of a joint.
    ClosureWarning
        When it closes only as far as the file's numbers are rounded.
    """
    closed: list[Mechanism] = []
    best = (mechanism.reference, np.inf)
    for q, gap in attempts(mechanism, given):
        best = min(best, (q, gap), key=lambda attempt: attempt[1])
        if gap > max(CLOSURE_TOLERANCE, ROUNDING * mechanism.length):
            continue
        closed.append(_at(mechanism, q))
        if _suits(closed[-1]) or len(closed) == ENOUGH:
            break
    if not closed:
        raise RobotFileError(_open_loops(mechanism, best[0], given))
    chosen = _most_suitable(closed)
    outside = _outside(chosen)
    if outside:
        warnings.warn(f"{mechanism.path}: the reference is {outside}", ReferenceWarning, 4)
    if chosen.closure_gap:
        warnings.warn(
            f"{mechanism.path}: the loops close to {chosen.closure_gap:.1e} m only: its numbers "
            "are rounded",
            ClosureWarning,
            stacklevel=4,
        )
    return chosen


def _at(mechanism: Mechanism, q: FloatArray) -> Mechanism:
    """The mechanism with a closed reference and the coordinates that are independent around it."""
    gap = float(constraint_gap(mechanism, q[None])[0])
    chosen = independent_coordinates(mechanism, nearby_configurations(mechanism, q))
    driven = mechanism.coordinates_of(mechanism.actuated)
    return replace(
        mechanism,
        reference=q,
        closure_gap=gap if gap > CLOSURE_TOLERANCE else 0.0,
        free=tuple(name for name in chosen if name not in driven),
        redundant=tuple(name for name in driven if name not in chosen),
    )


def _most_suitable(closed: list[Mechanism]) -> Mechanism:
    """The last one if it suits, else the most regular inside the limits, else the first one."""
    inside = [mechanism for mechanism in closed if not _outside(mechanism)]
    if not inside:
        return closed[0]
    return closed[-1] if _suits(closed[-1]) else max(inside, key=_measure)


def _suits(mechanism: Mechanism) -> bool:
    """Whether the reference is inside the limits and regular for the motors."""
    return not _outside(mechanism) and _measure(mechanism) >= NEAR_SINGULARITY


def _measure(mechanism: Mechanism) -> float:
    return float(singularity_measure(mechanism, mechanism.reference[None])[0])


def _outside(mechanism: Mechanism) -> str:
    """The first joint outside its limits, in words; nothing where there is none."""
    q = mechanism.reference
    for name in mechanism.joints:
        joint, (low, high) = mechanism.joint(name), mechanism.limits(name)
        if joint.nq != 1:
            continue
        if not low - LIMIT_TOLERANCE <= q[joint.idx_q] <= high + LIMIT_TOLERANCE:
            limits = f"{low:.4g} ... {high:.4g}"
            return f"outside the limits of joint {name}: {q[joint.idx_q]:.4g} is not in {limits}"
    return ""


def _open_loops(mechanism: Mechanism, q: FloatArray, given: Collection[str]) -> str:
    residual = np.abs(scaled_constraint(mechanism, q[None])[0][0])
    name = mechanism.row_names[int(residual.argmax())]
    origin = "the reference cannot be closed" if given else "no closed configuration was found"
    hint = "" if given else ", give one as 'reference'"
    if residual.max() < LIKELY_ROUNDING * mechanism.length:
        hint = (
            ": the numbers of the file seem rounded, so that redundant equations contradict each "
            "other; give more digits, or closures with fewer rows"
        )
    return (
        f"{mechanism.path}: {origin}: closure {name} stays open by "
        f"{residual.max():.1e} m (tolerance {CLOSURE_TOLERANCE:g} m){hint}"
    )
