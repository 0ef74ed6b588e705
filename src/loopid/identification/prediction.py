"""What a saved fit predicts for a recording that it need not have seen."""

from __future__ import annotations

from functools import cached_property
from html import escape

import numpy as np

from loopid.arguments import BoolArray, FloatArray, checked
from loopid.errors import DataError, OptionError
from loopid.files import csv_text
from loopid.identification.force_model import ForceModel
from loopid.identification.result import FitResult, Quality
from loopid.identification.saved import SavedFit
from loopid.logs.recording import Recording
from loopid.parameters import html_table
from loopid.records import record
from loopid.robot.mechanism import Mechanism


@record
class Prediction:
    """Measured forces beside those that a fit gives for the same motion.

    Attributes
    ----------
    recording : Recording
        Its ``force`` (N, dof) is what was measured, its ``used`` (N, dof) where motors move.
    predicted : FloatArray
        (N, dof) in N or N m.
    """

    recording: Recording
    predicted: FloatArray

    @property
    def residual(self) -> FloatArray:
        """Measured less predicted (N, dof) in N or N m."""
        return np.asarray(self.recording.force - self.predicted, dtype=np.float64)

    @cached_property
    def moving(self) -> Quality:
        """Errors where each motor moves and is not saturated."""
        return self._quality(self.recording.used)

    @cached_property
    def standing(self) -> Quality:
        """Errors elsewhere: there, friction is not known, and a model says little."""
        return self._quality(~self.recording.used)

    def _quality(self, chosen: BoolArray) -> Quality:
        force, residual, samples = self.recording.force, self.residual, chosen.sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = np.where(chosen, force, 0.0).sum(axis=0) / samples
            total = (np.where(chosen, force - mean, 0.0) ** 2).sum(axis=0)
            squares = (np.where(chosen, residual, 0.0) ** 2).sum(axis=0)
            rms, r_squared = np.sqrt(squares / samples), 1.0 - squares / total
        return Quality(rms, np.where(total > 0, r_squared, np.nan), samples)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """For each motor samples, RMS error and R² while it moves; samples and error elsewhere."""
        moving, standing = self.moving, self.standing
        return [
            (
                motor,
                f"{moving.samples[k]:,}",
                f"{moving.residual_rms[k]:.4g}",
                f"{moving.r_squared[k]:.4f}",
                f"{standing.samples[k]:,}",
                f"{standing.residual_rms[k]:.4g}" if standing.samples[k] else "-",
            )
            for k, motor in enumerate(self.recording.actuators)
        ]

    def __repr__(self) -> str:
        told = zip(self.recording.actuators, self.moving.r_squared, strict=True)
        shares = ", ".join(f"{motor} {value:.3f}" for motor, value in told)
        return f"<Prediction of {self.recording.name!r}: R² where motors move: {shares}>"

    def _repr_html_(self) -> str:
        head = "motor", "moving", "RMS error", "R²", "standing", "RMS error"
        return f"<p>{escape(repr(self))}</p>{html_table(head, self.rows)}"

    def csv(self) -> str:
        """A table of text: time, then measured, predicted and used of each motor."""
        recording, names = self.recording, ["time"]
        for motor in recording.actuators:
            names += [f"{motor}.{what}" for what in ("force", "predicted", "used")]
        tables = np.stack([recording.force, self.predicted, recording.used], axis=2)
        return csv_text(names, recording.motion.time, tables.reshape(len(recording), -1))


@checked
def predict(
    fit: SavedFit | FitResult, robot: Mechanism | ForceModel, recording: Recording
) -> Prediction:
    """Forces that a fit gives for the motion of a recording.

    Parameters
    ----------
    fit : SavedFit or FitResult
        From ``read_fit``, or of an identification.
    robot : Mechanism or ForceModel
        The robot of a saved fit; the force model of a fit that is not saved, whose combinations of
        parameters only that knows.
    recording : Recording
        From ``prepare_recording``, of that robot.

    Raises
    ------
    OptionError
        When a fit that is not saved comes without its force model.
    DataError
        When the robot is another one than that of the fit, or has other motors than the recording.

    Examples
    --------
    >>> import loopid, tempfile, numpy as np
    >>> robot = loopid.load_mechanism("four_bar")
    >>> model = loopid.find_force_model(robot, "full", None)
    >>> series = loopid.FourierSeries(robot.actuated, 0.5, [1.0], [[0.2]], [[0.0]])
    >>> motion = loopid.joint_motion(robot, series.motion(rate=20))
    >>> run = loopid.simulate_measurement(robot, motion)
    >>> recording = loopid.logs.Recording.of_motion(motion, run.force, robot.actuated)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     fit = loopid.read_fit(loopid.save_fit(f"{folder}/fit.json", model, model.prior))
    >>> loopid.predict(fit, robot, recording)
    <Prediction of 'run': R² where motors move: crank_joint 1.000>
    """
    model = _force_model(fit, robot)
    if recording.actuators != model.mechanism.independent:
        raise DataError(
            f"recording {recording.name} is of {', '.join(recording.actuators)}, but the fit of "
            f"{', '.join(model.mechanism.independent)}",
            recording=recording.name,
        )
    return Prediction(recording, model.samples(recording).predicted(fit.values))


def _force_model(fit: SavedFit | FitResult, robot: Mechanism | ForceModel) -> ForceModel:
    """The force model of a fit."""
    if isinstance(fit, SavedFit):
        return fit.find_force_model(robot if isinstance(robot, Mechanism) else robot.mechanism)
    if isinstance(robot, Mechanism):
        raise OptionError(
            "a fit that is not saved needs its ForceModel: predict(found.fit, found.force_model, "
            "recording)"
        )
    if fit.parameters != robot.parameters:
        raise DataError("the fit is of other parameters than the force model has")
    return robot
