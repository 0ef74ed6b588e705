"""Records of all commands keep the forms that are told of them, and their pages are valid."""

import json

import html5lib
import jsonschema
import numpy as np
import pytest

import loopid
from loopid.diagnosis.gains import GainFit
from loopid.errors import OptionError
from loopid.identification import Prediction
from loopid.identification.saved import FitFile
from loopid.motion.joints import MotionReview
from loopid.paper.page import paper_report
from loopid.report import (
    base_report,
    check_report,
    excitation_report,
    gains_report,
    identification_report,
    json_schema,
    motions_report,
    prediction_report,
)
from loopid.report.compare import comparison_report
from loopid.report.schema import FORMS


@pytest.fixture(scope="module")
def five_bar(load_once):
    return load_once("five_bar")


REPORTS = {
    "check": lambda get: check_report(get("knee")),
    "check, loops none": lambda get: check_report(get("linkage")("ball rssr")),
    "base": lambda get: base(get("knee"), "gravity"),
    "base, free": lambda get: base(get("linkage")("ball rssr"), "full"),
    "motions": lambda get: motions_report(
        "five_bar", {"a": MotionReview((), 0.05, 2.5, 0.01, {"a": 0.3})}, {"a": 12.0}
    ),
    "excitation": lambda get: excitation_report(get("designed")),
    "identification": lambda get: identification_report(get("study"), "loopid excite"),
    "prediction": lambda get: prediction_report(get("knee"), [prediction(get("study"))]),
    "gains": lambda get: gains_report(get("five_bar"), gains()),
    "comparison": lambda get: comparison_report(saved(get("study"))),
    "paper": lambda get: paper_report(get("paper")),
}


def base(robot, model):
    observation = loopid.regressors.structural_observation(robot, model)
    alone = observation.motors_alone
    found = loopid.base_parameters.find_base(observation)
    other = None if alone is None else loopid.base_parameters.find_base(alone)
    return base_report(robot, model, found, other)


def prediction(study):
    found = study
    (run,) = found.training
    return Prediction(run, found.force_model.samples(run).predicted(found.fit.values))


def gains():
    return GainFit(("left_crank_joint",), np.ones(1), np.eye(1), 5.0, ("right_crank_joint",))


def saved(study):
    found = study
    fits = found.fit, found["all parameters"].fit, found.force_model.prior
    names = "recommended", "all", "values alone"
    whole = (FitFile.of(loopid.Fit.of(found.force_model, fit)) for fit in fits)
    return dict(zip(names, whole, strict=True))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("kind", REPORTS)
def test_records_have_the_form_that_is_told_and_pages_are_valid(kind, request):
    report = REPORTS[kind](request.getfixturevalue)
    assert report.name == kind.split(",")[0]
    data = json.loads(json.dumps(report.data, allow_nan=False))
    schema = json_schema(report.name)
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(data | {"written": []}, schema)
    assert {*data} == {*schema["required"]}
    html5lib.HTMLParser(strict=True).parse(report.page().html())  # or a ParseError
    for broken in (data | {"more": 1}, {k: v for k, v in data.items() if k != "verdict"}):
        assert not jsonschema.Draft202012Validator(schema).is_valid(broken)


def test_all_forms_are_tested_and_others_unknown():
    tested = {kind.split(",")[0] for kind in REPORTS}
    assert set(FORMS) - tested == {"payload", "export"}  # by tests of commands, as all are
    with pytest.raises(OptionError, match="choose among check"):
        json_schema("chek")
