"""Observations at random closed poses: what a robot's structure lets be known at all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from loopid.arguments import Count, FloatArray, checked, derived_seed, random_generator
from loopid.kinematics.loop_motion import closed_nearby, loop_motion
from loopid.kinematics.rounding import Accuracy, geometry_accuracy, within_accuracy
from loopid.kinematics.sampling import SamplingOptions, configuration_batches
from loopid.observation import Draws, Observation, StackedRows
from loopid.parameters import ParameterSet
from loopid.progress import Progress
from loopid.records import record
from loopid.regressors.joint_laws import joint_term
from loopid.regressors.joint_terms import JointTerms
from loopid.regressors.motion_regressors import motion_parameters, motion_regressor
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

LEAST_SAMPLES = 100
ROWS_PER_COLUMN = 4
MORE = 4  # times as many samples where a rank is not clear


@checked
def structural_observation(
    robot: Robot,
    model: str = "gravity",
    *,
    samples: Count | None = None,
    seed: int = 0,
    joint_terms: JointTerms | None = None,
    options: SamplingOptions | None = None,
    progress: Progress | None = None,
) -> Observation:
    """Observe a robot at seeded random closed poses, in motion where the columns ask for it.

    Its rows are forces of the independent coordinates. Those that decide rank and null space are
    its ``unit_motions``: forces along all motions of one size.

    Parameters
    ----------
    robot : Robot
    model : str
        ``"gravity"`` (mass and first moments, at rest) or ``"full"``.
    samples : int, optional
        Number of poses; by default enough for four rows a column.
    seed : int
    joint_terms : JointTerms, optional
        Drives, friction and offsets as further columns.
    options : SamplingOptions, optional
        How poses are sampled, as in ``random_configurations``.
    progress : callable, optional
        Called with the numbers of poses done and in all.

    Returns
    -------
    Observation
        The same to the bit with any number of BLAS threads. Where the motors leave coordinates
        free, what the motors alone sense is its ``motors_alone``.

    Raises
    ------
    OptionError, AssemblyError
        As ``random_configurations``.

    Examples
    --------
    >>> import loopid
    >>> loopid.regressors.structural_observation(loopid.load("five_bar"), samples=50).rows
    100
    """
    motions = _Motions(robot, model, joint_terms, options)
    return motions.observation((seed,), motions.enough if samples is None else samples, progress)


class _Batch(NamedTuple):
    """Some samples: poses (k, nq), drawn rates (2, k, nv) in unit steps, and weights (k,)."""

    q: FloatArray
    rates: FloatArray
    weights: FloatArray


@record
class _Motions:
    """A robot that is observed in random motions."""

    robot: Robot
    model: str
    joint_terms: JointTerms | None
    options: SamplingOptions | None

    @cached_property
    def parameters(self) -> ParameterSet:
        """Names of the columns."""
        return motion_parameters(self.robot, self.model, self.joint_terms)

    @property
    def driven(self) -> int:
        """Rows of motors; those of free coordinates follow."""
        return len(self.robot.independent) - len(self.robot.free)

    @property
    def gravity(self) -> float:
        """Its size, in m/s²."""
        return float(np.linalg.norm(self.robot.model.gravity.linear))

    @property
    def rate(self) -> float:
        """Rate of motions: of a fall over the characteristic length; 0 where no column moves."""
        moves = self.model != "gravity" or self.joint_terms is not None
        return float(np.sqrt((self.gravity or 1.0) / self.robot.length)) * moves

    @property
    def enough(self) -> int:
        """Samples for four rows a column, two of them of motors."""
        columns, rows = len(self.parameters), len(self.robot.independent)
        return max(
            LEAST_SAMPLES, -(-ROWS_PER_COLUMN * columns // rows), 2 * columns // max(self.driven, 1)
        )

    def observation(
        self, seeds: tuple[int, ...], samples: int, progress: Progress | None = None
    ) -> Observation:
        """What samples of each seed show."""
        robot, driven, done = self.robot, self.driven, 0
        part = driven if robot.free and driven else None
        forces, along = (StackedRows(self.parameters, part) for _ in range(2))
        kept, usual = list[_Batch](), 0.0
        with one_blas_thread():
            for seed in seeds:
                for q, rates in self.draws(seed, samples):
                    rows, directions, regularity = self.forces(robot, q, rates)
                    usual = usual or float(regularity.max())
                    # Rounding moves directions by about one over the regularity.
                    batch = _Batch(q, rates, np.minimum(regularity / usual, 1.0) ** 2)
                    along.add(batch.weights[:, None, None] * rows)
                    own = directions[:, robot.velocity_indices(robot.independent)]
                    # G = N R, with R the inverse of N's rows of the independent coordinates.
                    forces.add(np.asarray(np.linalg.solve(own.swapaxes(1, 2), rows), dtype=float))
                    if done < self.enough:
                        kept.append(batch)
                    done += len(q)
                    if progress is not None:
                        progress(done, samples * len(seeds))
        # Weight of 1 kg in N, or its moment at the robot's length in N m: the smaller one.
        found = forces.observation(
            length=robot.length, natural_size=self.gravity * min(1.0, robot.length)
        )
        units = along.observation(length=robot.length, natural_size=self.gravity * robot.length)
        drawn = self._completed(found, units, RandomDraws.of(self, seeds, samples, kept))
        if found.motors_alone is None or units.motors_alone is None:
            return drawn
        draws = RandomDraws.of(self, seeds, samples, kept, driven)
        alone = self._completed(found.motors_alone, units.motors_alone, draws)
        return replace(drawn, motors_alone=alone)

    def _completed(
        self, forces: Observation, units: Observation, draws: RandomDraws
    ) -> Observation:
        """Forces with what decides their rank, and with how that can be drawn again."""
        units = replace(units, draws=draws)
        return replace(forces, order=_order(self.robot), unit_motions=units)

    def draws(self, seed: int, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Poses and rates, a few at a time; what friction does near standstill is to be seen."""
        robot, generator = self.robot, random_generator(seed, stream=1)
        places = robot.draw_places(np.arange(robot.model.nv))
        slow = self._slow_rates()
        for q in configuration_batches(robot, samples, seed, options=self.options):
            rates = generator.uniform(-1.0, 1.0, (2, len(q), robot.model.nv))[:, :, places]
            for k, slower in enumerate(slow, 1):
                rates[0, k :: len(slow) + 1] *= slower
            yield q, rates

    def _slow_rates(self) -> list[float]:
        """Parts of the usual rate at which joint terms with a rate of their own show."""
        units = self.robot.coordinate_scales
        kinds_of = self.joint_terms.of_joints if self.joint_terms else {}
        slow = [
            min(1.0, 2 * joint_term(kind).at / (self.rate * units[index]))
            for joint, kinds in kinds_of.items()
            for index in self.robot.velocity_indices([joint])[:1]
            for kind in kinds
            if "~" in kind
        ]
        # In motion friction by direction is a constant force, too: at rest it is none.
        directed = any({"Fc+", "Fc-"} & {*kinds} for kinds in kinds_of.values())
        return [*slow, 0.0] if directed else slow

    def forces(
        self, robot: Robot, q: FloatArray, rates: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces N'Y (k, dof, n) along unit motions, N (k, nv, dof), and regularity (k,)."""
        motion, directions = loop_motion(robot, q, rates, self.rate)
        rows = motion_regressor(robot, motion, self.model, joint_terms=self.joint_terms)
        return rows, motion.projection.G, directions.regularity


@record
class RandomDraws(Draws):
    """Random motions of a robot, of its geometry or of one that rounds to the same file."""

    accuracy: float
    source: str
    motions: _Motions
    seeds: tuple[int, ...]
    samples: int  # of each seed
    batches: tuple[_Batch, ...] = field(compare=False, repr=False)  # some of them
    geometry: Accuracy
    first: int | None = None  # how many rows of each sample are seen, those of motors; None for all

    @classmethod
    def of(
        cls,
        motions: _Motions,
        seeds: tuple[int, ...],
        samples: int,
        batches: Iterable[_Batch],
        first: int | None = None,
    ) -> RandomDraws:
        """Those of a robot whose accuracy its file states."""
        geometry = geometry_accuracy(motions.robot)
        known = max(geometry.length, geometry.angle * motions.robot.length)
        drawn = motions, seeds, samples, tuple(batches)
        return cls(known, geometry.source, *drawn, geometry, first)

    def rounded(self, count: int, within: float | None = None) -> FloatArray:
        """Triangular factors (1 + count, n, n) of the robot, and of others within its accuracy.

        Lengths of the others may be ``within`` another one, in m, and angles accordingly.
        """
        own, geometry, found = self.motions.robot, self.geometry, []
        generator = random_generator(0)
        if within is not None:
            geometry = replace(geometry, length=within, angle=within / own.length)
        for other in (own, *(within_accuracy(own, geometry, generator) for _ in range(count))):
            stacked = StackedRows(self.motions.parameters)
            for q, rates, weights in self.batches:
                there = q if other is own else closed_nearby(own, other, q)
                rows, _, _ = self.motions.forces(other, there, rates)
                stacked.add(weights[:, None, None] * rows[:, : self.first])
            found.append(stacked.observation().factor)
        return np.stack(found)

    def more(self) -> Observation:
        """The observation with the samples of other seeds, too."""
        first, *_ = self.seeds
        seeds = first, *(derived_seed(first, k) for k in range(1, MORE))
        found = self.motions.observation(seeds, self.samples)
        if self.first is None or found.motors_alone is None:
            return found
        return found.motors_alone


def _order(robot: Robot) -> tuple[str, ...]:
    """Links of bodies, then coordinates, in an order that no name and no file decides."""
    ranks = robot.joint_ranks
    carriers = {body.link: robot.joints[body.joint_id - 1] for body in robot.bodies}
    links = sorted(carriers, key=lambda link: ranks[carriers[link]])
    coordinates = robot.coordinates_of(sorted(robot.joints, key=ranks.__getitem__))
    return tuple(dict.fromkeys((*robot.in_groups(links), *coordinates)))
