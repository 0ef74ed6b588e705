"""The report of an identification: pages, tables and records that are complete and say the same."""

import io
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from ruamel.yaml import YAML

from loopid.identification import SavedFit
from loopid.report.identify import (
    findings,
    identification_files,
    identification_record,
    identification_tables,
)

LINK = re.compile(r"!\[[^]]*\]\(([^)]+)\)")


@pytest.fixture(scope="module")
def files(study):
    return identification_files(study)


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


def test_the_page_holds_all_tables(files, study):
    for table in identification_tables(study):
        assert str(table.title) in files["report.md"]


def test_every_figure_is_on_the_page_and_every_link_leads_to_a_file(files):
    linked = set(LINK.findall(files["report.md"]))
    assert linked <= set(files)
    assert {name for name in files if name.endswith(".svg")} == linked
    assert {name.replace(".svg", ".png") for name in linked} <= set(files)


def test_the_record_is_beside_the_page(files, study):
    record = json.loads(files["identification.json"])
    assert record == identification_record(study)


@pytest.mark.parametrize("width", [80, 120])
def test_all_tables_fit_the_terminal_and_nothing_in_them_is_cut(study, width):
    cut = set()
    for table in identification_tables(study):
        text = printed(table, width)
        assert max(map(len, text.splitlines())) <= width
        numbers = {
            number
            for column in table.columns
            for cell in column.cells
            for number in re.findall(r"-?\d+\.\d+", str(cell))
        }
        if "…" in text or not all(number in text for number in numbers):
            cut.add(table.title)
    assert cut == set()


def test_values_in_the_tables_are_those_of_the_fit(study):
    table = identification_tables(study)[0]
    cells = [[str(cell) for cell in column.cells] for column in table.columns]
    fit = study.identification["all parameters"].fit
    assert cells[0] == list(fit.parameters.labels)
    np.testing.assert_allclose([float(x) for x in cells[1]], fit.values, rtol=1e-3, atol=1e-12)
    np.testing.assert_allclose([float(x) for x in cells[2]], fit.standard_errors, rtol=0.06)


def test_tables_of_the_essential_parameters_name_their_sums_and_file_values(study):
    table = identification_tables(study)[1]
    names, values, _, known, _ = ([str(cell) for cell in column.cells] for column in table.columns)
    columns = study.reduction.columns
    model = study.identification.force_model
    assert names == [model.base.expressions[j] for j in columns]
    assert [cell == "-" for cell in known] == [j in model.joint_columns for j in columns]
    result = study.reduction.result
    np.testing.assert_allclose([float(x) for x in values], result.values, rtol=1e-3)


def test_what_was_left_out_is_listed(study):
    tables = identification_tables(study)
    (table,) = [table for table in tables if str(table.title) == "left out"]
    reasons = [str(cell) for cell in table.columns[1].cells]
    assert reasons == [part.reason for part in study.identification.training[0].dropped]
    assert "leg4_stroke stands still" in reasons


def test_suspicions_are_findings_and_gains_are_listed(study):
    record = identification_record(study)
    (listed,) = record["suspicions"]
    assert (listed["recording"], listed["sentences"]) == ("run", [])
    assert [gain["joint"] for gain in listed["gains"]] == record["actuators"]
    (found,) = study.suspicions
    told = replace(found, sentences=("the force of leg1_stroke is 1000 times",))
    suspected = replace(study, suspicions=(told,))
    assert "In run, the force of leg1_stroke is 1000 times." in findings(suspected)


def blaming(study):
    """The sentence that names weak parameters, if any."""
    found = [text for text in findings(study) if "not significant" in text]
    assert len(found) <= 1
    return "".join(found)


def test_parameters_that_are_not_significant_are_named(study):
    worse = judged(study, full={"error_ratio": (1.5, 0.1)})
    assert not worse.identification["all parameters"].beats_baseline
    weak = study.identification["all parameters"].fit.insignificant()
    assert 0 < len(weak) < len(study.identification["all parameters"].fit.values)
    assert blaming(worse).endswith(f": {', '.join(weak)}.")


def test_nobody_is_blamed_where_all_parameters_are_sure(study):
    fit = study.identification["all parameters"].fit
    sure = judged(study, full={"fit": replace(fit, covariance=1e-12 * fit.covariance)})
    assert sure.identification["all parameters"].fit.insignificant() == ()
    assert "none alone" in blaming(judged(sure, full={"error_ratio": (1.5, 0.1)}))
    assert blaming(judged(sure, full={"error_ratio": (0.5, 0.1)})) == ""


@pytest.mark.parametrize(
    ("ratio", "verdict"),
    [
        ((0.5, 0.1), ": better than it."),
        ((0.9, 0.1), ": not clearly better than it."),
        ((1.1, 0.1), ": not clearly better than it."),
        ((1.3, 0.2), ": not clearly better than it."),
        ((1.21, 0.1), ": worse than it."),
    ],
)
def test_verdicts_take_two_standard_errors(study, ratio, verdict):
    found = judged(study, full={"error_ratio": ratio})
    (sentence,) = [text for text in findings(found) if "all parameters the mean" in text]
    assert sentence.endswith(verdict)
    assert "{:.2f} ± {:.2f}".format(*ratio) in sentence


def test_the_recommended_fit_is_said_listed_and_saved(study):
    found = study.identification
    assert found.recommended is found["robot file"]  # which is true: nothing is better
    study = judged(study, informed={"error_ratio": (0.5, 0.1)})
    found, files = study.identification, identification_files(study)
    assert found.recommended is found["consistent"]
    saved = {
        name: YAML(typ="safe").load(files[name])["base_parameters"]
        for name in ("parameters.yaml", "all_parameters.yaml")
    }
    fits = found.fit, found["all parameters"].fit
    for fit, entries in zip(fits, saved.values(), strict=True):
        np.testing.assert_array_equal([entry["value"] for entry in entries], fit.values)
    (said,) = [text for text in findings(study) if "Recommended" in text]
    assert "parameters.yaml: consistent" in said
    assert "recommended: consistent" in files["report.md"]
    record = json.loads(files["identification.json"])
    assert record["recommended"] == "consistent"
    assert record["recommended_fit"] == SavedFit.of(found.force_model, found.fit).record()
    assert record["verdict"] == found.verdict
    worse = judged(study, informed={"error_ratio": (2.0, 0.1)})
    other = worse.identification
    assert other.recommended is other["robot file"]
    (said,) = [text for text in findings(worse) if "Recommended" in text]
    assert "robot file with fitted joint terms, as nothing is clearly better" in said
    bodies = [found.fit.parameters.labels[j] for j in found.force_model.body_columns]
    assert other.fit.assumed == tuple(bodies)


def test_findings_are_sentences_and_count_the_essential_parameters(study):
    said = findings(study)
    assert all(
        (text[0].isupper() or text[0].isdigit()) and text.endswith(".") and "\n" not in text
        for text in said
    )
    kept = len(study.reduction.result.parameters)
    assert any(text.startswith(f"{kept} of 23 parameters are essential") for text in said)
    cutoff = study.identification.training[0].cutoff
    assert any(f"cut-off of the filter: {cutoff:.3g} Hz" in text for text in said)
    plain = tuple(replace(part, cutoff=None) for part in study.identification.training)
    said = findings(replace(study, identification=replace(study.identification, training=plain)))
    assert any("unfiltered" in text for text in said)


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
    assert record["fit"] == SavedFit.of(model, found["all parameters"].fit).record()
    corrected = [model.parameters.labels[j] for j in study.reduction.columns]
    assert record["essential_parameters"] == corrected


def test_recordings_are_recorded_with_what_was_left_out(study):
    record = identification_record(study)
    for part, recordings in (
        (record["training"], study.identification.training),
        (record["validation"], study.identification.validation),
    ):
        (entry,), (recording,) = part, recordings
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
    assert "Joint terms: Fc,Fv." in findings(study)
    (sentence,) = [text for text in findings(study) if "On new data" in text]
    assert "these are enough with fitted bodies" in sentence
    assert "Try" not in sentence
    other = replace(study, term_sets=replace(found, chosen=found.sets[0]))
    assert any('Try terms="Fc,Fv".' in text for text in findings(other))


def test_what_is_not_finite_is_null(study):
    candidate = study.identification["all parameters"]
    empty = replace(candidate.validation, residual_rms=np.full(4, np.nan))
    odd = {"validation": empty, "error_ratio": (np.inf, np.nan)}
    record = identification_record(judged(study, full=odd))
    assert_strict(record)
    entry = record["candidates"][1]
    assert entry["validation"]["rms"] == [None] * 4
    assert entry["error_ratio"] is entry["error_ratio_standard_error"] is None
