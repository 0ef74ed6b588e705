"""Identification from recordings: all parameters, those that the data support, and a baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import DataError
from loopid.experiment.candidate import Candidate, judge
from loopid.experiment.force_model import ForceModel
from loopid.identification import (
    Estimator,
    FitResult,
    FitSamples,
    fit,
    fit_in_steps,
    quiet_fit,
)
from loopid.logs import Recording
from loopid.reduction import Reduction, eliminate

DEFAULT_FRACTION = 0.6  # of each recording's time that is fitted; the rest validates


@dataclass(frozen=True)
class Identification:
    """What recordings say about a mechanism.

    Attributes
    ----------
    force_model : ForceModel
    training, validation : tuple of Recording
    samples : tuple of FitSamples
        The same as samples of a fit.
    fit : FitResult
        All parameters of the force model.
    reduction : Reduction
        Corrections of the baseline that the data support.
    candidates : tuple of Candidate
        The robot file with friction (the baseline), all parameters, the supported corrections.
    """

    force_model: ForceModel
    training: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    samples: tuple[FitSamples, FitSamples]
    fit: FitResult
    reduction: Reduction
    candidates: tuple[Candidate, Candidate, Candidate]

    @property
    def baseline(self) -> Candidate:
        """Bodies of the robot file, joint terms fitted to the training data."""
        return self.candidates[0]

    @property
    def supported(self) -> Candidate:
        """Corrections of the robot file that the data support."""
        return self.candidates[2]

    @property
    def best(self) -> Candidate:
        """The candidate with the least validation error."""
        return min(self.candidates, key=lambda candidate: candidate.error_ratio[0])


def split_recordings(
    recordings: Sequence[Recording], fraction: float = DEFAULT_FRACTION
) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """The first part of each recording for training, the rest for validation."""
    parts = [recording.split(fraction) for recording in recordings]
    return tuple(part[0] for part in parts), tuple(part[1] for part in parts)


def identify(
    force_model: ForceModel,
    training: Sequence[Recording],
    validation: Sequence[Recording],
    estimator: Estimator | str = "wls",
    friction: Sequence[Recording] = (),
    n_jobs: int = 1,
) -> Identification:
    """Fit a force model to recordings, and say how much of it they support.

    Parameters
    ----------
    training, validation : sequence of Recording
        See ``split_recordings``.
    estimator : Estimator or str
        ``"wls"`` or ``"ols"``.
    friction : sequence of Recording, optional
        Recordings of an experiment of their own that the joint terms are identified from first;
        without them all parameters are fitted together.
    n_jobs : int
        Processes that work on the regressors; the result is the same to the bit.
    """
    data = (
        _gathered(force_model, training, n_jobs),
        _gathered(force_model, validation, n_jobs),
    )
    if friction:
        known = [force_model.parameters.labels[j] for j in force_model.joint_columns]
        fitted = fit_in_steps(_gathered(force_model, friction, n_jobs), data[0], known, estimator)
    else:
        fitted = fit(data[0], estimator)
    start, spread = _baseline(force_model, data[0], estimator)
    reduction = eliminate(*data, estimator, reference=force_model.prior)
    found = (
        ("robot file", len(force_model.joint_columns), start, spread),
        ("all parameters", len(start), fitted.values, fitted.covariance),
        ("supported parameters", reduction.supported, reduction.values, reduction.covariance),
    )
    first, second, third = (judge(*candidate, data, start) for candidate in found)
    recordings = tuple(training), tuple(validation)
    return Identification(force_model, *recordings, data, fitted, reduction, (first, second, third))


def _gathered(force_model: ForceModel, recordings: Sequence[Recording], n_jobs: int) -> FitSamples:
    if not recordings:
        raise DataError("identification needs recordings to fit, and others to validate")
    return FitSamples.combined([force_model.samples(recording, n_jobs) for recording in recordings])


def _baseline(
    force_model: ForceModel, samples: FitSamples, estimator: Estimator | str
) -> tuple[FloatArray, FloatArray]:
    """Values (n,) and covariance (n, n) with the bodies of the robot file, joint terms fitted."""
    values, joints = force_model.prior, force_model.joint_columns
    covariance = np.zeros((len(values), len(values)))
    if len(joints):
        left = samples.less(samples.predicted(values)).select(joints)
        terms = quiet_fit(left, estimator)
        values = values.copy()
        # A joint term may lead a combination with bodies: what the robot file says of it stays.
        values[joints] += terms.values
        covariance[np.ix_(joints, joints)] = terms.covariance
    return values, covariance
