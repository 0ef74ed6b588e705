"""A study of logs: an identification, and all that is worth asking of it."""

from __future__ import annotations

from collections.abc import Sequence

from loopid.arguments import checked
from loopid.diagnosis.selection import Reduction, eliminate, judge_essential
from loopid.diagnosis.term_sets import TermComparison, compare_terms
from loopid.findings import Finding, most_important_first
from loopid.identification.force_model import AUTOMATIC, chosen_terms, find_force_model
from loopid.identification.model_choice import chosen_model, require_model
from loopid.identification.pipeline import FitOptions, Identification, identify
from loopid.identification.prediction import Candidate
from loopid.identification.verdict import Verdict
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion
from loopid.records import record
from loopid.regressors.joint_terms import JointTerms
from loopid.robot.mechanism import Mechanism
from loopid.workers import Progress


@record(kw_only=True, checked=True)
class StudyOptions:
    """What a study asks for.

    Attributes
    ----------
    model : str
        ``"gravity"``, ``"full"``, or ``"auto"`` for the one that the recordings ask for
        (``choose_model``).
    terms : str
        Joint terms, a choice as of ``JointTerms.of``; by default those of ``find_force_model``.
    compared : tuple of str
        Further choices that are judged on new data.
    fit : FitOptions
        Of the identification.
    """

    model: str = AUTOMATIC
    terms: str = AUTOMATIC
    compared: tuple[str, ...] = ()
    fit: FitOptions = FitOptions()

    def require_terms(self, mechanism: Mechanism) -> None:
        """Refuse joint terms that a mechanism cannot have, before any work is done.

        Raises
        ------
        OptionError
            Naming the joint or the word.
        """
        model = require_model(self.model)
        chosen_terms(mechanism, "full" if model == AUTOMATIC else model, self.terms)
        for choice in self.compared:
            JointTerms.of(mechanism, choice)


@record
class Study:
    """An identification, and what was asked of it.

    Attributes
    ----------
    identification : Identification
    term_sets : TermComparison
        What sets of joint terms buy on new data.
    reduction : Reduction
        The essential parameters, by backward elimination.
    essential : Candidate
        These fitted, the others as in the robot file.
    """

    identification: Identification
    term_sets: TermComparison
    reduction: Reduction
    essential: Candidate

    @property
    def verdict(self) -> Verdict:
        """That of the identification."""
        return self.identification.verdict

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Those of the identification, and joint terms that are missing; the most serious first."""
        own, best = self.term_sets.chosen, self.term_sets.missing
        said = self.identification.findings
        if best is None:
            return said
        missing = Finding(
            "warning",
            f"joint terms {own.choice} are too few",
            f"with {best.choice} squared errors on new data are {best.errors[1].mean:.3g} instead "
            f"of {own.errors[1].mean:.3g}, and intervals do not hold what no term models",
            f'use terms="{best.choice}"',
        )
        return most_important_first((*said, missing))


@checked
def study_logs(
    mechanism: Mechanism,
    recordings: Sequence[Recording],
    *,
    validation: Sequence[Recording] | None = None,
    friction: Sequence[Recording] = (),
    references: Sequence[JointMotion] = (),
    options: StudyOptions = StudyOptions(),
    progress: Progress | None = None,
) -> Study:
    """Identify a robot from its logs, and look at the result from all sides.

    Parameters
    ----------
    recordings, validation, friction, references
        As of ``identify``.
    options : StudyOptions, optional
    progress : callable, optional
        Called with numbers of poses that the force model was made of, done and in all.

    Warns
    -----
    DataWarning
        Of all that ``identify`` warns of, and when further joint terms predict clearly better
        (``compare_terms``).

    Examples
    --------
    >>> import loopid, numpy as np
    >>> robot = loopid.load_mechanism("five_bar")
    >>> friction, values = loopid.JointTerms.with_values(robot, "Fv=1")
    >>> sine, cosine = 0.1 * np.random.default_rng(0).normal(size=(2, 2, 4))
    >>> series = loopid.FourierSeries(robot.actuated, 0.02, np.array([1.7, 0.7]), sine, cosine)
    >>> motion = loopid.joint_motion(robot, series.motion(100.0, 5.0))
    >>> log = loopid.simulate_measurement(
    ...     robot, motion, loopid.Noise(gaussian=0.01), joint_terms=friction, joint_values=values
    ... )
    >>> run = loopid.logs.Recording.of_motion(motion, log.force, robot.actuated)
    >>> study = loopid.study_logs(robot, [run])
    >>> study.term_sets.enough[1].choice
    'Fv'
    """
    options.require_terms(mechanism)

    model = chosen_model(mechanism, options.model, recordings)
    found = identify(
        find_force_model(mechanism, model, options.terms, progress=progress),
        recordings,
        validation=validation,
        friction=friction,
        references=references,
        options=options.fit,
    )
    return examine(found, options=options)


@checked
def examine(
    found: Identification,
    *,
    options: StudyOptions = StudyOptions(),
) -> Study:
    """Ask an identification all that a study asks; see ``study_logs``.

    Parameters
    ----------
    options : StudyOptions, optional
        Its model, terms and fit are those of the identification already.
    """
    reduction = eliminate(found)
    study = Study(
        found,
        compare_terms(found, choices=options.compared),
        reduction,
        judge_essential(found, reduction),
    )
    for each in study.findings:
        if each not in found.findings:
            each.warn()
    return study
