"""Identification in two steps: some parameters from one experiment, the rest from another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loopid.arguments import checked
from loopid.arrays import FloatArray
from loopid.errors import OptionError
from loopid.identification.correlation import warn_of_correlation
from loopid.identification.estimator import Estimator, WorkingFit
from loopid.identification.excitation import warn_of_unsupported
from loopid.identification.fitting import fit, fits
from loopid.identification.quality import fit_quality
from loopid.identification.result import FitResult
from loopid.identification.samples import FitSamples


@checked
def fit_in_steps(
    first: FitSamples,
    second: FitSamples,
    known: Sequence[str],
    estimator: str | Estimator = "wls",
) -> FitResult:
    """Take known parameters from a first experiment, and the rest from a second.

    All parameters of ``first`` are fitted to it. Those that are known keep their values; their
    forces are taken away from ``second``, to which all its other parameters are fitted.

    Parameters
    ----------
    first, second : FitSamples
        Of different experiments, with errors independent of each other.
    known : sequence of str
        Names, in both experiments, of what the first one tells; joint friction for instance.
    estimator : str or Estimator
        As of ``fit``.

    Returns
    -------
    FitResult
        All parameters of ``second``; the covariance holds what the uncertainty of the known ones
        does to the others. Quality and noise are those of the second experiment, the degrees of
        freedom those of the poorer one.

    Raises
    ------
    OptionError
        When a known parameter is not in both experiments, or nothing is left for the second.
    DataError, RankError
        As ``fit``.
    """
    held, free = _columns(second, known)
    for name in known:
        if name not in first.parameters.labels:
            raise OptionError.unknown("parameter of the first step", name, first.parameters.labels)
    start = fit(first, estimator)
    taken = [start.parameters.labels.index(name) for name in known]
    values, spread = start.values[taken], start.covariance[np.ix_(taken, taken)]
    joint = np.zeros(len(second.parameters))
    joint[held] = values
    rest, plain = fits(second.less(second.predicted(joint)).select(free), estimator)
    warn_of_correlation(rest.result, plain)
    warn_of_unsupported(rest.result)
    return _joined(second, rest, (held, free), (values, spread), start.degrees_of_freedom)


def _columns(second: FitSamples, known: Sequence[str]) -> tuple[list[int], list[int]]:
    labels = second.parameters.labels
    for name in known:
        if name not in labels:
            raise OptionError.unknown("parameter of the second step", name, labels)
    held = [labels.index(name) for name in known]
    free = [j for j in range(len(labels)) if j not in held]
    if not free:
        raise OptionError("all parameters of the second step are known: nothing is left to fit")
    return held, free


def _joined(
    second: FitSamples,
    fitted: WorkingFit,
    columns: tuple[list[int], list[int]],
    known: tuple[FloatArray, FloatArray],
    first_freedom: float,
) -> FitResult:
    """One result for both steps, with H = (X₂ᵀX₂)⁻¹ X₂ᵀF for the known columns F."""
    (held, free), (values, spread) = columns, known
    rest, H = fitted.result, fitted.response(second.select(held).regressor)
    n = len(second.parameters)
    joint, covariance = np.zeros(n), np.zeros((n, n))
    joint[held], joint[free] = values, rest.values
    covariance[np.ix_(held, held)] = spread
    covariance[np.ix_(free, held)] = -H @ spread
    covariance[np.ix_(held, free)] = -(H @ spread).T
    covariance[np.ix_(free, free)] = rest.covariance + H @ spread @ H.T
    return replace(
        rest,
        parameters=second.parameters,
        values=joint,
        covariance=covariance,
        degrees_of_freedom=min(first_freedom, rest.degrees_of_freedom),
        quality=fit_quality(second.problem, joint),
    )
