"""What the paper's tables and figures are computed from, at a low rate."""

import pytest

from loopid.paper.reproduction import run_experiment, simulate_stand_in


@pytest.fixture(scope="session")
def comparison(paper):
    return paper.base


@pytest.fixture(scope="session")
def experiment(paper):
    return paper.experiment


@pytest.fixture(scope="session")
def coarse(knee, once):
    """A tenth of the samples of the small experiment."""
    return once("coarse", lambda: run_experiment(knee, 0.2))


@pytest.fixture(scope="session")
def short(knee, once):
    """Two short trajectories at the rate of the paper's reproduction."""
    return once("short", lambda: run_experiment(knee, 10.0, names=("3", "9")))


@pytest.fixture(scope="session")
def made(short, once):
    """Recordings of stand-ins of two seeds, and the bodies of each."""
    return once("stand-ins", lambda: [simulate_stand_in(short, seed) for seed in (0, 2)])
