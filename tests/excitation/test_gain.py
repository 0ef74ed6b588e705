"""A design that gained nothing is no success."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid import DesignOptions
from loopid.errors import DataError


def test_a_design_that_gained_nothing_is_refused_with_advice(load_once):
    model = loopid.force_model(load_once("four_bar"), "full", None)
    options = DesignOptions(
        duration=4.0, starts=1, evaluations=1, size=2, solver="slsqp", noise=0.1
    )
    found = loopid.design_motion(model, options=options)
    assert found.gain > 0
    none = replace(found, errors_before=found.standard_errors)
    assert none.gain == 1.0
    with pytest.raises(DataError, match=r"excites more than the first motion.*evaluations=\d+"):
        none.require_gain()
    untold = np.full(len(found.parameters), np.inf)
    replace(found, errors_before=untold).require_gain()  # it tells what nothing told


@pytest.mark.validate
@pytest.mark.parametrize("solver", few_of(["slsqp", "ipopt"], "slsqp"))
def test_a_gain_is_over_the_start_that_solvers_leave_as_it_was(load_once, solver):
    if solver == "ipopt":
        pytest.importorskip("ipyopt")
    model = loopid.force_model(load_once("four_bar"), "full", None)
    options = DesignOptions(
        duration=4.0, starts=1, evaluations=6, rate=20.0, solver=solver, noise=0.1
    )
    assert loopid.design_motion(model, options=options).gain > 1.5
