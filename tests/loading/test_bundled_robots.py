"""Robots that come with the package, by name, by YAML and by URDF."""

import numpy as np
import pytest

from loopid import bundled_robots, load_mechanism
from loopid.kinematics import constraint_residual, mobility
from loopid.loading import bundled_directory


def test_the_bundled_names_are_those_of_the_committed_pairs(urdf_folder):
    pairs = {file.stem for file in urdf_folder.glob("*.urdf")}
    assert set(bundled_robots()) == pairs
    assert {"3ups_rpu", "5p"} <= pairs


@pytest.mark.parametrize("name", bundled_robots())
def test_a_bundled_robot_loads_closed_and_determined(name):
    mechanism = load_mechanism(name)
    assert mechanism.path == bundled_directory() / f"{name}.yaml"
    assert np.abs(constraint_residual(mechanism, mechanism.reference)).max() < 1e-10
    found = mobility(mechanism)
    assert found.degrees_of_freedom == len(mechanism.actuated)
    assert found.undetermined == ()
    assert found.residual < 1e-10


def test_a_name_and_its_file_give_the_same_robot(mechanism):
    again = load_mechanism(bundled_directory() / f"{mechanism.name}.yaml")
    np.testing.assert_array_equal(again.reference, mechanism.reference)
    np.testing.assert_array_equal(again.standard_parameters(), mechanism.standard_parameters())
    assert again.closures == mechanism.closures


def test_a_urdf_alone_is_the_open_tree_with_a_motor_in_every_joint(mechanism):
    tree = load_mechanism(mechanism.path.with_suffix(".urdf"))
    assert tree.closures == ()
    assert tree.actuated == tree.joints == mechanism.joints
    assert tree.bodies == mechanism.bodies
    assert mobility(tree).degrees_of_freedom == tree.model.nv


def test_joints_without_reference_start_at_zero_or_amid_their_limits(mechanism):
    tree = load_mechanism(mechanism.path.with_suffix(".urdf"))
    low, high = tree.model.lowerPositionLimit, tree.model.upperPositionLimit
    expected = np.where((low <= 0) & (high >= 0), 0, (low + high) / 2)
    assert expected[tree.prismatic].all()
    np.testing.assert_array_equal(tree.reference, expected)


def test_a_yaml_without_motors_drives_every_joint(edited):
    file = edited("yaml", r"\A.+", "urdf: 3ups_rpu.urdf\n")
    tree = load_mechanism(file)
    assert tree.actuated == tree.joints


def test_the_urdf_beside_the_yaml_is_found_by_its_stem(edited):
    assert load_mechanism(edited("yaml", "urdf: [^\n]*", "")).name == "3ups_rpu"


def test_motors_keep_the_order_of_the_file(edited):
    backwards = ["leg4_stroke", "leg3_stroke", "leg2_stroke", "leg1_stroke"]
    file = edited("yaml", r"name_mot: \[[^]]*\]", f"name_mot: [{', '.join(backwards)}]")
    assert list(load_mechanism(file).actuated) == backwards


def test_the_actuated_part_of_the_reference_stays_as_written(edited, knee):
    file = edited("yaml", r"leg1_universal_1: [\d.]*", "leg1_universal_1: 1.3")
    mechanism = load_mechanism(file)
    motors = mechanism.velocity_indices(mechanism.actuated)
    np.testing.assert_array_equal(mechanism.reference[motors], knee.reference[motors])
    np.testing.assert_allclose(mechanism.reference, knee.reference, atol=1e-12)


def test_without_a_reference_a_closed_one_is_found(edited):
    file = edited("yaml", r"reference:\n(  \w+: [^\n]*\n)+", "")
    mechanism = load_mechanism(file)
    assert np.abs(constraint_residual(mechanism, mechanism.reference)).max() < 1e-10
