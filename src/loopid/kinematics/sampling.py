"""Seeded random closed configurations, inside the limits and away from singularities."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from loopid.arrays import BoolArray, FloatArray
from loopid.errors import AssemblyError, OptionError
from loopid.kinematics.assembly import try_assemble
from loopid.kinematics.projection import partition, singularity_measure
from loopid.mechanism import Mechanism
from loopid.seeds import random_generator

DEFAULT_MARGIN = 0.02
ATTEMPTS_PER_SAMPLE = 200
BATCH = 64  # draws assembled together
UNLIMITED = 1e3  # turns, or characteristic lengths, beyond which a limit is none


def random_configurations(
    mechanism: Mechanism, count: int, seed: int = 0, margin: float = DEFAULT_MARGIN
) -> FloatArray:
    """Draw closed configurations on the reference's branch.

    Actuated coordinates are uniform within their limits (one turn, or one characteristic length,
    around the reference where there are none); draws that cannot be assembled, break a limit of
    a passive joint or come too near a singularity are left out.

    Parameters
    ----------
    count : int
    seed : int
        Same seed, same configurations; a larger count only adds more.
    margin : float
        Least singularity measure, see ``Projection.singularity``.

    Returns
    -------
    FloatArray
        (count, nq).

    Raises
    ------
    AssemblyError
        When hardly any draw passes.
    """
    return np.concatenate(list(configuration_batches(mechanism, count, seed, margin)))


def configuration_batches(
    mechanism: Mechanism, count: int, seed: int = 0, margin: float = DEFAULT_MARGIN
) -> Iterator[FloatArray]:
    """Yield the rows of ``random_configurations`` a few at a time."""
    if count < 1 or not margin >= 0:
        raise OptionError(f"samples must be positive and margin >= 0, not {count} and {margin}")
    generator = random_generator(seed)
    lower, upper = _actuated_limits(mechanism)
    found = drawn = 0
    while found < count:
        if drawn > ATTEMPTS_PER_SAMPLE * (found + BATCH):
            raise AssemblyError(
                f"only {found} of {drawn} random draws of {mechanism.name} close with a "
                f"singularity measure of at least {margin:g}: lower the margin or check the limits"
            )
        values = generator.uniform(lower, upper, size=(BATCH, len(lower)))
        assembly = try_assemble(mechanism, values)
        q = assembly.configurations[assembly.assembled]
        q = q[_admissible(mechanism, q, margin)][: count - found]
        found, drawn = found + len(q), drawn + BATCH
        if len(q):
            yield q


def random_motions(
    mechanism: Mechanism, count: int, seed: int | np.random.Generator = 0
) -> tuple[FloatArray, FloatArray]:
    """Draw independent velocities and accelerations (count, dof) each.

    They are uniform and as large as a fall over the characteristic length would make them, so
    that inertial and gravity forces have one order of magnitude.
    """
    generator = seed if isinstance(seed, np.random.Generator) else random_generator(seed)
    independent, _ = partition(mechanism)
    unit = np.ones(len(independent))
    unit[np.isin(independent, mechanism.prismatic)] = mechanism.length
    gravity = float(np.linalg.norm(mechanism.model.gravity.linear)) or 1.0
    rate = np.sqrt(gravity / mechanism.length)
    velocity, acceleration = generator.uniform(-1.0, 1.0, size=(2, count, len(unit)))
    return velocity * unit * rate, acceleration * unit * rate**2


def _actuated_limits(mechanism: Mechanism) -> tuple[FloatArray, FloatArray]:
    lower, upper = [], []
    for name in mechanism.actuated:
        joint = mechanism.joint(name)
        if joint.nv != 1:
            raise OptionError(
                f"joint {name} has {joint.nv} coordinates: only single ones are drawn"
            )
        low, high = mechanism.limits(name)
        prismatic = joint.idx_v in mechanism.prismatic
        width = mechanism.length if prismatic else np.pi
        centre = mechanism.reference[joint.idx_q] if joint.nq == 1 else 0.0
        lower.append(low if abs(low) < UNLIMITED * width else centre - width)
        upper.append(high if abs(high) < UNLIMITED * width else centre + width)
    return np.array(lower), np.array(upper)


def _admissible(mechanism: Mechanism, q: FloatArray, margin: float) -> BoolArray:
    model = mechanism.model
    below, above = q < model.lowerPositionLimit - 1e-9, q > model.upperPositionLimit + 1e-9
    inside = ~(below | above).any(axis=1)
    return np.asarray(inside & (singularity_measure(mechanism, q) >= margin), dtype=bool)
