"""Motion files to be read."""

import pytest
from ruamel.yaml import YAML

from loopid.trajectories import read_motion_program

VALID = """
coordinates: [a, b]
rate: 50
speeds: {a: 0.1}
motions:
  first:
    description: some words
    start: {a: 0, b: 1}
    steps:
      - hold: 2
      - repeat: 3
        steps:
          - to: {a: 1}
          - there_and_back:
              - to: {b: 2}
                seconds: 3
                arcs: {a: {height: 0.1, flatness: 0.5}}
            between:
              - hold: 1
          - to: {a: 0}
            speed: 0.5
  2:
    start: {a: 0, b: 1}
    steps: [hold: 1]
"""


@pytest.fixture(scope="session")
def valid_program():
    return VALID


@pytest.fixture(scope="session")
def program_of(tmp_path_factory):
    """Read a program of some motions, each given by its steps, or a program given as text."""
    file = tmp_path_factory.mktemp("program") / "motions.yaml"

    def read(text=None, **motions):
        if text is None:
            described = {
                name: {"start": {"a": 0.0, "b": 1.0}, "steps": s} for name, s in motions.items()
            }
            content = {"coordinates": ["a", "b"], "motions": described}
            content["speeds"] = {"a": 0.1, "b": 0.4}
            with file.open("w") as stream:
                YAML(typ="safe").dump(content, stream)
        else:
            file.write_text(text)
        return read_motion_program(file)

    return read


@pytest.fixture
def refusal():
    """Check that a refusal is one sentence that says all it must."""

    def check(failure, *fragments):
        text = str(failure.value)
        assert "\n" not in text
        assert len(text) < 500
        missing = [fragment for fragment in fragments if fragment not in text]
        assert not missing, f"{text!r} does not say {missing}"

    return check
