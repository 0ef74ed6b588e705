"""Closing the loops at the reference configuration."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import ClosureWarning, ReferenceWarning, RobotFileError
from loopid.kinematics import (
    CLOSURE_TOLERANCE,
    NEAR_SINGULARITY,
    independent_coordinates,
    largest_residual,
    nearby_configurations,
    scaled_constraint,
    singularity_measure,
)
from loopid.loading.starts import attempts
from loopid.robot import Mechanism

ENOUGH = 24  # closed configurations to choose the best of, where none suits
LIMIT_TOLERANCE = 1e-6  # rad or m
# Fractions of the characteristic length. Redundant equations of a file with rounded numbers
# contradict each other: up to the first the rank of the closures is still clear, up to the second
# rounding is the likely reason.
ROUNDING = 1e-9
LIKELY_ROUNDING = 1e-4


class ClosedReference(NamedTuple):
    """A mechanism closed at its reference, and closed configurations around it (n, nq)."""

    mechanism: Mechanism
    around: FloatArray


def close_reference(mechanism: Mechanism, given: Collection[str]) -> ClosedReference:
    """Close the loops of a mechanism at its reference.

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
    closed: list[ClosedReference] = []
    best = (mechanism.reference, np.inf)
    for q, gap in attempts(mechanism, given):
        best = min(best, (q, gap), key=lambda attempt: attempt[1])
        if gap > max(CLOSURE_TOLERANCE, ROUNDING * mechanism.length):
            continue
        closed.append(_at(mechanism, q))
        if _suits(closed[-1].mechanism) or len(closed) == ENOUGH:
            break
    if not closed:
        raise RobotFileError(_open_loops(mechanism, best[0], given))
    chosen = _most_suitable(closed)
    _warn_of_reference(chosen.mechanism)
    return chosen


def _warn_of_reference(mechanism: Mechanism) -> None:
    outside = _outside(mechanism)
    if outside:
        warnings.warn(f"{mechanism.path}: the reference is {outside}", ReferenceWarning, 4)
    if mechanism.closure_residual:
        warnings.warn(
            f"{mechanism.path}: the loops close to {mechanism.closure_residual:.1e} m only: its "
            "numbers are rounded",
            ClosureWarning,
            stacklevel=4,
        )


def _at(mechanism: Mechanism, q: FloatArray) -> ClosedReference:
    """The mechanism with a closed reference and the coordinates that are independent around it."""
    gap = float(largest_residual(mechanism, q[None])[0])
    around = nearby_configurations(mechanism, q)
    chosen = independent_coordinates(mechanism, around)
    driven = mechanism.coordinates_of(mechanism.actuated)
    closed = replace(
        mechanism,
        reference=q,
        closure_residual=gap if gap > CLOSURE_TOLERANCE else 0.0,
        free=tuple(name for name in chosen if name not in driven),
        redundant=tuple(name for name in driven if name not in chosen),
    )
    return ClosedReference(closed, around)


def _most_suitable(closed: list[ClosedReference]) -> ClosedReference:
    """The last one if it suits, else the most regular inside the limits, else the first one."""
    inside = [each for each in closed if not _outside(each.mechanism)]
    if not inside:
        return closed[0]
    if _suits(closed[-1].mechanism):
        return closed[-1]
    return max(inside, key=lambda each: _measure(each.mechanism))


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
