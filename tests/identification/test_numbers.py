"""What the bundled logs identify stays what it was: values, intervals, what they excite."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid import FitOptions, identify, read_log
from loopid.logs import FilterOptions
from made_runs import quietly

pytestmark = pytest.mark.usefixtures("nothing_suspected")

NUMBERS = json.loads(Path(__file__).with_name("numbers.json").read_text())
LOGS = Path(__file__).parents[2] / "urdf" / "logs"
CUTOFFS = {"five_bar": 7.927646270656544, "3ups_rpu": 1.0741301059001516}  # in Hz
# One a robot, and each estimator.
ORDINARY = [case for case in NUMBERS if case.startswith("five_bar") or case.endswith("wls")]
SAME = 1e-6  # relative; of values, in standard errors


@cache
def task(name, kind):
    robot = loopid.load(name)
    log, filtered = read_log(LOGS / f"{name}.csv", robot), FilterOptions(cutoff=CUTOFFS[name])
    recording = quietly(loopid.prepare, robot, log, filter=filtered)
    return loopid.force_model(robot, kind, "Fc,Fv,file"), recording


def assert_same(fit, expected):
    errors = np.array(expected["standard_errors"])
    assert (np.abs(fit.values - expected["values"]) <= SAME * errors).all()
    np.testing.assert_allclose(fit.standard_errors, errors, rtol=SAME)
    off = np.abs(fit.intervals()[:, 1] - expected["upper"])
    assert (off <= 10 * SAME * errors).all()


@pytest.mark.parametrize("case", few_of(NUMBERS, *ORDINARY))
def test_fits_of_the_bundled_logs_are_what_they_were(case):
    expected, (name, kind, estimator) = NUMBERS[case], case.split()
    model, recording = task(name, kind)
    found = quietly(
        identify, model, [recording], options=FitOptions(estimator=estimator, undo_delay=False)
    )
    assert_same(found["all parameters"].fit, expected)
    if estimator != "wls":
        assert found.recommended is found["all parameters"]
        return
    assert found.recommended is found["consistent"]
    assert all(
        each.certainty == "hidden" for each in found.missing
    )  # the logs were simulated with these terms
    assert_same(found.fit, expected["consistent"])
    told = found.identifiability
    np.testing.assert_allclose(told.excitation.effects, expected["effects"], rtol=SAME)
    np.testing.assert_allclose(told.standard_errors, expected["combination_errors"], rtol=SAME)
    np.testing.assert_allclose(found.recommended.error_ratio, expected["error_ratio"], rtol=SAME)
