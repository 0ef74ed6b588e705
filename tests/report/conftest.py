"""A designed motion, for reports."""

import pytest

import loopid
from made_runs import quietly


@pytest.fixture(scope="session")
def designed(load_once, once):
    """A motion of the five-bar, after few evaluations."""
    options = loopid.DesignOptions(duration=4.0, starts=1, evaluations=2, solver="slsqp")
    model = loopid.force_model(load_once("five_bar"), joint_terms=None)
    return once("designed", lambda: quietly(loopid.design_motion, model, options=options))
