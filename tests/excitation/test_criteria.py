import numpy as np
import pytest

from loopid.excitation import Criteria
from loopid.excitation.criteria import CRITERIA, OfCombinations


def information(seed=0, n=5):
    root = np.random.default_rng(seed).normal(size=(3 * n, n)) * 10.0 ** np.arange(n)
    return root.T @ root, np.linalg.qr(root, mode="r")


@pytest.mark.parametrize("name", [*CRITERIA, "chosen"])
def test_the_slope_is_that_of_finite_differences(name):
    M, _ = information()
    criterion = CRITERIA.get(name) or OfCombinations(np.eye(5)[[1, 3]])
    size = np.sqrt(np.diag(M))
    change = np.random.default_rng(1).normal(size=M.shape)
    change = (change + change.T) * np.outer(size, size)
    ends = (criterion(M + sign * 1e-6 * change)[0] for sign in (1, -1))
    slope = np.sum(criterion(M)[1] * change)
    assert np.diff(list(ends))[0] / -2e-6 == pytest.approx(slope, rel=1e-3)


def test_criteria_are_those_of_the_textbook():
    M, R = information()
    found, values = Criteria.of(R), np.linalg.eigvalsh(M)
    assert found.log_det == pytest.approx(np.linalg.slogdet(M)[1])
    assert found.trace == pytest.approx(np.trace(np.linalg.inv(M)))
    assert found.least_eigenvalue == pytest.approx(values[0])
    assert found.condition_number == pytest.approx(np.sqrt(values[-1] / values[0]))
    assert CRITERIA["D"](M)[0] == pytest.approx(-found.log_det)
    assert CRITERIA["A"](M)[0] == pytest.approx(np.log(found.trace))
    # Smooth ones stand for the extremes up to a factor n^(1/24).
    assert CRITERIA["E"](M)[0] == pytest.approx(-np.log(found.least_eigenvalue), abs=0.07)
    assert CRITERIA["condition"](M)[0] == pytest.approx(np.log(found.condition_number), abs=0.07)


def test_chosen_combinations_have_the_covariance_of_these():
    M, _ = information()
    chosen = [0, 4]
    covariance = np.linalg.inv(M)[np.ix_(chosen, chosen)]
    found = OfCombinations(np.eye(5)[chosen])(M)[0]
    assert found == pytest.approx(np.linalg.slogdet(covariance)[1])
