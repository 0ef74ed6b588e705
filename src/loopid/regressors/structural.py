"""Observations at random closed poses: what a robot's structure lets be known at all."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from loopid.arguments import FloatArray, checked, random_generator
from loopid.errors import AccuracyWarning
from loopid.kinematics.projection import closed_motion
from loopid.kinematics.rounding import Accuracy, geometry_accuracy, same_motion, within_accuracy
from loopid.kinematics.sampling import SamplingOptions, configuration_batches, random_motions
from loopid.observation import Observation, Rounding
from loopid.records import record
from loopid.regressors.closed_loop import gravity_regressor, motion_parameters, motion_regressor
from loopid.regressors.joint_laws import joint_term
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.mechanism import Mechanism
from loopid.workers import Progress, one_blas_thread

LEAST_SAMPLES = 100
ROWS_PER_COLUMN = 4
# Configurations (N, nq), independent velocities and accelerations (N, dof).
Motions = tuple[FloatArray, FloatArray, FloatArray]


@checked
def structural_observation(
    mechanism: Mechanism,
    model: str = "gravity",
    *,
    samples: int | None = None,
    seed: int = 0,
    joint_terms: JointTerms | None = None,
    options: SamplingOptions | None = None,
    progress: Progress | None = None,
) -> Observation:
    """Observe a mechanism at seeded random closed poses, in motion where the columns ask for it.

    Parameters
    ----------
    model : str
        ``"gravity"`` (mass and first moments, at rest) or ``"full"``.
    samples : int, optional
        Number of poses; by default enough for four rows a column.
    seed : int
    joint_terms : JointTerms, optional
        Drives, friction and offsets as further columns.
    options : SamplingOptions, optional
        How poses are drawn, as in ``random_configurations``.
    progress : callable, optional
        Called with the numbers of poses done and in all.

    Returns
    -------
    Observation
        The same to the bit with any number of BLAS threads. Where the motors leave coordinates
        free, what the motors alone feel is its ``motors_alone``.

    Raises
    ------
    OptionError, AssemblyError
        As ``random_configurations``.

    Examples
    --------
    >>> import loopid
    >>> loopid.structural_observation(loopid.load_mechanism("five_bar"), samples=50).rows
    100
    """
    parameters = motion_parameters(mechanism, model, joint_terms)
    driven = len(mechanism.independent) - len(mechanism.free)
    enough = -(-ROWS_PER_COLUMN * len(parameters) // len(mechanism.independent))
    enough = max(LEAST_SAMPLES, enough, 2 * len(parameters) // max(driven, 1))
    if samples is None:
        samples = enough
    generator, kept = random_generator(seed, stream=1), list[Motions]()

    def regressors() -> Iterator[FloatArray]:
        done = 0
        for q in configuration_batches(mechanism, samples, seed, options=options):
            rates = np.zeros((2, len(q), len(mechanism.independent)))
            if model == "gravity" and joint_terms is None:
                columns = gravity_regressor(mechanism, q)
            else:
                rates = _random_rates(mechanism, joint_terms, len(q), generator)
                motion = closed_motion(mechanism, q, *rates)
                columns = motion_regressor(mechanism, motion, model, joint_terms=joint_terms)
            if done < enough:
                kept.append((q, *rates))
            done += len(q)
            if progress is not None:
                progress(done, samples)
            yield columns

    # Weight of 1 kg in N, or its moment at the robot's length in N m: the smaller one.
    gravity = float(np.linalg.norm(mechanism.model.gravity.linear))
    natural = gravity * min(1.0, mechanism.length)
    with one_blas_thread(), warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)  # the draws keep a margin
        found = Observation.from_parts(
            regressors(),
            parameters,
            length=mechanism.length,
            natural_size=natural,
            driven=driven if mechanism.free and driven else None,
        )
    seen = _Seen(mechanism, model, joint_terms, tuple(kept), geometry_accuracy(mechanism))
    order, alone = _order(mechanism), found.motors_alone
    if alone is not None:
        alone = replace(alone, order=order, rounding=seen.rounding(driven))
    return replace(found, order=order, rounding=seen.rounding(None), motors_alone=alone)


def _order(mechanism: Mechanism) -> tuple[str, ...]:
    """Links of bodies, then coordinates, in an order that no name and no file decides."""
    ranks = mechanism.joint_ranks
    carriers = {body.link: mechanism.joints[body.joint_id - 1] for body in mechanism.bodies}
    links = sorted(carriers, key=lambda link: ranks[carriers[link]])
    coordinates = mechanism.coordinates_of(sorted(mechanism.joints, key=ranks.__getitem__))
    return tuple(dict.fromkeys((*mechanism.in_groups(links), *coordinates)))


def _random_rates(
    mechanism: Mechanism, terms: JointTerms | None, count: int, generator: np.random.Generator
) -> FloatArray:
    """Velocities and accelerations (2, count, dof), partly slow enough for friction to show.

    What a Stribeck or smooth friction does near standstill is to be seen.
    """
    rates = np.stack(random_motions(mechanism, count, generator))
    narrow = [
        (joint, joint_term(kind).at)
        for joint, kinds in (terms.of_joints if terms else {}).items()
        for kind in kinds
        if "~" in kind
    ]
    gravity = float(np.linalg.norm(mechanism.model.gravity.linear)) or 1.0
    for k, (joint, rate) in enumerate(narrow, 1):
        unit = mechanism.coordinate_scales[mechanism.velocity_indices([joint])[0]]
        usual = unit * np.sqrt(gravity / mechanism.length)
        rates[0, k :: len(narrow) + 1] *= min(1.0, 2 * rate / usual)
    return rates


@record
class _Seen:
    """A robot as it was observed, so that others can be observed in the same motions."""

    mechanism: Mechanism
    model: str
    joint_terms: JointTerms | None
    motions: tuple[Motions, ...]
    accuracy: Accuracy

    def rounding(self, driven: int | None) -> Rounding:
        """What the robot file's numbers leave open in the first ``driven`` rows, or in all."""
        known_to = max(self.accuracy.length, self.accuracy.angle * self.mechanism.length)
        return Rounding(known_to, self.accuracy.source, partial(self.factors, driven))

    def factors(self, driven: int | None, count: int, within: float | None = None) -> FloatArray:
        """Triangular factors (1 + count, n, n) of the robot, and of others within its accuracy.

        Lengths of the others may be ``within`` another accuracy, in m, and angles accordingly.
        """
        own, accuracy, generator = self.mechanism, self.accuracy, random_generator(0)
        if within is not None:
            accuracy = replace(accuracy, length=within, angle=within / own.length)
        parameters, found = motion_parameters(own, self.model, self.joint_terms), []
        regressor = partial(motion_regressor, model=self.model, joint_terms=self.joint_terms)
        for other in (own, *(within_accuracy(own, accuracy, generator) for _ in range(count))):
            moved = (same_motion(own, other, *batch) for batch in self.motions)
            rows = (regressor(other, one)[:, :driven] for one in moved)
            found.append(Observation.from_parts(rows, parameters).factor)
        return np.stack(found)
