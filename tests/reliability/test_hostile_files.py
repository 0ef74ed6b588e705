"""Robot descriptions without end or sense."""

from pathlib import Path

import pytest
from material import LAUGHS

from loopid import load_mechanism
from loopid.errors import RobotFileError


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (LAUGHS, "more than 1,000,000 values"),
        (b"reference: &a {b: *a}\n", "more than 1,000,000 values"),
        (b"- " * 5000, "nested too deeply"),
        (b"\xff\xfe", "is not YAML"),
        (b"urdf: 2020-13-45\n", "YAML|urdf"),
    ],
)
def test_a_yaml_without_end_or_sense_is_refused(tmp_path, content, words):
    (tmp_path / "robot.yaml").write_bytes(content)
    with pytest.raises(RobotFileError, match=words):
        load_mechanism(tmp_path / "robot.yaml")


def test_a_yaml_that_may_not_be_read_is_named(tmp_path, monkeypatch):
    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\n")
    monkeypatch.setattr(Path, "read_text", denied)
    with pytest.raises(RobotFileError, match=r"robot\.yaml cannot be read: Permission denied"):
        load_mechanism(tmp_path / "robot.yaml")
