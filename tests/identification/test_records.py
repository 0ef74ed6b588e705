"""Results as files, and back."""

import json

import numpy as np
import pytest

from loopid import Parameter, ParameterSet
from loopid.errors import DataError, MissingFileError, OptionError, OutputError
from loopid.identification import FitResult, FitSamples, WeightedLeastSquares, quiet_fit
from smooth_data import autoregressive, smooth_regressor

NAMES = ParameterSet(
    (Parameter("a.b", "m"), Parameter("leg1", "mx"), Parameter("slide", "Fc", "N"))
)


@pytest.fixture(scope="module")
def samples():
    W, rng = smooth_regressor(samples=400, dof=3, count=3), np.random.default_rng(0)
    force = W @ [3.0, 0.0, 1e-7] + autoregressive(rng, (400, 3), 0.7) * [1.0, 0.1, 1.0]
    used = np.ones((400, 3), dtype=bool) & [True, True, False]
    return FitSamples.of(NAMES, ("x", "y", "größe"), W, force, used)


@pytest.fixture(scope="module")
def results(samples):
    """With a noise model, and without."""
    return quiet_fit(samples), WeightedLeastSquares().fit(samples.problem)


@pytest.mark.parametrize("name", ["fit.json", "fit.yaml", "fit.yml"])
def test_a_saved_result_comes_back_equal(results, samples, tmp_path, name):
    for result in results:
        result.save(tmp_path / name)
        again = FitResult.load(tmp_path / name)
        assert again == result
        assert [p.unit for p in again.parameters] == ["kg", "kg m", "N"]
        prediction = again.predict(samples.regressor)
        np.testing.assert_array_equal(prediction, result.predict(samples.regressor))
        np.testing.assert_array_equal(again.intervals(0.9), result.intervals(0.9))
        assert again.validate(samples.problem) == result.quality


def test_results_that_differ_are_not_equal(results):
    first, second = results
    assert first != second
    assert first != "something else"


def test_the_record_is_plain_json_with_all_a_table_needs(results):
    result = results[0]
    record = json.loads(json.dumps(result.record(), allow_nan=False))
    line = record["parameters"][0]
    assert (line["number"], line["name"], line["unit"]) == (1, "a.b.m", "kg")
    assert line["value"] == result.values[0]
    assert line["standard_error"] == result.standard_errors[0]
    assert line["relative_std_percent"] == result.relative_std[0]
    assert line["interval_95_percent"] == result.intervals(0.95)[0].tolist()
    assert record["covariance"] == result.covariance.tolist()
    assert record["actuators"][2]["residual_rms"] is None
    assert record["actuators"][0]["noise"]["lag_one"] == result.noise.lag_one[0]


def test_the_text_has_a_line_a_parameter(results):
    lines = str(results[0]).splitlines()
    assert len(lines) == 3
    assert lines[0].strip().startswith("1 a.b.m: ")
    assert "kg" in lines[0]
    assert "±" in lines[0]


def without(record, *path):
    for key in path[:-1]:
        record = record[key]
    del record[path[-1]]


def changed(record, value, *path):
    for key in path[:-1]:
        record = record[key]
    record[path[-1]] = value


@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda r: without(r, "format"), "format"),
        (lambda r: without(r, "covariance"), "'covariance' is missing"),
        (lambda r: without(r, "parameters", 0, "value"), "'value' is missing"),
        (lambda r: without(r, "actuators", 1, "noise"), "'noise' is missing"),
        (lambda r: changed(r, None, "parameters", 0, "value"), "values must be 3 finite numbers"),
        (lambda r: changed(r, [[1.0]], "covariance"), "the covariance must be 3 by 3"),
        (lambda r: changed(r, [[1.0], [1.0, 2.0]], "covariance"), "not a saved fit"),
        (lambda r: changed(r, "many", "actuators", 0, "samples"), "not a saved fit"),
        (lambda r: changed(r, None, "actuators", 0, "samples"), "not a saved fit"),
        (lambda r: changed(r, "leg1.mx", "parameters", 0, "name"), "repeated: leg1.mx"),
        (lambda r: changed(r, 5, "actuators"), "not a saved fit"),
        (
            lambda r: changed(r, [0.1] * 30, "actuators", 0, "noise", "coefficients"),
            "not a saved fit",
        ),
    ],
)
def test_broken_records_are_refused_by_name(results, tmp_path, spoil, word):
    record = results[0].record()
    spoil(record)
    (tmp_path / "broken.json").write_text(json.dumps(record))
    with pytest.raises(DataError, match="broken.json.*" + word):
        FitResult.load(tmp_path / "broken.json")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("cut.json", '{"format": "loopid'),
        ("cut.yaml", "format: [loopid"),
        ("list.json", "[1, 2]"),
        ("empty.yaml", ""),
        ("binary.json", b"\xff\xfe\x00"),
    ],
)
def test_files_that_are_no_records_are_refused(tmp_path, name, text):
    (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(DataError, match=name):
        FitResult.load(tmp_path / name)


def test_wrong_places_are_refused(results, tmp_path):
    with pytest.raises(MissingFileError, match=r"absent\.json"):
        FitResult.load(tmp_path / "absent.json")
    with pytest.raises(OptionError, match=r"'.txt': choose one of .json, .yaml, .yml"):
        results[0].save(tmp_path / "fit.txt")
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError):
        results[0].save(tmp_path / "file" / "fit.json")


def test_results_are_read_only(results):
    for array in (results[0].values, results[0].covariance, results[0].quality.residual_rms):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
