"""A trajectory is assembled as if sample by sample, however it is cut and thinned out."""

import numpy as np
import pytest

from loopid import assemble, random_configurations
from loopid.kinematics import Assembly, constraint_residual, measured_coordinates, try_assemble
from loopid.kinematics import assembly as assembly_module

BUNDLED = ("3ups_rpu", "6ups", "delta", "3rrr", "five_bar", "four_bar")
# Closures with redundant rows, joints without end, a ball that spins, redundant motors, couplings.
OTHERS = ("four-bar 6d", "ball rssr", "redundant five-bar", "rack and pinion", "bennett")
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


KINDS = [swinging, noisy, quantised, standing, jumping, coarse, shuffled, far_out, spiked]


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
    spinning = [robot.joint(name.split(".")[0]) for name in robot.held]
    fixed = np.ones(robot.model.nq, dtype=bool)
    for joint in spinning:
        fixed[joint.idx_q : joint.idx_q + joint.nq] = False
    q = [each.configurations[found][:, fixed] for each in (one, other)]
    np.testing.assert_allclose(*q, rtol=0, atol=ROUND_OFF)
    assert (one.residual[found] < 1e-10).all()
    np.testing.assert_allclose(one.residual[~found], other.residual[~found], rtol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_trajectory_is_followed_as_if_sample_by_sample(robot, kind):
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
    "sizes", [{"STRIDE": 1}, {"STRIDE": 5, "LEAST_WINDOW": 3}, {"BLOCK": 7}], ids=str
)
@pytest.mark.parametrize("kind", [noisy, far_out])
@pytest.mark.parametrize("name", ["3ups_rpu", "five_bar", "four-bar 6d"])
def test_how_samples_are_thinned_out_and_batched_is_irrelevant(
    load, name, kind, sizes, monkeypatch
):
    robot = load(name)
    values = kind(robot)
    expected = try_assemble(robot, values, trajectory=True)
    for name, size in sizes.items():
        monkeypatch.setattr(assembly_module, name, size)
    assert_same(robot, try_assemble(robot, values, trajectory=True), expected)


@pytest.mark.parametrize("name", ["3ups_rpu", "5p"])
def test_poses_of_the_platform_are_followed_as_if_one_by_one(load_once, name):
    robot = load_once(name)
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


def test_a_smooth_trajectory_takes_hardly_more_than_one_newton_step_a_sample(knee, monkeypatch):
    values, counts = smooth(knee, 4000, 500.0, reach=0.2), []
    kind = type(measured_coordinates(knee))
    linearise = kind.linearise

    def counted(self, q, values):
        counts.append(len(q))
        return linearise(self, q, values)

    monkeypatch.setattr(kind, "linearise", counted)
    assemble(knee, values, trajectory=True)
    assert sum(counts) < 2.2 * 4000
