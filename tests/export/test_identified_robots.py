"""Identify, save, read, export, load again, predict: the same forces."""

import shutil
from functools import cache

import numpy as np
import pytest
from feasible_changes import changed, relative

import loopid
from loopid import JointTerms
from loopid.export.robot_file import export_robot_file
from loopid.identification import consistent_fit, load_fit
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import closed_motion
from loopid.loading.checks import inertia_defects
from loopid.regressors import motion_regressor
from made_runs import modelled, wander

ROUND_TRIP = 1e-9
CASES = [
    ("3ups_rpu", "gravity", ("Fc", "Fv")),
    ("five_bar", "full", ("Ia", "Fc", "Fv")),
]


@cache
def identify(robot, model, kinds):
    """A force model, its fit to noisy forces of another robot than the file's, and a motion."""
    mechanism = loopid.load(robot)
    found = loopid.force_model(mechanism, model, JointTerms(mechanism.actuated, kinds))
    truth = np.concatenate(
        [changed(mechanism, model, seed=1), np.full(len(kinds) * len(mechanism.actuated), 0.5)]
    )
    size = (0.06, 0.04, 0.2, 0.2) if robot == "3ups_rpu" else (0.6, 0.6)
    motion = wander(mechanism, 1, seconds=20.0, size=size)
    recording = modelled(found, motion, found.base.values(truth), noise=1e-6)
    return found, quiet_fit(found.samples(recording), "wls"), motion, recording


@pytest.fixture(params=CASES, ids=lambda case: "-".join(case[:2]))
def identified(request):
    return identify(*request.param)


def loaded_again(mechanism, folder, urdf_folder, standard, parameters):
    shutil.copy(urdf_folder / f"{mechanism.name}.yaml", folder)
    path = folder / f"{mechanism.name}.urdf"
    export_robot_file(mechanism, standard, path, parameters=parameters)
    return loopid.load(folder / f"{mechanism.name}.yaml")


def assert_same_forces(model, again, standard, motion, expected):
    """Bodies of the new file, and the joint terms that no robot file has."""
    bodies = again.standard_parameters(model.model)
    state = motion.configurations, motion.velocities, motion.accelerations
    whole = closed_motion(again, *state)
    W = motion_regressor(again, whole, model.model, joint_terms=model.joint_terms)
    found = W @ np.concatenate([bodies, standard[len(bodies) :]])
    assert relative(found, expected) < ROUND_TRIP


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
def test_robot_files_round_trip(identified, tmp_path, urdf_folder):
    model, result, motion, recording = identified
    found = consistent_fit(model, model.samples(recording), result.noise)
    saved = load_fit(loopid.Fit.of(model, found).save(tmp_path / "parameters.yaml"))
    standard, names = saved.require_bodies(), model.base.parameters
    np.testing.assert_array_equal(standard, found.standard_parameters)
    again = loaded_again(model.robot, tmp_path, urdf_folder, standard, names)
    expected = found.forces(model.regressor(motion))
    assert_same_forces(model, again, standard, motion, expected)
    assert not inertia_defects(again)
