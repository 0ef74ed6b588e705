"""However a robot's files are spoilt, ``loopid check`` works or ends with one sentence."""

import sys
import warnings

import pytest
from hypothesis import HealthCheck, given, settings

from broken_robots import FAMILY, FAMILY_YAML, mutilated_yaml
from closure_robots import files
from loopid.cli import main
from small_tree import PARTS

FUNCTION_SCOPED = [HealthCheck.function_scoped_fixture]
GEARS = [{"type": "gear", "joints": {"rail": 1}, "offset": offset} for offset in (0, 1)]
# Descriptions of a tree that are wrong, and what the command says of them.
WRONG = {
    "contradiction": ({"closures": GEARS}, "coupling rail = 1 contradicts the ones before it"),
    "length": (
        {"closures": [{"type": "rod", "frames": ["tip", "slide"], "length": -1}]},
        "closures.0.length: ",
    ),
    "one body": ({"closed_loop": [["tip", "palm"]], "type": ["3d"]}, "two frames of one body"),
    "link": ({"identical": {"part": ["arm", "leg"]}}, "identical: link 'leg' of part is unknown"),
    "reference": ({"reference": {"elbow": [0, 1]}}, "joint elbow in reference must be one number"),
    "joint": ({"joint_name": ["wrist"], "joint_type": ["SPHERICAL"]}, "'wrist' in joint_name"),
    "trees": ({"mjcf": "robot.xml"}, "'urdf' and 'mjcf' exclude each other"),
}
SAID = ("loopid: warning: ", "loopid: error: ")


@pytest.fixture
def check(tmp_path, monkeypatch, capfd):
    """Run the command on a robot; nothing but its own sentences may be on the error stream."""

    def call(urdf, yaml):
        (tmp_path / "robot.urdf").write_text(urdf)
        (tmp_path / "robot.yaml").write_text(yaml)
        monkeypatch.setattr(sys, "argv", ["loopid", "check", str(tmp_path / "robot.yaml")])
        code = 0
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            try:
                main()
            except SystemExit as end:
                code = int(end.code or 0)
        lines = capfd.readouterr().err.splitlines()
        assert all(line.startswith(SAID) for line in lines), lines
        errors = [line for line in lines if line.startswith("loopid: error: ")]
        assert len(errors) == (code == 2), (code, lines)
        assert all(f"{tmp_path}/robot." in line for line in errors), lines
        return code

    return call


@pytest.mark.parametrize("yaml", ["urdf: robot.urdf", FAMILY_YAML])
def test_the_family_itself_is_checked(check, yaml):
    assert check(FAMILY, yaml) == 0


@settings(max_examples=8, suppress_health_check=FUNCTION_SCOPED)
@given(yaml=mutilated_yaml(FAMILY_YAML))
def test_a_spoilt_description(check, yaml):
    check(FAMILY, yaml)


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_description_is_refused_by_key(run, write_files, case):
    description, words = WRONG[case]
    file = write_files(*files(PARTS, description))
    done = run("check", file)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert done.err.startswith(f"loopid: error: {file}: ")
    assert words in done.err
