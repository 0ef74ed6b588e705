"""What values predict, with bands that new forces lie in."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from loopid.arguments import BoolArray, FloatArray, checked, finite, variances
from loopid.errors import DataError
from loopid.files import csv_text
from loopid.identification.estimates import Estimates
from loopid.identification.friction_curves import (
    DOUBT,
    breakaway,
    friction_columns,
    friction_doubt,
    load_columns,
)
from loopid.identification.quality import Quality
from loopid.logs.preparing import at_cutoff, highest_cutoff
from loopid.logs.recording import Recording, require_robot
from loopid.numbers import NORMAL_95
from loopid.records import Tabular, columns_of, record


@record(checked="outside")
class Prediction(Tabular):
    """Measured forces beside those that a fit gives for the same motion.

    Attributes
    ----------
    recording : Recording
        Its ``force`` (N, dof) is what was measured, its ``used`` (N, dof) where motors move.
    predicted : FloatArray
        (N, dof) in N or N m.
    reach : FloatArray or None
        (N, dof), half the width of the band that holds 95 % of new forces, also while motors stand;
        None where the fit knows no errors.

    Examples
    --------
    >>> import loopid
    >>> found = loopid.identify(loopid.load("five_bar"), "urdf/logs/five_bar.csv")
    >>> prediction = found.fit.predict("urdf/logs/five_bar.csv")
    >>> prediction.predicted.shape == prediction.recording.force.shape
    True
    """

    recording: Recording
    predicted: FloatArray
    reach: FloatArray | None = None

    def _table(self) -> dict[str, FloatArray]:
        run = self.recording
        forces = {"force": run.force, "predicted": self.predicted}
        return columns_of(run.actuators, run.motion.time, **forces)

    @property
    def residual(self) -> FloatArray:
        """Measured less predicted (N, dof) in N or N m."""
        return np.asarray(self.recording.force - self.predicted, dtype=np.float64)

    @property
    def inside(self) -> FloatArray | None:
        """Part (dof,) of the forces that is in the band, where motors move; NaN where none does."""
        if self.reach is None:
            return None
        used = self.recording.used
        held = (used & (np.abs(self.residual) <= self.reach)).sum(axis=0)
        return np.asarray(
            np.where(used.any(axis=0), held / np.maximum(used.sum(axis=0), 1), np.nan)
        )

    @cached_property
    def moving(self) -> Quality:
        """Errors where each motor moves and is not saturated."""
        return self._quality(self.recording.used)

    @property
    def relative_errors(self) -> FloatArray:
        """Errors where each motor moves (dof,), in parts of its force there; NaN without force."""
        used = self.recording.used
        squares = np.where(used, self.recording.force, 0.0) ** 2
        size = np.sqrt(squares.sum(axis=0) / np.maximum(used.sum(axis=0), 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(size > 0, self.moving.residual_rms / size, np.nan)

    @cached_property
    def standing(self) -> Quality:
        """Errors elsewhere: there, friction is not known, and a model says little.

        Not of a force of zero all along, which was not recorded.
        """
        return self._quality(~self.recording.used & self.recording.force.any(axis=0))

    def _quality(self, chosen: BoolArray) -> Quality:
        samples, force = chosen.sum(axis=0), np.where(chosen, self.recording.force, 0.0)
        squares = (np.where(chosen, self.residual, 0.0) ** 2).sum(axis=0)
        mean = force.sum(axis=0) / np.maximum(samples, 1)
        return Quality.of_sums(samples, squares, (force**2).sum(axis=0), mean)

    def __repr__(self) -> str:
        errors = zip(self.recording.actuators, self.relative_errors, strict=True)
        shares = ", ".join(f"{motor} {error:.2%}" for motor, error in errors)
        return f"<Prediction of {self.recording.name!r}: errors where motors move: {shares}>"

    def csv(self) -> str:
        """A table of text: time, then measured, predicted and used of each motor."""
        recording, names = self.recording, ["time"]
        for motor in recording.actuators:
            names += [f"{motor}.{what}" for what in ("force", "predicted", "used")]
        tables = np.stack([recording.force, self.predicted, recording.used], axis=2)
        return csv_text(names, recording.motion.time, tables.reshape(len(recording), -1))


def predicted(fit: Estimates, recording: Recording) -> Prediction:
    """What a fit gives for a recording of its robot."""
    model = fit.require_model()
    require_robot(recording, model.robot)
    if fit.cutoff is not None and recording.log is not None:
        cutoff = min(fit.cutoff, highest_cutoff(recording.log))  # a slower log has a narrower band
        (recording,) = at_cutoff(model.robot, [recording], cutoff)
    samples = model.samples(recording)
    reach = reach_of(fit, recording, samples.regressor)
    return Prediction(recording, samples.predicted(fit.values), reach)


def reach_of(fit: Estimates, recording: Recording, regressor: FloatArray) -> FloatArray | None:
    """Half the width (N, dof) of the band of a fit; None where it knows no errors."""
    if fit.unseen_rms is None:
        return None
    errors = np.nan_to_num(fit.unseen_rms) ** 2 + _friction_doubt(fit, recording, regressor)
    return prediction_reach(regressor, fit.covariance, np.sqrt(errors))


def _friction_doubt(fit: Estimates, recording: Recording, regressor: FloatArray) -> FloatArray:
    """Mean squares (N, dof) of friction that a fit does not know.

    Of motors that are slower or faster than in its data. And of those that stand or turn back,
    whose friction is anything up to breakaway, either way, whatever is predicted.
    """
    loads, resting = fit.require_model().loads(regressor), recording.resting
    found = np.zeros(recording.force.shape)
    for k, motor in enumerate(recording.actuators):
        columns, gear = friction_columns(fit, motor), load_columns(fit, motor)
        size = np.abs(regressor[:, k, columns] @ fit.values[columns])
        found[:, k] = friction_doubt(fit, motor, recording.motion.velocities[:, k], size) ** 2
        size = size + np.abs(regressor[:, k, gear] @ fit.values[gear])
        most = breakaway(fit, motor, loads[:, k])
        even = 1 / 3 + DOUBT**2  # mean square of what is anything up to 1, which is in doubt
        found[:, k] += resting[:, k] ** 2 * (most**2 * even + size**2)
    return found


@checked
def prediction_reach(
    regressor: FloatArray, covariance: FloatArray, errors: FloatArray | None = None
) -> FloatArray:
    """Half the width (N, dof) of 95 % intervals of the forces that a regressor predicts.

    By a regressor (N, dof, n) and the covariance (n, n) of the parameters alone they hold what the
    model says. With errors on unseen data (dof,) or (N, dof), root mean squares in N or N m as
    ``Fit.unseen_rms``, which are those of sensors and of what the model lacks, they hold new
    forces; NaN for unknown ones.
    """
    # The order of numbers in memory would decide the last bits.
    W = np.ascontiguousarray(finite(regressor, "regressor"))
    C = np.ascontiguousarray(finite(covariance, "covariance"))
    if W.ndim != 3 or C.shape != 2 * W.shape[2:]:
        raise DataError(
            f"a regressor (N, dof, n) needs a covariance (n, n), not {W.shape} and {C.shape}"
        )
    unseen = 0.0 if errors is None else np.nan_to_num(errors) ** 2
    return np.asarray(NORMAL_95 * np.sqrt(variances(W, C) + unseen), dtype=np.float64)
