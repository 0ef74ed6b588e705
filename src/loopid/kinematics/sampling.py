"""Seeded random closed configurations, inside the limits and away from singularities."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from loopid.arguments import (
    FloatArray,
    checked,
    frozen,
    random_generator,
    require_count,
)
from loopid.errors import (
    AssemblyError,
    OptionError,
)
from loopid.kinematics.assembly import (
    CLOSURE_TOLERANCE,
    MeasuredCoordinates,
    PathOptions,
    follow_paths,
    measured_coordinates,
)
from loopid.kinematics.closing import (
    displaced,
    nearby_configurations,
)
from loopid.kinematics.projection import (
    NEAR_SINGULARITY,
    partition,
    singularity_measure,
)
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

DEFAULT_MARGIN = 0.02
LEAST_MARGIN = 1e-4
ATTEMPTS_PER_SAMPLE = 200
FEW = 0.5  # part of a batch that closes, below which the next keeps nearer to the reference ...
NARROWER = 0.5  # ... by this factor ...
MANY_LOOPS = 8  # from which on draws begin nearer
LEAST_SPREAD = 0.05  # ... down to this fraction of the limits
BATCH = 64  # draws between which the spread adapts
# Another draw is cheaper than more steps; poses near by need fewer.
SHORTEST_STEP, MOST_STEPS, LEAST_STEPS = 2.0**-6, 32, 8
MOST_KEPT = 512  # samples that a mechanism keeps: most work draws the same ones again
UNLIMITED = 1e3  # turns, or characteristic lengths, beyond which a limit is none
PART_LENGTH = 0.3  # characteristic lengths that a floating base moves


@checked
def random_configurations(
    mechanism: Mechanism, count: int, seed: int = 0, margin: float | None = None
) -> FloatArray:
    """Draw closed configurations on the reference's branch.

    Independent joints are uniform within their limits (one turn, or one characteristic length,
    around the reference where there are none); draws that cannot be assembled, break a limit of
    a passive joint or come too near a singularity are left out. Where most draws fail, the next
    ones keep nearer to the reference. Spins of rods and floating bases are anywhere.

    Parameters
    ----------
    count : int
    seed : int
        Same seed, same configurations; a larger count only adds more.
    margin : float, optional
        Least singularity measure, see ``Projection.singularity``; by default that of the robot's
        file, else 0.02, or less where the geometry hardly allows it, but not below
        ``LEAST_MARGIN``.

    Returns
    -------
    FloatArray
        (count, nq).

    Raises
    ------
    AssemblyError
        When hardly any draw passes.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load_mechanism("five_bar")
    >>> loopid.random_configurations(robot, 10, seed=1).shape
    (10, 4)
    """
    require_count(count, "count")
    return np.concatenate(list(configuration_batches(mechanism, count, seed, margin)))


def configuration_batches(
    mechanism: Mechanism,
    count: int,
    seed: int = 0,
    margin: float | None = None,
    spread: float = 1.0,
) -> Iterator[FloatArray]:
    """Yield the rows of ``random_configurations`` a few at a time.

    They are from a part ``spread`` of the limits around the reference, or less.
    """
    require_count(count, "samples")
    if not (margin is None or 0 <= margin < 1):
        raise OptionError(f"margin must be a singularity measure from 0 to 1, not {margin}")
    margin = mechanism.margin if margin is None else margin
    kept = mechanism.drawn.get((seed, margin, spread), ())
    enough = sum(map(len, kept)) >= count
    batches, found = list[FloatArray](), 0
    for batch in kept if enough else _drawn(mechanism, seed, margin, spread):
        if count <= MOST_KEPT:
            batches.append(frozen(batch))
        yield batch[: count - found]
        found += len(batch)
        if found >= count:
            break
    if batches and not enough:
        mechanism.drawn[seed, margin, spread] = tuple(batches)


def _drawn(
    mechanism: Mechanism, seed: int, margin: float | None, spread: float
) -> Iterator[FloatArray]:
    """Yield closed configurations without end."""
    generator, mechanism = random_generator(seed), _with_regular_reference(mechanism)
    measured = measured_coordinates(mechanism)
    home, lower, upper = _ranges(measured)
    places = mechanism.draw_places(mechanism.velocity_indices(mechanism.measured))
    start = np.repeat(mechanism.reference[None], BATCH, axis=0)
    paths = PathOptions(
        shortest_step=SHORTEST_STEP, most_steps=max(MOST_STEPS * spread, LEAST_STEPS)
    )
    # Of many loops that move on their own one fails in nearly every draw from anywhere.
    spread = min(spread, MANY_LOOPS / max(len(mechanism.loops), 1))
    # Where the reference hardly keeps the usual margin, poses around it do not.
    own = float(singularity_measure(mechanism, mechanism.reference[None])[0])
    least = max(LEAST_MARGIN, min(DEFAULT_MARGIN, 0.5 * own)) if margin is None else margin
    drawn, found, broken = 0, 0, np.zeros(mechanism.model.nq)
    while True:
        if drawn > ATTEMPTS_PER_SAMPLE * (found + BATCH):
            raise AssemblyError(_too_few(mechanism, found, drawn, least, broken))
        part = generator.uniform(size=(BATCH, len(home)))[:, places]
        values = home + spread * (lower + part * (upper - lower) - home)
        with one_blas_thread():
            outcome = follow_paths(measured, start, values, paths)
        q = _completed(mechanism, outcome.configurations[outcome.assembled], generator)
        outside = mechanism.outside(q)
        q, broken = q[~outside.any(axis=1)], broken + outside.sum(axis=0)
        regular = q[singularity_measure(mechanism, q) >= least]
        if len(q) < FEW * BATCH:  # draw nearer
            spread = max(NARROWER * spread, LEAST_SPREAD)
        if len(regular) < FEW * len(q) and margin is None:  # accept less
            least = max(0.5 * least, LEAST_MARGIN)
        found, drawn = found + len(regular), drawn + BATCH
        if len(regular):
            yield regular


def _ranges(measured: MeasuredCoordinates) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Reference values of the measured joints, and the limits between which they are drawn."""
    mechanism = measured.mechanism
    home = measured.read(mechanism.reference[None])[0]
    joints = [mechanism.joint(name) for name in mechanism.measured]
    sliding = np.isin([joint.idx_v for joint in joints], mechanism.prismatic)
    width = np.where(sliding, mechanism.length, np.pi)
    limits = np.array([mechanism.limits(name) for name in mechanism.measured]).reshape(-1, 2)
    limited = np.abs(limits) < UNLIMITED * width[:, None]
    lower = np.where(limited[:, 0], limits[:, 0], home - width)
    upper = np.where(limited[:, 1], limits[:, 1], home + width)
    return home, lower, upper


def _with_regular_reference(mechanism: Mechanism) -> Mechanism:
    """The mechanism with another reference, close by, where its own one is singular."""
    if singularity_measure(mechanism, mechanism.reference[None])[0] >= NEAR_SINGULARITY:
        return mechanism
    around = nearby_configurations(mechanism, mechanism.reference)
    best = int(singularity_measure(mechanism, around).argmax())
    return replace(mechanism, reference=around[best])


def _too_few(
    mechanism: Mechanism, found: int, drawn: int, margin: float, broken: FloatArray
) -> str:
    worst = next(
        (n for n in mechanism.joints if mechanism.joint(n).idx_q == int(broken.argmax())), ""
    )
    limits = f" ({worst} broke them {int(broken.max())} times)" if broken.any() else ""
    return (
        f"only {found} of {drawn} random draws of {mechanism.name} close with a singularity "
        f"measure of at least {margin:g}: lower the margin or check the limits{limits}"
    )


def _completed(mechanism: Mechanism, q: FloatArray, generator: np.random.Generator) -> FloatArray:
    """Closed configurations inside the limits, with the parts that are held at random."""
    q = q[~mechanism.outside(q).any(axis=1)]
    if not mechanism.held:
        return q
    chosen, _ = partition(mechanism)
    parts = np.isin(mechanism.independent, mechanism.held)
    units = np.where(np.isin(chosen, mechanism.prismatic), PART_LENGTH * mechanism.length, np.pi)
    steps = generator.uniform(-1.0, 1.0, size=(len(q), len(chosen)))
    steps = steps[:, mechanism.draw_places(chosen)] * units * parts
    q, residual = displaced(mechanism, q, steps)
    return q[residual <= max(CLOSURE_TOLERANCE, 2.0 * mechanism.closure_residual)]


@checked
def random_motions(
    mechanism: Mechanism, count: int, seed: int | np.random.Generator = 0
) -> tuple[FloatArray, FloatArray]:
    """Draw independent velocities and accelerations (count, dof) each.

    They are uniform and as large as a fall over the characteristic length would make them, so
    that inertial and gravity forces have one order of magnitude.
    """
    if count < 0:
        raise OptionError(f"count must be a number of samples from 0 on, not {count}")
    require_count(count, "count")
    generator = seed if isinstance(seed, np.random.Generator) else random_generator(seed)
    independent, _ = partition(mechanism)
    unit = np.ones(len(independent))
    unit[np.isin(independent, mechanism.prismatic)] = mechanism.length
    gravity = float(np.linalg.norm(mechanism.model.gravity.linear)) or 1.0
    rate = np.sqrt(gravity / mechanism.length)
    drawn = generator.uniform(-1.0, 1.0, size=(2, count, len(unit)))
    velocity, acceleration = drawn.take(mechanism.draw_places(independent), axis=2)
    return velocity * unit * rate, acceleration * unit * rate**2
