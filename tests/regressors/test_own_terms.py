"""Joint terms of one's own: what is wrong with them is told, what is right is fitted and saved."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid import JointTerms, load_fit, read_log
from loopid.errors import DataError, LoopidError, OptionError
from loopid.identification.fitting import quiet_fit
from loopid.regressors import JOINT_TERMS, JointTerm
from loopid.regressors.joint_laws import joint_term
from made_runs import modelled, wander

LOG = Path(__file__).parents[2] / "urdf" / "logs" / "five_bar.csv"
BESIDE, OUT = 0.3, 0.1  # m, of the ends of a gas spring from a hinge


@pytest.fixture
def register():
    """Registers terms that go after the test."""
    known = dict(JOINT_TERMS._entries)
    yield JOINT_TERMS.register
    JOINT_TERMS._entries.clear()
    JOINT_TERMS._entries.update(known)
    joint_term.cache_clear()


def gas(joint, _):
    """Slope of the length between the ends."""
    square = BESIDE**2 + OUT**2 - 2 * BESIDE * OUT * joint.math.cos(joint.position)
    return BESIDE * OUT * joint.math.sin(joint.position) / square**0.5


term = partial(JointTerm, "mine", ("N", "N m"))


@pytest.mark.parametrize("unit", ["Nm", "N m s^2", "lb", "-", "N//m", "N m/"])
def test_units_that_nobody_understands_are_refused(unit):
    with pytest.raises(OptionError) as refused:
        JointTerm("drag", ("N", unit), lambda joint, _: joint.rate, ("rate",))
    assert refused.value.facts["given"] == unit


@pytest.mark.parametrize(
    "kind", ["", "m", "Ixx", "file", "auto", "a b", "a,b", "F~0.1", "a.b", "2"]
)
def test_kinds_that_choices_could_not_name_are_refused(register, kind):
    with pytest.raises(OptionError) as refused:
        register(kind, term(lambda joint, _: joint.rate, ("rate",)))
    assert refused.value.facts["given"] == kind
    assert kind not in JOINT_TERMS


@pytest.mark.parametrize(
    ("law", "needs"),
    [
        (lambda joint, _: joint.position * joint.rate, ("rate",)),  # position is not asked for
        (lambda joint, _: joint.speed, ("rate",)),
        (lambda joint, _: np.ones((2, 2)), ()),
        (lambda joint, _: "much", ()),
        (lambda joint, _: joint.rate, ("velocity",)),
    ],
)
def test_laws_that_fail_are_refused_before_they_are_used(register, law, needs):
    with pytest.raises(LoopidError):
        register("Mine", term(law, needs))
    assert "Mine" not in JOINT_TERMS


def test_where_a_law_is_not_finite_is_told(register, load_once):
    register("Root", term(lambda joint, _: np.sqrt(joint.position - 10.0), ("position",)))
    robot = load_once("five_bar")
    with (
        pytest.raises(DataError, match="mine is not finite at position"),
        np.errstate(all="ignore"),
    ):
        loopid.force_model(robot, "gravity", JointTerms(robot.actuated, ("Root",)))


def test_a_joint_stays_on_one_side_of_a_gas_spring(load_once):
    """Nothing else refuses its pole: between two states it is finite at both."""
    robot = load_once("five_bar")
    joint = robot.actuated[0]
    low, high = robot.limits(joint)
    for outside in (low - 0.1, high + 0.1):
        loopid.force_model(robot, "gravity", f"Fo; {joint}: Kg@{outside:g}")
    with pytest.raises(DataError, match=f"the gas spring of {joint} is infinite at 2.33, between"):
        loopid.force_model(robot, "gravity", f"Fo; {joint}: Kg@{(low + 2 * high) / 3:.3g}")


def test_a_spring_with_its_geometry_is_found_and_saved(register, load_once, tmp_path):
    register("Gas", JointTerm("gas spring", ("N", "N"), gas, ("position",)))
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", "Fc,Fv; left_crank_joint: Gas")
    truth = model.prior.copy()
    place = model.parameters.labels.index("left_crank_joint.Gas")
    truth[place] = 80.0
    run = modelled(model, wander(robot, 4, 20.0, 20.0, size=(0.5, 0.5), harmonics=8), truth, 0.0)
    found = quiet_fit(model.samples(run))
    np.testing.assert_allclose(found.values, truth, rtol=1e-6, atol=1e-7)
    path = loopid.Fit.of(model, found).save(tmp_path / "fit.yaml")
    assert load_fit(path, robot=robot).parameters == model.parameters
    del JOINT_TERMS._entries["Gas"]
    joint_term.cache_clear()
    with pytest.raises(LoopidError, match="Gas"):
        load_fit(path)


def test_steps_that_follow_the_position_too_are_filtered(register, load_once):
    """A law of sign and position has both where steps are filtered at the rate of the log."""
    law = lambda joint, _: joint.sign() * (1.0 + joint.position)  # noqa: E731
    register("Fq", term(law, ("sign", "position")))
    robot = load_once("five_bar")
    log = read_log(LOG, robot)
    recording = loopid.prepare(robot, log)
    models = [loopid.force_model(robot, "gravity", terms) for terms in ("Fc,Fq", "Fc,Fv")]
    W, plain = (model.samples(recording) for model in models)
    name = robot.actuated[0]
    q = recording.motion.configurations[:, robot.joint(name).idx_q]
    j, k = (
        each.parameters.labels.index(f"{name}.{kind}") for each, kind in ((W, "Fq"), (plain, "Fc"))
    )
    steady = np.abs(plain.regressor[:, 0, k]) > 0.999  # far from any change of sign
    assert steady.mean() > 0.3
    expected = (plain.regressor[:, 0, k] * (1.0 + q))[steady]
    np.testing.assert_allclose(W.regressor[steady, 0, j], expected, rtol=0.02)


@pytest.mark.parametrize("unit", ["", "1"])
def test_a_coefficient_without_unit_goes_all_the_way(register, load_once, tmp_path, unit):
    register(
        "Cog",
        JointTerm("cogging", (unit, unit), lambda j, _: np.sin(8 * j.position), ("position",)),
    )
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", "Fc; left_crank_joint: Cog")
    assert model.parameters[model.parameters.labels.index("left_crank_joint.Cog")].unit == ""
    truth = np.where([p.kind == "Cog" for p in model.parameters], 0.3, model.prior)
    run = modelled(model, wander(robot, 4, seconds=4.0, size=(0.4, 0.4)), truth, noise=0.01)
    fit = quiet_fit(model.samples(run))
    found = load_fit(loopid.Fit.of(model, fit).save(tmp_path / "fit.yaml"))["left_crank_joint.Cog"]
    assert abs(found.value - 0.3) < 4 * found.standard_error
    assert "  " not in str(found)
    assert " 1 (" not in str(found)


@pytest.mark.parametrize("entry", [5, JointTerm, None])
def test_what_is_no_joint_term_is_refused_in_plain_words(entry):
    with pytest.raises(OptionError, match="must be a JointTerm, or 'module:name'") as refused:
        JOINT_TERMS.register("Odd", entry)
    assert "<" not in str(refused.value)
    assert "Odd" not in JOINT_TERMS
