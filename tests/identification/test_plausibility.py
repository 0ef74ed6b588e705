"""Laws that a fit keeps, and a verdict on one that breaks them."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import Dynamics, load_fit, read_log
from loopid.errors import OptionError
from loopid.identification import friction_curve
from loopid.identification.plausibility import absurdities
from loopid.identification.verdict import _unexplained
from made_runs import identify_unjudged, quietly

pytestmark = pytest.mark.usefixtures("nothing_suspected", "no_delay_sought", "none_missing")

LEFT = "left_crank_joint"


@pytest.fixture(scope="module")
def found(load_once, once):
    def identified():
        robot = load_once("five_bar")
        run = quietly(loopid.prepare, robot, read_log("urdf/logs/five_bar.csv", robot))
        terms = f"Fc,Fv,Fo,Ia; {LEFT}: Fs~0.05,Fs~0.1,Ks"
        return identify_unjudged(loopid.force_model(robot, "full", terms), run)

    return once("plausibility", identified)


def changed(found, **values):
    """The recommended fit with other values of terms of the left motor."""
    labels, phi = found.fit.parameters.labels, np.array(found.fit.values)
    for kind, value in values.items():
        phi[labels.index(f"{LEFT}.{kind}")] = value
    return replace(found.fit, values=phi)


def test_a_sane_fit_breaks_none(found):
    assert absurdities(found.fit, found.data) == ()
    assert found.verdict.use.startswith("Fit for")


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"Fc": 300.0}, "friction of left_crank_joint would be 3"),
        ({"Fc": -0.3}, "would drive it"),
        ({"Fo": 1e3}, "Fo and left_crank_joint.Ks would be 1e+03 of a largest force"),
        ({"Fs~0.05": 150.0, "Fs~0.1": -150.0}, "friction of left_crank_joint"),
        ({"Fo": 2.0, "Fc": 0.1}, None),
    ],
)
def test_what_breaks_a_law_is_fit_for_nothing(found, values, said):
    fit = changed(found, **values)
    broken = absurdities(fit, found.data)
    if said is None:
        assert not broken
        return
    assert said in broken[0]
    name = found.recommended.name
    fit = replace(fit, broken=broken)
    candidates = {**found.candidates, name: replace(found.recommended, fit=fit)}
    verdict = replace(found, candidates=candidates).verdict
    assert verdict.use == f"Not fit for use, as {broken[0]}"


def test_friction_may_be_all_of_a_force(found):
    """As of a slow wrist: a filter takes off a little of the largest force."""
    use = found.fit.use
    rates = np.geomspace(1e-4, 1.0, 100) * use.fastest[:, None]
    curves = (friction_curve(found.fit, *own) for own in zip(use.joints, rates, strict=True))
    most = np.array([curve.values.max() for curve in curves])
    for factor, broken in ((0.95, 0), (0.5, 2)):
        fit = replace(found.fit, use=replace(use, largest=factor * most))
        assert len(absurdities(fit, found.data)) == broken


def test_terms_that_cancel_are_named(found):
    data = found.data
    column = data.parameters.labels.index(f"{LEFT}.Fo")
    other = data.parameters.labels.index(f"{LEFT}.Fv")
    W = np.array(data.regressor)
    W[:, :, other] = 1.0001 * W[:, :, column]
    fit = changed(found, Fo=3.0, Ks=0.0, Fv=-3.0)
    fit = replace(fit, use=None)
    (said,) = absurdities(fit, replace(data, regressor=W))
    assert said.startswith(f"{LEFT}.Fv and {LEFT}.Fo and {LEFT}.Ks cancel")


@pytest.mark.parametrize("size", [0.6, 30.0])
def test_a_spring_and_where_it_is_slack_are_one_law(found, size):
    """Far from zero a spring and its offset cancel by their nature, whatever their sizes."""
    data = found.data
    labels = data.parameters.labels
    spring, offset = labels.index(f"{LEFT}.Ks"), labels.index(f"{LEFT}.Fo")
    W = np.array(data.regressor)
    W[:, :, spring] = 1.0001 * W[:, :, offset]
    fit = changed(found, Fo=5 * size, Ks=-5 * size)
    assert absurdities(fit, replace(data, regressor=W)) == ()


@pytest.mark.parametrize(("part", "broken"), [(0.9, 0), (2.5, 1)])
def test_a_spring_may_carry_the_bodies(found, part, broken):
    """As a counterbalance does: more than the motor, which is left with the rest."""
    data, model = found.data, found.fit.model
    labels, row = data.parameters.labels, data.actuators.index(LEFT)
    used, bodies = data.used[:, row], model.body_columns
    weight = np.abs(data.regressor[used, row][:, bodies] @ model.prior[bodies]).max()
    W = np.array(data.regressor)
    W[:, row, labels.index(f"{LEFT}.Ks")] = 1.0
    fit = replace(changed(found, Fo=0.0, Ks=part * weight), use=None)
    force = np.sign(data.force) * np.minimum(np.abs(data.force), 0.1 * weight)
    new = replace(data, regressor=W, force=force)
    said = [one for one in absurdities(fit, new) if "Ks would be" in one]
    assert len(said) == broken


ABSURD = (
    "friction of left_crank_joint would be .* N m at .* rad/s, for a largest force of .* N m: "
    'identify with terms="Fc,Fv" and estimator="wls"; anyway=True takes it nevertheless'
)
# All that a fit is saved by, exported by, or given to a controller by.
ROUTES = {
    "save": lambda fit, folder, **kw: fit.save(folder / "a.yaml", **kw),
    "to_robot_file": lambda fit, folder, **kw: fit.to_robot_file(folder / "a.urdf", **kw),
    "to_c": lambda fit, folder, **kw: fit.to_c(folder, **kw),
    "to_pinocchio": lambda fit, _, **kw: fit.to_pinocchio(**kw),
    "Dynamics": lambda fit, _, **kw: Dynamics(fit.robot, fit, **kw),
}


@pytest.mark.parametrize("route", ROUTES)
def test_what_breaks_a_law_is_neither_saved_nor_given_to_a_controller(found, route, tmp_path):
    standard, fit = np.array(found.fit.standard_parameters), changed(found, Fc=300.0)
    model, (place,) = found.force_model, np.flatnonzero(fit.values == 300.0)
    standard[model.base.base[place]] = 300.0
    absurd = replace(fit, standard_parameters=standard)
    with pytest.raises(OptionError, match=ABSURD):
        quietly(ROUTES[route], absurd, tmp_path)
    assert not list(tmp_path.iterdir())
    if route != "to_c":  # which takes a second
        quietly(ROUTES[route], absurd, tmp_path, anyway=True)
        quietly(ROUTES[route], found.fit, tmp_path)


def test_what_terms_break_on_a_log_is_kept_by_the_fit(found, tmp_path):
    """Forces of the log tell it, which a fit alone has not."""
    said = "left_crank_joint.Ks and left_crank_joint.Fo cancel"
    fit = replace(found.fit, broken=(said,))
    place = fit.save(tmp_path / "a.yaml", anyway=True)
    assert load_fit(place).broken == (said,)
    with pytest.raises(OptionError, match=said):
        Dynamics(found.force_model.robot, load_fit(place))


def test_a_fit_of_a_log_with_a_mistake_says_that_this_comes_first(found, tmp_path):
    """Other terms would not mend it."""
    mistake = "the force of left_crank_joint has the wrong sign; set force_scale"
    fit = replace(found.fit, broken=("friction would drive",), mistakes=(mistake,))
    with pytest.raises(OptionError, match=f"its log has a mistake, {mistake}") as refused:
        fit.save(tmp_path / "a.yaml")
    assert "terms=" not in str(refused.value)


REASONS = [{"mistakes": ("a sign",)}, {"broken": ("a law",)}, {"unexplained": ("an error",)}]


@pytest.mark.parametrize("reason", REASONS)
@pytest.mark.parametrize("way", ["save", "to_robot_file", "to_c", "to_pinocchio", "dynamics"])
def test_what_is_not_fit_for_use_leaves_loopid_on_no_way(found, tmp_path, way, reason):
    fit, robot = replace(found.fit, **reason), found.force_model.robot
    ways = {
        "save": lambda: fit.save(tmp_path / "a.yaml"),
        "to_robot_file": lambda: fit.to_robot_file(tmp_path / "a.urdf"),
        "to_c": lambda: fit.to_c(tmp_path),
        "to_pinocchio": fit.to_pinocchio,
        "dynamics": lambda: Dynamics(robot, fit),
    }
    (((said,),),) = (reason.values(),)
    if way in ("save", "dynamics") and "broken" not in reason:
        ways[way]()  # to look at it
        return
    with pytest.raises(OptionError, match=f"not fit for use.*{said}.*anyway=True"):
        ways[way]()
    assert not list(tmp_path.iterdir())


def test_a_force_that_is_not_explained_is_a_reason(found):
    half = replace(found.unseen, whole=0.5 * found.unseen.force)
    other = replace(found)
    object.__setattr__(other, "unseen", half)  # as what is kept of a record
    assert "50 % of its force" in other.fit.unexplained[0]
    assert found.fit.unexplained == ()


def test_a_force_that_its_own_data_explain_is_known_from_too_few(found):
    """What the model lacks errs on the data that were fitted, too."""
    own, unseen = found.fit.quality.residual_rms, found.unseen
    cases = {
        "is known from too few samples": replace(unseen, whole=0.5 * unseen.force),
        "is not explained at low speed": replace(unseen, slow=0.5 * unseen.force),
        "is not explained": replace(unseen, whole=3 * own, force=4 * own),
    }
    for said, errors in cases.items():
        other = replace(found)
        object.__setattr__(other, "unseen", errors)
        (wrong,) = _unexplained(other)
        assert wrong.title.endswith(said)
