"""The reference configuration: as the robot file writes it, then with its loops closed."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import (
    ClosureWarning,
    MobilityError,
    ReferenceWarning,
    RobotFileError,
    warn,
)
from loopid.kinematics import (
    CLOSURE_TOLERANCE,
    NEAR_SINGULARITY,
    close_by_continuation,
    close_loops,
    independent_coordinates,
    integrate,
    largest_residual,
    nearby_configurations,
    scaled_constraint,
    singularity_measure,
)
from loopid.loading.rounding import (
    SIX_DIGITS,
    changes,
    exact_geometry,
    largest_gap,
    rounding_that_closes,
)
from loopid.loading.tree import write_joint
from loopid.robot import Mechanism
from loopid.seeds import random_generator

STARTS = 64  # for joints that the file leaves out, tried together in parts
PART = 16
ENOUGH = 24  # closed configurations to choose the best of, where none suits
LIMIT_TOLERANCE = 1e-6  # rad or m
SPREAD = 3.0  # times what loops stay open by around the reference, farther away
# Of the characteristic length, up to which rounding is the likely reason that loops stay open.
LIKELY_ROUNDING = 1e-3
# A mechanism closed at its reference, and closed configurations around it (n, nq).
ClosedReference = tuple[Mechanism, FloatArray]


def close_reference(
    mechanism: Mechanism, given: Collection[str], rounding: float | None = None, snap: bool = False
) -> ClosedReference:
    """Close the loops of a mechanism at its reference.

    Motors with a given value stay. From what the file writes, passive joints move first, then also
    motors that it leaves out; then several seeded starts of all joints left out are tried, for
    a regular configuration inside the limits.

    Loops that hardly miss, or that hardly keep the robot from moving, are closed by moving frames
    of closures: within the rounding that is given, else within that of six digits.

    Raises
    ------
    RobotFileError
        With the residual that is left and the closure that stays open most.
    MobilityError
        When nothing can move.

    Warns
    -----
    ReferenceWarning
        When the closed configuration is outside the limits of a joint.
    ClosureWarning
        When frames, or with ``snap`` joints, were moved.
    """
    presumed = SIX_DIGITS if rounding is None else rounding
    near = largest_gap(presumed, mechanism.length)
    chosen, reason = None, None
    if rounding is None and not snap:
        try:
            chosen = _closed_reference(mechanism, given, near)
        except MobilityError as error:
            reason = error
    if chosen is None or chosen[0].closure_residual > CLOSURE_TOLERANCE:
        tolerance = max(mechanism.closure_rank_tolerance, near / mechanism.length)
        loose = replace(mechanism, closure_rank_tolerance=tolerance)
        try:
            chosen = _closed_reference(loose, given, near)
        except MobilityError as error:
            raise reason or error from None
        chosen = _exact(mechanism, chosen[0], rounding, snap)
    outside = _outside(chosen[0])
    if outside:
        warn(f"{mechanism.path}: the reference is {outside}", ReferenceWarning)
    return chosen


def _exact(
    file: Mechanism, loose: Mechanism, rounding: float | None, snap: bool
) -> ClosedReference:
    """The mechanism with frames moved so that its loops close, and what they leave open nearby."""
    presumed = SIX_DIGITS if rounding is None else rounding
    moved = exact_geometry(loose, loose.reference, presumed, snap)
    moved, around = _closed_at(moved, moved.reference)
    open_by = float(largest_residual(moved, around).max())
    exact = replace(moved, closure_rank_tolerance=file.closure_rank_tolerance)
    if open_by <= CLOSURE_TOLERANCE:
        moved, around = _closed_at(replace(exact, closure_residual=0.0), exact.reference)
    else:
        moved = replace(moved, closure_residual=SPREAD * open_by)
    shift, turn = changes(loose, moved)
    moved = replace(moved, rounding=rounding or (SIX_DIGITS if shift or open_by else 0.0))
    if shift or turn:
        text = f"joints and closures were moved by up to {shift:.1e} m and {turn:.1e} rad"
        text += f", and the loops then stay open by {open_by:.1e} m" * (open_by > CLOSURE_TOLERANCE)
        warn(f"{file.path}: its numbers are rounded: {text}", ClosureWarning)
    return moved, around


def _closed_reference(mechanism: Mechanism, given: Collection[str], near: float) -> ClosedReference:
    """The first closed configuration that suits, or that is as closed as numbers are rounded."""
    closed: list[ClosedReference] = []
    suits = False  # inside the limits, and regular for the motors
    best = (mechanism.reference, np.inf)
    for q, gap in _attempts(mechanism, given):
        best = min(best, (q, gap), key=lambda attempt: attempt[1])
        if gap > max(CLOSURE_TOLERANCE, near):
            continue
        closed.append(_closed_at(replace(mechanism, closure_residual=gap), q))
        suits = not _outside(closed[-1][0]) and _measure(closed[-1]) >= NEAR_SINGULARITY
        if suits or len(closed) == ENOUGH:
            break
    if not closed:
        raise RobotFileError(_open_loops(mechanism, best[0], given))
    # The one that suits, else the most regular inside the limits, else the first one.
    inside = [each for each in closed if not _outside(each[0])]
    return closed[-1] if suits else max(inside, key=_measure) if inside else closed[0]


def _attempts(mechanism: Mechanism, given: Collection[str]) -> Iterator[tuple[FloatArray, float]]:
    """Configurations and what their loops stay open by (m), from the most to the least wanted."""
    start = mechanism.reference[None]
    left_out = [joint for joint in mechanism.joints if joint not in given]
    either = {*mechanism.passive, *left_out}
    passive = mechanism.velocity_indices(mechanism.passive)
    movable = mechanism.velocity_indices([name for name in mechanism.joints if name in either])
    # Motors that a start puts anywhere may stay there, or help.
    ways = [passive, movable] if len(movable) > len(passive) else [passive]
    for joints in ways:
        yield from zip(*close_loops(mechanism, start, joints), strict=True)
        if mechanism.rows == 0:
            return
        yield from zip(*close_by_continuation(mechanism, start, joints), strict=True)
    generator = random_generator(0)
    for _ in range(STARTS // PART if left_out else 0):
        starts = np.stack([_scattered(mechanism, left_out, generator) for _ in range(PART)])
        for joints in ways:
            yield from zip(*close_loops(mechanism, starts, joints), strict=True)


def _scattered(
    mechanism: Mechanism, joints: list[str], generator: np.random.Generator
) -> FloatArray:
    """The reference with joints anywhere within their limits, or within a turn."""
    q = mechanism.reference.copy()
    for name in joints:
        joint = mechanism.joint(name)
        if name in mechanism.floating:
            continue
        if joint.nv > 1:
            turn = np.zeros(mechanism.model.nv)
            turn[mechanism.velocity_indices([name])] = generator.uniform(-1, 1, joint.nv)
            turn[mechanism.prismatic] = 0.0
            q = integrate(mechanism, q[None], np.pi * turn[None])[0]
            continue
        width = mechanism.length if joint.idx_v in mechanism.prismatic else np.pi
        lower, upper = mechanism.limits(name)
        low, high = max(lower, -width), min(upper, width)
        if low <= high:
            write_joint(joint, q, generator.uniform(low, high))
    return q


def _closed_at(mechanism: Mechanism, q: FloatArray) -> ClosedReference:
    """The mechanism with a closed reference and the coordinates that are independent around it."""
    around = nearby_configurations(mechanism, q)
    try:
        chosen = independent_coordinates(mechanism, around)
    except MobilityError as error:
        raise MobilityError(f"{mechanism.path}: {error}") from error
    driven = mechanism.coordinates_of(mechanism.actuated)
    closed = replace(
        mechanism,
        reference=q,
        closure_residual=mechanism.closure_residual
        * (mechanism.closure_residual > CLOSURE_TOLERANCE),
        free=tuple(name for name in chosen if name not in driven),
        redundant=tuple(name for name in driven if name not in chosen),
    )
    return closed, around


def _measure(closed: ClosedReference) -> float:
    return float(singularity_measure(closed[0], closed[0].reference[None])[0])


def _outside(mechanism: Mechanism) -> str:
    """The first joint outside its limits, in words; nothing where there is none."""
    for name in mechanism.joints:
        joint, (low, high) = mechanism.joint(name), mechanism.limits(name)
        value = mechanism.reference[joint.idx_q]
        if joint.nq == 1 and not low - LIMIT_TOLERANCE <= value <= high + LIMIT_TOLERANCE:
            limits = f"{low:.4g} ... {high:.4g}"
            return f"outside the limits of joint {name}: {value:.4g} is not in {limits}"
    return ""


def _open_loops(mechanism: Mechanism, q: FloatArray, given: Collection[str]) -> str:
    residual = np.abs(scaled_constraint(mechanism, q[None])[0][0])
    name = mechanism.row_names[int(residual.argmax())]
    origin = "the reference cannot be closed" if given else "no closed configuration was found"
    hint = "" if given else ", give one as 'reference'"
    if residual.max() < LIKELY_ROUNDING * mechanism.length:
        needed = rounding_that_closes(float(residual.max()), mechanism.length)
        hint = (
            f": if its numbers are rounded, say so by --rounding {needed:g}, or by "
            f"'rounding: {needed:g}' in a YAML, and frames of closures are moved within that"
        )
    return (
        f"{mechanism.path}: {origin}: closure {name} stays open by "
        f"{residual.max():.1e} m (tolerance {CLOSURE_TOLERANCE:g} m){hint}"
    )
