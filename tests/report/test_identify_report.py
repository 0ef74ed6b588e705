"""The report of an identification: verdict, page, tables, charts and records say the same."""

import io
import json
import re
from dataclasses import replace
from decimal import Decimal

import numpy as np
import pytest
from lxml.html import fromstring
from rich.console import Console
from ruamel.yaml import YAML

import loopid
from loopid.findings import SEVERITIES, Finding
from loopid.identification import friction_curve, identify
from loopid.identification.unseen import WHERE
from loopid.plots import Chart, friction_chart
from loopid.records import json_value
from loopid.report import identification_report
from loopid.report.identify import _card, identification_record
from loopid.report.look import rounded
from made_runs import modelled, quietly, wander, with_answers


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
    found = study
    others = {
        names[name]: replace(found[names[name]], **change) for name, change in changes.items()
    }
    return with_answers(replace(found, candidates=found.candidates | others), study)


def test_the_page_holds_all_tables_and_charts(files, report):
    page = fromstring(files["report.html"])
    cells = [cell.text_content() for cell in page.iter("td")]
    for each in report.tables():
        assert str(each.title or "").lower() in page.text_content().lower()
        for cell in (cell for column in each.columns for cell in column.cells):
            assert any(shown.startswith(str(cell)) for shown in cells)
    found = [figure.findtext("figcaption") for figure in page.iter("figure")]
    assert found[1:] == [chart.caption for chart in charts(report).values()]
    assert found[0].startswith("1 leg1_stroke; 2 leg2_stroke; ")
    titles = page.xpath("//h2/text()")
    assert titles == [
        "Findings, most important first",
        "Errors on new data, by motor",
        "Forces left unexplained over time",
        "Friction of each motor",
        "Parameters compared with the robot file",
        "Checks of the log",
        "Checks of the model",
        "All values",
        "Values of bodies and joints",
        "To reproduce this run",
    ]
    words = page.find("body/main").text_content() + page.xpath("string(//script[@id='data'])")
    assert not re.search(r"R²|r_squared|\bsizes\b|squared error", words)
    for each in report.findings:
        assert len(each.title.split()) <= 8


def test_the_record_is_on_the_page_and_beside_it(files, report):
    (data,) = fromstring(files["report.html"]).xpath("//script[@id='data']/text()")
    assert json.loads(files["identification.json"]) == report.data
    beside = {"fit", "all_parameters", "robot", "identifiability", "expressions"}
    kept = {name: each for name, each in report.data.items() if name not in beside}
    assert json.loads(data) == rounded(kept)
    assert beside < report.data.keys()


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
    fit = study.fit
    shown = names[:-1] if names[-1].startswith("... and ") else names
    assert shown == list(fit.parameters.names)[: len(shown)]
    left = len(fit.values) - len(shown)
    assert names[len(shown) :] == ([f"... and {left} more in the report"] if left else [])
    for value, error, estimate in zip(values, errors, fit.estimates[: len(shown)], strict=False):
        assert float(value) == pytest.approx(estimate.value, rel=5e-4, abs=estimate.standard_error)
        assert (error == "= file") == (estimate.name in fit.assumed)


def test_values_in_the_tables_are_those_of_the_fit(report, study):
    names, values, file, intervals = table(report, "parameter", "value ± std")
    found = study
    fit, model = found.fit, found.force_model
    assert names == list(fit.parameters.names)
    for k, (low, high) in enumerate(fit.intervals()):
        shown = values[k].split(" ")[0]
        half = 0.5001 * 10.0 ** Decimal(shown).as_tuple().exponent  # of the last digit
        assert float(shown) == pytest.approx(fit.values[k], rel=0, abs=half)
        if np.isfinite(low):
            ends = [float(end) for end in intervals[k].split(" ... ")]
            assert ends == pytest.approx([low, high], abs=0.06 * (high - low))
    bodies = [float(file[j]) for j in model.body_columns]
    np.testing.assert_allclose(bodies, model.prior[model.body_columns], rtol=1e-3, atol=1e-12)


def test_what_was_left_out_is_listed(report, study):
    _, reasons, *_ = table(report, "recording", "reason")
    assert reasons == [part.reason for part in study.training[0].dropped]
    assert "leg4_stroke stands still" in reasons


# Charts


def marks(panel, name):
    return [mark for mark in panel.marks if mark.name == name]


def test_errors_are_those_of_the_candidates_the_largest_first(study, report):
    found, chart = study, charts(report)["errors"]
    fits = {"robot file": found.baseline, "this fit": found.recommended}
    told = {entry["motor"]: entry for entry in report.data["errors"]}
    sizes = []
    for panel in chart.panels:
        k = found.data.actuators.index(panel.motor)
        assert panel.number == k + 1
        assert panel.worst == (panel.motor == study.verdict.motor)
        for name, candidate in fits.items():
            (point,) = marks(panel, name)
            squares = found.new.force[found.new.used[:, k], k] ** 2
            error = candidate.validation.residual_rms[k] / np.sqrt(squares.mean())
            assert point.x[0] == pytest.approx(100 * error, rel=1e-9)
            key = "fit" if candidate is found.recommended else "robot_file"
            assert told[panel.motor][key]["error"] == pytest.approx(error, rel=1e-9)
        (where,) = marks(panel, "where it is worst")
        shares = told[panel.motor]["where"]
        others = [share for name, share in shares.items() if share is not None and name != "whole"]
        assert where.x[0] == pytest.approx(100 * max(others))
        assert f" {panel.labels[2]}" in WHERE.values()
        sizes.append(max(where.x[0], point.x[0]))
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == pytest.approx(100 * study.verdict.error)


def test_what_is_left_of_forces_is_by_fits_that_have_not_seen_them(study, report):
    found, chart = study, charts(report)["forces"]
    (run,) = found.training
    fits = {
        "measured less the robot file": found.baseline,
        "measured less this fit": found.recommended,
    }
    assert (len(chart.panels), chart.lanes) == (3 * len(run.actuators), 3)
    for force, *lanes in zip(*[iter(chart.panels)] * 3, strict=True):
        k = run.actuators.index(force.motor)
        (mark,) = marks(force, "measured force")
        np.testing.assert_array_equal(mark.y, run.force[:, k])
        assert lanes[0].limits()[1] == lanes[1].limits()[1]
        for lane, (name, fit) in zip(lanes, fits.items(), strict=True):
            (drawn,) = marks(lane, name)
            left = np.where(run.used[:, k], run.force[:, k] - fit.predicted[:, k], np.nan)
            assert np.isnan(drawn.y).any()  # where the motor stands
            np.testing.assert_allclose(drawn.y, left, atol=1e-9)
            assert np.abs(drawn.y[run.used[:, k]]).max() <= lane.limits()[1][1]
            (shade,) = (mark for mark in lane.marks if mark.kind == "shade")
            time = run.motion.time
            inside = (time[:, None] >= shade.x) & (time[:, None] < shade.to)
            assert (inside.any(axis=1)[:-1] == ~run.used[:-1, k]).all()


def test_parameters_are_shown_against_the_robot_file_with_their_intervals(study, report):
    found, (panel,) = study, charts(report)["parameters"].panels
    model, bodies = found.force_model, found.force_model.body_columns
    fit, place = found.fit, np.arange(len(bodies))
    (spans,) = marks(panel, "95 % interval")
    points = marks(panel, "clearly changed") + marks(panel, "agrees with the robot file")
    order = np.concatenate([mark.y for mark in points]).argsort()
    middle = np.concatenate([mark.x for mark in points])[order]
    np.testing.assert_allclose(spans.x + spans.to, 2 * middle[spans.y.astype(int)], atol=1e-9)
    change = (fit.values - model.prior)[bodies]
    low, high = (fit.intervals()[bodies] - model.prior[bodies, None]).T
    known = np.isfinite(low)
    np.testing.assert_allclose(
        (spans.to - spans.x) / middle[known], ((high - low) / change)[known], rtol=1e-9
    )
    assert set(points[0].y) == set(place[(low > 0) | (high < 0)])
    assert panel.labels == tuple(fit.parameters.names[j] for j in bodies)
    assert panel.wholes == tuple(fit.parameters.expressions[j] for j in bodies)


def test_charts_of_the_log_and_the_model_are_those_of_the_records(study, report):
    found, drawn = study, charts(report)
    cutoff = found.cutoff
    (good,) = marks(drawn["filter"].panels[0], "equally good")
    assert (good.x[0], good.to[0]) == (cutoff.equally_good[0], cutoff.equally_good[-1])
    assert good.x[0] <= cutoff.chosen <= good.to[0]
    assert all(f"{each:.3g}" in drawn["filter"].caption for each in cutoff.equally_good)
    gains = [gain.gain for gain in found.log_faults[0].gains]
    points = [m for m in drawn["gains"].panels[0].marks if m.kind in ("disc", "ring")]
    assert sorted(np.concatenate([m.x for m in points])) == sorted(gains)
    (run,) = found.training
    used = drawn["used"].panels[0].marks
    for k, mark in enumerate(used):
        time = run.motion.time[:, None]
        inside = ((time >= mark.x) & (time <= mark.to)).any(axis=1)
        assert (inside == run.used[:, k]).all()


def test_friction_is_drawn_with_what_it_explains(study, report):
    """Curve and band are those of the fit; dots are forces less all other parts of the model."""
    found = study
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


def test_a_robot_without_friction_has_no_picture_of_it(load_once):
    model = loopid.force_model(load_once("four_bar"), joint_terms=None)
    run = modelled(model, wander(model.robot, 1), model.prior, noise=0.01)
    assert friction_chart(quietly(identify, model, [run])).panels == ()


# In words


def test_a_mistake_is_the_verdict_everywhere_and_gains_are_listed(study):
    found = study
    (listed,) = identification_record(study)["log_faults"]
    assert (listed["recording"], listed["mistakes"]) == ("run", [])
    assert [gain["joint"] for gain in listed["gains"]] == list(found.data.actuators)
    told = Finding("mistake", "the force of leg1_stroke is in mN m", "e^9", "set it to 0.001")
    suspected = replace(found, log_faults=(replace(found.log_faults[0], mistakes=(told,)),))
    report = identification_report(with_answers(suspected, study))
    assert suspected.verdict.excite == ()
    for text in (str(suspected.verdict), report.verdict, suspected._repr_html_()):
        assert "Not fit for use: the force of leg1_stroke is in mN m (e^9)." in text
    assert str(told.brief) in repr(suspected)
    assert report.findings[0] == told
    assert report.data["findings"][0] == json_value(told)
    page = fromstring(report.files()["report.html"]).text_content()
    assert "✗ Not fit until a mistake is mended" in page
    assert "✗ MistakeThe force of leg1_stroke is in mN m" in page
    assert "Do: Set it to 0.001." in page
    assert "Next: set it to 0.001." in page
    assert [figure.sure for figure in report.card.figures] == [False, False, False, True]


@pytest.mark.parametrize(
    ("use", "word", "said", "chips"),
    [
        (
            "Fit for predicting forces and as parameters of the robot",
            *("✓ Fit", "for predicting forces and as parameters of the robot", ("yes", "yes")),
        ),
        (
            "Fit for rough predictions of forces in motions like these, but not one by one",
            *("≈ Rough", "predictions of forces in motions like these, but not one by one"),
            ("roughly", "no"),
        ),
        (
            "Not fit for use, as a mass is negative",
            "✗ Not fit",
            "as a mass is negative",
            ("no", "no"),
        ),
    ],
)
def test_the_card_says_the_verdict(study, use, word, said, chips):
    judged = replace(study.verdict, use=use)
    card = _card(study, judged, "loopid excite")
    assert (card.said, card.use) == (word, said)
    assert tuple(text.split(": ")[1] for _, text in card.chips) == chips
    error, *_, mistakes = card.figures
    assert error.gauge == (judged.error, 0.1, 0.3)
    assert (error.value, mistakes.value) == (f"{100 * judged.error:.2g} %", "0")


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
    names, _, ratios, grades, *_ = table(report, "fit", "fitted", "error over the file's")
    row = names.index("all parameters")
    assert grades[row] == grade
    root, spread = map(float, ratios[row].split(" ± "))
    assert (root, spread) == pytest.approx(
        (np.sqrt(ratio[0]), ratio[1] / (2 * np.sqrt(ratio[0]))), rel=0.05
    )


def test_the_recommended_fit_is_said_listed_and_saved(study):
    study = judged(study, informed={"error_ratio": (0.5, 0.1)})
    found, files = study, identification_report(study).files()
    assert found.recommended is found["consistent"]
    saved = {
        name: YAML(typ="safe").load(files[name])["base_parameters"]
        for name in ("parameters.yaml", "all_parameters.yaml")
    }
    fits = found.fit, found["all parameters"].fit
    for fit, entries in zip(fits, saved.values(), strict=True):
        np.testing.assert_array_equal([entry["value"] for entry in entries], fit.values)
    (said,) = [each for each in study.findings if "recommended" in each.title]
    assert "parameters.yaml: consistent" in said.why
    assert "recommended: consistent, as in parameters.yaml" in files["report.html"]
    record = json.loads(files["identification.json"])
    assert record["recommended"] == "consistent"
    assert record["fit"] == found.fit.record()
    assert record["verdict"] == str(study.verdict)
    worse = judged(study, informed={"error_ratio": (2.0, 0.1)})
    other = worse
    assert other.recommended is other["robot file"]
    (said,) = [each for each in worse.findings if "recommended" in each.title]
    assert "robot file with fitted joint terms, as fitted bodies are clearly worse" in said.why
    bodies = [found.fit.parameters.names[j] for j in found.force_model.body_columns]
    assert other.fit.assumed == tuple(bodies)


def test_findings_are_lines_the_most_serious_first(study):
    said = study.findings
    order = [SEVERITIES.index(each.severity) for each in said]
    assert order == sorted(order)
    for each in said:
        assert not each.title.endswith(".")
        assert "\n" not in str(each)
    cutoff = study.training[0].cutoff
    assert any(f"filtered at {cutoff:.3g} Hz" in each.title for each in said)
    plain = tuple(replace(part, cutoff=None) for part in study.training)
    said = with_answers(replace(study, training=plain), study).findings
    assert any("unfiltered" in each.title for each in said)


# Records for machines


def assert_strict(record):
    assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_an_identification_is_recorded_whole(study):
    record, found = identification_record(study), study
    model, count = found.force_model, len(found.fit.values)
    assert (record["mechanism"], record["model"]) == ("3ups_rpu", "gravity")
    assert record["actuators"] == list(model.robot.actuated)
    assert record["expressions"] == list(model.base.expressions)
    assert len(record["expressions"]) == count == 23
    np.testing.assert_array_equal(record["robot_file"], model.prior)
    np.testing.assert_array_equal(record["essential"], study.essential.fit.values)
    assert record["all_parameters"] == found["all parameters"].fit.record()
    corrected = [model.parameters.names[j] for j in study.reduction.columns]
    assert record["essential_parameters"] == corrected


def test_recordings_are_recorded_with_what_was_left_out(study):
    record = identification_record(study)
    (entry,), (recording,) = record["training"], study.training
    assert record["validation"] == []
    assert (entry["name"], entry["samples"]) == ("run", len(recording))
    assert entry["used"] == recording.used.sum(axis=0).tolist()
    assert entry["cutoff"] == recording.cutoff
    assert any("stands still" in reason for reason in entry["dropped"])


def test_candidates_are_recorded_with_their_errors(study):
    record = identification_record(study)
    assert len(record["candidates"]) == 4
    start, whole, informed = study.candidates.values()
    candidates = start, whole, study.essential, informed
    for entry, candidate in zip(record["candidates"], candidates, strict=True):
        assert (entry["name"], entry["fitted"]) == (candidate.name, candidate.fitted)
        assert entry["beats_baseline"] is candidate.beats_baseline
        ratio, spread = entry["error_over_file"], entry["error_over_file_standard_error"]
        assert (ratio**2, 2 * ratio * spread) == pytest.approx(candidate.error_ratio)
        parts = {"training": candidate.fit.quality, "validation": candidate.validation}
        for part, quality in parts.items():
            np.testing.assert_array_equal(entry[part]["rms"], quality.residual_rms)


def test_what_is_not_finite_is_null(study):
    candidate = study["all parameters"]
    empty = replace(candidate.validation, residual_rms=np.full(4, np.nan))
    odd = {"validation": empty, "error_ratio": (np.inf, np.nan)}
    record = identification_record(judged(study, full=odd))
    assert_strict(record)
    entry = record["candidates"][1]
    assert entry["validation"]["rms"] == [None] * 4
    assert entry["error_over_file"] is entry["error_over_file_standard_error"] is None
