"""Linkages with every kind of closure: freedoms, derivatives, units, and equal motions."""

import numpy as np
import pytest

import pinocchio_loops
from closure_robots import ROWS, in_millimetres
from linkages import LINKAGES, PLANAR
from loopid import (
    find_base_parameters,
    mobility,
    project,
    random_configurations,
    singularity_measure,
    structural_observation,
)
from loopid.kinematics import constraint_drift, constraint_jacobian, constraint_residual, null_space

# Coordinates, equations, independent ones, of linkages that are not loops of rows + 1 joints.
COUNTS = {
    "3d four-bar": (3, 3, 2),
    "6d four-bar": (4, 6, 3),
    "hinge four-bar": (3, 5, 2),
    "universal four-bar": (3, 4, 2),
    "cylindrical four-bar": (3, 4, 2),
    "2d four-bar": (3, 2, 2),
    "distance four-bar": (2, 1, 1),
    "prismatic slider-crank": (3, 5, 2),
    "cylindrical slider-crank": (3, 4, 2),
    "bennett": (3, 5, 2),
    "rod rssr": (2, 1, 1),
    "ball rssr": (5, 3, 3),
    "cross rssr": (4, 3, 3),
    "five-bar": (4, 3, 2),
    "redundant five-bar": (4, 3, 2),
    "geared five-bar": (4, 4, 3),
    "rack and pinion": (3, 1, 1),
}
SHARED = ("crank_joint", "coupler_joint", "rocker_joint")


@pytest.fixture(scope="module", params=LINKAGES)
def robot(request, linkage):
    return linkage(request.param)


@pytest.fixture(scope="module")
def closed(robot):
    return random_configurations(robot, 4, seed=1)


def test_every_linkage_has_its_rank(robot, request):
    name = request.node.callspec.params["robot"]
    rows = ROWS.get(name.split()[0], 0)
    coordinates, rows, rank = COUNTS.get(name, (rows + 1, rows, rows))
    found = mobility(robot)
    assert (robot.model.nv, found.rows, found.rank) == (coordinates, rows, rank)
    assert found.degrees_of_freedom == found.generic_degrees_of_freedom == coordinates - rank
    assert found.rank_gap > 1e12


@pytest.mark.parametrize("opened", [0.0, 0.3], ids=["closed", "open"])
def test_derivatives_are_those_of_the_residual(robot, closed, opened, move, rate):
    generator = np.random.default_rng(2)
    step, v, a = generator.uniform(-1, 1, size=(3, len(closed), robot.model.nv))
    q = move(robot, closed, opened * step)
    A = constraint_jacobian(robot, q)

    def residual(t):
        return constraint_residual(robot, move(robot, q, v * t + a * t**2 / 2))

    np.testing.assert_allclose(np.einsum("nij,nj->ni", A, v), rate(residual), atol=1e-9)
    second = rate(lambda t: rate(lambda s: residual(t + s)))
    found = np.einsum("nij,nj->ni", A, a) + constraint_drift(robot, q, v)
    np.testing.assert_allclose(found, second, atol=1e-6)


def test_the_velocity_map_spans_what_the_closures_allow(robot, closed):
    A, G = constraint_jacobian(robot, closed), project(robot, closed).G
    assert np.abs(A @ G).max() < 1e-12
    for jacobian, motions in zip(A, G, strict=True):
        assert null_space(jacobian).shape == motions.shape


@pytest.mark.parametrize("name", ["3d loop", "6d loop", "3d four-bar", "6d four-bar", "ball rssr"])
def test_pinocchios_own_closures_allow_the_same_motions(name, linkage):
    robot = linkage(name)
    for q in random_configurations(robot, 4, seed=1):
        motions = null_space(constraint_jacobian(robot, q)[0])
        theirs = pinocchio_loops.jacobian(robot, q)
        assert motions.shape[1] == robot.model.nv - np.linalg.matrix_rank(theirs, tol=1e-8)
        assert np.abs(theirs @ motions).max() < 1e-12


def test_a_robot_in_millimetres_is_the_same(robot, closed, request, load_files):
    name = request.node.callspec.params["robot"]
    other = load_files(*in_millimetres(*LINKAGES[name]))
    scales = np.ones(robot.model.nq)
    scales[robot.prismatic] = 1000.0
    assert other.independent == robot.independent
    assert np.abs(constraint_residual(other, closed * scales)).max() < 1e-10
    measures = [singularity_measure(*pair) for pair in ((robot, closed), (other, closed * scales))]
    np.testing.assert_allclose(*measures, rtol=1e-9)
    assert mobility(other).rank == mobility(robot).rank


@pytest.mark.parametrize("kind", [kind for kind in PLANAR if kind not in ("hinge", "distance")])
def test_a_four_bar_moves_alike_however_its_pin_is_written(kind, linkage):
    hinged, other = linkage("hinge four-bar"), linkage(f"{kind} four-bar")
    q = random_configurations(hinged, 20, seed=3)
    again = random_configurations(other, 20, seed=3)
    np.testing.assert_allclose(again[:, :3], q, atol=1e-9)
    G, same = project(hinged, q).G, project(other, again).G
    np.testing.assert_allclose(same[:, :3], G, atol=1e-9)


@pytest.mark.parametrize("kind", [kind for kind in PLANAR if kind != "distance"])
def test_a_four_bar_has_its_base_parameters_however_its_pin_is_written(kind, linkage):
    # Planar: 4 of each body, less a mass carried by each pivot and one a pin; see mechanisms.md.
    observation = structural_observation(linkage(f"{kind} four-bar"), "full")
    assert len(find_base_parameters(observation)) == 8
