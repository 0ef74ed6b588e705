"""One voice for what does not fit a form: line, keys, value, choices, what was meant."""

import pytest

import loopid
from loopid.errors import LoopidError, RobotFileError

YAML = """\
# A leg.
name_mot: [hip]
closures:
  - {type: 3d, frames: [tip, foot]}
  - type: hinge
    frames: [rod, lever]
    LAST
"""
# What the last line says, the line and the keys that are named, and what is said of them.
REFUSED = {
    "a key": ("axxes: [[0, 0, 1], [0, 0, 1]]", 7, "closures.1", "did you mean 'axes'?"),
    "a number": ("axes: [[0, 0, 1], [0, 0, far]]", 7, "closures.1.axes.1.2", "a number, not 'far'"),
    "a kind": ("length: 1", 7, "closures.1", "unknown key of a hinge closure 'length'"),
    "several": ("axes: [[0, 0, a], [0, 0, b]]", 7, "closures.1.axes.0.2", "(and 1 more)"),
    "what is missing": ("axes: [[0, 0], [0, 0, 1]]", 7, "closures.1.axes.0.2", "is missing"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_is_refused_by_its_line(tmp_path, case):
    last, line, key, words = REFUSED[case]
    file = tmp_path / "leg.yaml"
    file.write_text(YAML.replace("LAST", last))
    file.with_suffix(".urdf").write_text("<robot name='leg'/>")
    with pytest.raises(RobotFileError) as refused:
        loopid.load(file)
    assert str(refused.value).startswith(f"{file}: line {line}, {key}: ")
    assert words in str(refused.value)
    assert {"line": line, "key": key}.items() <= refused.value.facts.items()


def test_a_bundled_robot_is_meant():
    with pytest.raises(loopid.errors.FileError, match=r"exist \(did you mean 'five_bar'\?\), and"):
        loopid.load("five_br")


@pytest.mark.parametrize(
    ("given", "meant"), [("jiont", "joint"), ("JOINT", "joint"), ("knee", None), (5, None)]
)
def test_a_word_is_refused_with_the_one_that_was_meant(given, meant):
    error = LoopidError.unknown("word", given, ["joint", "frame"])
    assert str(error).endswith(": choose among joint, frame")
    assert ("did you mean" in str(error)) == (meant is not None)
    assert f"did you mean {meant!r}?" in str(error) or meant is None
    assert error.facts == {"given": given, "valid": ("joint", "frame")}
