"""The real robots' logs: what the first part tells holds for the rest, and intervals are stable."""

import warnings

import numpy as np
import pytest

from loopid import (
    JointTerms,
    find_force_model,
    identify,
    load_mechanism,
    prepare_recording,
    read_log,
    split_recordings,
)
from loopid.identification import correlation, quiet_fit

LOGS = {"3ups_rpu": "exp_18_12_2020-12_36_29", "5p": "exp_20_01_2021-16_15_33"}


@pytest.fixture(scope="module", params=LOGS)
def found(request, shared):
    robot = load_mechanism(request.param)
    log = read_log(shared / "data" / "upv" / "logs" / LOGS[request.param], robot)
    model = find_force_model(robot, "gravity", JointTerms(robot.actuated, ("Fc", "Fv")))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return identify(model, *split_recordings([prepare_recording(robot, log)]))


def test_the_first_part_predicts_the_rest_better_than_the_robot_file(found):
    assert found.supported.beats_baseline
    assert (found.supported.validation.r_squared > 0.7).all()
    assert found.best is not found.baseline


def test_what_the_data_do_not_support_is_named(found):
    weak = found.fit.insignificant()
    assert len(weak) >= 5
    errors = dict(zip(found.fit.parameters.labels, found.fit.standard_errors, strict=True))
    # Intervals of the weakest exceed what such a link can have by far: they say so.
    assert max(errors[name] for name in weak) > 5
    assert len(found.reduction.result.parameters) < len(found.fit.parameters) / 2


def test_the_model_of_the_errors_settles(found, monkeypatch):
    noise = found.fit.noise
    monkeypatch.setattr(correlation, "CORRECTIONS", 0)
    first = quiet_fit(found.samples[0])
    monkeypatch.setattr(correlation, "CORRECTIONS", 12)
    longer = quiet_fit(found.samples[0])
    np.testing.assert_allclose(longer.standard_errors, found.fit.standard_errors, rtol=0.01)
    # What a fit takes up makes errors slower, not something else.
    assert (noise.effective_samples <= 1.01 * first.noise.effective_samples).all()
    assert (noise.effective_samples >= 0.5 * first.noise.effective_samples).all()
    assert (found.fit.standard_errors >= 0.99 * first.standard_errors).all()
