"""However a robot's files are spoilt, ``loopid check`` works or ends with one sentence."""

import sys
import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from broken_robots import FAMILY, FAMILY_YAML, KNEE, mutilated, mutilated_yaml
from loopid.cli import main

FUNCTION_SCOPED = [HealthCheck.function_scoped_fixture]
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


@settings(max_examples=40, suppress_health_check=FUNCTION_SCOPED)
@given(yaml=mutilated_yaml(FAMILY_YAML))
def test_a_spoilt_description(check, yaml):
    check(FAMILY, yaml)


@settings(max_examples=15, suppress_health_check=FUNCTION_SCOPED)
@given(urdf=mutilated(FAMILY))
def test_a_spoilt_family(check, urdf):
    check(urdf, "urdf: robot.urdf")


@settings(max_examples=40, suppress_health_check=FUNCTION_SCOPED)
@given(data=st.data())
def test_a_spoilt_knee_robot(check, urdf_folder, data):
    yaml = (urdf_folder / "3ups_rpu.yaml").read_text().replace("3ups_rpu.urdf", "robot.urdf")
    check(data.draw(mutilated(KNEE)), data.draw(mutilated_yaml(yaml)))
