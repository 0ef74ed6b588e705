"""Records for machines: complete, and nothing that JSON cannot say."""

import json

import numpy as np
import pytest

from loopid import find_base_parameters, load_mechanism, structural_observation
from loopid.base_parameters.expressions import expression
from loopid.report import base_record, check_record, compare_with_paper
from loopid.report.paper import TABLE_II, paper_tables
from loopid.symbolic import base_parameter_rows, read_geometry


@pytest.fixture(scope="module")
def robot():
    return load_mechanism("3ups_rpu")


def test_records_are_strict_json(robot):
    base = find_base_parameters(structural_observation(robot))
    for record in (base_record(robot.name, "gravity", base), check_record(robot)):
        assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_terms_rebuild_the_matrix(robot):
    base = find_base_parameters(structural_observation(robot))
    record = base_record(robot.name, "gravity", base)
    labels = base.parameters.labels
    for parameter, row in zip(record["base_parameters"], base.matrix, strict=True):
        assert list(row) == [parameter["terms"].get(label, 0.0) for label in labels]


def test_printed_table_ii_agrees_with_the_closed_forms(robot):
    geometry = read_geometry(robot.path.parent / "geometry.yaml", "3ups_rpu", 1)
    for printed, row in zip(TABLE_II, base_parameter_rows(), strict=True):
        exact = {k: v for k, v in row.coefficients(geometry).items() if abs(v) > 1e-12}
        assert exact.keys() == printed.keys()
        for label, value in printed.items():
            assert exact[label] == pytest.approx(value, abs=5e-5)


def test_every_row_of_the_paper_is_found_once():
    comparison = compare_with_paper()
    assert comparison.agrees
    assert sorted(comparison.rows) == list(range(len(TABLE_II)))
    assert comparison.seconds > 0
    assert paper_tables(comparison)[0].row_count == len(TABLE_II)


def test_a_row_that_differs_is_reported(robot, monkeypatch):
    wrong = (*TABLE_II[:8], TABLE_II[8] | {"leg2_stem.m": 0.1930}, *TABLE_II[9:])
    monkeypatch.setattr("loopid.report.paper.TABLE_II", wrong)
    comparison = compare_with_paper()
    assert comparison.rows[8] is None
    assert not comparison.agrees


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
