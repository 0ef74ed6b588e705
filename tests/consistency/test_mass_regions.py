"""Regions of centres of mass, and fits that keep to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid.consistency import Region, consistent_fit, consistent_parameters
from loopid.consistency.program import matrix, minimise
from loopid.errors import DataError, FeasibilityError

seeds = st.integers(0, 2**32 - 1)


def boxes(case, half):
    """A box about the prior's centre of mass for every body."""
    values = case.prior
    parameters = case.base.parameters
    labels = parameters.labels
    found = {}
    for body in dict.fromkeys(p.link for p in parameters if p.kind == "m"):
        m, *h = (values[labels.index(f"{body}.{kind}")] for kind in ("m", "mx", "my", "mz"))
        found[body] = Region.box(np.array(h) / m - half, np.array(h) / m + half)
    return found


def centres(parameters, values):
    labels = parameters.labels
    found = {}
    for body in dict.fromkeys(p.link for p in parameters if p.kind == "m"):
        m, *h = (values[labels.index(f"{body}.{kind}")] for kind in ("m", "mx", "my", "mz"))
        assert m > 0
        found[body] = np.array(h) / m
    return found


@given(seeds, st.integers(4, 30))
def test_a_hull_holds_all_mixtures_of_its_points_and_nothing_beyond(seed, count):
    generator = np.random.default_rng(seed)
    points = generator.normal(size=(count, 3)) + 100.0
    region = Region.hull(points)
    shares = generator.dirichlet(np.ones(count), 20)
    assert all((region.depths(p) >= -1e-9).all() for p in shares @ points)
    assert region.depths(region.centre).shape == region.offsets.shape
    for normal in generator.normal(size=(20, 3)):
        farthest = points[np.argmax(points @ normal)]
        beyond = farthest + 10 * normal / np.linalg.norm(normal) * np.ptp(points)
        assert beyond not in region


def test_a_box_is_the_hull_of_its_corners():
    box = Region.box(np.array([-1.0, 0, 2]), np.array([1.0, 3, 4]))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (0, 3) for z in (2, 4)], dtype=float)
    hull = Region.hull(corners)
    assert len(hull.offsets) == 6
    for point in np.random.default_rng(1).uniform(-5, 5, (200, 3)):
        assert (point in box) == (point in hull)
    for one, other in ((box.centre, hull.centre), (box.half_widths, hull.half_widths)):
        np.testing.assert_allclose(one, other)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Region.box(np.zeros(3), np.array([1.0, 1, 0])), "also in z"),
        (lambda: Region.box(np.zeros(2), np.ones(2)), r"shape \(3,\)"),
        (lambda: Region.hull(np.zeros((5, 3))), "span no volume"),
        (lambda: Region.hull(np.eye(3)), "span no volume"),
        (
            lambda: Region.hull(np.random.default_rng(0).normal(size=(9, 3)) * [1, 1, 0]),
            "no volume",
        ),
        (lambda: Region.hull(np.zeros((0, 3))), "span no volume"),
        (lambda: Region.hull(np.zeros((4, 2))), r"shape \(k, 3\)"),
        (lambda: Region.hull(np.full((4, 3), np.nan)), "finite"),
    ],
)
def test_what_has_no_inside_is_refused(make, match):
    with pytest.raises(DataError, match=match):
        make()


def test_gravity_fits_keep_masses_positive_and_centres_in_their_boxes(knee_gravity):
    half = 0.01
    regions = boxes(knee_gravity, half)
    truth = knee_gravity.base.values(knee_gravity.truth)
    for seed in range(4):
        problem, fit = knee_gravity.fitted(20.0, seed)
        result = consistent_fit(
            problem, fit, knee_gravity.base, knee_gravity.prior, regions=regions
        )
        for body, centre in centres(result.parameters, result.standard_parameters).items():
            assert centre in regions[body]
        W = knee_gravity.regressor
        free, kept = (np.linalg.norm(W @ (v - truth)) for v in (fit.values, result.values))
        assert kept < 1.1 * free


def test_binding_boxes_are_named(knee_gravity):
    regions = boxes(knee_gravity, 0.005)
    problem, fit = knee_gravity.fitted(30.0, seed=9)
    result = consistent_fit(problem, fit, knee_gravity.base, knee_gravity.prior, regions=regions)
    free = consistent_fit(problem, fit, knee_gravity.base, knee_gravity.prior)
    assert result.boundary
    assert set(result.boundary) <= set(regions) | {
        label for label in knee_gravity.base.parameters.labels if label.endswith((".Fc", ".Fv"))
    }
    assert result.fit_cost.total > free.fit_cost.total


def test_full_fits_keep_to_regions_too(arm_case):
    regions = boxes(arm_case, 0.01)
    problem, fit = arm_case.fitted(3.0, seed=2)
    result = consistent_fit(problem, fit, arm_case.base, arm_case.prior, regions=regions)
    for body, centre in centres(result.parameters, result.standard_parameters).items():
        assert centre in regions[body]
    free = consistent_fit(problem, fit, arm_case.base, arm_case.prior)
    assert any(
        centre not in regions[body]
        for body, centre in centres(free.parameters, free.standard_parameters).items()
    )


def test_exact_parameters_keep_to_regions_or_are_refused(knee_gravity):
    base, prior = knee_gravity.base, knee_gravity.prior
    shifted = prior.copy()
    labels = base.parameters.labels
    shifted[labels.index("platform.mx")] += 0.5
    values = base.values(shifted)
    found = consistent_parameters(base, values, prior, regions=boxes(knee_gravity, 0.5))
    np.testing.assert_allclose(base.values(found), values, atol=1e-10 * np.abs(values).max())
    for body, centre in centres(base.parameters, found).items():
        assert centre in boxes(knee_gravity, 0.5)[body]
    with pytest.raises(FeasibilityError, match="platform"):
        consistent_parameters(base, values, prior, regions=boxes(knee_gravity, 0.001))


def test_bodies_without_known_size_need_regions(knee_gravity):
    base, prior = knee_gravity.base, knee_gravity.prior.copy()
    moments = [j for j, p in enumerate(base.parameters) if p.kind in ("mx", "my", "mz")]
    prior[moments] = 0.0
    with pytest.raises(FeasibilityError, match="give regions"):
        consistent_parameters(base, base.values(knee_gravity.truth), prior)


@pytest.mark.parametrize("regularisation", ["entropic", "riemannian"])
@pytest.mark.parametrize("mu", [0.5, 1.0, 3.0])
def test_second_moments_that_gravity_does_not_show_cost_nothing(
    knee_gravity, whitened, regularisation, mu
):
    """The distance of a body is the least over all second moments it may have."""
    half = 0.3
    w = whitened(knee_gravity, regions=boxes(knee_gravity, half), margin=0.0)
    columns = w.prior.columns[3]
    mass, centre = (
        w.prior.values[columns[0]],
        w.prior.values[columns[1:]] / w.prior.values[columns[0]],
    )
    delta = np.array([0.5, -1.0, 0.2])  # in standard deviations of the box
    shift = delta @ delta
    wanted = mu * mass * np.append(1.0, centre + delta * half / np.sqrt(3))
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
