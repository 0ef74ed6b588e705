"""Assembly closes the loops, whatever set of coordinates was measured."""

import numpy as np
import pytest

from loopid import assemble, random_configurations
from loopid.errors import AssemblyError, DataError, MobilityError, OptionError
from loopid.kinematics import constraint_residual, measured_coordinates, try_assemble

STROKES = ("leg1_stroke", "leg2_stroke", "leg3_stroke", "leg4_stroke")
LIMB_4 = ("leg4_revolute", "leg4_stroke", "platform_pitch", "platform_yaw")
SETS = [STROKES, LIMB_4, "platform"]


def set_name(coordinates):
    return coordinates if isinstance(coordinates, str) else coordinates[0]


def read(mechanism, q, coordinates):
    return measured_coordinates(mechanism, coordinates).read(np.array(q))


@pytest.mark.parametrize("coordinates", SETS, ids=set_name)
def test_assembly_recovers_all_coordinates_to_round_off(mechanism, coordinates):
    q = random_configurations(mechanism, 100, seed=11)
    again = assemble(mechanism, read(mechanism, q, coordinates), coordinates)
    np.testing.assert_allclose(again, q, atol=1e-10)
    assert np.abs(constraint_residual(mechanism, again)).max() < 1e-13


@pytest.mark.parametrize("coordinates", SETS[:2], ids=set_name)
def test_measured_joints_keep_their_values(mechanism, poses, coordinates):
    values = read(mechanism, poses, coordinates)
    q = assemble(mechanism, values, coordinates)
    np.testing.assert_array_equal(q[:, mechanism.velocity_indices(coordinates)], values)


def test_the_actuated_joints_are_measured_by_default(mechanism, poses):
    values = poses[:, mechanism.velocity_indices(mechanism.actuated)]
    by_name = assemble(mechanism, values, mechanism.actuated)
    np.testing.assert_array_equal(assemble(mechanism, values), by_name)


@pytest.mark.parametrize("coordinates", SETS, ids=set_name)
def test_the_order_of_samples_is_irrelevant(mechanism, poses, coordinates):
    values = read(mechanism, poses, coordinates)
    shuffled = np.random.default_rng(0).permutation(len(values))
    q = assemble(mechanism, values, coordinates)
    again = assemble(mechanism, values[shuffled], coordinates)
    np.testing.assert_allclose(again, q[shuffled], rtol=0, atol=1e-14)


def test_one_sample_may_come_without_its_axis(mechanism, poses):
    values = read(mechanism, poses, None)
    np.testing.assert_allclose(
        assemble(mechanism, values[3]), assemble(mechanism, values)[3:4], atol=1e-14
    )


def test_strokes_out_of_reach_raise_with_sample_and_residual(mechanism, poses):
    values = read(mechanism, poses, None)
    values[[2, 5], 0] = 9.0
    with pytest.raises(AssemblyError, match=r"^sample 2 .* open by [\d.e+-]+ m .*2 of 12 samples"):
        assemble(mechanism, values)


def test_only_the_samples_out_of_reach_are_lost(mechanism, poses):
    values = read(mechanism, poses, None)
    whole = assemble(mechanism, values)
    lost = np.isin(np.arange(len(values)), [2, 5])
    values[lost, 0] = 9.0
    outcome = try_assemble(mechanism, values)
    np.testing.assert_array_equal(outcome.assembled, ~lost)
    assert np.isnan(outcome.configurations[lost]).all()
    np.testing.assert_allclose(outcome.configurations[~lost], whole[~lost], rtol=0, atol=1e-14)
    assert (outcome.residual[lost] > 1).all()
    assert (outcome.residual[~lost] < 1e-10).all()


def test_an_impossible_tolerance_is_not_met(mechanism, poses):
    outcome = try_assemble(mechanism, read(mechanism, poses, "platform"), "platform", tolerance=0)
    np.testing.assert_array_equal(outcome.assembled, outcome.residual == 0)
    assert not outcome.assembled.all()


@pytest.mark.parametrize("coordinates", [(), STROKES[:1], STROKES[:3], LIMB_4[:3]])
def test_too_few_coordinates_are_refused(mechanism, coordinates):
    with pytest.raises(MobilityError, match=r"determine .* of the .* other coordinates"):
        assemble(mechanism, np.zeros((1, len(coordinates))), coordinates)


@pytest.mark.parametrize("coordinates", [(*STROKES, "platform_yaw"), (*LIMB_4, "leg1_stroke")])
def test_coordinates_that_depend_on_each_other_are_refused(mechanism, coordinates):
    with pytest.raises(MobilityError, match="not independent of each other"):
        assemble(mechanism, np.zeros((1, len(coordinates))), coordinates)


def test_four_coordinates_that_leave_the_yaw_free_are_refused(knee):
    # At the reference limb 1 lies in the plane that the yaw is symmetric to.
    with pytest.raises(MobilityError, match="determine 8 of the 9"):
        assemble(knee, np.zeros((1, 4)), (*LIMB_4[:3], "leg1_stroke"))


def test_a_joint_given_twice_is_refused_by_name(mechanism):
    with pytest.raises(MobilityError, match=r"twice.*leg1_stroke"):
        assemble(mechanism, np.zeros((1, 4)), (*STROKES[:3], "leg1_stroke"))


def test_unknown_coordinates_are_refused_with_the_valid_names(mechanism, four_bars):
    with pytest.raises(OptionError, match=r"'knee'.*leg1_universal_1.*platform_yaw"):
        assemble(mechanism, np.zeros((1, 1)), ["knee"])
    with pytest.raises(OptionError, match="declares no platform coordinates"):
        assemble(four_bars["3d"], np.zeros((1, 1)), "platform")


@pytest.mark.parametrize(
    ("values", "problem"),
    [
        (np.zeros((2, 3)), r"shape \(samples, 4\), not \(2, 3\)"),
        (np.zeros((2, 2, 4)), r"shape \(samples, 4\), not \(2, 2, 4\)"),
        (np.full((1, 4), np.nan), r"finite, but entry \(0, 0\) is nan"),
        ([["far"] * 4], "must be numbers"),
    ],
)
def test_bad_values_are_refused(mechanism, values, problem):
    with pytest.raises(DataError, match=rf"measured coordinates.*{problem}"):
        assemble(mechanism, values)


def test_a_bad_start_is_refused(mechanism, poses):
    values = read(mechanism, poses, None)
    for start in (np.zeros(3), np.full(13, np.nan)):
        with pytest.raises(DataError, match="start"):
            assemble(mechanism, values, start=start)
