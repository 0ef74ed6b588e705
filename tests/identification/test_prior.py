"""The prior: what is refused body by body, and repaired only on request."""

import numpy as np
import pytest
from oracles import bodies_of

from loopid.errors import DataError
from loopid.identification import consistent_fit, consistent_parameters, repaired_prior
from loopid.identification.consistent_program import THICKNESS, matrix, minimise, sound_prior
from loopid.inertia import FLAT
from loopid.loading import inertia_defects
from loopid.parameters import KINDS, ParameterSet

TWO = ParameterSet.of_links(("arm", "hand"), KINDS)
SOUND = np.array([2.0, 0.2, 0.0, 0.4, 0.3, 0.0, 0.3, -0.04, 0.0, 0.1])


def values(hand):
    return np.concatenate([SOUND, hand])


def rod(thickness=0.0):
    """Along x, about its middle."""
    across = 0.5 * (1 + thickness)
    return np.array([1.0, 0, 0, 0, thickness, 0, across, 0, 0, across])


def test_sound_bodies_have_no_defect():
    sound_prior(TWO, values(SOUND))
    np.testing.assert_array_equal(repaired_prior(TWO, values(SOUND)), values(SOUND))


def test_the_thin_stem_is_named_with_what_to_do(load_once):
    robot = load_once("5p")
    parameters, prior = robot.parameters(), robot.standard_parameters()
    with pytest.raises(DataError, match="the prior of leg4_stem is not"):
        sound_prior(parameters, prior)
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
        DataError,
        match=r"the prior of lower is not physically consistent: lower: .*repair=True",
    ):
        consistent_fit(problem, fit, arm_case.base, prior)
    with pytest.raises(DataError, match=r"lower: .*repair=True"):
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
    with pytest.raises(DataError, match=f"the prior of hand is not.*{reason}"):
        sound_prior(TWO, values(hand))
    if repairable:
        sound_prior(TWO, repaired_prior(TWO, values(hand)))
    else:
        with pytest.raises(DataError, match=f"cannot be repaired: hand: .*{reason}"):
            repaired_prior(TWO, values(hand))


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
    with pytest.raises(DataError, match="how large hand is"):
        repaired_prior(alone, np.array([1.0, *np.zeros(9)]))


def test_massless_bodies_stay_massless(arm_case):
    prior = arm_case.prior.copy()
    columns = [j for j, p in enumerate(arm_case.base.parameters) if p.link == "lower"]
    prior[columns] = 0.0
    problem, fit = arm_case.fitted(0.1)
    result = consistent_fit(problem, fit, arm_case.base, prior)
    assert not result.standard_parameters[columns].any()
    assert np.isnan(result.margins[result.bodies.index("lower")])
    assert not result.feasible
    truth = arm_case.truth.copy()
    truth[columns] = 0.0
    again = consistent_parameters(arm_case.base, arm_case.base.values(truth), prior)
    assert not again[columns].any()


def test_negative_friction_is_a_defect_and_becomes_zero():
    parameters = TWO + ParameterSet.from_labels(("joint.Fv", "joint.Fo"))
    prior = np.concatenate([values(SOUND), [-1.0, -1.0]])
    with pytest.raises(DataError, match=r"joint\.Fv: it cannot be negative \(-1\)"):
        sound_prior(parameters, prior)
    np.testing.assert_array_equal(repaired_prior(parameters, prior)[-2:], [0.0, -1.0])


def test_priors_that_do_not_fit_are_refused():
    with pytest.raises(DataError, match=r"shape \(20,\)"):
        sound_prior(TWO, SOUND)
    with pytest.raises(DataError, match="finite"):
        sound_prior(TWO, values(np.full(10, np.nan)))
    part = ParameterSet.from_labels(("arm.m", "arm.mx", "arm.Ixx"))
    with pytest.raises(DataError, match="body arm lacks the parameters my, mz, Ixy"):
        sound_prior(part, np.ones(3))


def test_gravity_bodies_without_known_size_are_refused(knee_gravity):
    base, prior = knee_gravity.base, knee_gravity.prior.copy()
    moments = [j for j, p in enumerate(base.parameters) if p.kind in ("mx", "my", "mz")]
    prior[moments] = 0.0
    with pytest.raises(DataError, match="use the full model"):
        consistent_parameters(base, base.values(knee_gravity.truth), prior)


@pytest.mark.parametrize("regularisation", ["entropic", "riemannian"])
@pytest.mark.parametrize("mu", [0.5, 1.0, 3.0])
def test_second_moments_that_gravity_does_not_show_cost_nothing(
    knee_gravity, whitened, regularisation, mu
):
    """The distance of a body is the least over all second moments it may have."""
    w = whitened(knee_gravity, margin=0.0)
    columns, P = w.prior.columns[3], w.prior.factors[3] @ w.prior.factors[3].T
    mass, centre = P[3, 3], P[3, :3] / P[3, 3]
    deviation = np.sqrt(P[0, 0] / mass - centre[0] ** 2)
    delta = np.array([0.5, -1.0, 0.2])
    shift = delta @ delta
    wanted = mu * mass * np.append(1.0, centre + delta * deviation)
    target = wanted - w.prior.values[columns]
    found = minimise(w, w.map[columns], target, regularisation, exact=True)
    np.testing.assert_allclose(w.standard_parameters(found)[columns], wanted)
    X = matrix(found[: w.inside].reshape(-1, 10))
    eigenvalues = np.linalg.eigvalsh(np.eye(4) + X)
    distance, expected = {
        "entropic": (
            (eigenvalues - 1 - np.log(eigenvalues)).sum(),
            mu - 1 - np.log(mu) + mu * shift,
        ),
        "riemannian": ((X[:, 3] ** 2 * [1, 1, 1, 0.5]).sum(), (mu - 1) ** 2 / 2 + mu**2 * shift),
    }[regularisation]
    assert distance == pytest.approx(expected, rel=1e-3)
