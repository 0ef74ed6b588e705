"""How large errors are where most of them are normal."""

from __future__ import annotations

import numpy as np

from loopid.arrays import FloatArray
from loopid.errors import DataError
from loopid.identification.least_squares import EXACT_FIT
from loopid.identification.samples import FitSamples
from loopid.order_statistics import median
from loopid.scratch import row_blocks, spooled

# Median of the absolute value of a standard normal variable.
NORMAL_MEDIAN = 0.6744897501960817


def residual_scales(samples: FitSamples, values: FloatArray) -> FloatArray:
    """Standard deviations (dof,) of normal errors with the residuals' median size.

    Half of the samples may be outliers. Actuators without samples have scale 1.

    Raises
    ------
    DataError
        When more than half of an actuator's residuals are but round-off.
    """
    residual, problem = samples.residual(values), samples.problem
    scales = np.ones(len(samples.actuators))
    exact = EXACT_FIT * np.sqrt(problem.force_squares() / np.maximum(problem.samples, 1))
    for i in np.flatnonzero(problem.samples):
        middle = _median_size(samples, residual[:, i], int(i))
        scales[i] = max(middle / NORMAL_MEDIAN, samples.least_errors[i])
        if scales[i] <= exact[i]:
            raise DataError(
                f"actuator {samples.actuators[i]} is fitted without error in more than half of its "
                "samples: the scale of its errors is undefined; use ols"
            )
    return scales


def _median_size(samples: FitSamples, series: FloatArray, i: int) -> float:
    """Median of the absolute values of a series (N,) where an actuator's samples are used."""
    blocks = (series[rows][samples.used[rows, i]] for rows in row_blocks(len(samples)))
    sizes = spooled(np.abs(block) for block in blocks)

    def signal(rows: slice) -> FloatArray:
        return np.asarray(sizes[rows], dtype=np.float64)

    return median(signal, len(sizes))
