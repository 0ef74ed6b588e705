"""G and gamma are the velocities and accelerations of assembled motions; singularities are told."""

import warnings
from dataclasses import replace
from itertools import product

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq
from scipy.sparse.csgraph import connected_components

import loopid
from bank_robots import few_of
from loopid import random_configurations
from loopid.arguments import connected
from loopid.errors import AccuracyWarning, DataError, MobilityError, OptionError, SingularityError
from loopid.kinematics import (
    SamplingOptions,
    assemble,
    closed_motion,
    constraint_drift,
    constraint_jacobian,
    measured_coordinates,
    mobility,
    project,
    random_motions,
)
from loopid.kinematics.assembly import try_assemble
from loopid.kinematics.projection import NEAR_SINGULARITY, Solver, singularity_measure

LIMB_4 = ("leg4_revolute", "leg4_stroke", "platform_pitch", "platform_yaw")
CASES = {
    "3ups_rpu": None,
    "3ups_rpu by limb 4": LIMB_4,
    "pinned bar": None,
    "welded bar": None,
    "welded knee": None,
}


@pytest.fixture(scope="module", params=CASES)
def motion(request, four_bars, load_once, weld, knee):
    """A mechanism, closed configurations, independent joints and their velocities."""
    made = {"pinned bar": four_bars["3d"], "welded bar": four_bars["6d"]}
    if request.param == "welded knee":
        made["welded knee"] = load_once(weld(knee.path))
    robot = made.get(request.param) or load_once(request.param.split(" ")[0])
    q = random_configurations(robot, 8, seed=5)
    rates, _ = random_motions(robot, 8, seed=4)
    return robot, q, CASES[request.param], 0.05 * rates


def followed(motion, t):
    """The configurations after a time t at constant independent velocities."""
    robot, q, independent, rates = motion
    values = measured_coordinates(robot, independent).read(q.copy())
    outcomes = [
        assemble(robot, value + t * rate, independent, start=start)
        for value, rate, start in zip(values, rates, q, strict=True)
    ]
    return np.concatenate(outcomes)


def velocities(motion, q):
    robot, _, independent, rates = motion
    return np.einsum("nij,nj->ni", project(robot, q, independent=independent).G, rates)


def test_the_closures_allow_every_column_of_g(motion):
    robot, q, independent, _ = motion
    A, G = constraint_jacobian(robot, q), project(robot, q, independent=independent).G
    assert np.abs(A @ G).max() < 1e-12


def test_independent_velocities_are_their_own(motion):
    robot, q, independent, rates = motion
    projection = project(robot, q, independent=independent)
    chosen = robot.velocity_indices(independent or robot.actuated)
    np.testing.assert_array_equal(projection.independent, chosen)
    np.testing.assert_array_equal(
        projection.G[:, chosen], np.tile(np.eye(len(chosen)), (len(q), 1, 1))
    )
    moving = closed_motion(robot, q, rates, np.zeros_like(rates), independent=independent)
    np.testing.assert_array_equal(moving.gamma[:, chosen], 0)


def test_g_is_the_velocity_of_the_assembled_motion(motion, rate):
    robot, q, _, _ = motion

    def displacement(t):
        pairs = zip(q, followed(motion, t), strict=True)
        return np.array([pin.difference(robot.model, *pair) for pair in pairs])

    np.testing.assert_allclose(velocities(motion, q), rate(displacement), atol=1e-7)


def test_gamma_is_the_acceleration_of_the_assembled_motion(motion, rate):
    robot, q, independent, rates = motion
    gamma = closed_motion(robot, q, rates, np.zeros_like(rates), independent=independent).gamma
    expected = rate(lambda t: velocities(motion, followed(motion, t)))
    np.testing.assert_allclose(gamma, expected, rtol=1e-6, atol=1e-6)


def test_gamma_balances_the_drift(motion):
    robot, q, independent, rates = motion
    A = constraint_jacobian(robot, q)
    gamma = closed_motion(robot, q, rates, np.zeros_like(rates), independent=independent).gamma
    drift = constraint_drift(robot, q, velocities(motion, q))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, gamma), -drift, atol=1e-10)


def test_two_choices_of_independent_joints_span_the_same_motions(mechanism, poses):
    strokes, limb_4 = project(mechanism, poses).G, project(mechanism, poses, independent=LIMB_4).G
    change = strokes[:, mechanism.velocity_indices(LIMB_4)]
    np.testing.assert_allclose(limb_4 @ change, strokes, atol=1e-9)


def test_a_tree_moves_freely(mechanism, poses):
    tree = replace(mechanism, closures=(), actuated=mechanism.joints)
    motion = closed_motion(tree, poses, *np.ones((2, len(poses), 13)))
    np.testing.assert_array_equal(motion.projection.G, np.tile(np.eye(13), (len(poses), 1, 1)))
    np.testing.assert_array_equal(motion.gamma, 0)
    np.testing.assert_array_equal(motion.projection.singularity, 1)


@pytest.mark.parametrize("rates", [np.zeros((12, 3)), np.zeros((2, 4)), np.full((12, 4), np.nan)])
def test_bad_velocities_are_refused(mechanism, poses, rates):
    with pytest.raises(DataError) as error:
        closed_motion(mechanism, poses, rates, rates)
    assert error.value.facts["argument"] == "velocities"


def test_bad_independent_joints_are_refused_by_name(mechanism, poses):
    with pytest.raises(OptionError) as unknown:
        project(mechanism, poses, independent=["knee"])
    assert unknown.value.facts["given"] == "knee"
    assert "leg1_stroke" in unknown.value.facts["valid"]
    with pytest.raises(MobilityError) as twice:
        project(mechanism, poses, independent=["leg1_stroke", "leg1_stroke"])
    assert twice.value.facts["given"] == ("leg1_stroke", "leg1_stroke")
    with pytest.raises(MobilityError) as many:
        project(mechanism, poses, independent=[*LIMB_4, "leg1_stroke"])
    assert many.value.facts == {"given": 5, "freedom": 4}


# Published for the 3UPS+RPU at x_m = 0, z_m = 0.7 m, theta = 0: yaw (rad), determinant (m²).
PUBLISHED = {-0.3: 0.0445, 0.0: 0.0273, 0.2: 0.0141, 0.4: 0.0032}


def at_yaw(knee, yaw):
    poses = np.array([[0, 0.7, 0, yaw] for yaw in np.atleast_1d(yaw)])
    return assemble(knee, poses, "platform")


def stroke_determinant(knee, q):
    """Determinant (N,) of the strokes' derivative by x_m, z_m, theta, psi.

    Limb 4 is a pair of polar coordinates of (x_m, z_m), whose radius is its stroke.
    """
    G = project(knee, q, independent=LIMB_4).G
    strokes = knee.velocity_indices(knee.actuated)
    radius = q[:, knee.velocity_indices(["leg4_stroke"])][:, 0]
    return np.linalg.det(G[:, strokes]) / radius


@pytest.fixture(scope="module")
def singular_yaw(knee):
    return brentq(lambda yaw: stroke_determinant(knee, at_yaw(knee, yaw))[0], 0.4, 0.6, xtol=1e-14)


def test_the_stroke_jacobian_has_the_published_determinants(knee):
    found = stroke_determinant(knee, at_yaw(knee, list(PUBLISHED)))
    np.testing.assert_allclose(np.abs(found), list(PUBLISHED.values()), atol=5e-5)


def test_the_measure_vanishes_at_the_singularity_and_nowhere_near(knee, singular_yaw):
    distances = np.array([0.0, 1e-6, 1e-4, 1e-2])
    measures = singularity_measure(knee, at_yaw(knee, singular_yaw - distances))
    assert measures[0] < 1e-10
    # It grows with the distance, linearly at first.
    np.testing.assert_allclose(measures[1:3] / measures[2], distances[1:3] / 1e-4, rtol=1e-2)
    assert measures[3] > 50 * measures[2]


def test_a_singular_configuration_is_refused_by_sample(knee, singular_yaw):
    q = at_yaw(knee, [0.0, singular_yaw, 0.1])
    with pytest.raises(SingularityError) as error:
        project(knee, q)
    facts = error.value.facts
    assert (facts["sample"], facts["rank"], facts["dependent"], facts["samples"]) == (1, 8, 9, 1)
    assert facts["measure"] <= facts["tolerance"] == project(knee, q[:1]).tolerance


def test_a_configuration_near_it_is_warned_of_by_sample(knee, singular_yaw):
    q = at_yaw(knee, [0.0, singular_yaw - 1e-4, singular_yaw - 1e-3])
    measure = singularity_measure(knee, q)
    assert (measure[1:] < NEAR_SINGULARITY).all()
    assert measure[0] > NEAR_SINGULARITY
    with pytest.warns(AccuracyWarning, match=r"2 samples are near .* first sample 1 "):
        projection = project(knee, q)
    np.testing.assert_array_equal(projection.singularity, measure)


def test_regular_configurations_pass_in_silence(mechanism, poses):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert (project(mechanism, poses).singularity > NEAR_SINGULARITY).all()


def test_other_independent_joints_are_regular_where_the_motors_are_singular(knee, singular_yaw):
    q = at_yaw(knee, singular_yaw)
    assert project(knee, q, independent=LIMB_4).singularity[0] > 0.01


def test_the_motion_that_the_motors_lose_is_named(knee, singular_yaw):
    found = mobility(knee, at_yaw(knee, singular_yaw)[0])
    assert found.degrees_of_freedom == 4
    assert "platform_yaw" in found.undetermined
    assert not set(found.undetermined) & set(knee.actuated)


def test_the_motors_hold_every_joint_at_the_reference(mechanism):
    found = mobility(mechanism)
    assert (found.rows, found.rank, found.degrees_of_freedom) == (9, 9, 4)
    assert found.undetermined == ()
    assert found.rank_gap == np.inf


@pytest.mark.parametrize(("kind", "rows", "rank"), [("3d", 3, 2), ("6d", 6, 3)])
def test_redundant_rows_of_a_planar_loop_are_counted_once(four_bars, kind, rows, rank):
    found = mobility(four_bars[kind])
    assert (found.rows, found.rank, found.degrees_of_freedom) == (rows, rank, 1)
    assert found.rank_gap > 1e12


@pytest.mark.parametrize("place", [3, 700, 1199])
def test_one_singular_configuration_among_many_is_refused_by_sample(knee, singular_yaw, place):
    q = np.repeat(at_yaw(knee, 0.1), 1200, axis=0)
    q[place] = at_yaw(knee, singular_yaw)[0]
    with pytest.raises(SingularityError) as error:
        project(knee, q)
    assert (error.value.facts["sample"], error.value.facts["samples"]) == (place, 1)


def test_those_near_it_among_many_are_counted_and_no_others(knee, singular_yaw):
    q = np.repeat(at_yaw(knee, 0.1), 1200, axis=0)
    near = [5, 600, 1100]
    q[near] = at_yaw(knee, singular_yaw - 1e-4)
    with pytest.warns(AccuracyWarning, match=r"3 samples are near .* first sample 5 "):
        projection = project(knee, q)
    alone = project(knee, at_yaw(knee, 0.1))
    regular = np.delete(np.arange(1200), near)
    same = np.broadcast_to(alone.G, projection.G[regular].shape)
    np.testing.assert_allclose(projection.G[regular], same, rtol=0, atol=1e-12)
    np.testing.assert_allclose(projection.singularity[regular], alone.singularity[0], rtol=1e-12)


MM = 1000.0


def in_millimetres(geometry, robot):
    """A row of the geometry table, and its robot, with every length a thousand times larger."""
    lengths = {
        key: value if key.startswith("beta") else MM * value for key, value in geometry.items()
    }
    x_m, z_m, *angles = robot["home"]
    return lengths, robot | {
        "home": [MM * x_m, MM * z_m, *angles],
        "strokes": {limb: [MM * end for end in ends] for limb, ends in robot["strokes"].items()},
        "inertials": {
            link: [mass, [MM * x for x in centre], [MM**2 * value for value in inertia]]
            for link, (mass, centre, inertia) in robot["inertials"].items()
        },
    }


@pytest.fixture(scope="module", params=few_of(["3ups_rpu", "3ups_rpu welded"], "3ups_rpu welded"))
def pair(request, generator, write_robot, weld):
    name, _, welded = request.param.partition(" ")
    robot = generator.read_table()[name]
    geometry = robot["configurations"][1]
    descriptions = (geometry, robot), in_millimetres(geometry, robot)
    files = [write_robot(*description) for description in descriptions]
    return [loopid.load(weld(file) if welded else file) for file in files]


@pytest.fixture(scope="module")
def to_mm(pair):
    """Factors (nq,) between the coordinates of the two descriptions."""
    return np.where(np.isin(np.arange(pair[0].model.nv), pair[0].prismatic), MM, 1.0)


def test_the_singularity_measure_is_the_same(pair, to_mm):
    q = random_configurations(pair[0], 50, seed=4, options=SamplingOptions(singularity_threshold=0))
    metre, millimetre = (
        singularity_measure(robot, q * scales)
        for robot, scales in zip(pair, (1.0, to_mm), strict=True)
    )
    np.testing.assert_allclose(millimetre, metre, rtol=1e-9)


def test_the_same_strokes_can_be_assembled(pair, to_mm):
    # Twice as long a travel as the drives have, so that a good part is out of reach.
    motors = pair[0].velocity_indices(pair[0].actuated)
    centre = pair[0].reference[motors]
    strokes = centre + np.random.default_rng(1).uniform(-0.4, 0.4, size=(40, 4))
    metre, millimetre = (
        try_assemble(robot, strokes * unit) for robot, unit in zip(pair, (1.0, MM), strict=True)
    )
    assert 4 < metre.assembled.sum() < 36
    np.testing.assert_array_equal(millimetre.assembled, metre.assembled)
    reached = metre.assembled
    np.testing.assert_allclose(
        millimetre.configurations[reached], metre.configurations[reached] * to_mm, rtol=1e-6
    )


@pytest.mark.parametrize("shape", [(1, 4, 4), (1, 6, 4), (5, 6, 4), (5, 4, 6)])
@pytest.mark.parametrize("least", [1.0, 1e-6, 0.0])
def test_solves_are_least_squares_whatever_shape_and_condition(shape, least):
    rng = np.random.default_rng(1)
    matrices, right = rng.standard_normal(shape), rng.standard_normal((*shape[:2], 3))
    matrices[-1, :, 0] = matrices[-1, :, 1] + least * matrices[-1, :, 0]
    found = Solver.of(matrices, NEAR_SINGULARITY).solve(right)
    for k, (A, B) in enumerate(zip(matrices, right, strict=True)):
        expected = np.linalg.lstsq(A, B, rcond=1e-9)[0]
        np.testing.assert_allclose(found[k], expected, rtol=1e-7, atol=1e-9 / (least or 1.0))


def test_groups_of_links_are_connected_components():
    rng = np.random.default_rng(0)
    for count, share in product((0, 1, 2, 7, 40), (0.0, 0.02, 0.2)):
        links = rng.random((count, count)) < share
        found = connected(links | links.T)
        number, group = connected_components(links, directed=False) if count else (0, links)
        assert [each.tolist() for each in found] == [
            np.flatnonzero(group == k).tolist() for k in range(number)
        ]
