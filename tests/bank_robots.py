"""The bank's robots in memory: as they are bundled, and as the generator writes others."""

import importlib
import sys
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import loopid
from bank_doc import table
from loopid import random_configurations
from loopid.base_parameters.structure import analyse
from loopid.kinematics import closed_motion, random_motions
from loopid.observation import Observation
from loopid.regressors import motion_regressor

URDF = Path(__file__).parents[1] / "urdf"
COUNTS = {
    row["robot"]: row
    for row in table(
        "robot", "bodies", "motors", "full", "gravity", "full, alike", "gravity, alike", "published"
    )
}
ROBOTS = list(COUNTS)
MODELS = ("full", "gravity")
GAP = 1e6
POSES = 50  # at least half as many rows again as columns with an effect, for each of the robots


def few_of(names, *few):
    """Names, or tuples of values, as parameters: a few in an ordinary run, all to validate."""
    return [
        pytest.param(
            *(name if isinstance(name, tuple) else (name,)),
            marks=() if name in few else pytest.mark.validate,
        )
        for name in names
    ]


def count(robot, column):
    return int(COUNTS[robot][column])


@cache
def load(robot, alike=False):
    return loopid.load(robot, tied=alike)


@cache
def poses(robot, seed=0):
    return random_configurations(load(robot), POSES, seed=seed)


def moved(mechanism, model, q):
    """Random motion through poses, or rest in them."""
    rates = random_motions(mechanism, len(q), seed=1)
    return closed_motion(mechanism, q, *(rates if model == "full" else (0 * r for r in rates)))


def observe(mechanism, model, q):
    """Observation of a mechanism at poses, and its structure."""
    W = motion_regressor(mechanism, moved(mechanism, model, q), model)
    parameters = mechanism.parameters(model)
    observation = Observation.from_matrix(W, parameters, length=mechanism.length)
    return observation, analyse(observation)


@cache
def observed(robot, column, seed=0):
    """Observation and structure of a bundled robot, for a column of the table of counts."""
    model, _, alike = column.partition(", ")
    return observe(load(robot, bool(alike)), model, poses(robot, seed))


@cache
def generator():
    """The module that writes the files."""
    sys.path.insert(0, str(URDF))
    try:
        return importlib.import_module("generate_bank")
    finally:
        sys.path.remove(str(URDF))


def row(robot):
    """The robot's row of bank.yaml, to be changed at will."""
    return generator().read_table(generator().TABLE)[robot]


def plan(robot, changed_row):
    return generator().BUILDERS[robot](robot, changed_row)


def ranks(robot, changed_row, change=lambda urdf: urdf):
    """Numbers of base parameters, full and gravity, with other dimensions or another URDF."""
    files = plan(robot, changed_row).files()
    with TemporaryDirectory() as folder:
        files.write(Path(folder), robot)
        (Path(folder) / f"{robot}.urdf").write_text(change(files.urdf))
        mechanism = loopid.load(Path(folder) / f"{robot}.yaml")
    q = random_configurations(mechanism, POSES)
    found = {model: observe(mechanism, model, q)[1] for model in MODELS}
    assert min(structure.rank_gap for structure in found.values()) > GAP
    return {model: structure.rank for model, structure in found.items()}


def nearby(home, shift):
    """A pose, or a crank angle, a little away from home."""
    moved_home = (np.atleast_1d(home) + shift[: np.size(home)]).tolist()
    return moved_home if isinstance(home, list) else moved_home[0]
