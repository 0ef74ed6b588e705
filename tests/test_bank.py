"""What docs/mechanisms.md claims of the bank: counts, certificates, published sets."""

import numpy as np
import pinocchio as pin
import pytest

from bank_doc import PUBLISHED, certificate, published, table
from bank_robots import COUNTS, GAP, MODELS, ROBOTS, count, load, moved, observed, poses
from loopid.base_parameters import find_base
from loopid.kinematics import mobility
from loopid.regressors import motion_regressor

COLUMNS = ("full", "gravity", "full, alike", "gravity, alike")
CLAIMS = [(robot, column) for robot in ROBOTS for column in COLUMNS if COUNTS[robot][column]]
PLANAR = ("robot", "bodies", "grounded", "pins", "slides", "hinged loops", "full", "gravity")


def fresh(robot, column):
    """Regressor at poses that no structure was found from."""
    model, _, alike = column.partition(", ")
    mechanism = load(robot, bool(alike))
    K = motion_regressor(mechanism, moved(mechanism, model, poses(robot, 7)), model)
    return K.reshape(-1, K.shape[2])


def claimed_vectors(robot, column):
    return certificate(robot, column, observed(robot, column)[0].parameters.labels)


def visible(W, vectors):
    """Largest force of each vector (e, n), relative to what its terms have one by one."""
    return np.abs(W @ vectors.T).max(axis=0) / (np.abs(W) @ np.abs(vectors.T)).max(axis=0)


@pytest.mark.parametrize("robot", ROBOTS)
def test_bodies_and_motors_are_those_of_the_table(robot):
    assert len(load(robot).bodies) == count(robot, "bodies")
    assert len(load(robot).actuated) == count(robot, "motors")


@pytest.mark.parametrize(("robot", "column"), CLAIMS)
def test_the_count_is_the_documents(robot, column):
    _, structure = observed(robot, column)
    assert structure.rank == count(robot, column)
    assert structure.rank_gap > GAP


@pytest.mark.parametrize(("robot", "column"), CLAIMS)
def test_the_certificate_is_invisible_and_complete(robot, column):
    _, structure = observed(robot, column)
    vectors = claimed_vectors(robot, column)
    assert visible(fresh(robot, column), vectors[vectors.any(axis=1)]).max() < 1e-10
    independent = np.linalg.matrix_rank(vectors[:, structure.columns])
    assert len(structure.columns) - independent == structure.rank


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_certificate_with_a_wrong_number_is_seen(robot):
    vectors, W = claimed_vectors(robot, "full"), fresh(robot, "full")
    off = np.zeros_like(vectors)
    off[:, np.abs(W).max(axis=0).argmax()] = 1e-6
    assert visible(W, vectors + off).min() > 1e-9


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("robot", ROBOTS)
def test_base_parameters_give_the_forces_of_newton_and_euler(robot, model):
    mechanism = load(robot)
    base = find_base(observed(robot, model)[0])
    motion = moved(mechanism, model, poses(robot, 7))
    data = mechanism.model.createData()
    states = zip(motion.configurations, motion.velocities, motion.accelerations, strict=True)
    tree = np.array([pin.rnea(mechanism.model, data, *state) for state in states])
    forces = np.einsum("nji,nj->ni", motion.projection.G, tree).ravel()
    found = base.regressor(fresh(robot, model)) @ base.values(mechanism.standard_parameters(model))
    assert np.abs(found - forces).max() < 1e-8 * np.abs(forces).max()


@pytest.mark.parametrize("line", table(*PLANAR), ids=lambda line: line["robot"])
def test_counting_by_hand(line):
    bodies, grounded, pins, slides, loops, full, gravity = (int(line[key]) for key in PLANAR[1:])
    assert bodies == count(line["robot"], "bodies")
    assert 4 * bodies - grounded - pins - slides == full == count(line["robot"], "full")
    at_rest = 3 * bodies - grounded - pins - 2 * slides - loops
    assert at_rest == gravity == count(line["robot"], "gravity")


def test_the_closures_the_document_counts():
    four_bar, delta = mobility(load("four_bar")), mobility(load("delta"))
    assert (four_bar.rows, four_bar.rank) == (3, 2)
    assert (load("delta").model.nv, delta.rank, delta.degrees_of_freedom) == (18, 15, 3)


@pytest.mark.parametrize("robot", PUBLISHED)
def test_the_published_set_suffices_and_has_one_too_many(robot):
    number, _, column = COUNTS[robot]["published"].partition(" ")
    column = column.strip("()")
    observation, structure = observed(robot, column)
    P = published(robot, observation.parameters.labels)[:, structure.columns]
    W = fresh(robot, column)[:, structure.columns]
    W_P = W @ np.linalg.pinv(P)
    assert np.abs(W_P @ P - W).max() < 1e-11 * np.abs(W).max()
    assert len(P) == np.linalg.matrix_rank(P) == int(number)
    assert len(P) == structure.rank + 1
