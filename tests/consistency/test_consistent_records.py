"""Consistent fits as tables and files."""

import json

import numpy as np
import pytest

from loopid.consistency import ConsistentFit, consistent_fit
from loopid.errors import DataError, MissingFileError, OptionError


@pytest.fixture(scope="module")
def result(arm_case):
    return consistent_fit(*arm_case.fitted(3.0, seed=2), arm_case.base, arm_case.prior)


@pytest.mark.parametrize("ending", ["json", "yaml", "yml"])
def test_a_saved_result_comes_back_whole(result, tmp_path, ending):
    path = tmp_path / f"bodies.{ending}"
    result.save(path)
    again = ConsistentFit.load(path)
    assert again == result
    assert [p.unit for p in again.parameters] == [p.unit for p in result.parameters]
    assert list(tmp_path.iterdir()) == [path]


def test_massless_bodies_come_back_too(arm_case, tmp_path):
    prior = arm_case.prior.copy()
    prior[[j for j, p in enumerate(arm_case.base.parameters) if p.link == "lower"]] = 0.0
    result = consistent_fit(*arm_case.fitted(3.0), arm_case.base, prior)
    assert np.isnan(result.margins).sum() == 1
    result.save(tmp_path / "bodies.json")
    assert ConsistentFit.load(tmp_path / "bodies.json") == result


def test_records_are_plain(result):
    assert json.loads(json.dumps(result.record(), allow_nan=False)) == result.record()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"format": "loopid fit 1"}, "its format is not"),
        ({"margins": [1.0]}, "1 numbers where 2 belong"),
        ({"feasible": "yes"}, "feasible must be"),
        ({"bodies": None}, "not a saved consistent fit"),
        ({"standard_parameters": [{"name": "a.m", "unit": "kg"}]}, "'value' is missing"),
        ({"fit_cost": 3}, "not a saved consistent fit"),
        ({"base_parameters": [{"name": "a.m", "unit": "kg", "value": float("nan")}]}, "finite"),
        ({"strength": "much"}, "not a saved consistent fit"),
    ],
)
def test_broken_records_are_refused(result, tmp_path, change, match):
    path = tmp_path / "bodies.json"
    path.write_text(json.dumps({**result.record(), **change}))
    with pytest.raises(DataError, match=match):
        ConsistentFit.load(path)


def test_missing_files_and_unknown_endings_are_refused(result, tmp_path):
    with pytest.raises(MissingFileError):
        ConsistentFit.load(tmp_path / "none.json")
    with pytest.raises(OptionError, match="ending"):
        result.save(tmp_path / "bodies.txt")


def test_the_table_says_what_matters(result):
    text = str(result)
    assert text.startswith("unconstrained optimum not feasible; consistency costs ")
    assert all(f"\n{body}: " in text for body in ("upper", "lower"))
    rows = list(result.rows)
    labels = result.parameters.labels
    for row in rows:
        mass = result.standard_parameters[labels.index(f"{row['body']}.m")]
        assert row["mass"] == mass
        first = result.standard_parameters[labels.index(f"{row['body']}.my")]
        assert row["y"] * mass == pytest.approx(first)


def test_results_are_read_only(result):
    with pytest.raises(ValueError, match="read-only"):
        result.standard_parameters[0] = 0.0
