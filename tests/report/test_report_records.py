"""Records for machines: complete, and nothing that JSON cannot say."""

import json
from dataclasses import replace

import numpy as np
import pytest

from loopid.report import identification_record
from loopid.saved import SavedFit


def assert_strict(record):
    assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_the_record_is_strict_json(identification):
    assert_strict(identification_record(identification))


def test_an_identification_is_recorded_whole(identification):
    record, found = identification_record(identification), identification
    model, count = found.force_model, len(found.fit.values)
    assert (record["mechanism"], record["model"]) == ("3ups_rpu", "gravity")
    assert record["actuators"] == list(model.mechanism.actuated)
    assert record["expressions"] == list(model.base.expressions)
    assert len(record["expressions"]) == count == 23
    np.testing.assert_array_equal(record["robot_file"], model.prior)
    np.testing.assert_array_equal(record["essential"], found.essential.values)
    assert record["fit"] == SavedFit.of(model, found.fit).record()
    corrected = [model.parameters.labels[j] for j in found.reduction.columns]
    assert record["essential_parameters"] == corrected


def test_recordings_are_recorded_with_what_was_left_out(identification):
    record = identification_record(identification)
    for part, recordings in (
        (record["training"], identification.training),
        (record["validation"], identification.validation),
    ):
        (entry,), (recording,) = part, recordings
        assert (entry["name"], entry["samples"]) == ("run", len(recording))
        assert entry["used"] == recording.used.sum(axis=0).tolist()
        assert entry["cutoff"] == pytest.approx(2.5, rel=1e-3)
        assert any("stands still" in reason for reason in entry["dropped"])


def test_candidates_are_recorded_with_their_errors(identification):
    record = identification_record(identification)
    assert len(record["candidates"]) == 3
    for entry, candidate in zip(record["candidates"], identification.candidates, strict=True):
        assert (entry["name"], entry["fitted"]) == (candidate.name, candidate.fitted)
        assert entry["beats_baseline"] is candidate.beats_baseline
        ratio = entry["error_ratio"], entry["error_ratio_standard_error"]
        assert ratio == candidate.error_ratio
        for part in ("training", "validation"):
            quality = getattr(candidate, part)
            np.testing.assert_array_equal(entry[part]["rms"], quality.residual_rms)
            np.testing.assert_array_equal(entry[part]["r_squared"], quality.r_squared)


def test_what_is_not_finite_is_null(identification):
    candidate = identification.candidates[1]
    empty = replace(candidate.validation, residual_rms=np.full(4, np.nan))
    odd = replace(candidate, validation=empty, error_ratio=(np.inf, np.nan))
    candidates = (identification.candidates[0], odd, identification.candidates[2])
    record = identification_record(replace(identification, candidates=candidates))
    assert_strict(record)
    entry = record["candidates"][1]
    assert entry["validation"]["rms"] == [None] * 4
    assert entry["error_ratio"] is entry["error_ratio_standard_error"] is None
