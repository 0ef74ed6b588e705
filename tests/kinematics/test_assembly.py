"""Assembly closes the loops on the branch of its start, sample by sample or along a trajectory."""

import warnings

import numpy as np
import pytest

import loopid
from loopid import random_configurations
from loopid.errors import AccuracyWarning, AssemblyError, DataError, MobilityError, OptionError
from loopid.kinematics import (
    Assembly,
    AssemblyOptions,
    assemble,
    assembly,
    constraint_jacobian,
    constraint_residual,
    measured_coordinates,
    platform_coordinates,
)
from loopid.kinematics.assembly import closed_configurations, try_assemble
from loopid.kinematics.poses import integrate
from loopid.kinematics.projection import partition

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
    with pytest.raises(AssemblyError) as error:
        assemble(mechanism, values)
    facts = error.value.facts
    assert (facts["sample"], facts["samples"]) == (2, 2)
    assert facts["residual"] > 1 > facts["tolerance"]


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
    outcome = try_assemble(
        mechanism,
        read(mechanism, poses, "platform"),
        "platform",
        options=AssemblyOptions(tolerance=0),
    )
    np.testing.assert_array_equal(outcome.assembled, outcome.residual == 0)
    assert not outcome.assembled.all()


@pytest.mark.parametrize("coordinates", [(), STROKES[:1], STROKES[:3], LIMB_4[:3]])
def test_too_few_coordinates_are_refused(mechanism, coordinates):
    with pytest.raises(MobilityError) as error:
        assemble(mechanism, np.zeros((1, len(coordinates))), coordinates)
    assert error.value.facts["determined"] < error.value.facts["unknown"]


@pytest.mark.parametrize("coordinates", [(*STROKES, "platform_yaw"), (*LIMB_4, "leg1_stroke")])
def test_coordinates_that_depend_on_each_other_are_refused(mechanism, coordinates):
    with pytest.raises(MobilityError) as error:
        assemble(mechanism, np.zeros((1, len(coordinates))), coordinates)
    assert error.value.facts == {"measured": 5}


def test_four_coordinates_that_leave_the_yaw_free_are_refused(knee):
    # At the reference limb 1 lies in the plane that the yaw is symmetric to.
    with pytest.raises(MobilityError) as error:
        assemble(knee, np.zeros((1, 4)), (*LIMB_4[:3], "leg1_stroke"))
    assert error.value.facts == {"determined": 8, "unknown": 9}


def test_a_joint_given_twice_is_refused_by_name(mechanism):
    with pytest.raises(MobilityError) as error:
        assemble(mechanism, np.zeros((1, 4)), (*STROKES[:3], "leg1_stroke"))
    assert error.value.facts["given"].count("leg1_stroke") == 2


def test_unknown_coordinates_are_refused_with_the_valid_names(mechanism, four_bars):
    with pytest.raises(OptionError) as unknown:
        assemble(mechanism, np.zeros((1, 1)), ["knee"])
    assert unknown.value.facts["given"] == "knee"
    assert {"leg1_universal_1", "platform_yaw"} <= {*unknown.value.facts["valid"]}
    with pytest.raises(OptionError) as none:
        assemble(four_bars["3d"], np.zeros((1, 1)), "platform")
    assert none.value.facts["robot"] == four_bars["3d"].name


@pytest.mark.parametrize(
    "values",
    [np.zeros((2, 3)), np.zeros((2, 2, 4)), np.full((1, 4), np.nan), [["far"] * 4]],
)
def test_bad_values_are_refused(mechanism, values):
    with pytest.raises(DataError) as error:
        assemble(mechanism, values)
    assert error.value.facts["argument"] in ("values", "measured coordinates")


def test_a_bad_start_is_refused(mechanism, poses):
    values = read(mechanism, poses, None)
    for start in (np.zeros(3), np.full(13, np.nan)):
        with pytest.raises(DataError) as error:
            assemble(mechanism, values, start=start)
        assert error.value.facts["argument"] == "start"


@pytest.mark.parametrize("tolerance", [-1e-9, np.inf, np.nan])
def test_absurd_tolerances_are_refused(tolerance):
    with pytest.raises(OptionError):
        AssemblyOptions(tolerance=tolerance)


# Turned this far from the reference, the platform is beyond the type II singularity.
YAW_BEYOND = {"3ups_rpu": 0.6, "5p": 1.4}


def passive_determinant(mechanism, q):
    """Its sign tells apart the branches that meet where the motors lose control."""
    _, passive = partition(mechanism)
    return np.linalg.det(constraint_jacobian(mechanism, q)[:, :, passive])


def strokes_of(mechanism, q):
    return q[:, mechanism.velocity_indices(mechanism.actuated)]


def there_and_back(mechanism, poses, count):
    """Strokes that lead from the reference to a pose and back to the reference."""
    way = (1 - np.cos(np.linspace(0, 2 * np.pi, count))) / 2
    home, far = strokes_of(mechanism, np.stack([mechanism.reference, poses[0]]))
    return home + way[:, None] * (far - home)


@pytest.fixture(scope="module")
def trajectory(mechanism, poses):
    return there_and_back(mechanism, poses, 150)


def test_a_trajectory_there_and_back_ends_where_it_began(mechanism, trajectory):
    q = assemble(mechanism, trajectory, trajectory=True)
    np.testing.assert_allclose(q[-1], mechanism.reference, atol=1e-12)
    np.testing.assert_allclose(q, q[::-1], atol=1e-12)


def test_the_passive_determinant_keeps_its_sign(mechanism, trajectory, poses):
    at_home = passive_determinant(mechanism, mechanism.reference[None])
    along = passive_determinant(mechanism, assemble(mechanism, trajectory, trajectory=True))
    assert (along * at_home > 0).all()
    assert (passive_determinant(mechanism, poses) * at_home > 0).all()


def test_a_trajectory_is_assembled_like_its_samples_alone(mechanism, trajectory):
    np.testing.assert_allclose(
        assemble(mechanism, trajectory, trajectory=True),
        assemble(mechanism, trajectory),
        atol=1e-12,
    )


def test_a_trajectory_goes_on_after_lost_samples(mechanism, trajectory):
    expected, broken = assemble(mechanism, trajectory), trajectory.copy()
    # The whole of the second block is out of reach.
    lost = np.isin(np.arange(len(trajectory)), np.arange(64, 128))
    broken[lost, 0] = 9.0
    outcome = try_assemble(mechanism, broken, trajectory=True)
    np.testing.assert_array_equal(outcome.assembled, ~lost)
    np.testing.assert_allclose(outcome.configurations[~lost], expected[~lost], atol=1e-12)


def test_nothing_is_assembled_beyond_a_singularity(mechanism):
    # Far strokes too, most of them out of reach.
    centre = strokes_of(mechanism, mechanism.reference[None])
    strokes = centre + np.random.default_rng(1).uniform(-0.5, 0.5, size=(300, 4))
    found = try_assemble(mechanism, strokes)
    assert 20 < found.assembled.sum() < 280
    at_home = passive_determinant(mechanism, mechanism.reference[None])
    reached = passive_determinant(mechanism, found.configurations[found.assembled])
    assert (reached * at_home > 0).all()


@pytest.fixture(scope="module")
def sides(mechanism):
    """The reference, and a pose beyond the singularity."""
    home = platform_coordinates(mechanism, mechanism.reference)
    beyond = home + YAW_BEYOND[mechanism.name] * np.eye(4)[3]
    return assemble(mechanism, np.stack([home, beyond]), "platform")


def test_assembly_stays_on_the_side_of_its_start(mechanism, sides):
    signs = np.sign(passive_determinant(mechanism, sides))
    assert signs[0] * signs[1] == -1
    for side, sign in zip(sides, signs, strict=True):
        near = strokes_of(mechanism, side[None]) + 1e-4 * np.eye(4)
        q = assemble(mechanism, near, start=side)
        np.testing.assert_array_equal(np.sign(passive_determinant(mechanism, q)), sign)
        np.testing.assert_allclose(q, np.tile(side, (4, 1)), atol=0.02)


def test_the_same_strokes_close_on_both_sides(mechanism, sides):
    strokes = strokes_of(mechanism, sides[1:])
    here, beyond = (assemble(mechanism, strokes, start=side) for side in sides)
    for q in (here, beyond):
        assert np.abs(constraint_residual(mechanism, q)).max() < 1e-13
    np.testing.assert_allclose(beyond, sides[1:], atol=1e-12)
    assert passive_determinant(mechanism, here) * passive_determinant(mechanism, beyond) < 0


def crank_angles(bar, q):
    return np.arctan2(q[:, 1], q[:, 0])


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_along_two_turns_of_the_crank_no_joint_jumps(four_bars, kind):
    bar = four_bars[kind]
    angles = 1.0 + np.linspace(0, 4 * np.pi, 400)[:, None]
    q = assemble(bar, angles, trajectory=True)
    np.testing.assert_allclose(crank_angles(bar, q), np.angle(np.exp(1j * angles[:, 0])))
    assert np.abs(np.diff(q, axis=0)).max() < 0.2
    np.testing.assert_allclose(q[0], bar.reference, atol=1e-12)
    # The coupler is back where it was: relative to the crank it turned twice, backwards.
    turned = np.zeros(bar.model.nq)
    turned[bar.model.joints[bar.model.getJointId("coupler_joint")].idx_q] = -4 * np.pi
    np.testing.assert_allclose(q[-1], bar.reference + turned, atol=1e-12)


@pytest.mark.parametrize("kind", ["3d", "6d"])
def test_far_angles_of_the_crank_are_reached_as_by_small_steps(four_bars, kind):
    bar = four_bars[kind]
    for direction in (1, -1):
        angles = 1.0 + direction * np.linspace(0, 0.99 * np.pi, 100)[:, None]
        small_steps = assemble(bar, angles, trajectory=True)
        np.testing.assert_allclose(assemble(bar, angles), small_steps, atol=1e-12)


def test_an_endless_joint_is_measured_modulo_turns(four_bars):
    bar, angles = four_bars["3d"], np.array([[0.3], [2.0], [-1.0]])
    turned = angles + 2 * np.pi * np.array([[1], [-2], [5]])
    np.testing.assert_allclose(assemble(bar, turned), assemble(bar, angles), atol=1e-12)


BUNDLED = ("3ups_rpu", "delta", "five_bar")
# Closures with redundant rows, joints without end, a ball that spins, redundant motors, couplings.
OTHERS = ("four-bar 6d", "ball rssr", "redundant five-bar", "rack and pinion", "bennett")
FEW = ("3ups_rpu", "four-bar 6d", "redundant five-bar")
SAMPLES = 30
LONG = 700
ROUND_OFF = 1e-11  # rad or m, of solutions whose Jacobian is regular


@pytest.fixture(scope="module")
def load(load_once, linkage, four_bars):
    def by_name(name):
        if name == "four-bar 6d":
            return four_bars["6d"]
        return load_once(name) if name in BUNDLED else linkage(name)

    return by_name


@pytest.fixture(scope="module", params=(*BUNDLED, *OTHERS))
def robot(request, load):
    return load(request.param)


def smooth(robot, count, rate, reach=0.5, seed=0):
    """Measured values that swing about the reference, towards random closed poses."""
    measured = measured_coordinates(robot)
    home = measured.read(robot.reference[None])
    far = measured.read(random_configurations(robot, 8, seed=3))
    reach *= np.abs(measured.difference(np.repeat(home, 8, axis=0), far)).max(axis=0)
    rng = np.random.default_rng(seed)
    time, values = np.arange(count)[:, None] / rate, np.repeat(home, count, axis=0)
    for _ in range(3):
        speed, phase = rng.uniform(0.5, 4.0, len(reach)), rng.uniform(0, 6, len(reach))
        values += reach / 3 * (np.sin(speed * time + phase) - np.sin(phase))
    return values


def swinging(robot):
    return smooth(robot, SAMPLES, 50.0)


def noisy(robot):
    values = swinging(robot)
    return values + 1e-4 * np.random.default_rng(1).normal(size=values.shape)


def quantised(robot):
    return np.round(swinging(robot) / 1e-4) * 1e-4


def standing(robot):
    return np.repeat(swinging(robot)[::6], 6, axis=0)


def jumping(robot):
    values = swinging(robot)
    values[SAMPLES // 3 :] += 0.3 * (values[SAMPLES // 2] - values[0])
    return values


def coarse(robot):
    return smooth(robot, SAMPLES, 1.0)


def shuffled(robot):
    return swinging(robot)[np.random.default_rng(2).permutation(SAMPLES)]


def far_out(robot):
    """Beyond the reach or singularities of most robots, there and back."""
    return smooth(robot, SAMPLES, 10.0, reach=1.5)


def spiked(robot):
    values = swinging(robot)
    values[[0, 17], 0] += 9.0
    values[22:24, -1] += 9.0
    return values


KINDS = [noisy, jumping, far_out, spiked, swinging, quantised, standing, coarse, shuffled]
FOLLOWED = [
    pytest.param(
        *(name, kind),
        id=f"{name}-{kind.__name__}",
        marks=[] if name in FEW and kind in (jumping, far_out, spiked) else pytest.mark.validate,
    )
    for name in ("3ups_rpu", *OTHERS)
    for kind in (KINDS if name == "3ups_rpu" else (far_out,))
]


def sample_by_sample(robot, values, coordinates=None, start=None):
    """What following the straight line to each sample, from the last one reached, gives."""
    q, parts = robot.reference if start is None else start, []
    for value in values:
        parts.append(try_assemble(robot, value, coordinates, start=q))
        q = parts[-1].configurations[0] if parts[-1].assembled[0] else q
    return Assembly.joined(parts)


def assert_same(robot, one, other):
    """How far a rod has spun in its ball joint depends on the way there, all else does not."""
    np.testing.assert_array_equal(one.assembled, other.assembled)
    found = one.assembled
    spinning = [robot.joint(name.split(".")[0]) for name in robot.unmeasured]
    fixed = np.ones(robot.model.nq, dtype=bool)
    for joint in spinning:
        fixed[joint.idx_q : joint.idx_q + joint.nq] = False
    q = [each.configurations[found][:, fixed] for each in (one, other)]
    np.testing.assert_allclose(*q, rtol=0, atol=ROUND_OFF)
    assert (one.residual[found] < 1e-10).all()
    np.testing.assert_allclose(one.residual[~found], other.residual[~found], rtol=1e-6)


@pytest.mark.parametrize(("name", "kind"), FOLLOWED)
def test_a_trajectory_is_followed_as_if_sample_by_sample(load, name, kind):
    robot = load(name)
    values = kind(robot)
    found = try_assemble(robot, values, trajectory=True)
    assert found.assembled.any()
    assert_same(robot, found, sample_by_sample(robot, values))
    # Parts that start where the last one ended make up the whole.
    q, parts = robot.reference, []
    for part in np.array_split(values, [1, 8, 23]):
        parts.append(try_assemble(robot, part, start=q, trajectory=True))
        reached = parts[-1].configurations[parts[-1].assembled]
        q = reached[-1] if len(reached) else q
    assert_same(robot, Assembly.joined(parts), found)


@pytest.mark.parametrize(
    "sizes", [{"LEAST_WINDOW": 3}, {"WINDOW": 7}, {"WINDOW": 1, "LEAST_WINDOW": 1}], ids=str
)
@pytest.mark.parametrize("name", ["3ups_rpu", "four-bar 6d"])
def test_how_samples_are_thinned_out_and_batched_is_irrelevant(load, name, sizes, monkeypatch):
    robot = load(name)
    values = far_out(robot)
    expected = try_assemble(robot, values, trajectory=True)
    for size, value in sizes.items():
        monkeypatch.setattr(assembly, size, value)
    found = try_assemble(robot, values, trajectory=True)
    assert_same(robot, found, expected)


def test_poses_of_the_platform_are_followed_as_if_one_by_one(knee):
    robot = knee
    values = measured_coordinates(robot, "platform").read(assemble(robot, swinging(robot)))
    for some in (values, values[::10], values[::-1]):
        found = try_assemble(robot, some, "platform", trajectory=True)
        assert found.assembled.all()
        assert_same(robot, found, sample_by_sample(robot, some, "platform"))


def test_measured_joints_have_their_values_and_loops_close_to_round_off(robot):
    measured = measured_coordinates(robot)
    values = smooth(robot, LONG, 500.0, reach=0.3)
    q = assemble(robot, values, trajectory=True)
    off = measured.difference(measured.read(q), values)
    np.testing.assert_allclose(off, 0.0, atol=1e-14)
    assert np.abs(constraint_residual(robot, q)).max() < 1e-13 * max(robot.length, 1.0)


def test_a_smooth_trajectory_takes_few_newton_steps_a_sample(knee, monkeypatch):
    values, counts = smooth(knee, 4000, 500.0, reach=0.2), []
    kind = type(measured_coordinates(knee))
    linearise = kind.linearise

    def counted(self, q, values):
        counts.append(len(q))
        return linearise(self, q, values)

    monkeypatch.setattr(kind, "linearise", counted)
    assemble(knee, values, trajectory=True)
    assert sum(counts) < 4 * 4000


@pytest.mark.parametrize("name", ["five_bar", "3ups_rpu", "delta"])
def test_configurations_of_soft_constraints_are_closed_where_their_motors_are(load_once, name):
    """Loops that are open by some 1e-4 of the robot, as a simulator leaves them."""
    robot, rng = load_once(name), np.random.default_rng(4)
    q = loopid.random_configurations(robot, 40)
    own = robot.velocity_indices(robot.independent)
    steps = 3e-4 * robot.coordinate_scales * rng.normal(size=(40, robot.model.nv))
    steps[:, own] = 0.0
    soft = integrate(robot, q, steps)
    with pytest.raises(DataError, match=r"closed_configurations\(robot, q\) closes it") as said:
        loopid.kinematics.project(robot, soft)
    assert said.value.facts["given"] > said.value.facts["tolerance"]
    with pytest.warns(AccuracyWarning, match=rf"loops of {name} were open by up to .* m, 0\.00"):
        closed = closed_configurations(robot, soft)
    loopid.kinematics.project(robot, closed)
    np.testing.assert_allclose(closed, q, atol=1e-8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # what is closed is not worth a word
        np.testing.assert_allclose(closed_configurations(robot, closed), closed, atol=1e-12)


def test_what_is_open_by_more_is_not_taken_for_a_soft_constraint(load_once):
    robot = load_once("five_bar")
    far = robot.reference + np.array([0, 0.5, 0, 0])
    with pytest.raises(DataError, match=r"sample 0 is open by .* more than a soft") as said:
        closed_configurations(robot, far)
    assert said.value.facts["given"] > said.value.facts["tolerance"]
