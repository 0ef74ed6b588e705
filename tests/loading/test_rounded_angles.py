"""Angles printed with a few digits mean the multiples of 5 degrees that print alike."""

import math
import warnings

import pytest
from hypothesis import given
from hypothesis import strategies as st

from loopid import find_base_parameters, load_mechanism, mobility, structural_observation
from loopid.errors import ClosureWarning, RobotFileError
from loopid.loading.urdf_file import DECIMALS, STEP, exact_angle

steps = st.integers(-72, 72).filter(bool)


@given(steps, st.sampled_from(DECIMALS))
def test_a_multiple_is_found_from_its_digits(k, decimals):
    assert exact_angle(f"{k * STEP:.{decimals}f}") == k * STEP


@given(steps, st.sampled_from(DECIMALS))
def test_digits_may_be_cut_off(k, decimals):
    cut = math.trunc(k * STEP * 10**decimals) / 10**decimals
    assert exact_angle(f"{cut:.{decimals}f}") == k * STEP


def test_half_a_turn_may_be_twice_a_quarter_that_was_cut_off():
    assert exact_angle("3.14158") == math.pi


@given(steps, st.sampled_from(DECIMALS), st.sampled_from([-1, 1]))
def test_two_digits_off_is_meant_as_written(k, decimals, sign):
    text = f"{k * STEP + sign * 2 * 10.0**-decimals:.{decimals}f}"
    assert exact_angle(text) == float(text)


@pytest.mark.parametrize("text", ["1.57", "1.571", "0", "-0", "0.0000", "1e-17", "2.11941"])
def test_other_angles_stay(text):
    assert exact_angle(text) == float(text)


@pytest.mark.parametrize("text", ["1.57080e0", "1.5707963267948966"])
def test_all_digits_stay(text):
    assert exact_angle(text) == float(text)


PENDULUMS = """<robot name="arm">
  <link name="base"/>
  <link name="upper">{body}</link><link name="fore">{body}</link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/>
    <origin rpy="{quarter} 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="fore"/>
    <origin xyz="0.3 0 0" rpy="{turn} 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"""
BODY = """<inertial><origin xyz="0.1 0.02 0.03"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>"""


@pytest.mark.parametrize("decimals", [4, 5, 6, 9, 16])
def test_rounding_invents_no_parameters(tmp_path, decimals):
    angles = {"quarter": f"{math.pi / 2:.{decimals}f}", "turn": f"{math.pi:.{decimals}f}"}
    (tmp_path / "arm.urdf").write_text(PENDULUMS.format(body=BODY, **angles))
    robot = load_mechanism(tmp_path / "arm.urdf")
    for model, count in (("gravity", 4), ("full", 6)):
        found = find_base_parameters(structural_observation(robot, model))
        assert len(found) == count
        assert found.structure.rank_gap > 1e9


@pytest.fixture
def tilted_bar(tmp_path, urdf_folder):
    """Copy the five-bar, pinned at a point, with an axis tilted by some angle in rad."""

    def tilt(angle):
        text = (urdf_folder / "five_bar.urdf").read_text()
        upright = f'rpy="{math.pi / 2!r} 0 0"'
        assert text.count(upright) > 1
        (tmp_path / "bar.urdf").write_text(
            text.replace(upright, f'rpy="{math.pi / 2 + angle!r} 0 0"', 1)
        )
        yaml = (urdf_folder / "five_bar.yaml").read_text()
        (tmp_path / "bar.yaml").write_text(yaml.replace("five_bar.urdf", "bar.urdf"))
        return tmp_path / "bar.yaml"

    return tilt


def test_redundant_equations_that_rounding_sets_against_each_other_are_refused(tilted_bar):
    with pytest.raises(RobotFileError, match=r"stays open by .*: the numbers .* seem rounded"):
        load_mechanism(tilted_bar(5e-6))
    assert mobility(load_mechanism(tilted_bar(0.0))).least > 1e-3


@pytest.mark.parametrize(("other", "told"), [(-1.000001, True), (-1.0, False), (-1.01, False)])
def test_equations_that_nearly_follow_from_each_other_are_told(tmp_path, urdf_folder, other, told):
    # As a tree; a second gear between the same joints holds both, unless it is the first again.
    (tmp_path / "bar.urdf").write_text((urdf_folder / "five_bar.urdf").read_text())
    first = {"right_crank_joint": 1.0, "right_coupler_joint": -1.0}
    gears = [
        {"type": "coupling", "joints": first | {"right_coupler_joint": ratio}}
        for ratio in (-1.0, other)
    ]
    (tmp_path / "bar.yaml").write_text(f"closures: {gears}\nname_mot: [left_crank_joint]\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = load_mechanism(tmp_path / "bar.yaml")
    texts = [str(w.message) for w in caught if w.category is ClosureWarning]
    assert any("rank of the closures is not clear" in text for text in texts) == told
    assert mobility(robot).rank == (1 if other == -1.0 else 2)
