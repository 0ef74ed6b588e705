"""The report of an identification: verdict, page, tables, charts and records say the same."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from lxml.html import fromstring
from rich.console import Console
from ruamel.yaml import YAML

from loopid.findings import SEVERITIES, Finding
from loopid.identification import (
    SavedFit,
    find_force_model,
    friction_curve,
    identifiability,
    identify,
)
from loopid.plots import Chart, friction_chart, spectrum_chart
from loopid.report import identification_report
from loopid.report.identify import findings, identification_record
from loopid.report.look import json_value
from made_runs import modelled, quietly, stand, wander


@pytest.fixture(scope="module")
def report(study):
    return identification_report(study, "loopid excite 3ups_rpu")


@pytest.fixture(scope="module")
def files(report):
    return report.files()


def charts(report):
    parts = (part for section in report.sections() for part in section.parts)
    return {part.name: part for part in parts if isinstance(part, Chart)}


def table(report, *columns):
    """Columns of the table that has these."""
    for each in report.tables():
        if [str(column.header) for column in each.columns][: len(columns)] == [*columns]:
            return [[str(cell) for cell in column.cells] for column in each.columns]
    return pytest.fail(f"no table of {columns}")


def printed(table, width):
    stream = io.StringIO()
    Console(file=stream, width=width, force_terminal=False).print(table)
    return stream.getvalue()


def judged(study, **changes):
    """The study with other verdicts on its candidates."""
    names = {"full": "all parameters", "informed": "consistent"}
    found = study.identification
    others = {
        names[name]: replace(found[names[name]], **change) for name, change in changes.items()
    }
    return replace(study, identification=replace(found, candidates=found.candidates | others))


def test_the_page_holds_all_tables_and_charts(files, report):
    page = fromstring(files["report.html"])
    cells = [cell.text_content() for cell in page.iter("td")]
    for each in report.tables():
        assert str(each.title or "") in page.text_content()
        assert all(str(cell) in cells for column in each.columns for cell in column.cells)
    found = [figure.findtext("figcaption") for figure in page.iter("figure")]
    assert found == [chart.caption for chart in charts(report).values()]
    assert len(found) == 6


def test_the_record_is_on_the_page_and_beside_it(files, report):
    (data,) = fromstring(files["report.html"]).xpath("//script[@id='data']/text()")
    assert json.loads(data) == json.loads(files["identification.json"]) == report.data


@pytest.mark.parametrize("width", [80, 120])
def test_all_tables_fit_the_terminal_and_no_number_in_them_is_cut(report, width):
    for each in (*report.tables(), *report.brief):
        text = printed(each, width)
        assert max(map(len, text.splitlines())) <= width
        words = set(text.split())
        for column in each.columns:
            for cell in map(str, column.cells):
                numbers = re.findall(r"(?<!\S)-?\d+\.?\d*(?:e[-+]\d+)?(?!\S)", cell)
                assert set(numbers) <= words, (each.title, cell)


def test_the_terminal_shows_the_recommended_values(report, study):
    (brief,) = report.brief
    names, values, errors, _ = ([str(c) for c in column.cells] for column in brief.columns)
    fit = study.identification.fit
    shown = names[:-1] if names[-1].startswith("... and ") else names
    assert shown == list(fit.parameters.names)[: len(shown)]
    left = len(fit.values) - len(shown)
    assert names[len(shown) :] == ([f"... and {left} more in the report"] if left else [])
    for value, error, estimate in zip(values, errors, fit.estimates[: len(shown)], strict=False):
        assert float(value) == pytest.approx(estimate.value, rel=5e-4, abs=estimate.standard_error)
        assert (error == "= file") == (estimate.name in fit.assumed)


def test_values_in_the_tables_are_those_of_the_fit(report, study):
    names, values, errors, low, high, file, _ = table(
        report, "parameter", "value", "± std", "95 % from"
    )
    found = study.identification
    fit, model = found.fit, found.force_model
    assert names == list(fit.parameters.expressions)
    ends = [[float("nan") if cell == "-" else float(cell) for cell in part] for part in (low, high)]
    known = np.isfinite(fit.intervals()).all(axis=1)
    np.testing.assert_allclose(np.transpose(ends)[known], fit.intervals()[known], rtol=1e-3)
    bodies = [float(file[j]) for j in model.body_columns]
    np.testing.assert_allclose(bodies, model.prior[model.body_columns], rtol=1e-3, atol=1e-12)
    assert len(values) == len(errors) == len(names)


def test_tables_of_the_essential_parameters_name_their_sums_and_file_values(report, study):
    names, values, _, known, _ = table(report, "parameter", "value", "± std", "robot file")
    columns = study.reduction.columns
    model = study.identification.force_model
    assert names == [model.base.expressions[j] for j in columns]
    assert [cell == "-" for cell in known] == [j in model.joint_columns for j in columns]
    result = study.reduction.result
    np.testing.assert_allclose([float(x) for x in values], result.values, rtol=1e-3)


def test_what_was_left_out_is_listed(report, study):
    _, reasons, *_ = table(report, "recording", "reason")
    assert reasons == [part.reason for part in study.identification.training[0].dropped]
    assert "leg4_stroke stands still" in reasons


# Charts


def marks(panel, name):
    return [mark for mark in panel.marks if mark.name == name]


def test_forces_are_the_recommended_ones_on_new_data_with_what_is_left(study, report):
    found, chart = study.identification, charts(report)["forces"]
    (run,) = found.training
    fits = {"robot file": found.baseline, "predicted": found.recommended}
    assert len(chart.panels) == 2 * len(run.actuators)
    for k, motor in enumerate(run.actuators):
        panel, left = chart.panels[2 * k : 2 * k + 2]
        assert panel.title.startswith(f"{motor}: force (N), R² ")
        (mark,) = marks(panel, "measured")
        np.testing.assert_array_equal(mark.y, run.force[:, k])
        for name, fit in fits.items():
            force = np.where(run.used[:, k], fit.predicted[:, k], np.nan)
            (drawn,), (rest,) = marks(panel, name), marks(left, f"measured less {name}")
            assert np.isnan(drawn.y).any()  # where the motor stands
            np.testing.assert_allclose(drawn.y, force, atol=1e-9)
            np.testing.assert_allclose(rest.y, run.force[:, k] - force, atol=1e-9)


def test_parameters_are_shown_against_the_robot_file_with_their_intervals(study, report):
    found, (panel,) = study.identification, charts(report)["parameters"].panels
    model, bodies = found.force_model, found.force_model.body_columns
    fit = found.fit
    (dots,), (spans,) = marks(panel, "recommended"), marks(panel, "95 % interval")
    np.testing.assert_allclose(spans.x + spans.to, 2 * dots.x, atol=1e-9)
    reach = np.ptp(fit.intervals()[bodies], axis=1) / np.abs(fit.values - model.prior)[bodies]
    np.testing.assert_allclose((spans.to - spans.x) / np.abs(dots.x), reach, rtol=1e-9)
    assert panel.labels == tuple(fit.parameters.names[j] for j in bodies)


def test_friction_is_drawn_with_what_it_explains(study, report):
    """Curve and band are those of the fit; dots are forces less all other parts of the model."""
    found = study.identification
    fit, labels = found.fit, found.fit.parameters.labels
    panels = charts(report)["friction"].panels
    for k, (panel, joint) in enumerate(zip(panels, found.data.actuators, strict=True)):
        for half in marks(panel, "friction"):
            np.testing.assert_allclose(
                half.y, friction_curve(fit, joint, half.x).values, rtol=1e-12
            )
        others = fit.values.copy()
        others[[labels.index(f"{joint}.{kind}") for kind in ("Fc", "Fv")]] = 0.0
        left = found.data.residual(others)[:, k]
        (dots,) = marks(panel, "measured less all else")
        for rate, force in zip(dots.x, dots.y, strict=True):
            assert np.abs(left - force).min() < 1e-9 * np.abs(left).max()
            assert np.abs(found.training[0].motion.velocities[:, k] - rate).min() == 0.0


def test_a_robot_without_friction_has_no_picture_of_it(knee):
    model = find_force_model(knee, joint_terms=None)
    run = modelled(model, wander(knee, 1), model.prior)
    assert friction_chart(quietly(identify, model, [run])).panels == ()


def test_the_spectrum_is_that_of_structure_and_data(knee):
    model, motion = find_force_model(knee, joint_terms=None), stand(knee, seconds=5.0)
    told = identifiability(model, [modelled(model, motion, model.prior)])
    (panel,) = spectrum_chart(told).panels
    excitation, sure = told.excitation, told.well_determined
    named = {mark.name: mark for mark in panel.marks}
    np.testing.assert_allclose(named["structure"].y, 100 * excitation.structural)
    np.testing.assert_allclose(named["data"].y, 100 * excitation.effects[:sure])
    none = named["unidentifiable: no effect"]
    assert len(none.x) == len(told.unidentifiable) > 0
    assert none.y.max() < named["data"].y.min()
    places = np.concatenate([mark.x for name, mark in named.items() if name != "structure"])
    np.testing.assert_array_equal(np.sort(places), np.arange(1, told.structural_rank + 1))


# In words


def test_a_mistake_is_the_verdict_everywhere_and_gains_are_listed(study):
    found = study.identification
    (listed,) = identification_record(study)["suspicions"]
    assert (listed["recording"], listed["mistakes"]) == ("run", [])
    assert [gain["joint"] for gain in listed["gains"]] == list(found.data.actuators)
    told = Finding("mistake", "the force of leg1_stroke is in mN m", "e^9", "set it to 0.001")
    suspected = replace(found, suspicions=(replace(found.suspicions[0], mistakes=(told,)),))
    report = identification_report(replace(study, identification=suspected))
    assert suspected.verdict.excite == ()
    for text in (str(suspected.verdict), report.verdict, suspected._repr_html_()):
        assert "Not fit for use: the force of leg1_stroke is in mN m (e^9)." in text
    assert str(told.brief) in repr(suspected)
    assert report.findings[0] == told
    assert report.data["findings"][0] == json_value(told)
    page = fromstring(report.files()["report.html"]).text_content()
    assert "Mistake: the force of leg1_stroke is in mN m" in page
    assert "Do: set it to 0.001" in page


@pytest.mark.parametrize(
    ("ratio", "grade"),
    [
        ((0.5, 0.1), "better"),
        ((0.9, 0.1), "not clear"),
        ((1.1, 0.1), "not clear"),
        ((1.3, 0.2), "not clear"),
        ((1.21, 0.1), "worse"),
    ],
)
def test_verdicts_take_two_standard_errors(study, ratio, grade):
    report = identification_report(judged(study, full={"error_ratio": ratio}))
    names, _, ratios, errors, grades = table(report, "fit", "fitted parameters")
    row = names.index("all parameters")
    assert grades[row] == grade
    assert (float(ratios[row]), float(errors[row])) == pytest.approx(ratio, rel=0.05)


def test_the_recommended_fit_is_said_listed_and_saved(study):
    study = judged(study, informed={"error_ratio": (0.5, 0.1)})
    found, files = study.identification, identification_report(study).files()
    assert found.recommended is found["consistent"]
    saved = {
        name: YAML(typ="safe").load(files[name])["base_parameters"]
        for name in ("parameters.yaml", "all_parameters.yaml")
    }
    fits = found.fit, found["all parameters"].fit
    for fit, entries in zip(fits, saved.values(), strict=True):
        np.testing.assert_array_equal([entry["value"] for entry in entries], fit.values)
    (said,) = [each for each in findings(study) if "recommended" in each.title]
    assert "parameters.yaml: consistent" in said.why
    assert "Recommended values: consistent" in files["report.html"]
    record = json.loads(files["identification.json"])
    assert record["recommended"] == "consistent"
    assert record["fit"] == SavedFit.of(found.force_model, found.fit).record()
    assert record["verdict"] == str(study.verdict)
    worse = judged(study, informed={"error_ratio": (2.0, 0.1)})
    other = worse.identification
    assert other.recommended is other["robot file"]
    (said,) = [each for each in findings(worse) if "recommended" in each.title]
    assert "robot file with fitted joint terms, as fitted bodies are clearly worse" in said.why
    bodies = [found.fit.parameters.names[j] for j in found.force_model.body_columns]
    assert other.fit.assumed == tuple(bodies)


def test_findings_are_lines_the_most_serious_first(study):
    said = findings(study)
    order = [SEVERITIES.index(each.severity) for each in said]
    assert order == sorted(order)
    for each in said:
        assert not each.title.endswith(".")
        assert "\n" not in str(each)
    cutoff = study.identification.training[0].cutoff
    assert any(f"filtered at {cutoff:.3g} Hz" in each.title for each in said)
    plain = tuple(replace(part, cutoff=None) for part in study.identification.training)
    said = findings(replace(study, identification=replace(study.identification, training=plain)))
    assert any("unfiltered" in each.title for each in said)


# Records for machines


def assert_strict(record):
    assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_an_identification_is_recorded_whole(study):
    record, found = identification_record(study), study.identification
    model, count = found.force_model, len(found.fit.values)
    assert (record["mechanism"], record["model"]) == ("3ups_rpu", "gravity")
    assert record["actuators"] == list(model.mechanism.actuated)
    assert record["expressions"] == list(model.base.expressions)
    assert len(record["expressions"]) == count == 23
    np.testing.assert_array_equal(record["robot_file"], model.prior)
    np.testing.assert_array_equal(record["essential"], study.essential.values)
    assert record["all_parameters"] == SavedFit.of(model, found["all parameters"].fit).record()
    corrected = [model.parameters.names[j] for j in study.reduction.columns]
    assert record["essential_parameters"] == corrected


def test_recordings_are_recorded_with_what_was_left_out(study):
    record = identification_record(study)
    (entry,), (recording,) = record["training"], study.identification.training
    assert record["validation"] == []
    assert (entry["name"], entry["samples"]) == ("run", len(recording))
    assert entry["used"] == recording.used.sum(axis=0).tolist()
    assert entry["cutoff"] == recording.cutoff
    assert any("stands still" in reason for reason in entry["dropped"])


def test_candidates_are_recorded_with_their_errors(study):
    record = identification_record(study)
    assert len(record["candidates"]) == 4
    start, whole, informed = study.identification.candidates.values()
    candidates = start, whole, study.essential, informed
    for entry, candidate in zip(record["candidates"], candidates, strict=True):
        assert (entry["name"], entry["fitted"]) == (candidate.name, candidate.fitted)
        assert entry["beats_baseline"] is candidate.beats_baseline
        ratio = entry["error_ratio"], entry["error_ratio_standard_error"]
        assert ratio == candidate.error_ratio
        for part in ("training", "validation"):
            quality = getattr(candidate, part)
            np.testing.assert_array_equal(entry[part]["rms"], quality.residual_rms)
            np.testing.assert_array_equal(entry[part]["r_squared"], quality.r_squared)


def test_term_sets_are_recorded_and_the_one_that_is_enough_is_named(study):
    found, record = study.term_sets, identification_record(study)
    assert record["joint_terms"] == {
        joint: ["Fc", "Fv"] for joint in study.identification.force_model.mechanism.actuated
    }
    assert [entry["terms"] for entry in record["term_sets"]] == ["none", "Fv", "Fc,Fv", "Fc,Fv,Fo"]
    assert [entry["chosen"] for entry in record["term_sets"]] == [False, False, True, False]
    for entry, each in zip(record["term_sets"], found.sets, strict=True):
        for k, bodies in enumerate(("robot_file", "fitted_bodies")):
            assert entry[bodies]["error"] == each.errors[k].mean
            assert entry[bodies]["enough"] == (found.enough[k] is each)
    (said,) = [each for each in findings(study) if each.title == "the joint terms are Fc,Fv"]
    sentence = said.why
    assert "these are enough with fitted bodies" in sentence
    assert "Try" not in sentence
    other = replace(study, term_sets=replace(found, chosen=found.sets[0]))
    assert any('Try terms="Fc,Fv".' in each.why for each in findings(other))


def test_what_is_not_finite_is_null(study):
    candidate = study.identification["all parameters"]
    empty = replace(candidate.validation, residual_rms=np.full(4, np.nan))
    odd = {"validation": empty, "error_ratio": (np.inf, np.nan)}
    record = identification_record(judged(study, full=odd))
    assert_strict(record)
    entry = record["candidates"][1]
    assert entry["validation"]["rms"] == [None] * 4
    assert entry["error_ratio"] is entry["error_ratio_standard_error"] is None
