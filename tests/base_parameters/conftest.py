"""The knee robots, their geometry table and their regressors, made once."""

import pytest

import loopid
from loopid.base_parameters import find_base
from loopid.regressors import structural_observation


@pytest.fixture(scope="session")
def table(generator):
    """``urdf/geometry.yaml``: robot to configurations, strokes and inertials."""
    return generator.read_table()


@pytest.fixture(scope="session")
def knee_observation(knee):
    return structural_observation(knee)


@pytest.fixture(scope="session")
def knee_base(knee_observation):
    return find_base(knee_observation)


@pytest.fixture(scope="session")
def papers_choice(knee_observation, once):
    """That of the subgroup search."""
    return once("papers_choice", lambda: find_base(knee_observation, "subgroup"))


@pytest.fixture(scope="session")
def observe_robot(write_robot, table):
    """Gravity observation of a knee robot of any geometry, with strokes of its own."""

    def observe(geometry, robot, strokes, samples=100):
        entries = table[robot] | {"strokes": strokes}
        mechanism = loopid.load(write_robot(geometry, entries))
        return structural_observation(mechanism, samples=samples)

    return observe
