"""How often the intervals of the simulated fit hold the truth, over many draws of the noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray
from loopid.identification import FitSamples, quiet_fit
from loopid.paper.experiment import COVERAGE
from loopid.paper.printed import FORCE_NOISE
from loopid.progress import Progress
from loopid.seeds import derived_seed, random_generator

LEVEL = 0.95


@dataclass(frozen=True)
class Coverage:
    """Shares of repetitions whose intervals hold the truth.

    Attributes
    ----------
    repetitions : int
    samples : int
        Per actuator, in each repetition.
    shares : FloatArray
        (15,), at a level of 95 %.
    bias : FloatArray
        (15,), mean error in standard errors of the mean.
    """

    repetitions: int
    samples: int
    shares: FloatArray
    bias: FloatArray


def measure_coverage(
    samples: FitSamples,
    truth: FloatArray,
    repetitions: int,
    seed: int,
    progress: Progress | None = None,
) -> Coverage:
    """Fit the same motion again and again, each time with fresh noise of ±12 N.

    Parameters
    ----------
    samples : FitSamples
        Their forces are not used.
    truth : FloatArray
        (n,).
    """
    exact, generator = samples.regressor @ truth, random_generator(derived_seed(seed, COVERAGE))
    covered, errors = np.empty((2, repetitions, len(truth)))
    for k in range(repetitions):
        noise = generator.uniform(-FORCE_NOISE, FORCE_NOISE, exact.shape)
        found = quiet_fit(samples.with_force(exact + noise), "ols")
        low, high = found.intervals(LEVEL).T
        covered[k] = (low <= truth) & (truth <= high)
        errors[k] = found.values - truth
        if progress is not None:
            progress(k + 1, repetitions)
    spread = errors.std(axis=0, ddof=1) / np.sqrt(repetitions)
    return Coverage(repetitions, len(samples), covered.mean(axis=0), errors.mean(axis=0) / spread)
