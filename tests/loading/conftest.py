"""Copies of the bundled 3UPS+RPU with one thing changed."""

import re

import pytest


@pytest.fixture
def edited(tmp_path, urdf_folder):
    """Copy the robot's files with a pattern replaced in one of them; gives the YAML's path."""

    def edit(suffix="", pattern="", replacement=""):
        for name in ("3ups_rpu.urdf", "3ups_rpu.yaml"):
            text = (urdf_folder / name).read_text()
            if name.endswith(suffix or "none"):
                text, count = re.subn(pattern, replacement, text, flags=re.DOTALL)
                assert count > 0, f"the edit finds nothing to change in {name}"
            (tmp_path / name).write_text(text)
        return tmp_path / "3ups_rpu.yaml"

    return edit


@pytest.fixture
def refusal():
    """Message of a refusal, checked to be one sentence that says all it must."""

    def message(failure, *fragments):
        text = str(failure.value)
        assert "\n" not in text
        assert 0 < len(text) < 700
        missing = [fragment for fragment in fragments if fragment not in text]
        assert not missing, f"{text!r} does not say {missing}"
        return text

    return message
