"""One identification of the knee robot, to be reported."""

import warnings

import pytest

from loopid.experiment import find_force_model, identify, split_recordings
from loopid.logs import prepare_recording, read_log
from made_runs import friction, logged, wander


@pytest.fixture(scope="session")
def identification(knee, tmp_path_factory):
    """From a log in which motors stand at times, through reading, filter and split."""
    path = tmp_path_factory.mktemp("logs") / "run_1.csv"
    terms = friction(knee)
    path.write_text(logged(knee, wander(knee, 1, seconds=40.0, rate=50.0), terms, noise=2.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        recording = prepare_recording(knee, read_log(path, knee))
        model = find_force_model(knee, "gravity", terms[0])
        return identify(model, *split_recordings([recording]))
