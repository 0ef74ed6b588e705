"""Closed loops that others describe: the document's table, and the robots loaded once."""

import warnings
from functools import cache

import pytest

import loopid
from bank_doc import table
from loopid import random_configurations

COLUMNS = ("model", "coordinates", "closure rank", "freedoms", "left free", "full", "gravity")
ROWS = {row["model"]: row for row in table(*COLUMNS)}
LARGE = ("gepetto/cassie_like/robot.yaml", "gepetto/digit_like/robot.yaml",
         "gepetto/disney_like/robot.yaml", "gepetto/robot_delta/robot.yaml",
         "mjcf/cassie.xml")  # fmt: skip
FRESH = 6  # poses that no base parameters are found from


def each(cases):
    """Cases, tuples or names of models alone; those of large models run in ``make validate``."""
    return [
        pytest.param(*own, marks=[pytest.mark.validate] if own[0] in LARGE else [])
        for own in ((case,) if isinstance(case, str) else case for case in cases)
    ]


def path(shared, name):
    """File of a model in the folder of reference data."""
    if name.endswith(".xml"):
        pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    return shared / "models" / name


@cache
def load(file):
    """A robot, and the categories of what loading it warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = loopid.load(file)
    return robot, {warning.category for warning in caught}


@cache
def poses(file):
    """Closed poses: fresh ones, then enough for two rows a column of the full model."""
    robot, _ = load(file)
    enough = -(-2 * len(robot.parameters()) // len(robot.independent))
    return random_configurations(robot, FRESH + enough, seed=5)
