"""Identifiability from a log, of parameters that the structure makes identifiable.

A combination of base parameters is *unidentifiable* from a log where no force of the log depends on
it. It is *weakly identifiable* where its standard error is above its size in the robot file. With D
the sizes of the standard parameters (``body_sizes``) and Φ_base = M Φ, base parameters are φ = L x
with L Lᵀ = M D² Mᵀ. Forces count in parts of what each motor gave. The singular values of the
regressor W L are then effects: what a change of one size along each direction does to the forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray, IntArray, checked
from loopid.base_parameters.base import expression
from loopid.errors import DataError, RankError, counted
from loopid.findings import Finding, WithFindings
from loopid.identification.estimator import LEAST_EXCITATION, Estimator, excited_rank
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_models import ForceModel, samples_of
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.quality import fit_quality
from loopid.identification.result import Fit
from loopid.logs.recording import Recording
from loopid.parameters import KINDS, ParameterSet
from loopid.records import record
from loopid.robot.robot import Robot
from loopid.workers import one_blas_thread

# Part of a parameter's size that must be unidentifiable for its value to rest on the robot file.
INVOLVED = 1e-3
# Part of its effect in random states below which a joint term counts as not moved at all.
HARDLY_MOVED = 1e-3
# Relative difference of norms that are the same but for round-off: the first one is taken.
TIE = 1e-6
# Of the mean mass and of the characteristic length: bodies count as at least so heavy and large.
LEAST_MASS, LEAST_REACH = 0.01, 0.01


def body_sizes(robot: Robot, model: str) -> FloatArray:
    """Sizes (p,) of the standard parameters of the bodies by the robot file, all positive.

    They are m, m ℓ and m ℓ² for a body of mass m, which is ℓ from its link's origin in the root
    mean square. Uncertainties are compared with them.
    """
    values = robot.standard_parameters("full").reshape(-1, len(KINDS))
    mass = np.abs(values[:, 0])
    mass = np.maximum(mass, LEAST_MASS * (mass.mean() or 1.0))
    traces = values[:, [KINDS.index(kind) for kind in ("Ixx", "Iyy", "Izz")]].sum(axis=1)
    length = np.sqrt(np.maximum(traces / (2 * mass), (LEAST_REACH * robot.length) ** 2))
    powers = robot.parameters(model).length_powers.reshape(len(values), -1)
    return np.asarray((mass[:, None] * length[:, None] ** powers).ravel(), dtype=np.float64)


def joint_sizes(force_model: ForceModel, problem: FitProblem) -> FloatArray:
    """Sizes (k,) of all joint terms: each alone would make all of the force of some data."""
    return _weighed(force_model, problem)[-1]


def _weighed(
    force_model: ForceModel, problem: FitProblem
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Weights (dof,); factor (n, n) and random rows (N, p) by them; sizes (k,) of terms."""
    base, columns = force_model.base, force_model.columns_of(problem.parameters)
    prior, random = force_model.standard_prior, force_model.random_regressor
    n, bodies = len(columns), len(prior) - len(force_model.joint_values)
    usual = (random[:, :, :bodies] @ prior[:bodies]) ** 2
    squares = problem.force_squares() / np.maximum(problem.samples, 1)
    force = np.sqrt(np.where(squares > 0, squares, usual.mean(axis=0)))
    weights = 1.0 / np.where(force > 0, force, 1.0)
    K = (weights[:, None] * random).reshape(-1, random.shape[2])
    R = problem.weighted(weights)[:n, :n] / np.sqrt(max(problem.rows, 1))
    # A joint term has its effect in the data, or that in random states if they hardly move it.
    effect, leading = np.sqrt((K**2).mean(axis=0)), base.base[columns]
    effect[base.base] *= HARDLY_MOVED
    effect[leading] = np.maximum(effect[leading], np.linalg.norm(R, axis=0))
    joints = effect[bodies:]
    return weights, R, K, 1.0 / np.where(joints > 0, joints, 1.0)


@record(checked="outside")
class Excitation:
    """SVD of the scaled regressor of n parameters.

    Attributes
    ----------
    weights : FloatArray
        (dof,), one over the rms force of each motor.
    factor : FloatArray
        (n, n), triangular L of φ = L x.
    effects : FloatArray
        (n,), descending: rms effect on the forces of a change of one size along each direction.
    directions : FloatArray
        (n, n), columns are the directions x, orthonormal.
    structural : FloatArray
        (n,), effects in random states of the robot, descending.
    rank : int
        Directions that the data excite, by the limit that a fit is refused by.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.identify(loopid.load("five_bar"), "urdf/logs/five_bar.csv")
    >>> excitation = found.identifiability.excitation
    >>> excitation.rank, excitation.directions.shape
    (17, (17, 17))
    """

    weights: FloatArray
    factor: FloatArray
    effects: FloatArray
    directions: FloatArray
    structural: FloatArray
    rank: int

    @classmethod
    def of(cls, force_model: ForceModel, problem: FitProblem) -> Excitation:
        """Of a fit problem of some or all parameters of a force model."""
        base, columns = force_model.base, force_model.columns_of(problem.parameters)
        sizes = body_sizes(force_model.robot, force_model.model)
        weights, R, K, joints = _weighed(force_model, problem)
        with one_blas_thread():
            scaled = base.matrix[columns] * np.concatenate([sizes, joints])
            L = np.asarray(np.linalg.qr(scaled.T, mode="r")).T
            _, effects, right = np.linalg.svd(R @ L)
            leading = K[:, base.base[columns]]
            structural = np.linalg.svd(leading @ L, compute_uv=False) / np.sqrt(len(K))
            usual = np.sqrt((leading**2).mean(axis=0))
            rank = excited_rank(R, usual)
        return cls(weights, L, effects, right.T, structural, rank)

    @property
    def sizes(self) -> FloatArray:
        """Sizes (n,) of the parameters."""
        return np.asarray(np.linalg.norm(self.factor, axis=1))

    @property
    def excited(self) -> FloatArray:
        """Changes (n, rank) of the parameters, one size each, that the data excite."""
        return np.asarray(self.factor @ self.directions[:, : self.rank])

    @property
    def unidentifiable(self) -> FloatArray:
        """Changes (n, n - rank), one size each, that no force of the data depends on."""
        return np.asarray(self.factor @ self.directions[:, self.rank :])

    @property
    def held(self) -> IntArray:
        """As many parameters as are unidentifiable, (n - rank,); the others alone are excited.

        Those with most of their size in what is unidentifiable, by pivoting; ties go to the first.
        """
        rows, held = self.unidentifiable / self.sizes[:, None], []
        for _ in range(rows.shape[1]):
            left = np.linalg.norm(rows, axis=1)
            lead = int(np.argmax(left >= (1 - TIE) * left.max()))
            unit = rows[lead] / left[lead]
            rows = rows - np.outer(rows @ unit, unit)
            held.append(lead)
        return np.sort(np.array(held, dtype=np.int64))

    def assumed(self, parameters: ParameterSet) -> tuple[str, ...]:
        """Names of the n parameters that the data do not determine: part is unidentifiable."""
        part = np.linalg.norm(self.unidentifiable, axis=1) / self.sizes
        return tuple(parameters.names[j] for j in np.flatnonzero(part > INVOLVED))


def excited_samples(samples: FitSamples, prior: FloatArray, excitation: Excitation) -> FitSamples:
    """Samples of z in φ = φ₀ + B z: changes of the prior (n,) along what the data excite."""
    return samples.less(samples.predicted(prior)).along(excitation.excited)


def _excited(
    samples: FitSamples, prior: FloatArray, excitation: Excitation, fit: Callable[[FitSamples], Fit]
) -> tuple[Fit, Excitation]:
    """A fit of what the data excite, without the least excited directions until there is one.

    A motor of few rows that is fitted without error counts for so much that others are lost.
    """
    while True:
        try:
            return fit(excited_samples(samples, prior, excitation)), excitation
        except (DataError, RankError):
            if excitation.rank <= 1:
                raise
            excitation = replace(excitation, rank=excitation.rank - 1)


def fit_excited(
    samples: FitSamples,
    prior: FloatArray,
    excitation: Excitation,
    *,
    estimator: str | Estimator = "wls",
) -> Fit:
    """Fit what the data excite; of all parameters that fit as well, those nearest to the prior.

    This is the limit of Bayes' estimate for a prior (n,) that is ever less certain, in sizes. In
    unidentifiable directions the covariance is that of the robot file, one size. Parameters that
    have a part there are ``assumed``.
    """
    found, excitation = _excited(
        samples, prior, excitation, lambda part: quiet_fit(part, estimator)
    )
    B, U = excitation.excited, excitation.unidentifiable
    values, covariance = prior + B @ found.values, B @ found.covariance @ B.T + U @ U.T
    return replace(
        found,
        parameters=samples.parameters,
        values=values,
        covariance=(covariance + covariance.T) / 2,
        # Each value is a sum of what is excited, whose least sure deviation counts for all.
        degrees_of_freedom=np.full(len(values), found.degrees_of_freedom.min(initial=np.inf)),
        quality=fit_quality(samples.problem, values),
        assumed=excitation.assumed(samples.parameters),
    )


def determined_values(
    samples: FitSamples, prior: FloatArray, excitation: Excitation, estimator: Estimator
) -> FloatArray:
    """Values (n,) of ``fit_excited`` without uncertainty; the prior where they are undetermined."""
    try:
        found, excitation = _excited(
            samples, prior, excitation, lambda part: estimator.fit_samples(part).result
        )
    except (DataError, RankError):
        return np.array(prior)
    return np.asarray(prior + excitation.excited @ found.values)


# Standard error, in sizes by the robot file, above which a combination is weakly identifiable.
WEAK = 1.0
# Coefficients below this part of the largest, in sizes, are none in an unidentifiable
# combination, or not worth naming in a weak one, of which at most this many terms are named.
NEGLIGIBLE, MINOR, MOST_TERMS = 1e-6, 0.1, 4
# Combinations that a message names.
NAMED = 3


@record
class WeakDirection:
    """A change of parameters that is unidentifiable from a log, or weakly identifiable."""

    parameters: ParameterSet  # all n
    # (n,), one size by the robot file: parameters that change by this, up or down, change the
    # forces of the log hardly, or not at all
    change: FloatArray
    # The main parameters in it and their coefficients, that of the first is 1
    terms: dict[str, float]
    # On the forces of the log, in parts of the motors' forces, in the root mean square
    effect: float
    standard_error: float  # in sizes by the robot file; infinite for an unidentifiable one

    def __repr__(self) -> str:
        return f"WeakDirection({self.said})"

    @property
    def unidentifiable(self) -> bool:
        """Whether no force of the log depends on it."""
        return bool(np.isinf(self.standard_error))

    @property
    def text(self) -> str:
        """The main terms as a sum; dots stand for the others."""
        others = np.count_nonzero(self.change) > len(self.terms)
        return expression(self.terms) + (" + ..." if others else "")

    @property
    def said(self) -> str:
        """The sum and its standard error."""
        error = f" ± {self.standard_error:.2g} times the file's" if not self.unidentifiable else ""
        return self.text + error


@record
class Identifiability(WithFindings):
    """Identifiability of the base parameters from a log."""

    parameters: ParameterSet  # the n base parameters, all of which are structurally identifiable
    excitation: Excitation  # the singular spectra, of the structure and of the log
    # (rank,), of the combinations that the log excites, in sizes by the robot file, ascending; NaN
    # where the log has no more rows than them
    standard_errors: FloatArray
    # Combinations that span what no force of the log depends on, each led by a parameter that is in
    # no other one
    unidentifiable: tuple[WeakDirection, ...]
    weak: tuple[WeakDirection, ...]  # weakly identifiable combinations, the least known first

    def __repr__(self) -> str:
        head = (
            f"Identifiability({self.structural_rank} base parameters, {self.rank} combinations "
            f"excited by the data, {self.well_determined} better known than by the robot file)"
        )
        kinds = {"unidentifiable": self.unidentifiable, "weak": self.weak}
        lines = [f"  {kind}: {each.said}" for kind, all_ in kinds.items() for each in all_[:NAMED]]
        more = len(self.unidentifiable) + len(self.weak) - len(lines)
        return "\n".join([head, *lines, *([f"  and {more} more"] if more else [])])

    @property
    def structural_rank(self) -> int:
        """How many combinations can be identified at all."""
        return len(self.parameters)

    @property
    def rank(self) -> int:
        """How many of them the log excites."""
        return self.excitation.rank

    @property
    def well_determined(self) -> int:
        """How many combinations the log determines better than the robot file [MacKay1992]."""
        return int((self.standard_errors <= WEAK).sum())

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the parameters that no data determine: part of them is unidentifiable."""
        return self.excitation.assumed(self.parameters)

    @property
    def leads(self) -> tuple[str, ...]:
        """Names that lead what is unidentifiable or weak: parameters that a motion should excite.

        ``design_motion(model, parameters=leads, after=recordings)`` finds such a motion.
        """
        both = (*self.unidentifiable, *self.weak)
        return tuple(dict.fromkeys(next(iter(each.terms)) for each in both))

    @property
    def unidentifiable_message(self) -> str:
        """Which combinations are unidentifiable, and what excites them."""
        effects = self.excitation.effects
        return (
            f"{len(self.unidentifiable)} of {len(self.parameters)} combinations of parameters are "
            f"unidentifiable from the data: {_listed(self.unidentifiable)}; relative effect on the "
            f"forces {effects[-1] / (effects[0] or 1.0):.1e} (singular values must be above "
            f"{LEAST_EXCITATION:g} of the largest)"
        )

    @property
    def weak_message(self) -> str:
        """Which combinations are weakly identifiable, with their standard errors."""
        return (
            f"{len(self.weak)} of {len(self.parameters)} combinations of parameters are weakly "
            f"identifiable, known worse than by the robot file: {_listed(self.weak)}; the "
            "consistent fit keeps them near the robot file"
        )

    @property
    def refusal(self) -> RankError:
        """Why a fit of all parameters is refused, and what to do."""
        return RankError(
            f"{self.unidentifiable_message}; {self._advice}, or keep the robot file's values "
            "there, unidentifiable='prior'",
            unidentifiable=tuple(each.text for each in self.unidentifiable),
            leads=self.leads,
            tolerance=LEAST_EXCITATION,
        )

    @property
    def _advice(self) -> str:
        return f"excite the least known: design_motion with parameters={list(self.leads[:NAMED])}"

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is unidentifiable, and what is weak."""
        said, do = [], self._advice
        if self.unidentifiable:
            title = counted(len(self.unidentifiable), "unidentifiable combination")
            said.append(Finding("warning", title, self.unidentifiable_message, do))
        if self.weak:
            title = f"{counted(len(self.weak), 'combination')} weakly identifiable"
            said.append(Finding("warning", title, self.weak_message, do))
        return tuple(said)


def _listed(directions: Sequence[WeakDirection]) -> str:
    said = [direction.said for direction in directions[:NAMED]]
    leads = [next(iter(direction.terms)) for direction in directions[NAMED:]]
    if leads:
        said.append(f"and {len(leads)} more, led by {', '.join(leads)}")
    return "; ".join(said)


@checked
def identifiability(
    force_model: ForceModel, data: FitSamples | Sequence[Recording]
) -> Identifiability:
    """Compare what the structure lets be identified with what data excite.

    Parameters
    ----------
    force_model : ForceModel
    data : FitSamples, or sequence of Recording
        Samples may be of some of the parameters only, if the others are not to be fitted.

    Returns
    -------
    Identifiability
        Ranks of both, and the combinations that are not excited.

    Raises
    ------
    DataError
        When there are no recordings.

    Examples
    --------
    A five-bar of which only one crank moves:

    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> middle, wave = np.array([1.9, 0.7]), np.array([[0.2], [0.0]])  # rad
    >>> series = loopid.motion.FourierSeries(robot.actuated, 0.5, middle, wave, 0 * wave)
    >>> motion = loopid.motion.joint_motion(robot, series.motion(2.0, 20.0))
    >>> force = loopid.simulate(robot, motion, loopid.motion.Noise(gaussian=0.01)).force
    >>> run = loopid.logs.Recording.of_motion(motion, force, robot.actuated)
    >>> model = loopid.force_model(robot, "full", None)
    >>> found = loopid.identification.identifiability(model, [run])
    >>> found.rank < found.structural_rank
    True
    """
    samples = data if isinstance(data, FitSamples) else samples_of(force_model, data)
    columns, parameters = force_model.columns_of(samples.parameters), samples.parameters
    excitation = Excitation.of(force_model, samples.problem)
    errors, turns = _standard_errors(samples, force_model.prior[columns], excitation)
    changes = [*_unidentifiable(excitation), *_weak(excitation, errors, turns)]
    unidentifiable, weak = list[WeakDirection](), list[WeakDirection]()
    for change, order, error in changes:
        x = np.linalg.solve(excitation.factor, change)
        effect = float(np.linalg.norm(excitation.effects * (excitation.directions.T @ x)))
        terms = {parameters.labels[j]: float(change[j] / change[order[0]]) for j in order}
        found = WeakDirection(parameters, change, terms, effect, error)
        (unidentifiable if found.unidentifiable else weak).append(found)
    return Identifiability(parameters, excitation, errors, tuple(unidentifiable), tuple(weak))


# A change (n,) of one size, its main columns, and its standard error in sizes.
Change = tuple[FloatArray, list[int], float]


def _unidentifiable(excitation: Excitation) -> Iterator[Change]:
    """Changes with few terms that span what is unidentifiable."""
    held, sizes = excitation.held, excitation.sizes
    basis = excitation.unidentifiable / sizes[:, None]
    basis = basis @ np.linalg.inv(basis[held])
    basis[np.abs(basis) < NEGLIGIBLE * np.abs(basis).max(axis=0, initial=0.0)] = 0.0
    for column, lead in zip(basis.T, held.tolist(), strict=True):
        change = column * sizes
        change = change / np.linalg.norm(np.linalg.solve(excitation.factor, change))
        yield change, [lead, *(int(j) for j in np.flatnonzero(change) if j != lead)], np.inf


def _weak(excitation: Excitation, errors: FloatArray, turns: FloatArray) -> Iterator[Change]:
    """Axes of the confidence ellipsoid in sizes that are longer than one size, longest first."""
    for k in np.flatnonzero(errors > WEAK)[::-1]:
        change = excitation.excited @ turns[:, k]
        part = np.abs(change) / excitation.sizes
        order = [int(j) for j in np.argsort(-part)[:MOST_TERMS] if part[j] > MINOR * part.max()]
        yield change, order, float(errors[k])


def _standard_errors(
    samples: FitSamples, prior: FloatArray, excitation: Excitation
) -> tuple[FloatArray, FloatArray]:
    """Standard errors (rank,) in sizes, ascending, or NaN of too few rows; directions."""
    if not excitation.rank:
        return np.empty(0), np.empty((0, 0))
    # What the motion excites is required, not what the model lacks.
    alike = replace(samples, regions=0 * samples.regions)
    excited = excited_samples(alike, prior, excitation)
    for estimator in ("wls", "ols"):
        try:
            found = quiet_fit(excited, estimator)
        except (DataError, RankError):
            continue
        squares, turns = np.linalg.eigh(found.covariance)
        return np.sqrt(np.maximum(squares, 0.0)), turns
    return np.full(excitation.rank, np.nan), np.eye(excitation.rank)
