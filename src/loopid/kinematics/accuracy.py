"""How accurately a robot's geometry is written, and the same motion of robots within that.

Numbers of a file that end after so many decimals are known to half a unit of the last one. What is
drawn special (parallel, in a plane) stays so: zeros and right angles are not rounded numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pinocchio as pin

from loopid.arrays import FloatArray
from loopid.kinematics.constraint import Constraint, scaled_residual
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import ClosedMotion, Projection, partition, velocity_map
from loopid.robot import Mechanism

# Numbers with fewer decimals are round by design, those between the first two may be; those with
# more than the last have all the digits there are.
LEAST_DECIMALS, SURE_DECIMALS, MOST_DECIMALS = 5, 6, 12
DIGITS_LEFT = 1e-14  # that composing placements leaves of a number with few decimals
SQUARE = 1e-9  # rad, from a multiple of 90° that is drawn as such
NEARLY = 20  # times the accuracy, by which lengths differ that may be meant to be equal
CORRECTIONS = 3  # of the dependent coordinates, each leaves the square of what there was


@dataclass(frozen=True)
class Accuracy:
    """How far the geometry may be from what the file writes.

    Attributes
    ----------
    length, angle : float
        In m and rad; 0 where it is exact.
    source : str
        Where that is known from.
    presumed : bool
        Whether the numbers have so few decimals that they may be round by design.
    """

    length: float
    angle: float
    source: str
    presumed: bool = False


def geometry_accuracy(mechanism: Mechanism) -> Accuracy:
    """What the robot file says of its rounding, or what its numbers and closures show."""
    if mechanism.rounding is not None:
        angle = mechanism.rounding / mechanism.length
        return Accuracy(mechanism.rounding, angle, "the rounding that is given")
    numbers: tuple[list[float], list[float]] = ([], [])
    for place in _placements(mechanism.model):
        numbers[0].extend(place.translation)
        numbers[1].extend(x for x in pin.rpy.matrixToRpy(place.rotation) if not _square(x))
    numbers[0].extend(closure.length for closure in mechanism.closures)
    decimals = [_decimals(np.array(part)) for part in numbers]
    length, angle = (0.5 * 10.0**-count if count else 0.0 for count in decimals)
    said = [f"{n} decimals of {what}" for n, what in zip(decimals, ("m", "rad"), strict=True) if n]
    if mechanism.closure_residual > length:
        length, said = mechanism.closure_residual, ["what the closures leave open"]
    presumed = 0 < max(decimals) < SURE_DECIMALS and not mechanism.closure_residual
    return Accuracy(length, angle, ", ".join(said), presumed)


def _placements(model: pin.Model) -> list[pin.SE3]:
    """Of all joints and frames, in the frames that the file has them in."""
    found = []
    for frame in list(model.frames)[1:]:
        place = frame.placement
        if frame.type == pin.FrameType.JOINT:
            place = model.jointPlacements[frame.parentJoint]
        found.append(model.frames[frame.parentFrame].placement.actInv(place))
    return found


def nearly_equal_lengths(mechanism: Mechanism, accuracy: Accuracy) -> tuple[str, ...]:
    """Pairs of distances between joints that differ, but hardly: ``elbow 0.2 m, wrist 0.200001 m``.

    In a linkage such as a parallelogram equal lengths decide what can be known.
    """
    model, found = mechanism.model, dict[str, float]()
    for frame, place in zip(list(model.frames)[1:], _placements(model), strict=True):
        if length := float(np.linalg.norm(place.translation)):
            found[frame.name] = length
    found |= {closure.name: closure.length for closure in mechanism.closures if closure.length}
    by_length = sorted(found.items(), key=lambda item: item[1])
    return tuple(
        f"{one} {a:.9g} m, {other} {b:.9g} m"
        for (one, a), (other, b) in pairwise(by_length)
        if accuracy.length / 2 < b - a <= NEARLY * accuracy.length
    )


def _square(angle: float) -> bool:
    return bool(abs(np.sin(2 * angle)) < 2 * SQUARE)


def _decimals(values: FloatArray) -> int:
    """Decimals that most of the numbers have which are not round by design; 0 if all they can."""
    counts = np.arange(MOST_DECIMALS + 2)
    rounded = np.round(values[:, None] * 10.0**counts) / 10.0**counts
    ends = np.abs(rounded - values[:, None]) <= DIGITS_LEFT * np.maximum(np.abs(values), 1)[:, None]
    ends[:, -1] = True
    needed = ends.argmax(axis=1)
    needed = needed[needed >= LEAST_DECIMALS]
    most = int(np.median(needed)) if len(needed) else 0
    return most if most <= MOST_DECIMALS else 0


def within_accuracy(
    mechanism: Mechanism, accuracy: Accuracy, generator: np.random.Generator
) -> Mechanism:
    """The robot with other geometry that the file would write alike."""
    model, places = mechanism.model.copy(), _placements(mechanism.model)
    for k, (frame, place) in enumerate(zip(list(model.frames)[1:], places, strict=True), start=1):
        shift, turn = generator.uniform(-1, 1, (2, 3))
        rpy = pin.rpy.matrixToRpy(place.rotation)
        rpy = rpy + accuracy.angle * turn * [not _square(x) for x in rpy]
        xyz = place.translation + accuracy.length * shift * (place.translation != 0)
        moved = model.frames[frame.parentFrame].placement * pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
        if frame.type == pin.FrameType.JOINT:
            model.jointPlacements[frame.parentJoint] = moved
        elif k in mechanism.closure_frames[0]:
            model.frames[k].placement = moved
    longer = accuracy.length * generator.uniform(-1, 1, len(mechanism.closures))
    closures = tuple(
        replace(closure, length=closure.length + more) if closure.length else closure
        for closure, more in zip(mechanism.closures, longer, strict=True)
    )
    return replace(mechanism, model=model, closures=closures)


def same_motion(
    mechanism: Mechanism,
    other: Mechanism,
    configurations: FloatArray,
    velocities: FloatArray,
    accelerations: FloatArray,
) -> ClosedMotion:
    """The motion that a robot of slightly other geometry makes of the same independent motion.

    Equations that are redundant for the one and contradict each other for the other are satisfied
    in the least-squares sense, with the rank that they have for the one.

    Parameters
    ----------
    configurations : FloatArray
        (N, nq), closed for ``mechanism``.
    velocities, accelerations : FloatArray
        (N, dof) of the independent coordinates.
    """
    q, (chosen, dependent) = configurations, partition(mechanism)
    scales = mechanism.coordinate_scales[dependent]
    _, solver = velocity_map(mechanism, Constraint(mechanism, q).scaled()[1], chosen, dependent)
    for _ in range(CORRECTIONS):
        step = np.zeros((len(q), mechanism.model.nv))
        step[:, dependent] = -scales * solver.solve(scaled_residual(other, q)[:, :, None])[:, :, 0]
        q = integrate(other, q, step)
    constraint = Constraint(other, q)
    G, solver = velocity_map(other, constraint.scaled()[1], chosen, dependent)
    v, gamma = np.einsum("nij,nj->ni", G, velocities), np.zeros((len(q), mechanism.model.nv))
    drift = other.row_scales * constraint.drift(v)
    gamma[:, dependent] = -scales * solver.solve(drift[:, :, None])[:, :, 0]
    a = np.einsum("nij,nj->ni", G, accelerations) + gamma
    return ClosedMotion(q, v, a, gamma, Projection(G, gamma, chosen, solver.matrices))
