"""A study of logs: an identification, and all that is worth asking of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from loopid.arguments import checked
from loopid.diagnosis.selection import Reduction, eliminate, judge_essential
from loopid.diagnosis.term_sets import TermComparison, compare_terms
from loopid.findings import Finding, most_important_first
from loopid.identification.force_model import AUTOMATIC, chosen_terms, find_force_model, parted
from loopid.identification.friction import friction_findings
from loopid.identification.hysteresis import hysteresis_loop, hysteretic_joints
from loopid.identification.model_choice import chosen_model, require_model
from loopid.identification.pipeline import ALL, FitOptions, Identification, identify
from loopid.identification.prediction import Candidate
from loopid.identification.verdict import Verdict, insignificant
from loopid.logs.recording import Recording
from loopid.motion.joints import JointMotion
from loopid.progress import Progress
from loopid.records import record
from loopid.regressors.joint_terms import NO_TERMS, JointTerms
from loopid.robot.mechanism import Mechanism
from loopid.workers import one_blas_thread

NAMED = 4  # parameters that a note names
IDLE = 0.3  # part of a motor's samples left out, above which it is worth a word


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
        """Those of the identification, joint terms that are missing, and notes."""
        said, missing = self.identification.findings, self._missing_terms
        return most_important_first((*said, *([missing] if missing else []), *_notes(self)))

    @property
    def _missing_terms(self) -> Finding | None:
        own, best = self.term_sets.chosen, self.term_sets.missing
        if best is None:
            return None
        times = np.sqrt(own.errors[1].mean / best.errors[1].mean)
        return Finding(
            "warning",
            f"joint terms {own.choice} are too few",
            f"with {best.choice} errors on new data are {times:.3g} times smaller, and intervals "
            "do not hold what no term models",
            f'use terms="{best.choice}"',
        )

    @property
    def checks(self) -> tuple[tuple[bool, str], ...]:
        """What was checked, and whether it passed."""
        found, delay = self.identification, self.identification.delay
        told, cutoff, pay = found.identifiability, found.cutoff, self.term_sets.bodies_pay
        every, known = told.structural_rank, told.well_determined
        said = [
            (not found.mistakes, "signs, units and order of motors", "a mistake is suspected"),
            (told.rank == every, "all combinations excited", f"{every - told.rank} not excited"),
            (
                known == every,
                "all known better than by the file",
                f"{every - known} less known than by the file",
            ),
            (pay, "fitted bodies predict better", "fitted bodies do not predict clearly better"),
        ]
        if delay is not None:
            said.insert(1, (not delay.clear, "no clear delay", "a delay, undone"))
        if cutoff is not None:
            said.append((not cutoff.bound, "filter within its range", "filter at a bound"))
        return tuple((bool(good), text if good else other) for good, text, other in said)


def _notes(study: Study) -> Iterator[Finding]:
    """What is good to know, and nothing wrong."""
    found = study.identification
    fit, told, cutoff = found.fit, found.identifiability, found.training[0].cutoff
    runs = (*found.training, *found.validation)
    filtered = "unfiltered" if cutoff is None else f"filtered at {cutoff:.3g} Hz"
    terms, _ = parted(found.force_model.joint_terms)
    choice = NO_TERMS if terms is None else terms.choice(found.force_model.mechanism)
    unclear = insignificant(fit)
    idle = [float(1 - run.used.mean(axis=0).min()) for run in runs]
    notes = [
        (f"recommended: {found.recommended.name}", _recommendation(found)),
        (
            f"the data were {filtered}",
            "the condition number of the weighted regressor is "
            f"{found[ALL].fit.condition_number:.4g}",
        ),
        (f"the joint terms are {choice}", _terms_note(study.term_sets)),
    ]
    if unclear:
        more = f" and {len(unclear) - NAMED} more" if len(unclear) > NAMED else ""
        title = f"{len(unclear)} values may as well be zero"
        notes.append((title, f"{', '.join(unclear[:NAMED])}{more}"))
    if max(idle) > IDLE:
        why = f"there, up to {100 * max(idle):.0f} % of a motor's samples are left out"
        notes.append(("motors stand still for much of the log", why))
    if frames := dict.fromkeys(frame for run in runs for frame in run.wrenches):
        notes.append(("measured wrenches are part of the forces", f"on {', '.join(frames)}"))
    notes += friction_findings(fit)
    notes += [hysteresis_loop(fit, joint).finding for joint in hysteretic_joints(fit)]
    if told.unidentifiable:
        title = "unidentifiable combinations are as in the robot file"
        notes.append((title, f"the values of {', '.join(told.assumed)} rest on it"))
    return (Finding("note", *note) for note in notes)


def _terms_note(found: TermComparison) -> str:
    with_file, fitted = (
        f"{'these are' if each is found.chosen else f'{each.choice} are'} enough with {bodies}"
        for each, bodies in zip(found.enough, ("the given bodies", "fitted bodies"), strict=True)
    )
    said = (
        f"On new data {fitted}, {with_file}: fitted bodies are "
        f"{'' if found.bodies_pay else 'not '}clearly better."
    )
    good = found.chosen.errors[1].as_good
    return said if good else f'{said} Try terms="{found.enough[1].choice}".'


def _recommendation(found: Identification) -> str:
    said = f"Recommended, and written to parameters.yaml: {found.recommended.name}"
    if found.recommended is found.baseline:
        return f"{said} with fitted joint terms, as fitted bodies are clearly worse on new data."
    deviation = found.fit.deviation
    if deviation is None:
        return f"{said} by {found.fit.estimator}."
    return f"{said} parameters, every body solid; {deviation.sentence}."


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
@one_blas_thread()
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
