"""Closing the loops at the reference configuration."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterator
from dataclasses import replace

import numpy as np

from loopid.arrays import FloatArray, IntArray
from loopid.errors import ReferenceWarning, RobotFileError
from loopid.kinematics.assembly import CLOSURE_TOLERANCE
from loopid.kinematics.frames import integrate
from loopid.kinematics.linear import Factorisation
from loopid.kinematics.measured import scaled_constraint
from loopid.kinematics.projection import NEAR_SINGULARITY, partition, singularity_measure
from loopid.kinematics.scaling import coordinate_scales
from loopid.loading.reference import write_joint
from loopid.mechanism import Mechanism
from loopid.seeds import random_generator

STARTS = 60  # for joints that the file leaves out
LIMIT_TOLERANCE = 1e-6  # rad or m
GAUSS_NEWTON_STEPS = 100
LONGEST_STEP = 0.3  # rad or characteristic lengths


def close_reference(mechanism: Mechanism, given: Collection[str]) -> Mechanism:
    """The mechanism with its loops closed at the reference.

    Motors stay and passive joints move. Of joints that the file leaves out, motors among them,
    several seeded starts are tried, for a regular configuration inside the limits.

    Raises
    ------
    RobotFileError
        With the residual that is left and the closure that stays open most.

    Warns
    -----
    ReferenceWarning
        When the closed configuration is outside the limits of a joint.
    """
    closed = [q for q in _attempts(mechanism, given) if _gap(mechanism, q) <= CLOSURE_TOLERANCE]
    if not closed:
        raise RobotFileError(_open_loops(mechanism, given))
    best = closed[-1] if _suits(mechanism, closed[-1]) else closed[0]
    outside = _outside(mechanism, best)
    if outside:
        warnings.warn(f"{mechanism.path}: the reference is {outside}", ReferenceWarning, 4)
    return replace(mechanism, reference=best)


def _attempts(mechanism: Mechanism, given: Collection[str]) -> Iterator[FloatArray]:
    """Configurations with closed loops, as far as they close, until one suits."""
    left_out = [joint for joint in mechanism.joints if joint not in given]
    _, passive = partition(mechanism)
    generator = random_generator(0)
    for start in range(STARTS if left_out and mechanism.closures else 1):
        q = mechanism.reference.copy()
        if start > 0:
            _scatter(mechanism, q, left_out, generator)
        q = _gauss_newton(mechanism, q, passive)
        yield q
        if _suits(mechanism, q):
            return


def _scatter(
    mechanism: Mechanism, q: FloatArray, joints: list[str], generator: np.random.Generator
) -> None:
    """Put joints anywhere within their limits, or within a turn."""
    for name in joints:
        joint = mechanism.joint(name)
        if joint.nv != 1:
            continue
        lower, upper = mechanism.limits(name)
        low, high = max(lower, -np.pi), min(upper, np.pi)
        if low <= high:
            write_joint(joint, q, generator.uniform(low, high))


def _suits(mechanism: Mechanism, q: FloatArray) -> bool:
    """Whether a configuration is closed, inside the limits and regular for the motors."""
    if _gap(mechanism, q) > CLOSURE_TOLERANCE or _outside(mechanism, q):
        return False
    return float(singularity_measure(mechanism, q[None])[0]) >= NEAR_SINGULARITY


def _gap(mechanism: Mechanism, q: FloatArray) -> float:
    return float(np.abs(scaled_constraint(mechanism, q[None])[0]).max(initial=0.0))


def _outside(mechanism: Mechanism, q: FloatArray) -> str:
    """The first joint outside its limits, in words; nothing where there is none."""
    for name in mechanism.joints:
        joint, (low, high) = mechanism.joint(name), mechanism.limits(name)
        if joint.nq != 1:
            continue
        if not low - LIMIT_TOLERANCE <= q[joint.idx_q] <= high + LIMIT_TOLERANCE:
            limits = f"{low:.4g} ... {high:.4g}"
            return f"outside the limits of joint {name}: {q[joint.idx_q]:.4g} is not in {limits}"
    return ""


def _open_loops(mechanism: Mechanism, given: Collection[str]) -> str:
    first = next(_attempts(mechanism, given))
    residual = np.abs(scaled_constraint(mechanism, first[None])[0][0])
    names = [closure.name for closure in mechanism.closures for _ in range(closure.rows)]
    origin = "the reference cannot be closed" if given else "no closed configuration was found"
    hint = "" if given else ", give one as 'reference'"
    return (
        f"{mechanism.path}: {origin}: closure {names[int(residual.argmax())]} stays open by "
        f"{residual.max():.1e} m (tolerance {CLOSURE_TOLERANCE:g} m){hint}"
    )


def _gauss_newton(mechanism: Mechanism, q: FloatArray, movable: IntArray) -> FloatArray:
    """Shrink the residual by steps of limited length of the movable coordinates."""
    scales = coordinate_scales(mechanism)[movable]
    for _ in range(GAUSS_NEWTON_STEPS):
        residual, jacobian = scaled_constraint(mechanism, q[None])
        factors = Factorisation.of(jacobian[:, :, movable])
        step = -factors.solve(residual[:, :, None])[0, :, 0]
        longest = np.abs(step).max(initial=0.0)
        tangent = np.zeros(mechanism.model.nv)
        tangent[movable] = scales * step * min(1.0, LONGEST_STEP / max(longest, 1e-300))
        q = integrate(mechanism, q[None], tangent[None])[0]
        if longest < 1e-15:
            break
    return q
