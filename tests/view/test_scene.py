"""What is where at a pose: rods, closures, masses; and robots that move with their loops closed."""

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from loopid.errors import DataError
from loopid.inertia import from_moments, pseudo_inertia
from loopid.kinematics.poses import integrate
from loopid.view import Scene
from loopid.view.masses import body_masses, fitted_masses

ROBOTS = ["3ups_rpu", "delta", "five_bar", "mjcf/cassie.xml"]


@pytest.fixture(scope="module", params=few_of(ROBOTS, *ROBOTS[:3]))
def scene(request, load_once):
    if "/" not in request.param:
        return Scene(load_once(request.param))
    pytest.importorskip("mujoco")
    return Scene(load_once(request.getfixturevalue("shared") / "models" / request.param))


def drags(scene, count, part=0.02):
    """Values of the sliders, one after the other a little way to and fro."""
    rng, pose = np.random.default_rng(1), scene.at(scene.robot.reference)
    for k in range(count):
        each, values = scene.sliders[k % len(scene.sliders)], pose.values.copy()
        step = part * (each.high - each.low) * rng.uniform(-1.0, 1.0)
        index = k % len(values)
        values[index] = np.clip(values[index] + step, each.low, each.high)
        pose, arrived = scene.moved(pose, values)
        yield pose, values, arrived


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_loops_stay_closed_while_a_slider_is_dragged(scene):
    for pose, values, arrived in drags(scene, 30):
        assert pose.residual <= 1e-9
        if arrived:
            np.testing.assert_allclose(pose.values, values, atol=1e-12)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_places_are_pinocchios_and_cut_frames_meet(scene):
    robot = scene.robot
    pose = [pose for pose, _, _ in drags(scene, 8)][-1]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pose.configuration)
    np.testing.assert_allclose(pose.origins, [M.translation for M in data.oMi], atol=1e-12)
    np.testing.assert_allclose(pose.rotations, [M.rotation for M in data.oMi], atol=1e-12)
    met = [closure.kind != "distance" for closure in robot.closures]
    assert any(met)
    apart = np.linalg.norm(pose.closures[:, 0] - pose.closures[:, 1], axis=1)
    assert (apart[met] <= 1e-9).all()
    assert (pose.open_by <= pose.residual).all()
    # An open pose says so at the closure that is open.
    step = np.zeros((1, robot.model.nv))
    step[0, robot.loops[0].columns[-1]] = 0.1 * robot.length
    opened = scene.at(integrate(robot, pose.configuration[None], step)[0])
    assert opened.residual > 1e-3 * robot.length
    assert opened.residual == pytest.approx(opened.open_by.max())


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_rods_are_rigid_but_for_slides_and_reach_every_joint(scene):
    robot = scene.robot
    here, there = scene.at(robot.reference), [pose for pose, _, _ in drags(scene, 12)][-1]
    long = [np.linalg.norm(np.diff(pose.rods, axis=1)[:, 0], axis=1) for pose in (here, there)]
    changed = np.abs(long[0] - long[1]) > 1e-9
    sliding = [name for name in robot.joints if robot.joint(name).shortname()[10] == "P"]
    assert changed.sum() <= len(sliding)
    assert changed.any() == bool(sliding)
    # A joint is marked at its origin, one that slides between there and where it comes from.
    marked = np.abs(here.joints - here.origins[1:]).max(axis=1) > 0
    assert {robot.joints[k] for k in np.flatnonzero(marked)} <= set(sliding)
    middles = here.rods.mean(axis=1)
    assert all((middles == place).all(axis=1).any() for place in here.joints[marked])
    # One can walk along rods from each closure to where its links begin.
    ends = here.rods.reshape(-1, 3)
    for point in here.closures.reshape(-1, 3):
        assert np.linalg.norm(ends - point, axis=1).min() <= 0.02 * robot.length


def test_out_of_reach_a_robot_goes_as_far_as_it_gets(load_once):
    scene = Scene(load_once("five_bar"))
    here = scene.at(scene.robot.reference)
    goal = here.values + np.array([1.5, 0.0])
    there, arrived = scene.moved(here, goal)
    assert not arrived
    assert there.residual <= 1e-9
    left = np.linalg.norm(goal - there.values)
    assert 0.1 < left < 0.9 * np.linalg.norm(goal - here.values)
    back, arrived = scene.moved(there, here.values)
    assert arrived
    np.testing.assert_allclose(back.configuration, here.configuration, atol=1e-9)


def test_modes_are_other_closed_poses_of_the_same_motors(load_once):
    scene = Scene(load_once("3ups_rpu"))
    poses = [scene.at(q) for q in scene.modes()]
    assert len(poses) > 1
    for pose in poses:
        assert pose.residual <= 1e-9
        np.testing.assert_allclose(pose.values, poses[0].values, atol=1e-9)
    assert np.abs(poses[0].closures - poses[1].closures).max() > 0.1


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_an_ellipsoid_has_the_inertia_of_its_body(scene):
    robot, drawn = scene.robot, 0
    for mass in body_masses(robot):
        own = robot.model.inertias[mass.joint].toDynamicParameters()
        np.testing.assert_allclose(mass.centre * mass.mass, own[1:4], atol=1e-12)
        assert np.linalg.det(mass.axes) == pytest.approx(1.0)
        if mass.radii.any():  # a homogeneous ellipsoid's second moments are m r² / 5
            moments = mass.axes * (mass.mass * mass.radii**2 / 5) @ mass.axes.T
            P = from_moments(mass.mass, mass.centre, moments)
            np.testing.assert_allclose(P, pseudo_inertia(own), atol=1e-9 * np.abs(P).max())
            drawn += 1
    assert drawn


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_masses_of_a_fit_are_those_that_it_found(study, knee, tmp_path):
    found = study
    path = found.fit.save(tmp_path / "fit.yaml")
    values = found.fit.standard_parameters
    for k, mass in enumerate(fitted_masses(knee, loopid.load_fit(path))):
        np.testing.assert_allclose(mass.mass, values[4 * k])  # a gravity model has no inertias
        np.testing.assert_allclose(mass.centre * mass.mass, values[4 * k + 1 : 4 * k + 4])
        assert not mass.radii.any()
    model = found.force_model
    values_only = loopid.Fit.of(model, model.prior).save(tmp_path / "v.yaml")
    with pytest.raises(DataError):
        fitted_masses(knee, loopid.load_fit(values_only))
