"""An identification is a value, of data of any form, and answers what is asked of it."""

import pickle
from dataclasses import replace

import numpy as np
import polars
import pytest

import loopid
from loopid import FitOptions, identify, read_log
from loopid.errors import OptionError
from loopid.identification import compare_terms, eliminate
from loopid.identification.selection import judge_essential
from made_runs import quietly

RUN = "urdf/logs/five_bar.csv"


def test_an_identification_holds_what_its_functions_say(study):
    assert study.term_sets == compare_terms(study)
    assert study.reduction == eliminate(study)
    assert study.essential == judge_essential(study, study.reduction)
    assert {*study.mistakes} <= {*study.findings}


def test_an_identification_is_a_value(study):
    again = pickle.loads(pickle.dumps(study))
    assert again == study
    assert hash(again) == hash(study)
    parts = study.reduction, study.term_sets, *study.suspicions
    for part in (study, *parts, *study.candidates.values()):
        assert len(repr(part).splitlines()) <= 10
        assert part != "something else"


def test_a_fit_that_is_not_saved_predicts_with_its_force_model(study):
    (recording,) = study.training
    predicted = study.fit.predict(recording)
    np.testing.assert_array_equal(predicted.predicted, study.data.predicted(study.fit.values))
    alone = replace(study.fit, model=None)
    with pytest.raises(OptionError, match="force model"):
        alone.predict(recording)


def test_joint_terms_that_a_robot_cannot_have_are_refused_before_any_work(knee):
    for options in (FitOptions(terms="wrist: Fc"), FitOptions(compared=("Fq",))):
        with pytest.raises(OptionError) as refused:
            identify(knee, "no such log", options=options)
        assert refused.value.facts["valid"]


def test_data_of_any_form_are_identified_alike(load_once):
    robot = load_once("five_bar")
    log = read_log(RUN, robot)
    frame = polars.read_csv(RUN)
    data = {"path": RUN, "frame": frame, "Log": log, "Recording": loopid.prepare(robot, log)}
    found = {name: quietly(identify, robot, one) for name, one in data.items()}
    for each in found.values():
        np.testing.assert_array_equal(each.fit.values, found["path"].fit.values)
        assert str(each.verdict) == str(found["path"].verdict)
    assert found["path"].fit.robot == robot
    with pytest.raises(OptionError, match="data must be a path, a table"):
        identify(robot, {RUN})


def test_a_model_that_is_given_is_not_chosen_again(load_once):
    model, robot = loopid.force_model(load_once("five_bar"), "full"), load_once("five_bar")
    run = loopid.prepare(robot, read_log(RUN, robot))
    with pytest.raises(OptionError, match="has a model and terms of its own"):
        identify(model, run, options=FitOptions(terms="Fc"))
