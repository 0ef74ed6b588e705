"""Records for machines: complete, and nothing that JSON cannot say."""

import json
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import floats

from loopid import find_base_parameters, load_mechanism, structural_observation
from loopid.base_parameters.expressions import expression
from loopid.report import base_record, check_record, identification_record, motions_record
from loopid.report.base import certificate
from loopid.robot import named_lengths
from loopid.trajectories import JointRange, MotionReview


@pytest.fixture(scope="module")
def robot():
    return load_mechanism("3ups_rpu")


def assert_strict(record):
    assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_records_are_strict_json(robot, identification, paper):
    base = find_base_parameters(structural_observation(robot))
    assert_strict(base_record(robot.name, "gravity", base))
    assert_strict(check_record(robot))
    assert_strict(identification_record(identification))
    assert_strict(motions_record(robot.name, paper.experiment.reviews, paper.seconds))


def test_a_search_without_a_certificate_says_how_much_is_proven(robot):
    base = find_base_parameters(structural_observation(robot), "qr")
    records = {
        gap: base_record(robot.name, "gravity", replace(base, search=replace(base.search, gap=gap)))
        for gap in (inf, 1.16914, 3.3906)
    }
    for record in records.values():
        assert_strict(record)
    found = {gap: (r["search"]["gap"], certificate(r["search"])) for gap, r in records.items()}
    assert found == {
        inf: (None, "not certified: a better choice may exist"),
        1.16914: (1.16914, "not certified: at most 17 % above the least possible"),
        3.3906: (3.3906, "not certified: at most 3.4 times the least possible"),
    }


@given(gap=floats(1 + 1e-6, 1e12))
def test_a_printed_bound_holds(gap):
    said = certificate({"certified": False, "gap": gap})
    (number,) = [float(word) for word in said.split() if word[0].isdigit()]
    printed = 1 + number / 100 if "%" in said else number
    assert gap <= printed * (1 + 1e-12)
    assert printed - 1 < 1.011 * (gap - 1)


def test_terms_rebuild_the_matrix(robot):
    base = find_base_parameters(structural_observation(robot))
    record = base_record(robot.name, "gravity", base)
    labels = base.parameters.labels
    for parameter, row in zip(record["base_parameters"], base.matrix, strict=True):
        assert list(row) == [parameter["terms"].get(label, 0.0) for label in labels]


def test_coefficients_are_named_and_their_lengths_listed(robot):
    base = find_base_parameters(structural_observation(robot))
    record = base_record(robot.name, "gravity", base, named_lengths(robot))
    assert_strict(record)
    (row,) = [row for row in record["base_parameters"] if row["name"] == "platform.mx"]
    assert row["coefficients"] == {
        "platform.mx": None,
        "leg1_stem.m": "x(platform_B1)",
        "leg2_stem.m": "x(platform_B2)",
    }
    assert row["where"] == ["-0.3 = x(platform_B1)", "0.1928 = x(platform_B2)"]
    assert row["expression"] == f"{expression(row['terms'])}, where {', '.join(row['where'])}"
    assert [length["symbol"] for length in record["lengths"]] == [
        f"{axis}(platform_B{leg})" for axis, leg in ("x1", "x2", "y2", "y3")
    ]
    # x of B1, y of B3 and the distance of B2 are all 0.3 m.
    assert [length["equally_long"] for length in record["lengths"]] == [2, 0, 0, 2]


def test_without_lengths_sums_stay_numbers(robot):
    base = find_base_parameters(structural_observation(robot))
    record = base_record(robot.name, "gravity", base)
    assert [row["expression"] for row in record["base_parameters"]] == list(base.expressions)
    assert record["lengths"] == []


def test_an_identification_is_recorded_whole(identification):
    record, found = identification_record(identification), identification
    model, count = found.force_model, len(found.fit.values)
    assert (record["mechanism"], record["model"]) == ("3ups_rpu", "gravity")
    assert record["actuators"] == list(model.mechanism.actuated)
    assert record["expressions"] == list(model.base.expressions)
    assert len(record["expressions"]) == count == 23
    np.testing.assert_array_equal(record["robot_file"], model.prior)
    np.testing.assert_array_equal(record["supported"], found.supported.values)
    assert record["fit"] == found.fit.record()
    corrected = [model.parameters.labels[j] for j in found.reduction.columns]
    assert record["supported_corrections"] == corrected


def test_recordings_are_recorded_with_what_was_left_out(identification):
    record = identification_record(identification)
    for part, recordings in (
        (record["training"], identification.training),
        (record["validation"], identification.validation),
    ):
        (entry,), (recording,) = part, recordings
        assert (entry["name"], entry["samples"]) == ("run_1", len(recording))
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


def test_a_motion_is_recorded_with_its_nearest_limit():
    ranges = (JointRange("a", -1.0, 1.0, -2.0, 3.0), JointRange("b", 0.0, 0.5, -0.2, np.inf))
    review = MotionReview(ranges, 0.05, 2.5, 0.01, {"a": 0.3})
    record = motions_record("robot", {"up": review}, {"up": 12.0})
    assert_strict(record)
    (motion,) = record["motions"]
    assert (motion["name"], motion["seconds"]) == ("up", 12.0)
    assert (motion["nearest_limit"], motion["clearance"]) == ("b", 0.2)
    assert motion["ranges"] == {"a": [-1.0, 1.0], "b": [0.0, 0.5]}
    assert (motion["singularity"], motion["singular_time"]) == (0.05, 2.5)
    assert motion["problems"] == []


@pytest.mark.parametrize("ranges", [(), (JointRange("a", -1.0, 1.0, -np.inf, np.inf),)])
def test_a_robot_without_limits_is_recorded_in_strict_json(ranges):
    review = MotionReview(ranges, 0.05, 2.5, 0.01, {"a": 0.3})
    record = motions_record("robot", {"up": review}, {"up": 12.0})
    assert_strict(record)
    assert record["motions"][0]["clearance"] is None


@pytest.mark.parametrize(
    ("terms", "text"),
    [
        ({"a.m": 1.0}, "a.m"),
        ({"a.m": -1.0, "b.m": 1.0}, "-a.m + b.m"),
        ({"a.m": 1.0, "b.m": -0.25, "c.mx": 2.0}, "a.m - 0.25 b.m + 2 c.mx"),
        ({"a.m": -np.pi}, "-3.142 a.m"),
        ({}, ""),
    ],
)
def test_expressions_read_as_sums(terms, text):
    assert expression(terms) == text
