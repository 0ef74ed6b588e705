"""The prior: what is refused body by body, and repaired only on request."""

import numpy as np
import pytest
from oracles import bodies_of

from loopid.consistency import (
    Region,
    consistent_fit,
    consistent_parameters,
    prior_defects,
    repaired_prior,
)
from loopid.consistency.prior import THICKNESS
from loopid.errors import DataError, FeasibilityError, OptionError
from loopid.parameters import KINDS, ParameterSet
from loopid.pseudo_inertia import FLAT
from loopid.robot import inertia_defects

TWO = ParameterSet.of_links(("arm", "hand"), KINDS)
SOUND = np.array([2.0, 0.2, 0.0, 0.4, 0.3, 0.0, 0.3, -0.04, 0.0, 0.1])


def values(hand):
    return np.concatenate([SOUND, hand])


def rod(thickness=0.0):
    """Along x, about its middle."""
    across = 0.5 * (1 + thickness)
    return np.array([1.0, 0, 0, 0, thickness, 0, across, 0, 0, across])


def test_sound_bodies_have_no_defect():
    assert prior_defects(TWO, values(SOUND)) == ()
    np.testing.assert_array_equal(repaired_prior(TWO, values(SOUND)), values(SOUND))


def test_the_thin_stem_is_named_with_what_to_do(load_once):
    robot = load_once("5p")
    parameters, prior = robot.parameters(), robot.standard_parameters()
    (defect,) = prior_defects(parameters, prior)
    assert (defect.name, defect.repairable) == ("leg4_stem", True)
    assert {found.link for found in inertia_defects(robot)} == {"leg4_stem"}
    repaired = repaired_prior(parameters, prior)
    changed = {parameters[j].link for j in np.flatnonzero(repaired != prior)}
    assert changed == {"leg4_stem"}
    assert (np.linalg.eigvalsh(bodies_of(parameters, repaired)) > 0).all()


def test_a_fit_refuses_it_unless_it_may_repair(arm_case):
    prior = arm_case.prior.copy()
    labels = arm_case.base.parameters.labels
    first = labels.index("lower.Ixx")
    prior[first : first + 6] = 0.0
    problem, fit = arm_case.fitted(0.1)
    with pytest.raises(
        FeasibilityError,
        match=r"the prior of lower is not physically consistent: lower: .*repair=True",
    ):
        consistent_fit(problem, fit, arm_case.base, prior)
    with pytest.raises(FeasibilityError, match=r"lower: .*repair=True"):
        consistent_parameters(arm_case.base, fit.values, prior)
    assert consistent_fit(problem, fit, arm_case.base, prior, repair=True).repaired == ("lower",)


@pytest.mark.parametrize(
    ("hand", "reason", "repairable"),
    [
        (rod(), "no solid body", True),
        (rod(FLAT / 2), "no solid body", True),
        (np.array([1.0, 0.1, 0, 0, 0, 0, 0.01, 0, 0, 0.01]), "no solid body", True),
        (np.array([-1.0, 0, 0, 0, 1, 0, 1, 0, 0, 1]), "mass is not positive", False),
        (np.array([0.0, 0.1, 0, 0, 1, 0, 1, 0, 0, 1]), "mass is not positive", False),
        (np.array([1.0, 0, 0, 0, 3, 0, 1, 0, 0, 1]), "no solid body", True),
        (np.array([1.0, 5, 0, 0, 1, 0, 1, 0, 0, 1]), "no solid body", True),
    ],
)
def test_impossible_bodies_are_named(hand, reason, repairable):
    (defect,) = prior_defects(TWO, values(hand))
    assert defect.name == "hand"
    assert reason in defect.reason
    assert defect.repairable == repairable


def test_a_repaired_rod_keeps_mass_centre_and_length():
    repaired = repaired_prior(TWO, values(rod()))[10:]
    np.testing.assert_allclose(repaired[:4], rod()[:4], atol=1e-15)
    P = bodies_of(TWO, values(repaired))[1]
    np.testing.assert_allclose(np.diag(P), [0.5, 0.5 * THICKNESS, 0.5 * THICKNESS, 1], rtol=1e-12)


def test_a_repaired_point_is_a_ball_as_large_as_the_others():
    point = np.array([1.0, 0.1, 0, 0, 0, 0, 0.01, 0, 0, 0.01])
    repaired = repaired_prior(TWO, values(point))
    P = bodies_of(TWO, repaired)
    second = (
        P[:, :3, :3] - np.einsum("ki,kj->kij", P[:, :3, 3], P[:, 3, :3]) / P[:, 3, 3, None, None]
    )
    sizes = np.trace(second, axis1=1, axis2=2) / P[:, 3, 3]
    assert sizes[1] == pytest.approx(sizes[0])
    np.testing.assert_allclose(second[1], second[1, 0, 0] * np.eye(3), atol=1e-12)


def test_nobody_tells_the_size_of_lonely_points():
    alone = ParameterSet.of_links(("hand",), KINDS)
    with pytest.raises(FeasibilityError, match="how large hand is"):
        repaired_prior(alone, np.array([1.0, *np.zeros(9)]))


def test_negative_masses_cannot_be_repaired():
    with pytest.raises(FeasibilityError, match="cannot be repaired: hand: its mass"):
        repaired_prior(TWO, values(-SOUND))


def test_massless_bodies_stay_massless(arm_case):
    prior = arm_case.prior.copy()
    columns = [j for j, p in enumerate(arm_case.base.parameters) if p.link == "lower"]
    prior[columns] = 0.0
    assert prior_defects(arm_case.base.parameters, prior) == ()
    problem, fit = arm_case.fitted(0.1)
    result = consistent_fit(problem, fit, arm_case.base, prior)
    assert not result.standard_parameters[columns].any()
    assert np.isnan(result.margins[result.bodies.index("lower")])
    assert not result.feasible
    truth = arm_case.truth.copy()
    truth[columns] = 0.0
    again = consistent_parameters(arm_case.base, arm_case.base.values(truth), prior)
    assert not again[columns].any()


def test_centres_outside_their_regions_are_moved_inside_on_request():
    regions = {"hand": Region.box(np.full(3, -0.15), np.full(3, 0.15))}
    (defect,) = prior_defects(TWO, values(SOUND), regions)
    assert "outside its region" in str(defect)
    repaired = repaired_prior(TWO, values(SOUND), regions)
    assert repaired[11:14] / repaired[10] in regions["hand"]
    assert repaired[10] == SOUND[0]
    before, after = bodies_of(TWO, values(SOUND))[1], bodies_of(TWO, repaired)[1]
    for P in (before, after):
        P[:3, :3] -= np.outer(P[3, :3], P[3, :3]) / P[3, 3]
    np.testing.assert_allclose(after[:3, :3], before[:3, :3], atol=1e-12)


def test_negative_friction_is_a_defect_and_becomes_zero():
    parameters = TWO + ParameterSet.from_labels(("joint.Fv", "joint.Fo"))
    prior = np.concatenate([values(SOUND), [-1.0, -1.0]])
    (defect,) = prior_defects(parameters, prior)
    assert str(defect) == "joint.Fv: it cannot be negative (-1)"
    np.testing.assert_array_equal(repaired_prior(parameters, prior)[-2:], [0.0, -1.0])


def test_priors_that_do_not_fit_are_refused():
    with pytest.raises(DataError, match=r"shape \(20,\)"):
        prior_defects(TWO, SOUND)
    with pytest.raises(DataError, match="finite"):
        prior_defects(TWO, values(np.full(10, np.nan)))
    with pytest.raises(OptionError, match=r"body of a region 'foot'.*arm, hand"):
        prior_defects(TWO, values(SOUND), {"foot": Region.box(-np.ones(3), np.ones(3))})
    part = ParameterSet.from_labels(("arm.m", "arm.mx", "arm.Ixx"))
    with pytest.raises(DataError, match="body arm lacks the parameters my, mz, Ixy"):
        prior_defects(part, np.ones(3))
