"""Joint terms that data ask for: friction with more shape than a line, and offsets.

Friction is a curve F(q̇) of each joint. Coulomb and viscous friction make a line on either side of
standstill; what bends it is Stribeck friction, which falls off over a rate that nobody knows
[Armstrong1994]. Stribeck terms of a series of rates follow all such laws, also others than
Stribeck's, and stay linear in the parameters. A joint has them where a pair of neighbouring rates
is clearly significant beside all that the model has.

An offset hardly differs from gravity, or from Coulomb friction where a motor moves one way, in
motions that excite little. Errors of both would be large and opposite, and add up on other motions:
a motor keeps its offset where the data tell it well, or where it is clearly significant.

The forces are fitted with the pairs of all joints and rates at once, whose residuals tell the
errors and their autocorrelation. With orthonormal columns Q of what k terms add to the others, and
estimates u of covariance F, uᵀQ (QᵀFQ)⁻¹ Qᵀu / k has the F distribution with k and ν degrees of
freedom.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from loopid.arguments import FloatArray, Share, checked, finite
from loopid.errors import DataError, OptionError, RankError
from loopid.identification.estimator import LEAST_EXCITATION, scaled_svd
from loopid.identification.fitting import quiet_fit
from loopid.identification.force_model import ForceModel, samples_of
from loopid.identification.problem import FitSamples
from loopid.identification.result import LEAST_FREEDOM, FitResult
from loopid.logs.recording import Recording
from loopid.parameters import KINDS
from loopid.records import Tabular, record
from loopid.regressors.joint_laws import JointState, joint_term
from loopid.regressors.joint_terms import JointTerms, terms_of_file, together
from loopid.workers import one_blas_thread

STRIBECK, OFFSET = "Fs~", "Fo"
# Rates of a decade: neighbours are so near that they follow all between them.
SERIES = (1.0, 2.0, 5.0)
# The slowest, relative to the joint's largest rate in the data: below it are too few samples.
SLOWEST = 0.01
# Part of the effect of terms that other parameters must not make up for: less is round-off.
OWN_EFFECT = 1e-4


@record(kw_only=True, checked=True)
class TermOptions:
    """When friction has more shape than Coulomb's and viscous friction, and motors have offsets.

    Attributes
    ----------
    false_alarm : float
        Probability that any joint has more shape, or a badly known offset, where none has; 0 for
        the usual terms whatever the data say.
    further : float
        Probability that one more joint has more shape by chance, where another clearly has.
    known_offset : float
        Standard error, relative to the motor's force, up to which an offset is told well.
    """

    false_alarm: Share = 0.01
    further: Annotated[float, Field(gt=0, lt=1)] = 0.05
    known_offset: Share = 0.05


class Terms(NamedTuple):
    """Terms of a joint that the model has or has not together."""

    joint: str
    kinds: tuple[str, ...]

    @property
    def labels(self) -> tuple[str, ...]:
        """Of its parameters."""
        return tuple(f"{self.joint}.{kind}" for kind in self.kinds)


@checked
def choose_terms(
    force_model: ForceModel,
    recordings: Sequence[Recording],
    *,
    options: TermOptions = TermOptions(),
    n_jobs: int = 1,
) -> ForceModel:
    """Take the Stribeck friction and the offsets that recordings ask for.

    A step of ``identify``. Models whose terms were chosen by name are taken as they are.

    Parameters
    ----------
    recordings : sequence of Recording
        Those that are fitted.
    n_jobs : int
        Processes that compute the regressor; the result is the same to the bit.

    Returns
    -------
    ForceModel
        The same one where nothing is asked for.

    Examples
    --------
    A five-bar with 30 % more friction near standstill:

    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> friction, values = loopid.JointTerms.with_values(robot, "Fc=1,Fv=1,Fs~0.05=0.3")
    >>> sine, cosine = 0.1 * np.random.default_rng(0).normal(size=(2, 2, 4))
    >>> series = loopid.FourierSeries(robot.actuated, 0.02, np.array([1.7, 0.7]), sine, cosine)
    >>> motion = loopid.joint_motion(robot, series.motion(100.0, 5.0))
    >>> noise = loopid.Noise(gaussian=0.01)
    >>> log = loopid.simulate_measurement(
    ...     robot, motion, noise, joint_terms=friction, joint_values=values
    ... )
    >>> run = loopid.logs.Recording.of_motion(motion, log.force, robot.actuated)
    >>> chosen = loopid.identification.choose_terms(loopid.find_force_model(robot), [run])
    >>> [kind for kind in chosen.joint_terms.of_joints["left_crank_joint"] if "Fs" in kind]
    ['Fs~0.001', 'Fs~0.002', 'Fs~0.005', 'Fs~0.01', 'Fs~0.02', 'Fs~0.05']
    """
    usual = force_model.joint_terms
    if usual is None or not (force_model.automatic and options.false_alarm):
        return force_model
    pairs = list(_pairs(force_model, recordings))
    offsets = list(_offsets(force_model))
    wide = force_model.with_columns(_kinds(pairs))
    evidence = _Evidence.of(samples_of(wide, recordings, n_jobs=n_jobs))
    if evidence is None:
        return force_model
    least = np.log(options.false_alarm / max(len(pairs) + len(offsets), 1))  # by Bonferroni
    dropped = evidence.unknown(force_model.parameters.labels, offsets, least, options)
    gone = {label for each in dropped for label in each.labels}
    labels = [label for label in force_model.parameters.labels if label not in gone]
    chosen = evidence.shaped(labels, pairs, least, options)
    if not (dropped or chosen):
        return force_model
    own = together(usual.of_joints, _kinds(chosen))
    return force_model.with_terms(
        {
            joint: tuple(kind for kind in kinds if f"{joint}.{kind}" not in gone)
            for joint, kinds in own.items()
        }
    )


def _offsets(force_model: ForceModel) -> Iterator[Terms]:
    """Offsets of motors that the robot file does not give, and that lead a base parameter."""
    given = terms_of_file(force_model.mechanism)
    for name in force_model.parameters:
        if name.kind == OFFSET and OFFSET not in given.get(name.link, {}):
            yield Terms(name.link, (OFFSET,))


def _pairs(force_model: ForceModel, recordings: Sequence[Recording]) -> Iterator[Terms]:
    """Neighbouring rates of each motor with friction, up to its largest rate in the data."""
    terms = force_model.joint_terms
    kinds = {} if terms is None else terms.of_joints
    independent = force_model.mechanism.independent
    for joint in force_model.mechanism.actuated:
        own = kinds.get(joint, ())
        if "Fc" not in own or joint not in independent or any(STRIBECK in kind for kind in own):
            continue
        column = independent.index(joint)
        speeds = [np.abs(run.motion.velocities[:, column]).max(initial=0.0) for run in recordings]
        fastest = float(max(speeds, default=0.0))
        for slow, fast in pairwise(_rates(SLOWEST * fastest, fastest) if fastest else ()):
            yield Terms(joint, (f"{STRIBECK}{slow:g}", f"{STRIBECK}{fast:g}"))


def _rates(least: float, most: float) -> Iterator[float]:
    """Numbers of the series 1, 2, 5, 10, ... from the least to the most."""
    for decade in range(int(np.floor(np.log10(least))), int(np.floor(np.log10(most))) + 1):
        for digit in SERIES:
            rate = float(f"{digit:g}e{decade}")
            if least <= rate <= most:
                yield rate


def _kinds(terms: Iterable[Terms]) -> dict[str, tuple[str, ...]]:
    kinds = dict[str, tuple[str, ...]]()
    for joint, own in terms:
        kinds[joint] = tuple(dict.fromkeys((*kinds.get(joint, ()), *own)))
    return kinds


class _Evidence(NamedTuple):
    """Estimates of all columns together, in orthonormal coordinates."""

    columns: dict[str, FloatArray]  # of each parameter (r,)
    estimate: FloatArray  # (r,)
    covariance: FloatArray  # (r, r), for autocorrelated errors
    freedom: float
    forces: dict[str, float]  # rms of each motor, in N or N m

    @classmethod
    def of(cls, data: FitSamples) -> _Evidence | None:
        """Of weighted least squares; None where there are too few samples for it."""
        n = len(data.parameters)
        with one_blas_thread():
            R = data.problem.weighted(np.ones(len(data.actuators)))[:n, :n]
            lengths, effects, turn = scaled_svd(R)
            excited = turn[effects > LEAST_EXCITATION * effects[0]]
        reduced = data.along((excited / lengths).T)
        try:
            fit = quiet_fit(reduced)
        except (DataError, RankError):
            return None
        if fit.degrees_of_freedom.min() < LEAST_FREEDOM:
            return None
        with one_blas_thread():
            Q = reduced.problem.weighted(fit.weights)[:-1, :-1]
            every = Q @ (excited * lengths * R.any(axis=0))
        columns = dict(zip(data.parameters.labels, every.T, strict=True))
        freedom = float(fit.degrees_of_freedom.min())
        forces = dict(zip(data.actuators, data.problem.force_rms.tolist(), strict=True))
        return cls(columns, Q @ fit.values, Q @ fit.covariance @ Q.T, freedom, forces)

    def unknown(
        self, labels: Sequence[str], terms: Sequence[Terms], least: float, options: TermOptions
    ) -> list[Terms]:
        """Of terms among the columns of labels, those neither told well nor significant."""
        found = []
        for each in terms:
            others = self._span(label for label in labels if label not in each.labels)
            own, known = self._own(each, others), False
            if own is not None:
                (label,) = each.labels
                unit = own[:, 0]
                error = np.sqrt(unit @ self.covariance @ unit) / abs(unit @ self.columns[label])
                # A redundant motor has no row: its offset counts beside the largest force of any.
                force = self.forces.get(each.joint, max(self.forces.values()))
                known = bool(error <= options.known_offset * force)
            if own is None or not (known or self._chance(own) < least):
                found.append(each)
        return found

    def shaped(
        self, labels: Sequence[str], pairs: Sequence[Terms], least: float, options: TermOptions
    ) -> list[Terms]:
        """All rates of joints with a pair that is significant beside columns, the clearest first.

        One pair follows one law, such as that of its rates; all of them follow any, with as wide a
        band as the data leave.
        """
        taken, left, columns = list[Terms](), list(pairs), list(labels)
        while left:
            inside = self._span(columns)
            parts = [self._own(each, inside) for each in left]
            chances = [0.0 if own is None else self._chance(own) for own in parts]
            best = int(np.argmin(chances))
            if chances[best] >= (np.log(options.further) if taken else least):
                break
            joint = left[best].joint
            kinds = _kinds(each for each in left if each.joint == joint)
            taken.append(Terms(joint, kinds[joint]))
            columns += taken[-1].labels
            left = [each for each in left if each.joint != joint]
        return taken

    def _span(self, labels: Iterable[str]) -> FloatArray:
        """Orthonormal columns of those of labels."""
        columns = np.stack([self.columns[label] for label in labels], axis=1)
        U, sizes, _ = np.linalg.svd(columns / _lengths(columns), full_matrices=False)
        return np.asarray(U[:, sizes > LEAST_EXCITATION * sizes[0]])

    def _own(self, terms: Terms, inside: FloatArray) -> FloatArray | None:
        """Orthonormal columns (r, k) of what terms add to a span; None where that is nothing."""
        columns = np.stack([self.columns[label] for label in terms.labels], axis=1)
        own = columns / _lengths(columns)
        for _ in range(2):  # the second time for round-off
            own = own - inside @ (inside.T @ own)
        Q, R = np.linalg.qr(own)
        return Q if np.abs(np.diag(R)).min() > OWN_EFFECT else None

    def _chance(self, own: FloatArray) -> float:
        """Logarithm of the probability of so large an estimate by errors alone."""
        u, count = own.T @ self.estimate, own.shape[1]
        squares = float(u @ np.linalg.solve(own.T @ self.covariance @ own, u))
        if count == 2:  # closed form, which does not underflow
            return float(-self.freedom / 2 * np.log1p(squares / self.freedom))
        from scipy.special import fdtrc  # slow to import

        chance = fdtrc(count, self.freedom, squares / count)
        return float(np.log(max(chance, np.finfo(float).tiny)))


def _lengths(columns: FloatArray) -> FloatArray:
    lengths = np.linalg.norm(columns, axis=0)
    return np.where(lengths > 0, lengths, 1.0)


@record
class FrictionCurve(Tabular):
    """Friction of a joint over its rate, with a 95 % band.

    Attributes
    ----------
    joint : str
    rates : FloatArray
        (k,), in m/s or rad/s.
    values : FloatArray
        (k,), in N or N m, along the rate.
    band : FloatArray
        (k, 2), ends of the 95 % intervals.
    """

    joint: str
    rates: FloatArray
    values: FloatArray
    band: FloatArray

    def _table(self) -> dict[str, FloatArray]:
        low, high = self.band.T
        return {"rate": self.rates, "friction": self.values, "low": low, "high": high}


@checked
def friction_curve(
    fit: FitResult, joint: str, rates: FloatArray, *, joint_terms: JointTerms | None = None
) -> FrictionCurve:
    """Friction of a joint over its rate, of all its terms that depend on the rate alone.

    Parameters
    ----------
    fit : FitResult
    joint : str
    rates : FloatArray
        (k,), in m/s or rad/s.
    joint_terms : JointTerms, optional
        Those of the force model, where they have a dead zone or are smoothed.

    Raises
    ------
    OptionError
        When the joint has no friction.

    Examples
    --------
    >>> import loopid, numpy as np
    >>> names = loopid.ParameterSet.from_labels(["elbow.Fc", "elbow.Fv"])
    >>> rng = np.random.default_rng(0)
    >>> rate = rng.normal(size=(500, 1))
    >>> W = np.stack([np.sign(rate), rate], axis=2)
    >>> force = W @ [2.0, 0.5] + 0.1 * rng.normal(size=(500, 1))
    >>> fit = loopid.fit(loopid.identification.FitSamples.of(names, ["elbow"], W, force))
    >>> curve = loopid.friction_curve(fit, "elbow", np.array([-1.0, 1.0]))
    >>> curve.values.round(1), bool((np.ptp(curve.band, axis=1) < 0.1).all())
    (array([-2.5,  2.5]), True)
    """
    from scipy.special import stdtrit  # slow to import

    columns = friction_columns(fit, joint)
    if not columns:
        raise OptionError.unknown("joint with friction", joint, frictional_joints(fit))
    rate = finite(rates, "rates")
    if rate.ndim != 1:
        raise DataError(f"rates must have shape (k,), not {rate.shape}", argument="rates")
    state = (joint_terms or JointTerms(())).state(JointState(None, rate, None))
    terms = [joint_term(fit.parameters[j].kind) for j in columns]
    laws = np.stack([term.signal(state, len(rate)) for term in terms], axis=1)
    values, spread = laws @ fit.values[columns], fit.covariance[np.ix_(columns, columns)]
    error = np.sqrt(np.maximum(((laws @ spread) * laws).sum(axis=1), 0.0))
    freedom = float(fit.degrees_of_freedom[columns].min())
    sure = freedom >= LEAST_FREEDOM and not {*fit.parameters.select(columns).names} & {*fit.assumed}
    reach = stdtrit(freedom, 0.975) * error if sure else np.full(len(rate), np.inf)
    return FrictionCurve(joint, rate, values, np.stack([values - reach, values + reach], axis=1))


def frictional_joints(fit: FitResult) -> tuple[str, ...]:
    """Joints with terms that depend on the rate alone."""
    return tuple(dict.fromkeys(name.link for name in fit.parameters if _friction(name.kind)))


def friction_columns(fit: FitResult, joint: str) -> list[int]:
    """Columns of a joint's terms that depend on the rate alone."""
    names = enumerate(fit.parameters)
    return [j for j, name in names if name.link == joint and _friction(name.kind)]


def _friction(kind: str) -> bool:
    return kind not in KINDS and joint_term(kind).friction
