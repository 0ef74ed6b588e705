"""What recordings say about a robot: the outcome, a verdict on it, and what to know beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from html import escape

from loopid.arguments import checked
from loopid.errors import counted, first_of
from loopid.findings import Finding, most_important_first
from loopid.identification.candidate import Candidate
from loopid.identification.force_models import parted
from loopid.identification.friction import friction_findings
from loopid.identification.outcome import ALL, FRACTION, Outcome
from loopid.identification.selection import Reduction, eliminate, judge_essential
from loopid.identification.terms import without_offset
from loopid.identification.verdict import Verdict, findings_of, insignificant
from loopid.logs.recording import Recording
from loopid.numbers import root
from loopid.parameters import html_table
from loopid.records import record
from loopid.regressors.joint_terms import NO_TERMS

NAMED = 4  # parameters that a note names
IDLE = 0.3  # part of a motor's samples left out, above which it is worth a word


@record(checked="outside")
class Identification(Outcome):
    """What recordings say about a robot; candidates and parameters are found by name.

    Attributes
    ----------
    force_model : ForceModel
    training, validation, friction : tuple of Recording
        What was fitted, what judged, and what the joint terms alone were identified from, if any.
        Without validation each segment of the training was predicted by fits to the others.
    data, new : FitSamples
        Training, and what judges, as samples of a fit.
    identifiability : Identifiability
        Identifiability of the fitted parameters from the training data.
    candidates : dict of Candidate
        ``"robot file"``: its bodies, and joint terms that are fitted; ``"all parameters"``: all
        fitted by the estimator; ``"consistent"``, with weighted least squares as the estimator:
        all fitted with the robot file weighed, every body solid.
    options : FitOptions
    cutoff : CutoffChoice or None
        Of the filter; None if the caller fixed it.
    delay : Delay or None
        Between forces and motion, what is clear of it undone in all recordings; None where it was
        not looked for, and for motions without a log.
    log_faults : tuple of LogFaults
        What may be wrong with each log.
    missing : tuple of MissingForce
        Forces that the data have beside the consistent fit, clearly or likely, and hidden springs.
    choice : ModelChoice or None
        The model that the recordings ask for; None where a full one was given.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.identify(loopid.load("five_bar"), "urdf/logs/five_bar.csv")
    >>> found.verdict.forces, len(found.fit.parameters), list(found.candidates)
    ('yes', 17, ['robot file', 'all parameters', 'consistent'])
    """

    @cached_property
    def reduction(self) -> Reduction:
        """The essential parameters, by backward elimination."""
        return eliminate(self)

    @cached_property
    def essential(self) -> Candidate:
        """These fitted, the others at the robot file's values."""
        return judge_essential(self, self.reduction)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What to know beside the numbers, the most important first."""
        return most_important_first([*findings_of(self), *notes_of(self)])

    @property
    def checks(self) -> tuple[tuple[bool, str], ...]:
        """What was checked, and whether it passed."""
        delay, excited, cutoff = self.delay, self.identifiability, self.cutoff
        hidden = excited.structural_rank - excited.rank
        unsure = excited.structural_rank - excited.well_determined
        fitted = self.recommended.beats_baseline
        said = [(not self.mistakes, "signs, units and order of motors", "a mistake is suspected")]
        if delay is not None:
            said.append((not delay.clear, "no clear delay", "a delay, undone"))
        said += [
            (not hidden, "all combinations excited", f"{hidden} not excited"),
            (not unsure, "all known better than by the file", f"{unsure} less known than by it"),
            (fitted, "fitted bodies predict better", "fitted bodies do not predict better"),
        ]
        if cutoff is not None:
            said.append((not cutoff.bound, "filter within its range", "filter at a bound"))
        return tuple((bool(good), text if good else other) for good, text, other in said)

    @property
    def verdict(self) -> Verdict:
        """What the recommended values are good for, and what would improve them most."""
        return Verdict.of(self)

    def __repr__(self) -> str:
        model, excited = self.force_model, self.identifiability
        lines = [
            f"Identification({model.robot.name}, {model.model} model by "
            f"{self[ALL].fit.estimator}: {len(self.data)} samples fitted, {len(self.new)} to "
            "validate)",
            *(
                f"  {name}: {each.fitted} parameters fitted, error on new data "
                "{:.2f} ± {:.2f} of the robot file's".format(*root(*each.error_ratio))
                for name, each in self.candidates.items()
            ),
            f"  {excited.rank} of {excited.structural_rank} combinations excited by the data, "
            f"{excited.well_determined} better known than by the robot file",
        ]
        return "\n".join(
            [*lines, *(f"  {each.severity}: {each.brief}" for each in self.mistakes[:1])]
        )

    def _repr_html_(self) -> str:
        said = [f"<p>{escape(str(self.verdict))}</p>"]
        said += [f"<p>{escape(f'{each.severity}: {each}')}</p>" for each in self.findings]
        head = "candidate", "parameters fitted", "error on new data, of the robot file's"
        rows = [(n, c.fitted, *root(*c.error_ratio)) for n, c in self.candidates.items()]
        return "".join(said) + html_table((*head, "±"), rows)


def notes_of(found: Outcome) -> Iterator[Finding]:
    """What is good to know, and nothing wrong."""
    fit, excited, cutoff = found.fit, found.identifiability, found.training[0].cutoff
    runs = (*found.training, *found.validation)
    filtered = "unfiltered" if cutoff is None else f"filtered at {cutoff:.3g} Hz"
    model = found.force_model
    terms, _ = parted(model.joint_terms)
    choice = NO_TERMS if terms is None else terms.choice(model.robot)
    without = first_of(without_offset(model, found.data), NAMED)
    unclear = insignificant(fit)
    left_out = (~run.used & run.force.any(axis=0) for run in runs)
    idle = [float(each.mean(axis=0).max()) for each in left_out]
    notes = [
        (f"recommended: {found.recommended.name}", _recommendation(found)),
        (
            f"the data were {filtered}",
            "the condition number of the weighted regressor is "
            f"{found[ALL].fit.condition_number:.4g}",
        ),
        (
            f"the joint terms are {choice}",
            f"the data do not determine the offset of {without}" * bool(without),
        ),
    ]
    if unclear:
        title = f"{counted(len(unclear), 'value')} may as well be zero"
        notes.append((title, first_of(unclear, NAMED)))
    if max(idle) > IDLE:
        why = f"there, up to {100 * max(idle):.0f} % of a motor's samples are left out"
        notes.append(("motors stand still for much of the log", why))
    if frames := dict.fromkeys(frame for run in runs for frame in run.wrenches):
        notes.append(("measured wrenches are part of the forces", f"on {', '.join(frames)}"))
    notes += friction_findings(fit)
    if excited.unidentifiable:
        title = "unidentifiable combinations keep the robot file's values"
        notes.append((title, f"the values of {', '.join(excited.assumed)} rest on it"))
    yield from (Finding("note", *note) for note in notes)


def _recommendation(found: Outcome) -> str:
    said = f"Recommended, and written to parameters.yaml: {found.recommended.name}"
    if found.recommended is found.baseline:
        return f"{said} with fitted joint terms, as fitted bodies are clearly worse on new data."
    deviation = found.fit.deviation
    if deviation is None:
        return f"{said} by {found.fit.estimator}."
    return f"{said} parameters, every body solid; {deviation.sentence}."


@checked
def split_recordings(
    recordings: Sequence[Recording], fraction: float = FRACTION
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """The first part of each recording's moving samples for training, the rest for validation.

    Parameters
    ----------
    recordings : sequence of Recording
    fraction : float
        Of the samples of each recording in which a motor moves, between 0 and 1.

    Returns
    -------
    training, validation : tuple of Recording

    Raises
    ------
    OptionError
        When the fraction is not between 0 and 1.

    Examples
    --------
    >>> import loopid
    >>> robot = loopid.load("five_bar")
    >>> log = loopid.read_log("urdf/logs/five_bar.csv", robot)
    >>> run = loopid.prepare(robot, log)
    >>> training, validation = loopid.identification.split_recordings([run], 0.75)
    >>> len(training[0]) + len(validation[0]) == len(run)
    True
    """
    parts = [recording.split(fraction) for recording in recordings]
    return tuple(part[0] for part in parts), tuple(part[1] for part in parts)
