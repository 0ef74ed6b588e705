"""Robots of many bodies have ranks that are known in closed form."""

import pytest

from bank_robots import moved
from closure_robots import chain
from folded_robots import parallelogram_chain
from loopid import random_configurations
from loopid.base_parameters import find_base
from loopid.regressors import motion_regressor, structural_observation
from loopid.report.structure import base_record, check_record

# Of n bodies in a row 7 each but 3 of the first, at rest 2 each [Khalil2004]; a parallelogram adds
# what a four-bar has, and a turning base three, at rest two.
KINDS = {
    "chain": lambda n: ((chain(n), {}), {"full": 7 * n - 4, "gravity": 2 * n}),
    "parallelograms": lambda n: (
        parallelogram_chain(n // 3),
        {"full": 5 * (n // 3) + 3, "gravity": 2 * (n // 3) + 2},
    ),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bodies", [6, pytest.param(180, marks=pytest.mark.validate)])
def test_a_large_robot_has_its_known_rank(kind, bodies, load_files):
    files, ranks = KINDS[kind](bodies)
    robot = load_files(*files)
    assert len(check_record(robot)["joints"]) == bodies + (kind == "parallelograms")
    for model, rank in ranks.items():
        observation = structural_observation(robot, model)
        base = find_base(observation)
        record = base_record(robot, model, base)
        assert record["rank"] == len(record["base_parameters"]) == rank
        assert not record["doubtful"]

        fresh = moved(robot, model, random_configurations(robot, 3, seed=9))
        W = motion_regressor(robot, fresh, model)
        assert base.reconstruction_error(W) < 1e-8
        # The gap is a bound on every choice, another search's too.
        other = find_base(observation, "qr").search
        best = base.search
        assert best.condition_number / best.gap <= other.condition_number * (1 + 1e-6)
