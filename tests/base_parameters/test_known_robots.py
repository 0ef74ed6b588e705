"""Trees that others describe, whose numbers of base parameters are known: docs/mechanisms.md."""

import warnings
from itertools import pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

import loopid
from bank_doc import table
from bank_robots import GAP, MODELS, few_of, moved
from loopid import random_configurations
from loopid.base_parameters import find_base
from loopid.base_parameters.choice import CRITERIA
from loopid.base_parameters.structure import analyse
from loopid.errors import ModelWarning
from loopid.kinematics import closed_motion
from loopid.observation import Observation
from loopid.regressors import motion_regressor, structural_observation

ROWS = table("URDF", "motors", "full", "gravity")
for each in ROWS:  # a file, and options behind it
    each["URDF"], _, each["options"] = each["URDF"].partition("` `")
SMALL = 12  # motors of robots whose best choice is proven within a second
ORDINARY = ("ur5_robot.urdf", "panda.urdf", "solo12.urdf")
TALOS = "talos_data/robots/talos_full_v2.urdf"
FOLLOWERS = 12  # six links of either gripper, moved by the motor of a seventh


def options(row):
    words = row["options"].split()
    lock = [joint for option, joint in pairwise(words) if option == "--lock"]
    return {"lock": lock, "free_mimics": "--free-mimics" in words}


def name(row):
    own = row["URDF"].rpartition("/")[2].removesuffix(".urdf")
    return f"{own} {row['options'].partition(' ')[0]}".strip()


def ordinary(row):
    return row["URDF"].endswith(ORDINARY) and "--free-mimics" not in row["options"]


EVERY, SMALL_ONES = (
    pytest.mark.parametrize(
        "row", few_of(rows, *filter(ordinary, rows)), ids=name, indirect=True, scope="module"
    )
    for rows in (ROWS, [row for row in ROWS if int(row["motors"]) <= SMALL])
)


@pytest.fixture(scope="module")
def row(request, robot_data):
    if not (robot_data / request.param["URDF"]).is_file():
        pytest.skip(f"example-robot-data has no {request.param['URDF']}")
    return request.param


def load(*arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # what transmissions say beside the bodies
        return loopid.load(*arguments, **options)


@pytest.fixture(scope="module")
def robot(row, robot_data):
    return load(robot_data / row["URDF"], **options(row))


@pytest.fixture(scope="module")
def observations(robot):
    return {model: structural_observation(robot, model) for model in MODELS}


def fresh(robot, model):
    """Regressor at poses and in motions that no base parameters were found from."""
    return motion_regressor(
        robot, moved(robot, model, random_configurations(robot, 12, seed=8)), model
    )


@EVERY
def test_coordinates_and_motors_are_the_documents(row, robot):
    motors, mimicking = int(row["motors"]), row["URDF"] == TALOS and not row["options"]
    assert robot.model.nv == motors + FOLLOWERS * mimicking
    assert len(robot.actuated) == len(robot.independent) == motors


@EVERY
@pytest.mark.parametrize("model", MODELS)
def test_base_parameters_are_as_many_as_known_and_suffice(row, robot, observations, model):
    found = find_base(observations[model], "qr")
    assert len(found) == int(row[model])
    assert found.structure.rank_gap > GAP
    assert found.reconstruction_error(fresh(robot, model)) < 1e-8


@SMALL_ONES
@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("model", MODELS)
def test_those_of_small_robots_are_certified(row, robot, observations, model, criterion):
    found = find_base(observations[model], criterion=criterion)
    assert len(found) == int(row[model])
    assert found.search.certified
    assert found.structure.rank_gap > 1e10
    pivoted = find_base(observations[model], "qr", criterion=criterion)
    assert found.search.condition_number <= pivoted.search.condition_number * (1 + 1e-9)
    assert found.reconstruction_error(fresh(robot, model)) < 1e-10


@pytest.fixture(scope="module")
def talos(robot_data):
    """Talos with grippers that follow their motors, and with motors in all their joints."""
    file = robot_data / TALOS
    if not file.is_file():
        pytest.skip(f"example-robot-data has no {TALOS}")
    return load(file), load(file, free_mimics=True)


@pytest.fixture(scope="module")
def leading(talos):
    """P (44, 32): velocities of all joints from those of the leaders, as the file has it."""
    held, loose = talos
    P = np.array([[float(one == other) for other in held.independent] for one in loose.independent])
    for joint in ElementTree.parse(held.path).getroot().iter("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            leader = held.independent.index(mimic.get("joint"))
            follower = loose.independent.index(joint.get("name"))
            P[follower, leader] = float(mimic.get("multiplier", 1))
    assert np.count_nonzero(P) == P.shape[1] + FOLLOWERS == len(P)
    return P


@pytest.mark.parametrize("model", MODELS)
def test_the_rows_of_followers_merge_into_their_leaders(talos, leading, model):
    """K_held = Pᵀ K_free on poses where the grippers are as their motors hold them.

    Not the poses make the difference of the counts, but what is felt there: 44 forces, or 32.
    """
    held, loose = talos
    motion = moved(held, model, random_configurations(held, 40, seed=2))
    felt = motion_regressor(held, motion, model)
    rates = held.velocity_indices(held.independent)
    leaders = [part[:, rates] for part in (motion.velocities, motion.accelerations)]
    each = free_regressor(loose, motion.configurations, leaders, leading, model)
    np.testing.assert_allclose(felt, leading.T @ each, atol=1e-11 * np.abs(each).max())

    parameters = loose.parameters(model)
    merged, apart = (
        analyse(Observation.from_matrix(K, parameters, length=held.length)) for K in (felt, each)
    )
    assert (merged.rank, apart.rank) == tuple(known(opts, model) for opts in ("", "--free-mimics"))
    assert min(merged.rank_gap, apart.rank_gap) > GAP


def free_regressor(robot, q, leaders, leading, model):
    """Regressor of all joints' own forces where followers move as P has them."""
    motion = closed_motion(robot, q, *(rate @ leading.T for rate in leaders))
    return motion_regressor(robot, motion, model)


def known(opts, model):
    (row,) = (row for row in ROWS if row["URDF"] == TALOS and row["options"] == opts)
    return int(row[model])
