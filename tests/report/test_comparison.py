"""Fits beside each other: which values differ, told as the definition tells it."""

from dataclasses import replace

import numpy as np
import pytest

from loopid.errors import OptionError
from loopid.identification.saved import FitFile
from loopid.report.compare import comparison_report


@pytest.fixture(scope="module")
def fits(study):
    """A fit of all parameters, and the same with two values moved by this many standard errors."""
    found = study
    fit = found["all parameters"].fit
    fit = replace(fit, degrees_of_freedom=np.full(len(fit.values), 1000.0))
    moved = fit.values.copy()
    moved[3] += 5.0 * np.sqrt(2.0) * fit.standard_errors[3]
    moved[7] -= 2.0 * np.sqrt(2.0) * fit.standard_errors[7]
    both = fit, replace(fit, values=moved)
    return [FitFile.of(each) for each in both]


def test_values_that_differ_clearly_are_named(fits):
    report = comparison_report(dict(zip(("a", "b"), fits, strict=True)))
    rows = report.data["parameters"]
    assert [row["name"] for row in rows] == list(fits[0].parameters.names)
    apart = np.array([row["apart"] for row in rows])
    np.testing.assert_allclose(apart[[3, 7]], [5.0, 2.0], rtol=1e-6)
    assert np.delete(apart, [3, 7]).max() == 0.0
    assert report.verdict.startswith("They disagree: ")
    assert f"the largest is 5 ({rows[3]['expression']})" in report.verdict
    assert [row["differs"] for row in rows].index(True) == 3
    (table,) = report.brief
    names = [str(cell) for cell in table.columns[0].cells]
    assert [k for k, name in enumerate(names) if name.endswith(" *")] == [3]


def test_a_parameter_of_one_fit_alone_is_said_so(fits):
    one, content = fits[0], fits[1].content
    estimate = content["estimate"]
    less = FitFile(
        {
            **content,
            "base_parameters": content["base_parameters"][:-1],
            "covariance": [row[:-1] for row in content["covariance"][:-1]],
            "estimate": estimate | {"degrees_of_freedom": estimate["degrees_of_freedom"][:-1]},
        }
    )
    report = comparison_report({"a": one, "b": less})
    assert report.data["parameters"][-1]["values"][1] is None
    assert report.verdict.endswith(" Not in all of them: 1 parameter.")


def test_a_motor_without_samples_has_no_error(fits):
    estimate = fits[1].content["estimate"]
    quality = estimate["quality"]
    quality = quality | {"residual_rms": [None, *quality["residual_rms"][1:]]}
    silent = FitFile(fits[1].content | {"estimate": estimate | {"quality": quality}})
    report = comparison_report({"a": fits[0], "b": silent})
    assert report.data["runs"][1]["rms"][0] is None
    assert '<td class="number">-, ' in report.page().html()


def test_many_fits_are_in_tables_of_three(fits):
    report = comparison_report({f"run {k}": fits[k % 2] for k in range(7)})
    assert len(report.brief) == 4  # the first is of pairs
    assert len(report.data["agreements"]) == 21
    assert len(report.page().html()) < 3_000_000


def test_one_fit_alone_is_refused(fits):
    with pytest.raises(OptionError, match="two fits or more"):
        comparison_report({"a": fits[0]})
