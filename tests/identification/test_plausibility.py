"""Laws that a fit keeps, and a verdict on one that breaks them."""

from dataclasses import replace

import numpy as np
import pytest

from loopid import find_force_model, identify, prepare_recording, read_log
from loopid.identification import absurdities
from made_runs import quietly

LEFT = "left_crank_joint"


@pytest.fixture(scope="module")
def found(load_once):
    robot = load_once("five_bar")
    run = quietly(prepare_recording, robot, read_log("urdf/logs/five_bar.csv", robot))
    terms = f"Fc,Fv,Fo,Ia; {LEFT}: Fs~0.05,Fs~0.1,Ks"
    return quietly(identify, find_force_model(robot, "full", terms), [run])


def changed(found, **values):
    """The recommended fit with other values of terms of the left motor."""
    labels, phi = found.fit.parameters.labels, np.array(found.fit.values)
    for kind, value in values.items():
        phi[labels.index(f"{LEFT}.{kind}")] = value
    return replace(found.fit, values=phi)


def test_a_sane_fit_breaks_none(found):
    assert absurdities(found.force_model, found.fit, found.data) == ()
    assert found.verdict.use.startswith("Fit for")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"Fc": 300.0}, "friction of left_crank_joint would be 3"),
        ({"Fc": -0.3}, "would drive it"),
        ({"Fo": 1e3}, "Fo would be 1e+03 of a largest force"),
        ({"Fs~0.05": 150.0, "Fs~0.1": -150.0}, "friction of left_crank_joint"),
        ({"Fo": 2.0, "Fc": 0.1}, None),
    ],
)
def test_what_breaks_a_law_is_fit_for_nothing(found, values, said):
    fit = changed(found, **values)
    broken = absurdities(found.force_model, fit, found.data)
    if said is None:
        assert not broken
        return
    assert said in broken[0]
    name = found.recommended.name
    candidates = {**found.candidates, name: replace(found.recommended, fit=fit)}
    verdict = replace(found, candidates=candidates).verdict
    assert verdict.use == f"Not fit for use, as {broken[0]}"


def test_terms_that_cancel_are_named(found):
    data = found.data
    column = data.parameters.labels.index(f"{LEFT}.Fo")
    other = data.parameters.labels.index(f"{LEFT}.Fv")
    W = np.array(data.regressor)
    W[:, :, other] = 1.0001 * W[:, :, column]
    fit = changed(found, Fo=3.0, Fv=-3.0)
    fit = replace(fit, use=None)
    (said,) = absurdities(found.force_model, fit, replace(data, regressor=W))
    assert f"{LEFT}.Fv and {LEFT}.Fo cancel" in said or f"{LEFT}.Fo and {LEFT}.Fv cancel" in said


def test_a_spring_and_where_it_is_slack_are_one_law(found):
    """Far from zero a spring and its offset cancel by their nature."""
    data = found.data
    labels = data.parameters.labels
    spring, offset = labels.index(f"{LEFT}.Ks"), labels.index(f"{LEFT}.Fo")
    W = np.array(data.regressor)
    W[:, :, spring] = 1.0001 * W[:, :, offset]
    fit = changed(found, Fo=3.0, Ks=-3.0)
    assert absurdities(found.force_model, fit, replace(data, regressor=W)) == ()
