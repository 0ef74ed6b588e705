"""Identify, export, load again, predict: the same forces; in robot files and in base parameters."""

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from feasible_changes import changed, relative

from loopid import JointTerms, find_force_model, load_mechanism
from loopid.consistency import consistent_fit
from loopid.errors import DataError, FeasibilityError, MissingFileError
from loopid.export import (
    BaseValues,
    SavedFit,
    export_robot_file,
    force_model_of,
    read_fit,
    standard_parameters_of,
)
from loopid.identification import quiet_fit
from loopid.kinematics import closed_motion
from loopid.regressors import motion_regressor
from loopid.robot import inertia_defects
from made_runs import ARM, modelled, wander

ROUND_TRIP = 1e-9
CASES = [
    ("3ups_rpu", "gravity", ("Fc", "Fv")),
    ("3ups_rpu", "full", ("Fc", "Fv")),
    ("five_bar", "full", ("Ia", "Fc", "Fv")),
]


@cache
def identify(robot, model, kinds):
    """A force model, its fit to noisy forces of another robot than the file's, and a motion."""
    mechanism = load_mechanism(robot)
    found = find_force_model(mechanism, model, JointTerms(mechanism.actuated, kinds))
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


@pytest.fixture
def five_bar():
    return identify(*CASES[-1])


def loaded_again(mechanism, folder, urdf_folder, standard, parameters):
    shutil.copy(urdf_folder / f"{mechanism.name}.yaml", folder)
    path = folder / f"{mechanism.name}.urdf"
    export_robot_file(mechanism, standard, path, parameters=parameters)
    return load_mechanism(folder / f"{mechanism.name}.yaml")


def assert_same_forces(model, again, standard, motion, expected):
    """Bodies of the new file, and the joint terms that no robot file has."""
    bodies = again.standard_parameters(model.model)
    state = motion.configurations, motion.velocities, motion.accelerations
    whole = closed_motion(again, *state)
    W = motion_regressor(again, whole, model.model, model.joint_terms)
    found = W @ np.concatenate([bodies, standard[len(bodies) :]])
    assert relative(found, expected) < ROUND_TRIP


@pytest.mark.filterwarnings("ignore::loopid.errors.InertiaWarning")
def test_robot_files_round_trip(identified, tmp_path, urdf_folder):
    model, result, motion, _ = identified
    result.save(tmp_path / "parameters.yaml")
    saved = read_fit(tmp_path / "parameters.yaml")
    standard = standard_parameters_of(saved, model)
    names = model.base.parameters
    again = loaded_again(model.mechanism, tmp_path, urdf_folder, standard, names)
    expected = result.predict(model.regressor(motion))
    assert_same_forces(model, again, standard, motion, expected)
    assert not inertia_defects(again)


@pytest.mark.filterwarnings("ignore::loopid.errors.InertiaWarning")
def test_consistent_fits_round_trip(identified, tmp_path, urdf_folder):
    model, result, motion, recording = identified
    prior = model.mechanism.standard_parameters(model.model)
    prior = np.concatenate([prior, np.zeros(len(model.base.parameters) - len(prior))])
    problem = model.samples(recording).problem
    found = consistent_fit(problem, result, model.base, prior)
    found.save(tmp_path / "consistent.yaml")
    saved = read_fit(tmp_path / "consistent.yaml")
    standard = standard_parameters_of(saved, model)
    np.testing.assert_array_equal(standard, found.standard_parameters)
    again = loaded_again(model.mechanism, tmp_path, urdf_folder, standard, found.parameters)
    expected = model.regressor(motion) @ found.values
    assert_same_forces(model, again, standard, motion, expected)


def test_saved_fits_find_their_force_model(five_bar, tmp_path):
    model, result, _, _ = five_bar
    result.save(tmp_path / "parameters.json")
    BaseValues.of(model, result.values, result.covariance).save(tmp_path / "base.npz")
    BaseValues.of(model, result.values, result.covariance).save(tmp_path / "base.yaml")
    for name in ("parameters.json", "base.npz", "base.yaml"):
        saved = read_fit(tmp_path / name)
        np.testing.assert_array_equal(saved.values, result.values)
        np.testing.assert_array_equal(saved.covariance, result.covariance)
        found = force_model_of(saved, model.mechanism)
        assert found.model == model.model
        assert found.parameters == model.parameters


def test_fits_of_other_robots_are_refused_by_name(five_bar, tmp_path):
    model, result, _, _ = five_bar
    result.save(tmp_path / "parameters.yaml")
    saved = read_fit(tmp_path / "parameters.yaml")
    with pytest.raises(DataError, match=r"not the parameters of .*four_bar.yaml: row \w+"):
        force_model_of(saved, load_mechanism("four_bar"))
    shifted = replace(saved, parameters=saved.parameters.select(range(1, len(saved.values))))
    with pytest.raises(DataError, match=r"not the parameters of .*: parameter"):
        force_model_of(shifted, model.mechanism)


def test_files_that_are_no_fits_are_refused(tmp_path):
    (tmp_path / "other.yaml").write_text("format: something else\n")
    with pytest.raises(DataError, match="its format is none of 'loopid fit 1'"):
        read_fit(tmp_path / "other.yaml")
    for name in ("none.yaml", "none.npz"):
        with pytest.raises(MissingFileError, match=name):
            read_fit(tmp_path / name)


def test_impossible_base_parameters_are_refused(load_once):
    mechanism = load_once("five_bar")
    model = find_force_model(mechanism, "full")
    values = model.prior.copy()
    values[model.parameters.labels.index("left_coupler.Izz")] = -1.0
    saved = SavedFit(
        Path("fit"), model.parameters, mechanism.independent, values, None, "full", None
    )
    with pytest.raises(FeasibilityError, match="left_coupler"):
        standard_parameters_of(saved, model)


def test_fits_of_other_lengths_are_refused(tmp_path):
    lengths = (0.4, 0.5)
    for length in lengths:
        text = ARM.replace('xyz="0 0 0.4"', f'xyz="0 0 {length}"')
        (tmp_path / f"{length}.urdf").write_text(text)
    one, other = (load_mechanism(tmp_path / f"{length}.urdf") for length in lengths)
    model = find_force_model(one, "gravity")
    saved = read_fit(BaseValues.of(model, model.prior).save(tmp_path / "base.yaml"))
    assert force_model_of(saved, one).base.names == model.base.names
    with pytest.raises(DataError, match=r"0\.5\.urdf: .* stands for another combination"):
        force_model_of(saved, other)
