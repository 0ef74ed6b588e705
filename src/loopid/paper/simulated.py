"""Table IV and figure 4: base parameters fitted to the simulated forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.experiment import ForceModel
from loopid.identification import (
    FitResult,
    FitSamples,
    influence,
    quiet_fit,
    truncated_values,
)
from loopid.paper.base import BaseComparison
from loopid.paper.experiment import DRAWS, Experiment, frictionless_recordings
from loopid.paper.printed import TABLE_IV
from loopid.seeds import derived_seed, random_generator

FIRST = len(TABLE_IV)
INFLUENCE_DRAWS = 300  # of the estimates, for intervals of what follows from them


@dataclass(frozen=True)
class SimulatedFit:
    """Fits to the nine trajectories together, base parameters in the order of Table II.

    Attributes
    ----------
    truth : FloatArray
        (15,), values from the robot file.
    fifteen, eight : FitResult
        With all base parameters, and with the first eight.
    expected : FloatArray
        (8,), what leaving out the other seven must make of the first eight.
    expected_range : FloatArray
        (8, 2), least and greatest of the same over single trajectories.
    condition_numbers : dict
        cond(W_1) with 15 and 8 parameters, by trajectory; all nine under ``"all"``.
    influence, influence_reach : FloatArray
        (15,) p_i in %, and half the width of its 95 % interval from the fit's covariance.
    alone : FloatArray
        (15,), rms in N of the forces that each parameter makes alone.
    explained : FloatArray
        (15,) part of the forces that the first i parameters explain, 1 - |T - A_i| / |T|, in %.
    """

    truth: FloatArray
    fifteen: FitResult
    eight: FitResult
    expected: FloatArray
    expected_range: FloatArray
    condition_numbers: dict[str, tuple[float, float]]
    influence: FloatArray
    influence_reach: FloatArray
    alone: FloatArray
    explained: FloatArray


def fit_simulated(experiment: Experiment, comparison: BaseComparison, seed: int) -> SimulatedFit:
    """Fit all, and the first eight, base parameters to noisy forces of the nine trajectories."""
    single = ordered_samples(experiment, comparison, seed)
    whole, truth = FitSamples.combined(list(single.values())), ordered_truth(comparison)
    first = whole.select(range(FIRST))
    fifteen, eight = quiet_fit(whole, "ols"), quiet_fit(first, "ols")
    bent = np.stack([truncated_values(part.problem, truth, FIRST) for part in single.values()])
    pulled = {"all": whole} | single
    return SimulatedFit(
        truth=truth,
        fifteen=fifteen,
        eight=eight,
        expected=truncated_values(whole.problem, truth, FIRST),
        expected_range=np.stack([bent.min(axis=0), bent.max(axis=0)], axis=1),
        condition_numbers={name: _conditions(part) for name, part in pulled.items()},
        influence=influence(whole, fifteen.values),
        influence_reach=_influence_reach(whole, fifteen, seed),
        alone=np.sqrt(((whole.regressor * truth) ** 2).mean(axis=(0, 1))),
        explained=_explained(whole, fifteen.values),
    )


def ordered_samples(
    experiment: Experiment, comparison: BaseComparison, seed: int
) -> dict[str, FitSamples]:
    """Samples of each trajectory with columns in the order of Table II."""
    force_model = ForceModel(experiment.mechanism, "gravity", None, comparison.base)
    recordings = frictionless_recordings(experiment, seed)
    return {
        recording.name: force_model.samples(recording).select(comparison.order)
        for recording in recordings
    }


def ordered_truth(comparison: BaseComparison) -> FloatArray:
    """Values (15,) from the robot file, in the order of Table II."""
    standard = comparison.mechanism.standard_parameters("gravity")
    return comparison.base.values(standard)[comparison.order]


def _conditions(samples: FitSamples) -> tuple[float, float]:
    W = samples.regressor.reshape(-1, len(samples.parameters))
    return float(np.linalg.cond(W)), float(np.linalg.cond(W[:, :FIRST]))


def _explained(samples: FitSamples, values: FloatArray) -> FloatArray:
    """Share of the forces' norm (n,) that the first i parameters explain, in %."""
    force = np.linalg.norm(samples.force)
    partial = np.cumsum(samples.regressor * values, axis=2)
    left = np.linalg.norm(samples.force[:, :, None] - partial, axis=(0, 1))
    return np.asarray(100 * (1 - left / force), dtype=np.float64)


def _influence_reach(samples: FitSamples, result: FitResult, seed: int) -> FloatArray:
    """Half the width (n,) of 95 % intervals of p_i, from draws of the estimates."""
    generator = random_generator(derived_seed(seed, DRAWS))
    draws = generator.multivariate_normal(result.values, result.covariance, INFLUENCE_DRAWS)
    shares = np.stack([influence(samples.problem, values) for values in draws])
    low, high = np.percentile(shares, [2.5, 97.5], axis=0)
    return np.asarray((high - low) / 2, dtype=np.float64)
