"""Robot files that are damaged are refused in one sentence; how one is written changes nothing."""

import warnings

import pytest
from robot_fuzz import fuzz_robots

pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")


@pytest.mark.parametrize(
    "numbers",
    [range(12), pytest.param(range(12, 2000), marks=pytest.mark.validate)],
    ids=["some", "all"],
)
def test_robot_files_are_answered_or_refused_and_only_physics_counts(tmp_path, numbers):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert fuzz_robots(tmp_path, numbers) == {}
