"""Cables as motors: lengths, forces, powers and ranks are those of MuJoCo's tendons."""

import json

import numpy as np
import pytest

import cable_robots
import loopid
from loopid import JointTerms, Log, random_configurations
from loopid.base_parameters import find_base
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import closed_motion, platform_coordinates, random_motions
from loopid.logs import FilterOptions, Recording
from loopid.logs.preparing import on_independent
from loopid.motion import FourierSeries, joint_motion
from loopid.regressors import motion_regressor, structural_observation
from made_runs import simulated

pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
import mujoco
from mujoco_rank import Oracle, positions, rates

COUNT = 12
AXES = {"x": "x", "y": "y", "z": "z", "roll": "rx", "pitch": "ry", "yaw": "rz"}
RUNS = 12
# Cables, freedoms, base parameters of a body that cannot turn; two links; and one flying.
COUNTS = {"plane": (4, 2, 1, 1), "finger": (3, 2, None, None), "hanging": (8, 6, 10, 4)}


@pytest.fixture(scope="module", params=cable_robots.ROBOTS)
def name(request):
    return request.param


@pytest.fixture(scope="module")
def write(tmp_path_factory):
    def written(text):
        path = tmp_path_factory.mktemp("cables") / "robot.xml"
        path.write_text(text)
        return path

    return written


@pytest.fixture(scope="module")
def robot(name, write):
    return loopid.load(write(cable_robots.ROBOTS[name]))


class Theirs:
    """MuJoCo's model of the same file, put where the robot is."""

    def __init__(self, robot):
        self.robot, self.model = robot, mujoco.MjModel.from_xml_path(str(robot.path))
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self.model)

    def inverse(self, q, v, a):
        """Forces (nv,) that move the tree so."""
        data, (T, turned) = self.data, rates(self.robot, self.model, q)
        data.qpos[:] = positions(self.robot, self.model, q)
        data.qvel[:], data.qacc[:] = T @ v, T @ (a + turned(v))
        mujoco.mj_inverse(self.model, data)
        return data.qfrc_inverse.copy()

    @property
    def arms(self):
        """Rates (tendons, nv) of the lengths per unit velocity, where the robot was put last."""
        columns = []
        for velocity in np.eye(self.model.nv):
            self.data.qvel[:] = velocity
            mujoco.mj_fwdVelocity(self.model, self.data)
            columns.append(self.data.ten_velocity.copy())
        return np.array(columns).T

    def index(self, cables):
        return [self.model.tendon(cable).id for cable in cables]


@pytest.fixture(scope="module")
def states(robot):
    q = random_configurations(robot, COUNT, seed=1)
    return closed_motion(robot, q, *random_motions(robot, COUNT, seed=2))


def test_the_robot_is_what_its_file_says(robot, name):
    cables, freedoms, *_ = COUNTS[name]
    assert (len(robot.actuated), len(robot.independent)) == (cables, freedoms)
    assert len(robot.redundant) == cables - freedoms
    assert not robot.free


def test_lengths_and_their_rates_are_those_of_mujoco(robot, states):
    theirs = Theirs(robot)
    tendons = theirs.index(robot.actuated)
    for q, v, a in zip(states.configurations, states.velocities, states.accelerations, strict=True):
        theirs.inverse(q, v, a)
        own = [robot.joint(cable) for cable in robot.actuated]
        lengths, rates = [q[one.idx_q] for one in own], [v[one.idx_v] for one in own]
        np.testing.assert_allclose(lengths, theirs.data.ten_length[tendons], atol=1e-12)
        np.testing.assert_allclose(rates, theirs.data.ten_velocity[tendons], atol=1e-10)


def assert_forces_agree(robot, states, forces):
    theirs = Theirs(robot)
    chosen = theirs.index(robot.independent)
    for k in range(COUNT):
        q, v, a = (
            part[k] for part in (states.configurations, states.velocities, states.accelerations)
        )
        needed = theirs.inverse(q, v, a)
        assert not theirs.data.nefc
        # The work of the forces of the tendons in any motion is that of the joints'.
        found = theirs.arms[chosen].T @ forces[k]
        np.testing.assert_allclose(found, needed, atol=1e-9 * np.abs(needed).max())


def rates_of(robot, states):
    chosen = robot.velocity_indices(robot.independent)
    return states.configurations, states.velocities[:, chosen], states.accelerations[:, chosen]


def test_forces_pull_as_in_mujoco(robot, states):
    q, rates, accelerations = rates_of(robot, states)
    K = motion_regressor(robot, closed_motion(robot, q, rates, accelerations))
    assert_forces_agree(robot, states, K @ robot.standard_parameters())


def test_springs_dampers_and_armatures_of_cables_are_joint_terms(write):
    laws = 'stiffness="3" springlength="0.2" damping="0.4" armature="0.05"'
    robot = loopid.load(write(cable_robots.finger(laws)))
    assert not robot.left_out[:-1]  # but for a gear
    model = loopid.force_model(robot, "full", "file")
    q = random_configurations(robot, COUNT, seed=1)
    states = closed_motion(robot, q, *random_motions(robot, COUNT, seed=2))
    forces = model.standard_regressor(*rates_of(robot, states)) @ model.standard_prior
    assert_forces_agree(robot, states, forces)
    bodies = len(robot.parameters())
    assert np.abs(model.standard_prior[bodies:]).max() > 0.01


@pytest.mark.parametrize("kind", ["full", "gravity"])
def test_ranks_are_those_of_mujoco(robot, kind, name):
    q = random_configurations(robot, 40, seed=3)
    rank, gap = Oracle.of(robot).rank(q, kind)
    assert gap > 1e3
    found = find_base(structural_observation(robot, kind))
    assert len(found) == rank
    assert COUNTS[name][2 + (kind == "gravity")] in (rank, None)
    # Also by what the tendons feel: those that are independent pull in all directions.
    theirs = Theirs(robot)
    theirs.inverse(q[0], np.zeros(robot.model.nv), np.zeros(robot.model.nv))
    assert np.linalg.matrix_rank(theirs.arms) == len(robot.independent)


# Joints, or coordinates of the platform, that are moved.
MOVED = {"plane": ("x", "z"), "finger": ("knuckle", "end"), "hanging": tuple(AXES)}
PLATFORM = json.dumps({"mjcf": "robot.xml", "platform": {"frame": "platform", "coordinates": AXES}})


@pytest.fixture(scope="module")
def run(robot, name):
    """A motion, and what winches measure with friction in them."""
    names, size = MOVED[name], 0.4
    middle = np.zeros(len(names))
    if name == "hanging":
        robot.path.with_suffix(".yaml").write_text(PLATFORM)
        robot, size = loopid.load(robot.path.with_suffix(".yaml")), 0.1
        middle = platform_coordinates(robot, robot.reference[None])[0]
    sine, cosine = np.random.default_rng(3).uniform(-size / 2, size / 2, (2, len(names), 3))
    series = FourierSeries(names, 0.1, middle, sine, cosine)
    motion = joint_motion(robot, series.motion(10.0, 30.0))
    kinds = JointTerms(robot.actuated, ("Fc", "Fv"))
    values = np.tile([2.0, 5.0], len(robot.actuated))
    return motion, kinds, values


def test_the_power_of_all_cables_is_that_of_the_robot(robot, run):
    motion, kinds, values = run
    measured = simulated(robot, motion, None, terms=(kinds, values))
    log = Log.from_arrays(motion.time, measured.position, measured.force, robot.actuated)
    recording = loopid.prepare(robot, log, filter=FilterOptions(cutoff=None))
    rates = np.gradient(measured.position, motion.time, axis=0)
    rows = np.isin(motion.time, recording.motion.time)
    power = (measured.force * rates).sum(axis=1)[rows]
    found = (recording.force * recording.motion.velocities).sum(axis=1)
    np.testing.assert_allclose(found[5:-5], power[5:-5], atol=5e-3 * np.abs(power).max())


def test_estimates_from_all_cables_are_unbiased(robot, run):
    motion, kinds, values = run
    model = loopid.force_model(robot, "full", kinds)
    truth = model.base.values(np.append(robot.standard_parameters(), values))
    clean = simulated(robot, motion, None, terms=(kinds, values))
    every = np.ones(clean.force.shape, dtype=bool)
    force, _ = on_independent(robot, motion, clean.force, every)
    samples = model.samples(Recording.of_motion(motion, force, robot.independent))
    off, generator = [], np.random.default_rng(0)
    whole = quiet_fit(samples).values
    np.testing.assert_allclose(whole, truth, atol=1e-6 * np.abs(truth).max())
    for _ in range(RUNS):
        noise = generator.normal(scale=0.5, size=clean.force.shape)
        error, _ = on_independent(robot, motion, noise, every)
        found = quiet_fit(samples.with_force(samples.force + error))
        off.append((found.values - truth) / found.standard_errors)
    off = np.array(off)
    assert np.abs(off.mean(axis=0)).max() < 4 / np.sqrt(RUNS)
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
