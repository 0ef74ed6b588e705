"""Closing the loops at the reference: what is left out is found, what is odd is said."""

import numpy as np
import pytest

import loopid
from closure_robots import files, tie
from linkages import five_bar
from loopid import random_configurations
from loopid.errors import ModelWarning
from loopid.kinematics import mobility
from loopid.kinematics.projection import NEAR_SINGULARITY, singularity_measure
from small_tree import PARTS

REFERENCE = r"reference:\n(  \w+: [^\n]*\n)+"
PASSIVE = r"  (leg\d_universal_\d|leg4_revolute|platform_\w+): [^\n]*\n"


def assert_usable(mechanism):
    model, q = mechanism.model, mechanism.reference
    assert (q >= model.lowerPositionLimit - 1e-6).all()
    assert (q <= model.upperPositionLimit + 1e-6).all()
    assert singularity_measure(mechanism, q)[0] >= NEAR_SINGULARITY
    assert len(random_configurations(mechanism, 5)) == 5


@pytest.mark.filterwarnings("ignore:.*exclude the drawn pose")
def test_without_any_reference_a_regular_one_inside_the_limits_is_found(edited):
    assert_usable(loopid.load(edited("yaml", REFERENCE, "")))


def test_left_out_passive_joints_are_found_for_the_given_motors(edited, knee):
    mechanism = loopid.load(edited("yaml", PASSIVE, ""))
    assert_usable(mechanism)
    motors = knee.velocity_indices(knee.actuated)
    np.testing.assert_array_equal(mechanism.reference[motors], knee.reference[motors])


@pytest.mark.filterwarnings("ignore:.*exclude the drawn pose")
def test_the_search_is_repeatable(edited):
    file = edited("yaml", REFERENCE, "")
    first, second = (loopid.load(file).reference for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_reference_outside_the_limits_is_named(edited):
    file = edited("urdf", 'lower="0.6537"', 'lower="0.8"')
    with pytest.warns(ModelWarning, match=r"leg1_stroke: 0\.7071 is not in 0\.8 \.\.\. 0\.9337"):
        loopid.load(file)


def test_a_closure_that_always_holds_takes_no_freedom(load_files):
    """The elbow is on the upper arm, wherever it is: what is left of the rows is round-off."""
    closure = tie("2d", ("arm", "hand"), axes=[[1, 0, 0], [1, 0, 0]])
    robot = load_files(PARTS, {"closures": [closure], "reference": {"shoulder": 0.7, "elbow": 1.1}})
    found = mobility(robot)
    assert (found.rows, found.rank, found.degrees_of_freedom) == (2, 0, 4)
    assert robot.independent == robot.actuated == robot.joints


def test_a_rounded_reference_closes_where_no_motors_are_known(tmp_path, urdf_folder):
    (tmp_path / "bar.urdf").write_text((urdf_folder / "four_bar.urdf").read_text())
    rounded = "{crank_joint: 1.0, coupler_joint: -0.329, rocker_joint: 1.683}"
    closure = "closed_loop: [[coupler_end, rocker_end]]\ntype: [3d]\n"
    (tmp_path / "bar.yaml").write_text(f"{closure}reference: {rounded}\n")
    with pytest.warns(ModelWarning, match="does not say which joints have motors"):
        robot = loopid.load(tmp_path / "bar.yaml")
    np.testing.assert_allclose(robot.reference, [1.0, -0.329, 1.683], atol=2e-3)
    assert mobility(robot).residual < 1e-10


def test_limits_that_exclude_the_drawn_pose_are_named(write_files):
    parts, description = five_bar()
    there = 'joint name="left_joint"'
    away = [p.replace('lower="-3"', 'lower="0.5"') if there in p else p for p in parts]
    with pytest.warns(ModelWarning, match=r"limits of left_joint exclude the drawn pose"):
        loopid.load(write_files(*files(away, description | {"reference": {}})))
