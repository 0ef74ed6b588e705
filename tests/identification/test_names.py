"""No combination goes by one of its members; and the robot that stands beside the sums."""

import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid.identification.saved import FitFile
from loopid.parameters import Parameter
from loopid.report.compare import comparison_report
from loopid.report.look import json_text
from made_runs import identify_unjudged

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")


@pytest.fixture(scope="module")
def found(load_once, once):
    def identified():
        robot = load_once("five_bar")
        run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
        return identify_unjudged(loopid.force_model(robot, "full", "Fc,Fv,Ia"), run)

    return once("names", identified)


def test_names_are_unique_and_say_how_many_more(found):
    fit, base = found.fit, found.force_model.base
    assert len(set(fit.parameters.names)) == len(fit.values)
    for name, label, terms in zip(fit, fit.parameters.labels, base.terms, strict=True):
        more = len(terms) - 1
        assert name == (f"{label} + {more} more" if more else label)
    assert any(" more" in name for name in fit)


def test_an_estimate_is_found_by_its_name_or_its_sum_and_no_member(found):
    fit, base = found.fit, found.force_model.base
    for k, (name, sum_) in enumerate(zip(fit, base.expressions, strict=True)):
        assert fit[name].value == fit[sum_].value == fit.values[k]
        assert fit[name].expression == sum_
    with pytest.raises(
        loopid.LoopidError, match=r"no left_crank_joint\.Ia alone, but in sums: ask"
    ):
        fit["left_crank_joint.Ia"]
    _, member, *_ = base["left_crank_joint.Ia"]
    with pytest.raises(loopid.LoopidError, match=r"ask for .*left_crank_joint.Ia \+ 3 more"):
        fit[member]
    with pytest.raises(loopid.LoopidError, match="by its name, not by 0"):
        fit[0]
    with pytest.raises(loopid.LoopidError, match=r"unknown parameter .left_crank_joint\.Fx."):
        fit["left_crank_joint.Fx"]


def test_tables_prints_and_files_name_sums(found):
    fit, leads = found.fit, []
    for parameter in fit.parameters:
        leads += [f"{parameter.label}:"] if parameter.others else []
    assert leads
    assert not any(lead in f"{fit}\n{fit!r}" for lead in leads)
    table = fit.to_polars()
    assert table["parameter"].to_list() == [*fit]
    assert table["expression"].to_list() == list(found.force_model.base.expressions)
    saved = fit.record()["base_parameters"]
    assert [each["name"] for each in saved] == [*fit]
    assert tuple(each["expression"] for each in saved) == fit.parameters.expressions


def test_nothing_that_is_printed_calls_a_sum_by_its_lead(found, tmp_path):
    """A lead stands with the rest of its sum, in all that shows estimates."""
    fit, whole = found.fit, found["all parameters"].fit
    compared = comparison_report({"a": FitFile.of(fit), "b": FitFile.of(whole)})
    said = {
        "notebook": fit._repr_html_() + found._repr_html_(),
        "verdict": "\n".join([str(found.verdict), *map(str, found.findings)]),
        "reduction": repr(found.reduction) + repr(found.identifiability),
        "comparison": json_text(compared.data) + compared.page().html(),
    }
    if find_spec("casadi"):
        said |= {path.name: path.read_text() for path in map(Path, fit.to_c(tmp_path))}
    leads = [re.escape(each.label) for each in fit.parameters if each.others]
    alone = re.compile(rf"(?<![\w.])({'|'.join(leads)})(?![\w.]| [+-])")
    assert leads
    assert {name: hits for name, text in said.items() if (hits := alone.findall(text))} == {}


def test_the_robot_beside_the_sums_has_their_uncertainty(found):
    """M Σ Mᵀ is the covariance of M π, and the intervals of what stands alone are the same."""
    fit, base = found["consistent"].fit, found.force_model.base
    known = fit.uncertainty
    np.testing.assert_allclose(base.matrix @ known.gain, np.eye(len(base)), atol=1e-6)
    assert list(fit.standard) == list(base.parameters.labels)
    fit = replace(fit, degrees_of_freedom=np.linspace(5.0, 50.0, len(fit.values)))
    alone = [name for name in fit.standard if name in fit.parameters.names]
    assert {"left_crank.my", "right_crank_joint.Fv"} <= {*alone}
    for name in alone:
        one, same = fit.standard[name], fit[name]
        assert one.determined
        assert one.standard_error == pytest.approx(same.standard_error, rel=1e-6)
        assert one.interval == pytest.approx(same.interval, rel=1e-6)


def test_what_only_the_file_tells_is_said(found):
    """No force of a planar robot depends on anything out of its plane."""
    robot = found["consistent"].fit.standard
    for name, estimate in robot.items():
        if Parameter.parse(name).kind in ("mz", "Ixz", "Iyz"):
            assert not estimate.determined, name
    assert not robot["left_crank.Ixx"].determined
    assert not found["robot file"].fit.standard["left_crank.m"].determined
    assert found["robot file"].fit.standard["left_crank_joint.Fc"].determined


def test_a_saved_robot_is_the_same(found, tmp_path):
    fit = found["consistent"].fit
    again = loopid.load_fit(fit.save(tmp_path / "fit.yaml")).standard
    for name, estimate in fit.standard.items():
        other = again[name]
        assert (other.value, other.determined, other.unit) == (
            estimate.value,
            estimate.determined,
            estimate.unit,
        )
        np.testing.assert_allclose(other.interval, estimate.interval, rtol=1e-9)


def test_what_is_zero_but_for_round_off_has_no_share(found):
    """Of a value that is held at zero no error is a part, whether it is 0 or 1e-20."""
    few = found.fit.values.size
    shares = []
    for zero in (0.0, 2e-20, -2e-20):
        fit = replace(found.fit, values=np.full(few, zero), standard_parameters=None, model=None)
        shares.append(fit.relative_std)
        first = fit.estimates[0]
        assert first.relative_std == np.inf
        assert "inf" not in str(first)
        assert "%)" not in str(first)
    assert all(np.array_equal(each, shares[0]) for each in shares)
