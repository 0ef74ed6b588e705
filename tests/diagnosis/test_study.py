"""A study is one composition of functions that can be called alone, and a value."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from loopid.diagnosis import StudyOptions, compare_terms, eliminate, judge_essential
from loopid.errors import OptionError


def test_a_study_holds_what_its_functions_say(study):
    found = study.identification
    assert set(found.findings) <= set(study.findings)
    assert study.verdict == found.verdict
    assert study.term_sets == compare_terms(found)
    assert study.reduction == eliminate(found)
    assert study.essential == judge_essential(found, study.reduction)


def test_a_study_is_a_value(study):
    again = pickle.loads(pickle.dumps(study))
    assert again == study
    assert hash(again) == hash(study)
    parts = study.identification, study.reduction, study.term_sets, *study.identification.suspicions
    for part in (study, *parts, *study.identification.candidates.values()):
        assert len(repr(part).splitlines()) <= 10
        assert part != "something else"


def test_a_fit_that_is_not_saved_predicts_with_its_force_model(study):
    found = study.identification
    (recording,) = found.training
    predicted = found.fit.predict(recording)
    np.testing.assert_array_equal(predicted.predicted, found.data.predicted(found.fit.values))
    alone = replace(found.fit, model=None)
    with pytest.raises(OptionError, match="force model"):
        alone.predict(recording)


def test_joint_terms_that_a_robot_cannot_have_are_refused_before_any_work(knee):
    for options in (StudyOptions(terms="wrist: Fc"), StudyOptions(compared=("Fq",))):
        with pytest.raises(OptionError) as refused:
            options.require_terms(knee)
        assert refused.value.facts["valid"]
