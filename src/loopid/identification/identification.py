"""What recordings say about a robot: fits of it, judged, and all that is worth asking of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from loopid.arguments import FloatArray, checked
from loopid.errors import OptionError
from loopid.findings import Finding, most_important_first
from loopid.identification.consistent import CONSISTENT
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.delay import Delay
from loopid.identification.force_models import ForceModel
from loopid.identification.information import Identifiability
from loopid.identification.leaving_out import repeated_share
from loopid.identification.log_mistakes import LogFaults
from loopid.identification.missing import MissingForce
from loopid.identification.model_choice import ModelChoice
from loopid.identification.notes import checks_of, notes_of
from loopid.identification.options import FitOptions
from loopid.identification.prediction import Candidate, error_ratio
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.identification.sensor_noise import sensor_noise
from loopid.identification.unseen import UnseenErrors
from loopid.identification.verdict import Verdict, findings_of
from loopid.logs.recording import Recording
from loopid.numbers import root
from loopid.parameters import html_table
from loopid.records import record

if TYPE_CHECKING:
    from loopid.identification.selection import Reduction

# Of the moving samples that are fitted where many models are compared.
FRACTION = 0.6
CLEARLY_BETTER = 1.25  # ratio of errors above which another candidate is worth a word
# Names of the candidates.
ROBOT_FILE, ALL = "robot file", "all parameters"


@record
class Identification:
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
    """

    force_model: ForceModel
    training: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    friction: tuple[Recording, ...]
    data: FitSamples
    new: FitSamples
    identifiability: Identifiability
    candidates: Mapping[str, Candidate]
    options: FitOptions
    cutoff: CutoffChoice | None = None
    delay: Delay | None = None
    log_faults: tuple[LogFaults, ...] = ()
    missing: tuple[MissingForce, ...] = ()
    choice: ModelChoice | None = None

    def __getitem__(self, name: str) -> Candidate:
        if name not in self.candidates:
            raise OptionError.unknown("candidate", name, self.candidates)
        return self.candidates[name]

    @property
    def baseline(self) -> Candidate:
        """Bodies of the robot file, joint terms fitted to the training data."""
        return self[ROBOT_FILE]

    @property
    def recommended(self) -> Candidate:
        """What to predict and to export with.

        Consistent parameters, unless they are clearly worse on new data than the baseline; where
        an estimator was chosen, all parameters by that.
        """
        if CONSISTENT not in self.candidates:
            return self[ALL]
        return self.baseline if self[CONSISTENT].loses_to_baseline else self[CONSISTENT]

    @property
    def advantage(self) -> float | None:
        """How much smaller errors of all parameters are on new data than the recommended ones.

        The ratio of these, the geometric mean over the motors; None where it is not clearly more
        than 1.25.
        """
        ratio, error = error_ratio(self.new, self[ALL].predicted, self.recommended.predicted)[0]
        clear = ratio + 2 * error < CLEARLY_BETTER**-2
        return float(ratio**-0.5) if clear else None

    @property
    def parts(self) -> tuple[FitSamples, FitSamples]:
        """Samples to fit and others to judge, for comparisons of many models.

        Without validation the first and the last part of the training, both with all rows.
        """
        if self.validation:
            return self.data, self.new
        moving = np.cumsum(self.data.used.any(axis=1))
        first = (moving <= FRACTION * moving[-1])[:, None]
        used = self.data.used
        return replace(self.data, used=used & first), replace(self.data, used=used & ~first)

    @property
    def fit(self) -> Fit:
        """The recommended values with their uncertainty."""
        return self.recommended.fit

    @cached_property
    def unseen(self) -> UnseenErrors:
        """Errors of the recommended fit on data that it was not fitted to, by where."""
        runs = self.validation or self.training
        return UnseenErrors.of(self.recommended, self.force_model, self.new, runs)

    @cached_property
    def repeated(self) -> float:
        """Part of the fitted samples whose states come back in other segments, or logs."""
        return repeated_share(self.data, self.training)

    @cached_property
    def sensor_noise(self) -> FloatArray:
        """Noise (dof,) of the sensors of force in N or N m; NaN where it is undetermined."""
        every = np.array([sensor_noise(run) for run in self.training])
        known = ~np.isnan(every).all(axis=0)
        return np.where(known, np.nan_to_num(every, nan=0.0).max(axis=0), np.nan)

    @checked
    def relative_errors(self, candidate: Candidate) -> tuple[FloatArray, FloatArray]:
        """Errors on new data (dof,) in parts of each motor's force, and their standard errors.

        Root mean squares; NaN without samples.
        """
        force = self.new.problem.force_rms
        force = np.where(force > 0, force, np.nan)
        return candidate.validation.residual_rms / force, candidate.rms_errors[1] / force

    @property
    def prior_deviation(self) -> float | None:
        """Scale of the inertia prior, relative to the bodies; of consistent fits."""
        weighed = self.candidates.get(CONSISTENT)
        found = None if weighed is None else weighed.fit.deviation
        return None if found is None else found.common

    @property
    def mistakes(self) -> tuple[Finding, ...]:
        """Mistakes in the logs: no figure counts before they are mended."""
        found = (each for one in self.log_faults for each in one.mistakes)
        return tuple(each for each in found if each.severity == "mistake")

    @cached_property
    def reduction(self) -> Reduction:
        """The essential parameters, by backward elimination."""
        from loopid.identification.selection import eliminate  # stands on this

        return eliminate(self)

    @cached_property
    def essential(self) -> Candidate:
        """These fitted, the others as in the robot file."""
        from loopid.identification.selection import judge_essential  # stands on this

        return judge_essential(self, self.reduction)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What to know beside the numbers, the most important first."""
        return most_important_first([*findings_of(self), *notes_of(self)])

    @property
    def checks(self) -> tuple[tuple[bool, str], ...]:
        """What was checked, and whether it passed."""
        return checks_of(self)

    @property
    def verdict(self) -> Verdict:
        """What the recommended values are good for, and what would improve them most."""
        return Verdict.of(self)

    def __repr__(self) -> str:
        model, told = self.force_model, self.identifiability
        lines = [
            f"Identification({model.robot.name}, {model.model} model by "
            f"{self[ALL].fit.estimator}: {len(self.data)} samples fitted, {len(self.new)} to "
            "validate)",
            *(
                f"  {name}: {each.fitted} parameters fitted, error on new data "
                "{:.2f} ± {:.2f} of the robot file's".format(*root(*each.error_ratio))
                for name, each in self.candidates.items()
            ),
            f"  {told.rank} of {told.structural_rank} combinations excited by the data, "
            f"{told.well_determined} better known than by the robot file",
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
    >>> log = loopid.read_log(robot, "urdf/logs/five_bar.csv")
    >>> run = loopid.prepare(robot, log)
    >>> training, validation = loopid.identification.split_recordings([run], 0.75)
    >>> len(training[0]) + len(validation[0]) == len(run)
    True
    """
    parts = [recording.split(fraction) for recording in recordings]
    return tuple(part[0] for part in parts), tuple(part[1] for part in parts)
