"""What the paper's tables and figures are computed from, at a low rate."""

import pytest

from loopid.paper.experiment import Experiment
from small_paper import small_paper


@pytest.fixture(scope="session")
def paper():
    return small_paper()


@pytest.fixture(scope="session")
def comparison(paper):
    return paper.base


@pytest.fixture(scope="session")
def experiment(paper) -> Experiment:
    return paper.experiment


@pytest.fixture(scope="session")
def coarse(experiment):
    """A tenth of the samples of the small experiment."""
    return experiment.thinned(10)
