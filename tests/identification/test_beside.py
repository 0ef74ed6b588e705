"""Columns beside all that is fitted: their evidence is a ratio of densities of the forces."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from loopid.identification.beside import TRIED, Beside, evidence_of
from loopid.identification.problem import FitSamples
from loopid.parameters import ParameterSet


def some(seed, rows=60):
    """Samples of two motors, three parameters; columns in the force of the second motor."""
    rng = np.random.default_rng(seed)
    W, columns = rng.normal(size=(rows, 2, 3)), rng.normal(size=(rows, 2))
    force = W @ [2.0, -1.0, 0.5] + rng.normal(size=(rows, 2))
    force[:, 1] += columns @ [0.4, 0.2]
    names = ParameterSet.from_labels(["arm.m", "arm.mx", "arm.my"])
    used = rng.random((rows, 2)) > 0.2
    return FitSamples.of(names, ["hip", "knee"], W, force, used=used), columns


def test_evidence_is_a_ratio_of_densities():
    rng = np.random.default_rng(0)
    columns, left = rng.normal(size=(6, 2)), rng.normal(size=6) + 1.0
    spread = [np.eye(6) + (size * 3.0) ** 2 * columns @ columns.T for size in TRIED]
    densities = [multivariate_normal.logpdf(left, np.zeros(6), each) for each in spread]
    without = multivariate_normal.logpdf(left, np.zeros(6), np.eye(6))
    assert evidence_of(columns, left, 3.0) == pytest.approx(max(densities) - without)


@pytest.mark.parametrize("seed", range(4))
def test_columns_count_by_what_the_others_leave_of_them(seed):
    samples, columns = some(seed)
    weights = np.array([1.0, 0.7])
    wide = np.zeros((len(samples), 2, 2))
    wide[:, 1] = columns
    R = samples.beside("more", wide).problem.weighted(weights)[3:, 3:]
    size = samples.problem.force_rms[1]
    expected = evidence_of(R[:, :-1], R[:, -1], size)
    assert Beside(samples, weights).evidence(1, columns) == pytest.approx(expected, rel=1e-9)


def test_what_is_fitted_anyway_has_no_evidence():
    samples, columns = some(0)
    alone = np.where(np.arange(2)[:, None] == 1, samples.regressor, 0.0)
    fitted = samples.beside("own", alone[:, :, :1])
    again = Beside(fitted, np.ones(2)).evidence(1, samples.regressor[:, 1, :1])
    assert abs(again) < 1e-6 < Beside(samples, np.ones(2)).evidence(1, columns)
