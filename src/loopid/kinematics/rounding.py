"""Geometry of files with a few digits: how accurate it is, and how far its loops may stay open.

Numbers of a file with few decimals are known to half a unit of the last one. What is
drawn special (parallel, in a plane) stays so: zeros and right angles are not rounded numbers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from loopid.arguments import FloatArray, IntArray
from loopid.records import record
from loopid.robot.robot import Robot

# Lengths and angles with fewer decimals are round by design; those with more have all the digits
# there are.
LEAST_DECIMALS, LEAST_OF_ANGLES, MOST_DECIMALS = 4, 3, 12
NEARLY_SQUARE = 2e-3  # rad, that 1.57 and 3.14 miss multiples of 90° by
DIGITS_LEFT = 1e-14  # that composing placements leaves of a number with few decimals
SQUARE = 1e-9  # rad, from a multiple of 90° that is drawn as such
SIX_DIGITS = 1e-6  # m or rad: what a file is taken to be rounded to where it must be
# Numbers of a loop that add up, in units of the rounding.
NEARLY = 20.0


# How accurate it is.


@record(checked="outside")
class Accuracy:
    """How far the geometry may be from what the file writes.

    Examples
    --------
    >>> import loopid
    >>> loopid.kinematics.Accuracy(1e-6, 1e-6, "the file's decimals").length
    1e-06
    """

    length: float  # m; 0 where it is exact
    angle: float  # rad
    source: str  # where that is known from


def geometry_accuracy(robot: Robot) -> Accuracy:
    """What the robot file says of its rounding, or what its numbers and closures show."""
    if robot.rounding is not None:
        length = max(robot.rounding, robot.closure_residual)
        return Accuracy(length, length / robot.length, "the rounding that is given or needed")
    numbers: tuple[list[float], list[float]] = ([], [])
    for place in _placements(robot.model):
        numbers[0].extend(place.translation)
        numbers[1].extend(x for x in pin.rpy.matrixToRpy(place.rotation) if not _square(x))
    numbers[0].extend(closure.length for closure in robot.closures)
    angles = np.array(numbers[1])
    length, said = _rounded_to(np.array(numbers[0]), LEAST_DECIMALS, "m")
    angle, more = _rounded_to(angles, LEAST_OF_ANGLES, "rad")
    missed = np.abs(angles - np.pi / 2 * np.round(angles / (np.pi / 2)))
    missed = missed[(np.abs(angles) > 1) & (_decimals(angles) <= LEAST_OF_ANGLES)]
    if (tilt := float(missed[missed < NEARLY_SQUARE].max(initial=0.0))) > angle:
        angle, more = tilt, [f"{tilt:.0e} rad from a multiple of 90°"]
    said += more
    if robot.closure_residual > length:
        length, said = robot.closure_residual, ["what the closures leave open"]
    return Accuracy(length, angle, ", ".join(said))


def _placements(model: pin.Model) -> list[pin.SE3]:
    """Of all joints and frames, in the frames that the file has them in."""
    found = []
    for frame in list(model.frames)[1:]:
        place = frame.placement
        if frame.type == pin.FrameType.JOINT:
            place = model.jointPlacements[frame.parentJoint]
        found.append(model.frames[frame.parentFrame].placement.actInv(place))
    return found


def _square(angle: float) -> bool:
    return bool(abs(np.sin(2 * angle)) < 2 * SQUARE)


def _decimals(values: FloatArray) -> IntArray:
    """Decimals that each number has."""
    counts = np.arange(MOST_DECIMALS + 2)
    rounded = np.round(values[:, None] * 10.0**counts) / 10.0**counts
    ends = np.abs(rounded - values[:, None]) <= DIGITS_LEFT * np.maximum(np.abs(values), 1)[:, None]
    ends[:, -1] = True
    return np.asarray(ends.argmax(axis=1))


def _rounded_to(values: FloatArray, least: int, unit: str) -> tuple[float, list[str]]:
    """Half a unit of the last digit of numbers that are not round by design; 0 if all they can.

    Most of them have as many decimals, or as many significant digits: then the largest counts.
    """
    decimals = _decimals(values)
    values, decimals = values[decimals >= least], decimals[decimals >= least]
    if not len(values) or (usual := int(np.median(decimals))) > MOST_DECIMALS:
        return 0.0, []
    before = np.floor(np.log10(np.abs(values))).astype(int) + 1  # digits before the point
    digits = int(np.median(before + decimals))
    if (before + decimals == digits).sum() > (decimals == usual).sum():
        return 0.5 * 10.0 ** (before.max() - digits), [f"{digits} digits of {unit}"]
    return 0.5 * 10.0**-usual, [f"{usual} decimals of {unit}"]


def within_accuracy(robot: Robot, accuracy: Accuracy, generator: np.random.Generator) -> Robot:
    """The robot with other geometry that rounds to the same file."""
    model, places = robot.model.copy(), _placements(robot.model)
    for k, (frame, place) in enumerate(zip(list(model.frames)[1:], places, strict=True), start=1):
        shift, turn = generator.uniform(-1, 1, (2, 3))
        rpy = pin.rpy.matrixToRpy(place.rotation)
        rpy = rpy + accuracy.angle * turn * [not _square(x) for x in rpy]
        xyz = place.translation + accuracy.length * shift * (place.translation != 0)
        moved = model.frames[frame.parentFrame].placement * pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
        if frame.type == pin.FrameType.JOINT:
            model.jointPlacements[frame.parentJoint] = moved
        elif k in robot.closure_frames[0]:
            model.frames[k].placement = moved
    longer = accuracy.length * generator.uniform(-1, 1, len(robot.closures))
    closures = tuple(
        replace(closure, length=closure.length + more) if closure.length else closure
        for closure, more in zip(robot.closures, longer, strict=True)
    )
    return replace(robot, model=model, closures=closures)


# How far its loops may stay open.


def rounding_that_closes(gap: float, length: float) -> float:
    """The rounding, of one digit, by which loops may stay open by a gap in m."""
    needed = gap / (NEARLY * max(1.0, length))
    size = 10.0 ** np.floor(np.log10(needed))
    return float(f"{np.ceil(needed / size) * size:.0e}")


def largest_gap(rounding: float, length: float) -> float:
    """What loops of rounded numbers may stay open by, in m."""
    return NEARLY * rounding * max(1.0, length)
