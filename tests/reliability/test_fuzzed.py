"""Thousands of wrong commands and damaged robot files: each is answered in one sentence.

A nightly run (``make validate``): what one of them finds gets a test of its own.
"""

import warnings

import pytest
from fuzz import calls, fuzz, log_calls
from robot_fuzz import fuzz_robots

pytestmark = pytest.mark.validate


@pytest.mark.parametrize(("made", "count"), [(calls, 300), (log_calls, 60)])
def test_commands_answer_or_refuse_in_one_sentence(tmp_path, made, count):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz(tmp_path, range(count), made=made) == {}


def test_robot_files_are_answered_or_refused_and_only_physics_counts(tmp_path):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz_robots(tmp_path, range(2000)) == {}
