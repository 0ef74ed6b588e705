"""Which joint terms a robot needs: sets of them compared on data that were not fitted."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import DataError
from loopid.identification.force_models import ForceModel, parted, samples_of
from loopid.identification.identification import Identification, split_recordings
from loopid.identification.information import body_sizes
from loopid.identification.selection import PredictionError, prediction_errors
from loopid.numbers import root
from loopid.parameters import KINDS
from loopid.records import record
from loopid.regressors.joint_laws import grouped
from loopid.regressors.joint_terms import NO_TERMS, JointTerms, together
from loopid.robot.robot import Robot

# Singular values of the columns, relative to the largest, below which they count as zero.
NO_EFFECT = 1e-10
# Deviation of an actuator's errors, relative to its force, below which it is round-off.
ROUND_OFF = 1e-9


@record
class TermSet:
    """A set of joint terms, fitted with the bodies of the robot file and together with them.

    Attributes
    ----------
    choice : str
        As of ``JointTerms.of``.
    kinds : frozenset of tuple of str
        Joints and kinds of the terms.
    parameters : tuple of int
        What is fitted with the bodies of the robot file, and together with them.
    errors : tuple of PredictionError
        The same two on validation data, each beside the other sets; 1 is the variance of the fit's
        errors.
    """

    choice: str
    kinds: frozenset[tuple[str, str]]
    parameters: tuple[int, int]
    errors: tuple[PredictionError, PredictionError]

    @property
    def rms(self) -> tuple[tuple[float, float], ...]:
        """Root mean squares of the same errors, each with its standard error."""
        return tuple(root(each.mean, each.standard_error) for each in self.errors)


@record
class TermComparison:
    """What each set of joint terms buys, from ``compare_terms``.

    Attributes
    ----------
    sets : tuple of TermSet
    chosen : TermSet
        That of the force model.
    bodies_pay : bool
        Whether fitted bodies are clearly better than those of the robot file, each with the terms
        that are enough for it.
    """

    sets: tuple[TermSet, ...]
    chosen: TermSet
    bodies_pay: bool

    def __repr__(self) -> str:
        lines = (
            "  {}: {:.3g} ± {:.2g}, robot file {:.3g} ± {:.2g}".format(
                each.choice, *each.rms[1], *each.rms[0]
            )
            for each in self.sets
        )
        return "\n".join([f"TermComparison(enough: {self.enough[1].choice})", *lines])

    @property
    def enough(self) -> tuple[TermSet, TermSet]:
        """The set with the fewest parameters of those whose error is not clearly above the least.

        With the bodies of the robot file, and with fitted ones.
        """
        with_file, fitted = (self.sets[_enough(self.sets, k)] for k in (0, 1))
        return with_file, fitted

    @property
    def missing(self) -> TermSet | None:
        """A set that is clearly better with fitted bodies, and has terms that the chosen lacks.

        Where fewer terms predict better, the intervals of the chosen ones are as wide as they
        should be.
        """
        best, own = self.enough[1], self.chosen
        return None if own.errors[1].as_good or best.kinds <= own.kinds else best


def _enough(sets: Sequence[TermSet], k: int) -> int:
    good = [j for j, each in enumerate(sets) if each.errors[k].as_good]
    return min(good, key=lambda j: (sets[j].parameters[k], sets[j].errors[k].mean))


@checked
def compare_terms(found: Identification, *, choices: Sequence[str] = ()) -> TermComparison:
    """Fit sets of joint terms to the training data of an identification, and judge each on the new.

    The terms of its force model are compared with parts of them, with constant forces of the
    motors, and with the choices; all with the weights of its fit.

    Parameters
    ----------
    choices : sequence of str
        Further sets, as of ``JointTerms.of``.

    Raises
    ------
    DataError
        When the fit has no model of its errors.

    Examples
    --------
    A five-bar that has viscous friction only:

    >>> import loopid, numpy as np
    >>> from loopid.motion import FourierSeries, Noise
    >>> robot = loopid.load("five_bar")
    >>> friction, values = loopid.JointTerms.with_values(robot, "Fv=1")
    >>> sine, cosine = 0.1 * np.random.default_rng(0).normal(size=(2, 2, 4))
    >>> series = FourierSeries(robot.actuated, 0.02, np.array([1.7, 0.7]), sine, cosine)
    >>> motion = loopid.motion.joint_motion(robot, series.motion(100.0, 5.0))
    >>> log = loopid.simulate(
    ...     robot, motion, Noise(gaussian=0.01), joint_terms=friction, joint_values=values
    ... )
    >>> run = loopid.logs.Recording.of_motion(motion, log.force, robot.actuated)
    >>> found = loopid.identify(loopid.force_model(robot, "gravity", "Fc,Fv"), [run])
    >>> told = loopid.identification.compare_terms(found)
    >>> [each.choice for each in told.sets], told.enough[1].choice
    (['none', 'Fv', 'Fc,Fv', 'Fc,Fv,Fo'], 'Fv')
    """
    force_model, noise = found.force_model, found["all parameters"].fit.noise
    if noise is None:
        raise DataError("the fit has no model of its errors that sets could be weighted by")
    training, validation = found.training, found.validation
    if not validation:
        training, validation = split_recordings(training)
    prior_deviation, n_jobs = found.prior_deviation, found.options.n_jobs
    robot, (own, _) = force_model.robot, parted(force_model.joint_terms)
    asked = [JointTerms.of(robot, choice) for choice in choices]
    sets = _each_once([*_sets(robot, own), *({} if t is None else t.of_joints for t in asked)])
    whole = force_model.with_columns(together(*sets))
    # Beside friction whose size the evidence decides, as it was found.
    known = dict(zip(force_model.parameters.labels, found.fit.values.tolist(), strict=True))
    given = np.array([known[p.label] if grouped(p.kind) else 0.0 for p in whole.parameters])
    data, unseen = (samples_of(whole, runs, n_jobs=n_jobs) for runs in (training, validation))
    data, unseen = (each.less(each.predicted(given)) for each in (data, unseen))
    deviation = np.maximum(noise.deviation, ROUND_OFF * data.problem.force_rms)
    deviation = np.maximum(deviation, data.least_errors)
    present = (noise.samples > 0) & (deviation > 0)
    scale = np.divide(1.0, deviation, out=np.zeros(len(deviation)), where=present)
    worth = np.sqrt(noise.effective_samples / np.maximum(noise.samples, 1))
    factor = data.problem.weighted(scale * worth)
    fits = [_fits(whole, factor, kinds, prior_deviation) for kinds in sets]
    errors = [prediction_errors(unseen, [fit[k][1] for fit in fits], scale) for k in (0, 1)]
    judged = [
        TermSet(_choice(robot, kinds), _pairs(kinds), (fit[0][0], fit[1][0]), (with_file, fitted))
        for kinds, fit, with_file, fitted in zip(sets, fits, *errors, strict=True)
    ]
    chosen = [each.kinds for each in judged].index(_pairs(own.of_joints if own else {}))
    best = [fits[_enough(judged, k)][k][1] for k in (0, 1)]
    bodies_pay = not prediction_errors(unseen, best, scale)[0].as_good
    return TermComparison(tuple(judged), judged[chosen], bodies_pay)


Kinds: TypeAlias = Mapping[str, tuple[str, ...]]  # of each joint


def _sets(robot: Robot, own: JointTerms | None) -> list[Kinds]:
    """No terms, more and more friction of the motors, constant forces, all that was chosen."""
    chosen = {} if own is None else own.of_joints
    motors = [name for name in robot.actuated if robot.joint(name).nv == 1]

    def part(joints: Iterable[str], *beginnings: str) -> Kinds:
        return {
            joint: tuple(kind for kind in chosen.get(joint, ()) if kind.startswith(beginnings))
            for joint in joints
        }

    viscous, offsets = dict.fromkeys(motors, ("Fv",)), dict.fromkeys(motors, ("Fo",))
    coulomb = {joint: kinds or ("Fc",) for joint, kinds in part(motors, "Fc").items()}
    friction = together(coulomb, viscous)
    moving = together(friction, part(chosen, "Fc", "Fv", "Ia"))
    shifted = together(moving, offsets)
    return [{}, viscous, friction, moving, shifted, chosen, together(shifted, chosen)]


def _choice(robot: Robot, kinds: Kinds) -> str:
    terms = JointTerms.of_kinds(kinds)
    return NO_TERMS if terms is None else terms.choice(robot)


def _each_once(sets: Iterable[Kinds]) -> list[Kinds]:
    """Sets without those that say the same as one before."""
    found: dict[frozenset[tuple[str, str]], Kinds] = {}
    for each in sets:
        found.setdefault(_pairs(each), each)
    return list(found.values())


def _pairs(kinds: Kinds) -> frozenset[tuple[str, str]]:
    return frozenset((joint, kind) for joint, own in kinds.items() for kind in own)


def _fits(
    model: ForceModel, factor: FloatArray, kinds: Kinds, prior_deviation: float | None
) -> list[tuple[int, FloatArray]]:
    """Numbers of parameters and values (n,), with the bodies of the robot file and fitted ones.

    Least squares of standard parameters, which the data need not all determine; values are
    those of the base parameters, zero for terms that are not in the set.
    """
    base, n = model.base, len(model.base)
    bodies = np.array([name.kind in KINDS for name in base.parameters])
    terms = np.array([name.kind in kinds.get(name.link, ()) for name in base.parameters])
    start = np.where(bodies, model.standard_prior, 0.0)
    A, force = factor[:n, :n] @ base.matrix, factor[:n, n] - factor[:n, :n] @ base.values(start)
    units = np.linalg.norm(A, axis=0)
    units = np.divide(1.0, units, out=np.ones(len(units)), where=units > 0)
    units[bodies] = (prior_deviation or 1.0) * body_sizes(model.robot, model.model)
    prior = np.diag(bodies.astype(float))[bodies] if prior_deviation else np.zeros((0, len(units)))
    rows, right = np.vstack([A * units, prior]), np.append(force, np.zeros(len(prior)))
    found = []
    for free in (terms, terms | bodies):
        values = start.copy()
        values[free] += units[free] * np.linalg.lstsq(rows[:, free], right, rcond=NO_EFFECT)[0]
        told = np.linalg.matrix_rank(A[:, free] * units[free], rtol=NO_EFFECT) if free.any() else 0
        found.append((int(told), base.values(values)))
    return found
