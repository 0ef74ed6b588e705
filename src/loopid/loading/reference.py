"""The reference configuration: as the robot file writes it, then with its loops closed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.errors import (
    ClosureWarning,
    LoopidError,
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
from loopid.robot import Mechanism
from loopid.seeds import random_generator

# Of a joint with one coordinate its value, of another one its part of the configuration.
Reference = float | list[float]
LARGEST = 1e100  # as for the numbers of a URDF
STARTS = 64  # for joints that the file leaves out, tried together in parts
PART = 16
ENOUGH = 24  # closed configurations to choose the best of, where none suits
LIMIT_TOLERANCE = 1e-6  # rad or m
# Fractions of the characteristic length. Redundant equations of a file with rounded numbers
# contradict each other: up to the first the rank of the closures is still clear, up to the second
# rounding is the likely reason.
ROUNDING = 1e-9
LIKELY_ROUNDING = 1e-4
# Index of the first number of a quaternion, or of cosine and sine.
UNIT_PARTS = {"JointModelSpherical": 0, "JointModelFreeFlyer": 3, "JointModelPlanar": 2}
# A mechanism closed at its reference, and closed configurations around it (n, nq).
ClosedReference = tuple[Mechanism, FloatArray]


def joint_named(
    name: str, model: pin.Model, problem: str, failure: type[LoopidError] = RobotFileError
) -> pin.JointModel:
    """Joint of a name; where there is none, an error that lists the joints."""
    names = list(model.names)[1:]
    if name not in names:
        raise failure(f"{problem}: choose among {', '.join(names)}")
    return model.joints[model.getJointId(name)]


def written_reference(file: Path, model: pin.Model, values: Mapping[str, Reference]) -> FloatArray:
    """Configuration (nq,) with the given joint values; others in the middle of their limits."""
    q = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        if joint.nq == 1:
            k = joint.idx_q
            low, high = model.lowerPositionLimit[k], model.upperPositionLimit[k]
            if not low <= q[k] <= high:
                q[k] = 0.5 * (low + high)
    for name, value in values.items():
        joint = joint_named(name, model, f"{file}: unknown joint {name!r} in reference")
        what, given = f"{file}: joint {name} in reference", np.array(value, float, ndmin=1)
        if not (np.abs(given) < LARGEST).all():
            raise RobotFileError(f"{what} must be finite and below {LARGEST:g}, not {value}")
        wanted = 1 if joint.nv == 1 else joint.nq
        if len(given) != wanted:
            count = "one number" if wanted == 1 else f"a list of {wanted} numbers"
            raise RobotFileError(f"{what} must be {count}, not {value}")
        if joint.nv == 1:
            write_joint(joint, q, float(given[0]))
            continue
        turn = given[UNIT_PARTS.get(joint.shortname(), len(given)) :]
        if len(turn):
            size = float(np.linalg.norm(turn))
            if not 0.9 < size < 1.1:
                raise RobotFileError(
                    f"{what} must end in a unit vector, not one of length {size:.3g}"
                )
            turn /= size
        q[joint.idx_q : joint.idx_q + joint.nq] = given
    return np.asarray(q, dtype=np.float64)


def read_joint(joint: pin.JointModel, q: FloatArray) -> float:
    """Value of a joint with one coordinate in a configuration."""
    first = joint.idx_q
    return float(np.arctan2(q[first + 1], q[first]) if joint.nq == 2 else q[first])


def write_joint(joint: pin.JointModel, q: FloatArray, value: float) -> None:
    """Put the value of a joint with one coordinate into a configuration, in place."""
    coordinates = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
    q[joint.idx_q : joint.idx_q + joint.nq] = coordinates


def close_reference(mechanism: Mechanism, given: Collection[str]) -> ClosedReference:
    """Close the loops of a mechanism at its reference.

    Motors with a given value stay. From what the file writes, passive joints move first, then also
    motors that it leaves out; then several seeded starts of all joints left out are tried, for
    a regular configuration inside the limits.

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
        When it closes only as far as the file's numbers are rounded.
    """
    closed: list[ClosedReference] = []
    suits = False  # inside the limits, and regular for the motors
    best = (mechanism.reference, np.inf)
    for q, gap in _attempts(mechanism, given):
        best = min(best, (q, gap), key=lambda attempt: attempt[1])
        if gap > max(CLOSURE_TOLERANCE, ROUNDING * mechanism.length):
            continue
        closed.append(_closed_at(mechanism, q))
        suits = not _outside(closed[-1][0]) and _measure(closed[-1]) >= NEAR_SINGULARITY
        if suits or len(closed) == ENOUGH:
            break
    if not closed:
        raise RobotFileError(_open_loops(mechanism, best[0], given))
    # The one that suits, else the most regular inside the limits, else the first one.
    inside = [each for each in closed if not _outside(each[0])]
    chosen = closed[-1] if suits else max(inside, key=_measure) if inside else closed[0]
    outside, left = _outside(chosen[0]), chosen[0].closure_residual
    if outside:
        warn(f"{mechanism.path}: the reference is {outside}", ReferenceWarning)
    if left:
        text = f"the loops close to {left:.1e} m only: its numbers are rounded"
        warn(f"{mechanism.path}: {text}", ClosureWarning)
    return chosen


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
    residual = float(largest_residual(mechanism, q[None])[0])
    around = nearby_configurations(mechanism, q)
    try:
        chosen = independent_coordinates(mechanism, around)
    except MobilityError as error:
        raise MobilityError(f"{mechanism.path}: {error}") from error
    driven = mechanism.coordinates_of(mechanism.actuated)
    closed = replace(
        mechanism,
        reference=q,
        closure_residual=residual if residual > CLOSURE_TOLERANCE else 0.0,
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
        hint = (
            ": the numbers of the file seem rounded, so that redundant equations contradict each "
            "other; give more digits, or closures with fewer rows"
        )
    return (
        f"{mechanism.path}: {origin}: closure {name} stays open by "
        f"{residual.max():.1e} m (tolerance {CLOSURE_TOLERANCE:g} m){hint}"
    )
