"""The recommended fit: all standard parameters, every body solid at every step.

    min  ½ |R (M [π; f], -1)|² + Σ_i D(P_i | P⁰_i) / s_i² + ½ Σ_j ((f_j - f⁰_j) / δ_j)²
    D(P | P⁰) = tr(P⁰⁻¹ P) - log det(P⁰⁻¹ P) - 4

R is the triangular factor of the data, each motor by its deviation and effective samples. M makes
base parameters of standard ones π and joint terms f. P_i is the pseudo-inertia of body i and P⁰_i
that of the robot file. D is the Bregman divergence of -log det [Lee2020]: convex, independent of
frames and units, and its own barrier. So no step leaves the solid bodies. What the data do not
excite stays as in the file. Near the file, D is ½ |Z|² of P = L (1 + Z) Lᵀ, P⁰ = L Lᵀ: s_i is the
deviation of body i in parts of itself. Joint terms keep linear limits, A f ≥ b, such as friction
that does not drive (``joint_priors.py``).

Newton's method turns with the bodies. With L a factor of the present P = L Lᵀ, the Hessian of D is
the identity in Z. So each step is a ridge regression. An orthogonal factorisation solves it at any
scaling. Where it would leave the limits, it is a least-distance problem, solved by non-negative
least squares [Lawson1974, ch. 23]. Where it would leave the solid bodies, steps of pairs come first
[Nesterov1998].

The deviations are those under which the data are most likely, by MacKay's fixed point [MacKay1992].
Those of single bodies scatter about a common s as 1 / s_i² ~ Gamma(ν / 2, ν s² / 2). A body that is
far off does not loosen the others. With γ_i of the ten parameters of a body determined by the data
and d_i = 2 D(P_i | P⁰_i),

    s_i² = (ν s² + d_i) / (ν + γ_i)  and  Σ_i (d_i - γ_i s²) / (ν s² + d_i) = 0.

A group of joint terms, such as the points of a friction curve, has one deviation σ, found in the
same fixed point. Let u be the terms in units of σ, and γ the number of them that the data
determine. Then σ² = |σ u|² / γ. Where the data ask for none, σ falls to its least and the terms
with it.

The inverse Hessian is the covariance (Laplace). What of a variance rests on the file is known with
ν + γ_i degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve
from scipy.linalg.lapack import dtrtri

from loopid.arguments import BoolArray, FloatArray, IntArray, checked
from loopid.errors import DataError, ModelWarning, warn
from loopid.findings import Finding
from loopid.identification.correlation import within_runs
from loopid.identification.estimator import WorkingFit, result_of
from loopid.identification.force_models import ForceModel
from loopid.identification.information import LEAST_MASS, body_sizes, joint_sizes
from loopid.identification.jackknife import with_scatter
from loopid.identification.joint_priors import JointPriors
from loopid.identification.problem import FitProblem, FitSamples
from loopid.identification.quality import (
    LARGEST_OF_BODY,
    LARGEST_OFF,
    LEAST_OFF,
    FileDeviation,
    NoiseModel,
    StandardUncertainty,
    TermDeviations,
    fit_quality,
)
from loopid.identification.result import Fit, with_errors
from loopid.inertia import body_defect, nearest_solid, parameters_of, pseudo_inertia, upper_factor
from loopid.numbers import SUM_ROUND_OFF
from loopid.observation import updated_factor
from loopid.parameters import KINDS
from loopid.workers import one_blas_thread

CONSISTENT = "consistent"
# ν, degrees of freedom of the deviations of single bodies about the common one: few let a body be
# far off while the others are right.
NU = 4.0
# Part by which bodies of a file that explains the forces count as off, which is as good as none.
RIGHT = 1e-4
# Deviation of a joint term of which nothing is known, in values that would make all of the force:
# so large that only terms without an effect in the data depend on it.
FLAT = 10.0
# Errors of forces, relative to their root mean square, that are round-off. Deviation of bodies
# without any mass in the file, which stay without, in sizes of light bodies.
PRECISION, MASSLESS = 1e-8, 1e-3
# Of the minimum, in units of the log-likelihood; what a last step gains at most while deviations
# still change; their relative change that ends their iteration; iterations of either, at most.
TOLERANCE, NEAR, SETTLED, ITERATIONS = 1e-8, 1e-2, 3e-4, 200


@checked
def consistent_fit(
    force_model: ForceModel,
    data: FitSamples,
    noise: NoiseModel,
    *,
    known: Fit | None = None,
) -> Fit:
    """Fit all standard parameters with the robot file as prior, every body solid.

    Parameters
    ----------
    force_model : ForceModel
    data : FitSamples
        Of all parameters of the force model.
    noise : NoiseModel
        Errors of each actuator, as of a fit by weighted least squares.
    known : Fit, optional
        Of the same parameters, as by an experiment of their own: joint terms are known to its
        errors, where it has any. Of others nothing is known but that some are not negative
        (``JointTerm.positive``), and that some belong to groups (``JointTerm.prior``), whose
        deviations the data choose.

    Returns
    -------
    Fit
        With ``standard_parameters``, the ``deviation`` of the robot file, and the
        ``term_deviations`` of groups of joint terms.

    Raises
    ------
    DataError
        When arguments do not belong together.

    Warns
    -----
    ModelWarning
        Naming bodies of the robot file that are no solid bodies, and are taken as the nearest ones.
        When the file gives no masses. When bodies would have to be so far off the file that the
        model lacks a force.
    DataWarning
        When no solid bodies explain the forces, and the fit is not at its best (``settled``).

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load("five_bar")
    >>> model = loopid.force_model(robot, joint_terms=None)
    >>> q, at_rest = loopid.random_configurations(robot, 50), np.zeros((50, 2))
    >>> W = model.base.regressor(model.standard_regressor(q, at_rest, at_rest))
    >>> force = 1.2 * W @ model.prior + 0.01 * np.random.default_rng(0).normal(size=(50, 2))
    >>> samples = loopid.identification.FitSamples.of(model.parameters, robot.independent, W, force)
    >>> noise = loopid.identification.fit(samples).noise
    >>> found = loopid.identification.consistent_fit(model, samples, noise)
    >>> bool((found.standard_parameters[::4] > 0).all())  # masses
    True
    >>> bool(np.allclose(model.base.values(found.standard_parameters), found.values))
    True
    """
    found = quiet_consistent_fit(force_model, data, noise, known)
    warn_of_bodies(force_model, found.result)
    return found.result


def quiet_consistent_fit(
    force_model: ForceModel,
    data: FitSamples,
    noise: NoiseModel,
    known: Fit | None = None,
) -> WorkingFit:
    """As ``consistent_fit``, with its least squares, the file as rows, and without warnings."""
    weights, program = _posed(force_model, data, noise, known)
    with one_blas_thread():
        state, common = _most_likely(program)
        found = _result(force_model, data, weights, program, state)
        last = len(found.result.values) - (program.terms.group >= 0).sum()  # those of groups
        groups = _groups(program, state, found.result.covariance[last:, last:])
    return found.with_result(
        deviation=FileDeviation(common, program.names, state.deviations),
        term_deviations=groups,
        settled=state.settled,
        model=force_model,
    )


def consistent_parameters(
    force_model: ForceModel,
    data: FitSamples,
    noise: NoiseModel,
    *,
    like: Fit | None = None,
) -> FloatArray:
    """The standard parameters (p,) of ``consistent_fit``, without their uncertainty.

    The deviations are those of a fit of more data, ``like``, which is also where the search begins;
    without it, the most likely ones.
    """
    _, program = _posed(force_model, data, noise)
    with one_blas_thread():
        if like is None:
            return program.standard(_most_likely(program)[0])
        bodies, far = 0.0 * force_model.standard_prior, like.deviation
        if far is None:
            program, bodies = _terms_alone(force_model, program)
        state = program.first(1.0)
        if far is not None:
            state = replace(program.near(state, like.require_bodies()), deviations=far.own)
        if like.term_deviations is not None:
            state = replace(state, groups=like.term_deviations.own)
        return bodies + program.standard(_minimised(program, state)[0])


def fit_terms(
    force_model: ForceModel, data: FitSamples, noise: NoiseModel, least: NoiseModel
) -> Fit:
    """As ``consistent_fit``, with the bodies of the robot file.

    The ``noise`` of each actuator holds errors of the file's bodies; the ``least`` is beside any
    bodies, and what is more shows how far those of the file are off. Parameters of bodies alone are
    ``assumed``. Those that joint terms fold into are not, and hold by how much the bodies seem to
    be off.
    """
    weights, whole = _posed(force_model, data, noise)
    base, (program, standard) = force_model.base, _terms_alone(force_model, whole)
    first = len(standard) - len(program.terms.start)
    J = base.matrix[:, first:]
    # Motors of one coordinate may have more joint terms than base parameters.
    joints = base.parameters.select(range(first, len(standard)))
    left = data.less(data.predicted(base.values(standard))).along(J, joints)
    with one_blas_thread():
        state, _ = _most_likely(program)
        standard[first:] = state.joints
        spread = program.terms.spread(state.groups)
        working = _posterior(left, weights, state.joints, spread.T)
        _, best = _posed(force_model, data, least)
        off, known = _off_the_file(whole, best, standard, working.factor[:-1, :-1])
        alone = np.minimum(working.result.degrees_of_freedom, _freedom(program, state, spread))
        terms = with_errors(replace(working.result, degrees_of_freedom=alone), off[first:], known)
        own = np.flatnonzero(program.terms.group >= 0)
        groups = _groups(program, state, working.result.covariance[np.ix_(own, own)])
    names, inside = force_model.parameters.names, J != 0
    folded = inside.any(axis=1)
    found = replace(
        terms,
        parameters=force_model.parameters,
        values=base.values(standard),
        covariance=J @ working.result.covariance @ J.T,
        degrees_of_freedom=np.where(inside, alone, np.inf).min(axis=1, initial=data.problem.rows),
    )
    file = np.where(inside.any(axis=0), np.inf, 0.0)
    bodies, none = np.zeros(first), np.zeros((len(standard), len(names)))  # as they are known
    return replace(
        with_errors(found, folded[:, None] * (base.matrix @ off), known),
        quality=fit_quality(data.problem, found.values),
        assumed=tuple(names[j] for j in np.flatnonzero(~folded)),
        standard_parameters=standard,
        uncertainty=StandardUncertainty(
            none,
            np.append(bodies, np.diag(terms.covariance)),
            np.append(bodies, file),
            np.append(bodies + np.inf, terms.degrees_of_freedom),
        ),
        term_deviations=groups,
    )


def _off_the_file(
    program: _Program, best: _Program, standard: FloatArray, factor: FloatArray
) -> tuple[FloatArray, float]:
    """How far bodies seem to be off the file, and joint terms with them: columns (p, 10 b).

    Of the standard parameters (p,) with the bodies of the file, and the triangular factor of their
    joint terms. What is left of the forces, in the errors of the best fit, is e. Its variance is 1
    + s² A Aᵀ, with A what such changes leave of them. The most likely s is taken, with the degrees
    of freedom that it is known with.
    """
    from scipy.optimize import minimize_scalar  # slow to import

    first = len(standard) - len(factor)
    E, J = program.effects, program.effects[:, first:]
    T = program.changes(program.first(1.0))[:, : WIDTH * len(program.file)]
    T[first:] = -cho_solve((factor, False), J.T @ (E @ T))
    U, sizes, _ = np.linalg.svd(best.effects @ T, full_matrices=False)
    squares = (U.T @ (best.target - best.effects @ standard)) ** 2

    def unlikely(logarithm: float) -> float:
        variances = 1 + np.exp(2 * logarithm) * sizes**2
        return float((np.log(variances) + squares / variances).sum())

    bounds = np.log(RIGHT), np.log(LARGEST_OF_BODY)
    s = float(np.exp(minimize_scalar(unlikely, bounds=bounds, method="bounded").x))
    determined = (s * sizes) ** 2 / (1 + (s * sizes) ** 2)
    return s * T, NU + float(determined.sum())


def _terms_alone(force_model: ForceModel, program: _Program) -> tuple[_Program, FloatArray]:
    """The program with the bodies of the robot file, and their standard parameters (p,)."""
    bodies = np.array(force_model.standard_prior)
    bodies[len(bodies) - len(program.terms.start) :] = 0.0
    alone = replace(
        program,
        target=program.target - program.effects @ bodies,
        names=(),
        file=program.file[:0],
        columns=program.columns[:0],
    )
    return alone, bodies


def _posed(
    force_model: ForceModel,
    data: FitSamples,
    noise: NoiseModel,
    known: Fit | None = None,
) -> tuple[FloatArray, _Program]:
    """Weights (dof,) of the actuators' rows, and what is minimised."""
    own = force_model.parameters
    if data.parameters != own or data.actuators != noise.actuators:
        raise DataError("data and noise must be of the parameters and actuators of the force model")
    if known is not None and known.parameters != own:
        raise DataError("the fit that is known must be of the parameters of the force model")
    weights = error_weights(data.problem, noise)
    priors = _joint_priors(force_model, data.problem, known)
    with one_blas_thread():
        return weights, _Program.of(force_model, data.problem.weighted(weights), priors)


def _groups(program: _Program, state: _State, covariance: FloatArray) -> TermDeviations | None:
    """Deviations of the groups of joint terms, and what the data say of them.

    The evidence is the ratio of the densities of prior and posterior at none [Dickey1971]. It takes
    the ``covariance`` of the terms of groups for autocorrelated errors.
    """
    terms, first = program.terms, WIDTH * len(program.file)
    if not terms.names:
        return None
    step, evidence = program.step(state), []
    places = np.cumsum(terms.group >= 0) - 1
    for number in range(len(terms.names)):
        own = np.flatnonzero(terms.group == number)
        rows = np.eye(first + len(terms.group))[first + own]
        apart = state.joints[own]
        spread = covariance[np.ix_(places[own], places[own])]
        size = np.linalg.slogdet(step.covariance(rows)[:, first + own])[1]
        evidence.append((size + apart @ np.linalg.solve(spread, apart)) / 2)
    determined = terms.of_groups(step.determined[first:])
    return TermDeviations(terms.names, state.groups, determined, np.array(evidence))


def error_weights(problem: FitProblem, noise: NoiseModel) -> FloatArray:
    """Weights (dof,) of the actuators' rows, which count as samples that inform as much."""
    present = (noise.samples > 0) & (problem.samples > 0)
    least = np.maximum(problem.least_errors, PRECISION * problem.force_rms)
    deviation = np.fmax(noise.deviation, least)[present]
    worth = np.sqrt(noise.informing_samples / np.maximum(noise.samples, 1))[present]
    weights = np.zeros(len(present))
    weights[present] = worth / np.where(deviation > 0, deviation, 1.0)
    return weights


def _joint_priors(force_model: ForceModel, problem: FitProblem, known: Fit | None) -> JointPriors:
    """What is known of the joint terms: to the errors of a fit, where it has any."""
    base, columns = force_model.base, force_model.joint_columns
    sizes, start = FLAT * joint_sizes(force_model, problem), np.nan_to_num(force_model.joint_values)
    given = np.full(len(sizes), np.inf)
    if known is not None:
        own = columns[known.standard_errors[columns] > 0]
        places = base.base[own] - (len(base.parameters) - len(sizes))
        start[places], given[places] = known.values[own], known.standard_errors[own]
    deviations = np.where(np.isfinite(given), given, sizes)
    return JointPriors.of(force_model, problem, start, deviations, given)


# An orthonormal basis of the symmetric matrices, and the ten parameters of each.
_ROWS, _COLUMNS = np.triu_indices(4)
WIDTH = len(_ROWS)
UNITS = np.zeros((WIDTH, 4, 4))
for _row, _column in ((_ROWS, _COLUMNS), (_COLUMNS, _ROWS)):
    UNITS[range(WIDTH), _row, _column] = np.where(_ROWS == _COLUMNS, 1.0, 0.5**0.5)
PARAMETERS = parameters_of(UNITS)


def _vector(matrices: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 4, 4) by their ten coordinates."""
    return np.asarray(matrices.reshape(*matrices.shape[:-2], 16) @ UNITS.reshape(WIDTH, 16).T)


@dataclass(frozen=True, eq=False)
class _State:
    """Upper factors L (b, 4, 4) of the bodies P = L Lᵀ, and joint terms (k,).

    With deviations of the bodies (b,) and of the groups of joint terms (g,), and whether steps have
    settled there.
    """

    factors: FloatArray
    joints: FloatArray
    deviations: FloatArray
    groups: FloatArray
    settled: bool = True

    @property
    def metric(self) -> FloatArray:
        """B (b, 4, 4) of changes L B Z B Lᵀ of the bodies: of size s near L Lᵀ."""
        return np.sqrt(self.deviations)[:, None, None] * np.eye(4)

    @property
    def weights(self) -> FloatArray:
        """1 / s² (b, 1, 1)."""
        return 1 / self.deviations[:, None, None] ** 2


@dataclass(frozen=True, eq=False)
class _Step:
    """The ridge regression about a state, min ½ |e - J z|² + ½ |g + z|².

    ``z`` are changes of the bodies, ten each, and of the joint terms, in their deviations.
    """

    J: FloatArray
    e: FloatArray
    g: FloatArray

    @property
    def gradient(self) -> FloatArray:
        """Of what is minimised."""
        return np.asarray(self.g - self.J.T @ self.e)

    @cached_property
    def _triangle(self) -> FloatArray:
        """R (q, q + 1) of [J, e; 1, -g]: RᵀR of its first q columns is the Hessian."""
        count = len(self.g)
        prior = np.column_stack([np.eye(count), -self.g])
        return updated_factor(np.pad(prior, ((0, 1), (0, 0))), np.column_stack([self.J, self.e]))[
            :count
        ]

    @cached_property
    def _root(self) -> FloatArray:
        """R⁻¹ (q, q)."""
        R = self._triangle[:, :-1]
        return np.asarray(dtrtri(R)[0]) if len(R) else R

    def solution(self, rows: FloatArray, least: FloatArray) -> FloatArray:
        """The best z (q,) with rows (m, k) least (m,) or more times its last k."""
        z, first = self._root @ self._triangle[:, -1], len(self.g) - rows.shape[1]
        missing = least - rows @ z[first:]
        if not (missing > 0).any():
            return np.asarray(z)
        # With x = R (z - z_free): the shortest x with G x ≥ h, rows of G of unit length. The root
        # is triangular, so that x is of the last k alone.
        G = rows @ self._root[first:, first:]
        lengths = np.linalg.norm(G, axis=1)
        kept = lengths > 0
        G, h = G[kept] / lengths[kept, None], missing[kept] / lengths[kept]
        return np.asarray(z + self._root[:, first:] @ _least_distance(G, h))

    @property
    def determined(self) -> FloatArray:
        """How much of each z the data determine, from 0 to 1."""
        return np.asarray(np.maximum(1.0 - (self._root**2).sum(axis=1), 0.0))

    def covariance(self, rows: FloatArray) -> FloatArray:
        """``rows`` (r, q) times the covariance of z."""
        return np.asarray((rows @ self._root) @ self._root.T)


def _least_distance(G: FloatArray, h: FloatArray) -> FloatArray:
    """The shortest x with G x ≥ h, of which there is one [Lawson1974, 23.4]."""
    from scipy.optimize import nnls  # slow to import

    scale = np.abs(h).max()
    E = np.vstack([G.T, h / scale])
    aim = np.append(np.zeros(G.shape[1]), 1.0)
    multipliers, _ = nnls(E, aim, maxiter=NNLS_STEPS * len(h))
    left = E @ multipliers - aim
    return np.asarray(-scale * left[:-1] / left[-1])


@dataclass(frozen=True, eq=False)
class _Program:
    """What is minimised, of weighted data and a robot file.

    ``effects`` (r, p) are those of all standard parameters on the rows, ``target`` (r,) what is
    measured. ``file`` (b, 4, 4) are the upper factors of the bodies with a mass, ``columns`` (b, 4
    or 10) where their parameters are. ``terms`` is what is known of the joint terms.
    """

    effects: FloatArray
    target: FloatArray
    names: tuple[str, ...]
    file: FloatArray
    columns: IntArray
    terms: JointPriors

    @classmethod
    def of(cls, force_model: ForceModel, R: FloatArray, terms: JointPriors) -> _Program:
        """The program of a triangular factor (r + 1, r + 1)."""
        P, _ = _solid_bodies(force_model)
        massive = P[:, 3, 3] > 0
        parameters, count = force_model.base.parameters, len(terms.start)
        columns = np.arange(len(parameters) - count).reshape(len(P), -1)
        names = [parameters[int(first)].link for first in columns[:, 0]]
        return cls(
            effects=R[:-1, :-1] @ force_model.base.matrix,
            target=R[:-1, -1],
            names=tuple(name for name, flag in zip(names, massive, strict=True) if flag),
            file=upper_factor(P[massive]),
            columns=columns[massive],
            terms=terms,
        )

    def first(self, deviation: float) -> _State:
        """Bodies of the file, joint terms as known where that is within the limits."""
        terms = self.terms
        inside = (terms.limits @ terms.start >= terms.least).all()
        joints = terms.start if inside else np.zeros(len(terms.start))
        groups = FIRST * terms.bounds[:, 1]
        return _State(self.file, joints, np.full(len(self.file), deviation), groups)

    def near(self, state: _State, standard: FloatArray) -> _State:
        """A state with the bodies of standard parameters (p,), where these say all of bodies."""
        if self.columns.shape[1] < len(KINDS):
            return state
        P = pseudo_inertia(standard[self.columns])
        return replace(state, factors=upper_factor(P))

    def standard(self, state: _State) -> FloatArray:
        """Standard parameters and joint terms (p,) of a state."""
        found = np.zeros(self.effects.shape[1])
        P = state.factors @ state.factors.swapaxes(1, 2)
        found[self.columns] = (_vector(P) @ PARAMETERS)[:, : self.columns.shape[1]]
        found[len(found) - len(state.joints) :] = state.joints
        return found

    def divergences(self, state: _State) -> FloatArray:
        """D (b,) of the bodies from those of the file."""
        C = np.linalg.solve(self.file, state.factors)
        logs = np.log(np.diagonal(C, axis1=1, axis2=2)).sum(axis=1)
        return np.asarray((C**2).sum(axis=(1, 2)) - 2 * logs - 4)

    def value(self, state: _State) -> float:
        """What is minimised."""
        e = self.target - self.effects @ self.standard(state)
        u = self.terms.departures(state.joints, state.groups)
        return float(0.5 * (e @ e + u @ u) + (self.divergences(state) / state.deviations**2).sum())

    def changes(self, state: _State, metric: FloatArray | None = None) -> FloatArray:
        """Changes (p, 10 b + k) of all standard parameters with z."""
        B, count = state.metric if metric is None else metric, len(state.joints)
        K = (state.factors @ B)[:, None]
        turned = (_vector(K @ UNITS @ K.swapaxes(2, 3)) @ PARAMETERS)[..., : self.columns.shape[1]]
        T = np.zeros((self.effects.shape[1], WIDTH * len(self.file) + count))
        for k, columns in enumerate(self.columns):
            T[columns, WIDTH * k : WIDTH * (k + 1)] = turned[k].T
        T[len(T) - count :, T.shape[1] - count :] = self.terms.spread(state.groups)
        return T

    def step(self, state: _State, metric: FloatArray | None = None, push: float = 1.0) -> _Step:
        """The ridge regression about a state, in its own metric or another (b, 4, 4).

        The bodies' limits push so many times as at the minimum.
        """
        B = state.metric if metric is None else metric
        C = np.linalg.solve(self.file, state.factors)
        G = state.weights * (B @ (C.swapaxes(1, 2) @ C - push * np.eye(4)) @ B)
        u = self.terms.departures(state.joints, state.groups)
        e = self.target - self.effects @ self.standard(state)
        return _Step(self.effects @ self.changes(state, B), e, np.append(_vector(G).ravel(), u))

    def matrices(self, z: FloatArray) -> FloatArray:
        """Z (b, 4, 4) of the bodies."""
        own = z[: WIDTH * len(self.file)].reshape(-1, WIDTH)
        return np.asarray(np.einsum("bk,kij->bij", own, UNITS))

    def moved(self, state: _State, z: FloatArray, metric: FloatArray | None = None) -> _State:
        """The state after a step inside the solid bodies."""
        B = state.metric if metric is None else metric
        S, (low, high) = self.terms.spread(state.groups), self.terms.box
        joints, near = state.joints + S @ z[WIDTH * len(self.file) :], SUM_ROUND_OFF * np.diag(S)
        # Steps end at limits but for round-off of what is known, which would be read as a value.
        joints = np.where(joints < low + near, low, np.where(joints > high - near, high, joints))
        factors = state.factors @ upper_factor(np.eye(4) + B @ self.matrices(z) @ B)
        return replace(state, factors=factors, joints=joints)

    def limits(self, state: _State) -> tuple[FloatArray, FloatArray]:
        """Rows (m, k) and their least (m,) that joint terms keep to in a step z."""
        rows = self.terms.limits @ self.terms.spread(state.groups)
        return rows, np.minimum(self.terms.least - self.terms.limits @ state.joints, 0.0)


# Part of the decrease that the slope promises which a step must reach; how far it goes to where a
# body is flat; least part of a step.
ARMIJO, INSIDE, SHORTEST = 1e-4, 0.95, 1e-12
# How much harder limits push at first than the data; less by which part from step to step.
FARTHER, CLOSER = 10.0, 0.5
# First deviation of a group relative to its largest; largest growth of its steps; iterations of
# non-negative least squares for each limit.
FIRST, FASTEST, NNLS_STEPS = 0.1, 8.0, 30


# Of a fit that is not at its best.
UNSETTLED = Finding(
    "warning",
    "the fit is not at its best",
    f"no solid bodies near those of the robot file explain the forces, {ITERATIONS} steps end at "
    "no least error",
    "look for a wrong length, a payload or a missing joint term",
)


def _minimised(program: _Program, state: _State, near: float = 0.0) -> tuple[_State, _Step]:
    """Newton's method at given deviations, within the limits of the joint terms; its last step.

    A step that gains less than ``near`` is the last one.
    """
    value = program.value(state)
    for number in range(ITERATIONS):
        step = program.step(state)
        z = step.solution(*program.limits(state))
        decrement = -float(step.gradient @ z)
        if decrement <= TOLERANCE + SUM_ROUND_OFF * abs(value):
            return replace(state, settled=True), step
        part = _inside(program.matrices(z) * state.deviations[:, None, None])
        if number == 0 and part < 1.0:
            state = _approached(program, state, step)
            value = program.value(state)
            continue
        tried = program.moved(state, part * z)
        while program.value(tried) > value - ARMIJO * part * decrement + SUM_ROUND_OFF * abs(value):
            part /= 2
            if part < SHORTEST:
                return replace(state, settled=True), step  # as near as round-off lets it be
            tried = program.moved(state, part * z)
        before, state, value = value, tried, program.value(tried)
        if before - value <= SUM_ROUND_OFF * abs(value) or decrement <= near:
            return replace(state, settled=True), step
    return replace(state, settled=False), step


def _most_likely(program: _Program) -> tuple[_State, float]:
    """The best state at the most likely deviations, and the common one."""
    state = program.first(LEAST_OFF)
    steps, gains = np.zeros((2, len(state.groups)))
    near = NEAR
    for _ in range(ITERATIONS):
        state, step = _minimised(program, state, near)
        determined = step.determined
        gamma, d = _of_bodies(program, determined), 2 * program.divergences(state)
        common = _common(gamma, d)
        own = np.sqrt((NU * common**2 + d) / (NU + gamma)).clip(max=LARGEST_OF_BODY)
        before, steps = steps, _group_steps(program, state, determined)
        settled = np.append(own / state.deviations - 1, steps)
        if np.abs(settled).max(initial=0.0) <= SETTLED:
            if not near:
                break
            near = 0.0
        # Steps that go on in one direction, as towards none, grow.
        gains = np.where(steps * before > 0, np.minimum(1.5 * gains, FASTEST), 1.0)
        groups = (state.groups * np.exp(gains * steps)).clip(*program.terms.bounds.T)
        state = replace(state, deviations=own, groups=groups)
    return state, common


def _group_steps(program: _Program, state: _State, determined: FloatArray) -> FloatArray:
    """Logarithms (g,) of what the deviations of groups are to be multiplied by."""
    terms = program.terms
    u = terms.departures(state.joints, state.groups)
    gamma = terms.of_groups(determined[WIDTH * len(program.file) :])
    squares = state.groups**2 * terms.of_groups(u**2) / np.maximum(gamma, np.finfo(float).tiny)
    return np.log(np.sqrt(squares).clip(*terms.bounds.T) / state.groups)


def _approached(program: _Program, state: _State, step: _Step) -> _State:
    """A state so near the minimum that Newton's step stays inside the solid bodies [Nesterov1998].

    A nearly flat body lets such steps slide along its limit by little. These are of pairs: of P = L
    Lᵀ and S, by which its limit pushes. They end at S = P⁻¹ / s². Their metric W, W S W = P, lets
    both be far off. With A = Lᵀ S L it is W = L A^(-1/2) Lᵀ.
    """
    slope = np.linalg.norm(program.matrices(step.gradient), axis=(1, 2))
    A = FARTHER * max(1.0, float((slope * state.deviations).max())) * state.weights * np.eye(4)
    for _ in range(ITERATIONS):
        push = max(1.0, CLOSER * float(np.trace(A / state.weights, axis1=1, axis2=2).mean()) / 4)
        sizes, turn = np.linalg.eigh(A)
        B = (turn * sizes[:, None, :] ** -0.25) @ turn.swapaxes(1, 2)
        z = program.step(state, B, push).solution(*program.limits(state))
        inverse = np.linalg.inv(B)
        change = push * state.weights * np.eye(4) - A - inverse @ program.matrices(z) @ inverse
        part = _inside(B @ program.matrices(z) @ B, B @ B @ change @ B @ B)
        before, state = state, program.moved(state, part * z, B)
        U = np.linalg.solve(before.factors, state.factors)
        A = U.swapaxes(1, 2) @ (A + part * change) @ U
        if push == part == 1.0:
            break
    return state


def _inside(*changes: FloatArray) -> float:
    """How much of relative changes (b, 4, 4) leaves all matrices positive."""
    shrinks = max(-float(np.linalg.eigvalsh(each).min(initial=0.0)) for each in changes)
    return min(1.0, INSIDE / shrinks) if shrinks > 0 else 1.0


def _of_bodies(program: _Program, determined: FloatArray) -> FloatArray:
    """How many of the ten parameters of each body the data determine, (b,), of all z."""
    bodies = determined[: WIDTH * len(program.file)]
    return np.asarray(bodies.reshape(-1, WIDTH).sum(axis=1))


def _common(gamma: FloatArray, d: FloatArray) -> float:
    """The root s of Σ (d - γ s²) / (ν s² + d), which falls, within its bounds."""
    from scipy.optimize import brentq  # slow to import

    def excess(logarithm: float) -> float:
        square = np.exp(2 * logarithm)
        return float(((d - gamma * square) / (NU * square + d)).sum())

    low, high = LEAST_OFF, LARGEST_OFF
    if excess(np.log(low)) <= 0:
        return low
    if excess(np.log(high)) >= 0:
        return high
    return float(np.exp(brentq(excess, np.log(low), np.log(high))))


def _result(
    force_model: ForceModel,
    data: FitSamples,
    weights: FloatArray,
    program: _Program,
    state: _State,
) -> WorkingFit:
    """The values, with Laplace's covariance for autocorrelated errors."""
    M, standard = force_model.base.matrix, program.standard(state)
    moved = M @ program.changes(state)
    # Bodies without a mass are kept so, and not known to be.
    sizes = MASSLESS * body_sizes(force_model.robot, force_model.model)
    sizes[program.columns.ravel()] = 0.0
    kept = M[:, : len(sizes)] * sizes
    kept = kept[:, sizes > 0]
    values = force_model.base.values(standard)
    C = np.asarray(np.linalg.qr(np.hstack([moved, kept]).T, mode="r"))
    only_kept = kept.any(axis=1) & ~moved.any(axis=1)
    found = _posterior(data, weights, values, C)
    known = np.minimum(found.result.degrees_of_freedom, _freedom(program, state, moved))
    return found.with_result(
        assumed=tuple(force_model.parameters.names[j] for j in np.flatnonzero(only_kept)),
        standard_parameters=standard,
        degrees_of_freedom=known,
        uncertainty=_robot_uncertainty(force_model, program, state),
    )


def _posterior(
    data: FitSamples, weights: FloatArray, values: FloatArray, C: FloatArray
) -> WorkingFit:
    """Values (n,) with the covariance for autocorrelated errors; CᵀC is that of the prior.

    The prior counts as rows whose least squares with the data are the values.
    """
    problem = data.problem
    R = problem.weighted(weights)
    middle = values + C.T @ (C @ (R[:-1, :-1].T @ (R[:-1, :-1] @ values - R[:-1, -1])))
    inverse = np.linalg.inv(C).T
    rows = np.asarray(np.column_stack([inverse, inverse @ middle]), dtype=np.float64)
    factor = problem.weighted(weights, rows)[:-1, :-1]
    plain = result_of(CONSISTENT, problem, values, factor, weights, 1.0)
    return with_scatter(within_runs(WorkingFit(plain, data, rows)))


# Relative eigenvalues of a covariance that are round-off.
SINGULAR = 1e-12


def _robot_uncertainty(
    force_model: ForceModel, program: _Program, state: _State
) -> StandardUncertainty:
    """Of standard parameters: what the posterior of the base parameters leaves open beside them."""
    T, M = program.changes(state), force_model.base.matrix
    spread = program.step(state).covariance(T)
    both, base = spread @ (M @ T).T, (M @ spread) @ (M @ T).T
    sizes = np.sqrt(np.diag(base))
    sizes = np.where(sizes > 0, sizes, 1.0)
    gain = both / sizes @ np.linalg.pinv(base / np.outer(sizes, sizes), SINGULAR, True) / sizes
    return StandardUncertainty(
        gain=gain,
        beside=np.maximum((spread * T).sum(axis=1) - (gain * both).sum(axis=1), 0.0),
        # What no force depends on only the file gives, though it goes with its body.
        file=np.where(M.any(axis=0), (T**2).sum(axis=1), 0.0),
        degrees_of_freedom=_freedom(program, state, T),
    )


def solid_body(
    values: FloatArray, covariance: FloatArray, matrix: FloatArray, guess: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The most likely solid body of estimates x = M π, of which nothing else is known.

    Of values (r,) with their covariance (r, r), M (r, 4) or (r, 10), and the pseudo-inertia (4, 4)
    of a body near it. This may be off by ``LARGEST_OF_BODY`` times itself. Gives π, and the
    covariance (r, r) of M π.
    """
    # Errors that are round-off of such a body count as a little larger, lest they are nothing.
    own = (_vector(guess) @ PARAMETERS)[: matrix.shape[1]]
    sizes = np.sqrt(np.diag(covariance)) + PRECISION * (np.abs(matrix) @ np.abs(own))
    shares, turn = np.linalg.eigh(covariance / np.outer(sizes, sizes))
    least = PRECISION**2 * shares.max() + PRECISION**2
    inverse = (turn / np.sqrt(np.maximum(shares, least))).T / sizes
    program = _Program(
        effects=inverse @ matrix,
        target=inverse @ values,
        names=("",),
        file=upper_factor(guess[None]),
        columns=np.arange(matrix.shape[1])[None],
        terms=JointPriors.none(),
    )
    with one_blas_thread():
        state, step = _minimised(program, program.first(LARGEST_OF_BODY))
        turned = matrix @ program.changes(state)
        return program.standard(state), step.covariance(turned) @ turned.T


def _freedom(program: _Program, state: _State, rows: FloatArray) -> FloatArray:
    """Degrees of freedom (r,) that what rests on priors leaves the variances [Welch1947]."""
    step, bodies, terms = program.step(state), len(program.file), program.terms
    spread = step.covariance(rows)
    variance = (spread * rows).sum(axis=1)
    own = spread[:, : WIDTH * bodies].reshape(len(rows), bodies, WIDTH)
    known = step.determined
    parts = [(own**2).sum(axis=2)]
    parts.append(np.stack([terms.of_groups(row**2) for row in spread[:, WIDTH * bodies :]]))
    shares = np.hstack(parts) / np.where(variance > 0, variance, 1.0)[:, None]
    every = np.append(_of_bodies(program, known), terms.of_groups(known[WIDTH * bodies :]))
    squares = (shares**2 / (NU + every)).sum(axis=1)
    return np.asarray(np.divide(1.0, squares, out=np.full(len(rows), np.inf), where=squares > 0))


# Radius of the ball that a body counts as of which nothing is known, of the robot's length.
BALL = 0.1


def _solid_bodies(force_model: ForceModel) -> tuple[FloatArray, BoolArray]:
    """Pseudo-inertias (n, 4, 4) of the file's bodies as solid ones, and which (n,) were none.

    Those of massless bodies are zero; without any masses, all are balls of one kilogram.
    """
    robot = force_model.robot
    P = pseudo_inertia(robot.standard_parameters("full").reshape(-1, len(KINDS)))
    unsound, reach = np.zeros(len(P), dtype=bool), BALL * robot.length
    if not force_model.has_masses:
        ball = np.append(np.full(3, reach**2 / 5), 1.0)
        return np.tile(np.diag(ball), (len(P), 1, 1)), unsound
    masses = P[:, 3, 3]
    least = LEAST_MASS * float(np.mean(masses[masses > 0])) if (masses > 0).any() else 1.0
    for k, own in enumerate(P):
        if own.any() and body_defect(own):
            unsound[k], P[k] = True, nearest_solid(own, least, reach)
    return P, unsound


def warn_of_bodies(force_model: ForceModel, found: Fit) -> None:
    """Tell of bodies of the file that are none, and of a model that lacks a force."""
    name = force_model.robot.name
    if not found.settled:
        UNSETTLED.warn()
    if not force_model.has_masses:
        warn(
            f"the file of {name} gives no masses: of all bodies with the base parameters that the "
            "data determine, those nearest to balls of 1 kg are taken",
            ModelWarning,
        )
        return
    _, unsound = _solid_bodies(force_model)
    if unsound.any() and force_model.model == "full":
        links = [body.link for body in force_model.base.parameters if body.kind == KINDS[0]]
        listed = ", ".join(link for link, flag in zip(links, unsound, strict=True) if flag)
        warn(
            f"no solid bodies have the inertials of {listed} in the file of {name}: the nearest "
            "that have are taken",
            ModelWarning,
        )
    if found.deviation is not None and (fault := found.deviation.fault):
        warn(f"{name}: {fault}", ModelWarning)
