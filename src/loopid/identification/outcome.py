"""What an identification found: models, samples and candidates, and which of these is best."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import OptionError
from loopid.findings import Finding
from loopid.identification.candidate import Candidate, error_ratio
from loopid.identification.consistent import CONSISTENT
from loopid.identification.cutoff import CutoffChoice
from loopid.identification.delay import Delay
from loopid.identification.force_models import ForceModel
from loopid.identification.information import Identifiability
from loopid.identification.leaving_out import repeated_share
from loopid.identification.load_change import LogChange, load_change, log_difference
from loopid.identification.log_mistakes import LogFaults
from loopid.identification.missing import MissingForce
from loopid.identification.model_choice import ModelChoice
from loopid.identification.options import FitOptions
from loopid.identification.problem import FitSamples
from loopid.identification.result import Fit
from loopid.identification.sensor_noise import sensor_noise
from loopid.identification.unseen import ErrorBurst, UnseenErrors, outstanding
from loopid.logs.recording import Recording
from loopid.numbers import number
from loopid.records import record

# Of the moving samples that are fitted where many models are compared.
FRACTION = 0.6
# Error on new data as a part of a motor's force, in the root mean square: above, a fit is not fit
# for use.
ROUGH = 0.3
CLEARLY_BETTER = 1.25  # ratio of errors above which another candidate is worth a word
# Names of the candidates.
ROBOT_FILE, ALL = "robot file", "all parameters"


@record(checked="outside")
class Outcome:
    """What an ``Identification`` found; there, what each attribute is, and what it says."""

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

        Consistent parameters, unless they are clearly worse on new data than the baseline. Where an
        estimator was chosen, all parameters by that.
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

    @cached_property
    def fit(self) -> Fit:
        """The recommended values with their uncertainty, and whether a force is unexplained."""
        fit, worst = self.recommended.fit, self.unseen.worst
        if not worst[2] > ROUGH:
            return fit
        motor, size = self.new.actuators[worst[1]], number(100 * worst[2], 2)
        said = f"errors of {motor} on new data are {size} % of its force"
        return replace(fit, unexplained=(said,))

    @cached_property
    def unseen(self) -> UnseenErrors:
        """Errors of the recommended fit on data that it was not fitted to, by where."""
        runs = self.validation or self.training
        return UnseenErrors.of(self.recommended, self.new, runs)

    @cached_property
    def outstanding(self) -> ErrorBurst | None:
        """The short time in which the recommended fit errs far more than ever else."""
        return outstanding(self.recommended.fit, self.data, self.training)

    @cached_property
    def log_difference(self) -> LogChange | None:
        """How one of the logs that were fitted differs from the others."""
        return log_difference(self.force_model, self.data, self.training)

    @cached_property
    def load_change(self) -> LogChange | None:
        """The time at which a load comes or goes in a log that was fitted."""
        return load_change(self.force_model, self.data, self.training)

    @cached_property
    def repeated(self) -> float:
        """Part of the fitted samples whose states come back in other segments, or logs."""
        return repeated_share(self.data, self.training)

    @cached_property
    def sensor_noise(self) -> FloatArray:
        """Noise (dof,) of the sensors of force in N or N m; NaN where it is undetermined."""
        return np.asarray(np.fmax.reduce([sensor_noise(run) for run in self.training]))

    def relative_errors(self, candidate: Candidate) -> tuple[FloatArray, FloatArray]:
        """Errors on new data (dof,) in parts of each motor's force, and their standard errors.

        Root mean squares; NaN without samples.
        """
        force = self.new.problem.force_rms
        force = np.where(force > 0, force, np.nan)
        return candidate.validation.residual_rms / force, candidate.rms_errors[1] / force

    @property
    def singular(self) -> Finding | None:
        """Singular poses that a log passes."""
        return next((one.singular for one in self.log_faults if one.singular is not None), None)

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
