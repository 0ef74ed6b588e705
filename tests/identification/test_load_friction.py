"""Friction by the force that a joint carries: found, covered, and told from constant friction."""

from shutil import copy

import numpy as np
import pytest

import loopid
from loopid import JointTerms, load_fit
from loopid.errors import DataError, OptionError
from loopid.export.robot_file import export_robot_file
from loopid.identification.fitting import quiet_fit
from loopid.motion import scaled_bodies
from made_runs import record, wander

FRICTION = "Fc=0.1,Fv=0.05; left_crank_joint: Fl=0.003; passive: Fl=0.02"
DRAWS = 25
SIDES = "left", "right"


@pytest.fixture(scope="module")
def loaded(load_once):
    """A force model with such friction, values of its terms, and two motions."""
    robot = load_once("five_bar")
    terms, values = JointTerms.with_values(robot, FRICTION)
    motions = [wander(robot, seed, 20.0, 20.0, size=(0.5, 0.5), harmonics=8) for seed in (4, 5)]
    return loopid.force_model(robot, "full", terms), values, motions


@pytest.fixture(scope="module")
def truth(loaded):
    model, values, _ = loaded
    return model.base.values(np.concatenate([model.robot.standard_parameters(), values]))


def run_of(loaded, k, noise=0.0, seed=0):
    model, values, motions = loaded
    return record(model.robot, motions[k], (model.joint_terms, values), None, noise, seed)


def test_it_is_found_exactly_without_noise(loaded, truth):
    model = loaded[0]
    assert len(model.joint_columns) == 7  # as many as there are terms: none is folded
    found = quiet_fit(model.samples(run_of(loaded, 0))).values
    np.testing.assert_allclose(found[model.joint_columns], truth[model.joint_columns], rtol=1e-9)


def test_intervals_cover_it(loaded, truth):
    model = loaded[0]
    samples, inside = model.samples(run_of(loaded, 0)), []
    for seed in range(DRAWS):
        error = np.random.default_rng(seed).normal(scale=0.02, size=samples.force.shape)
        intervals = quiet_fit(samples.with_force(samples.force + error)).intervals()
        covered = (intervals[:, 0] <= truth) & (truth <= intervals[:, 1])
        inside.append(covered[model.joint_columns])
    assert 0.92 <= np.mean(inside) <= 0.98


def test_a_saved_fit_predicts_with_the_bodies_that_loaded_the_joints(loaded, truth, tmp_path):
    model = loaded[0]
    path, run = loopid.Fit.of(model, truth).save(tmp_path / "fit.json"), run_of(loaded, 1)
    fit = load_fit(path)
    np.testing.assert_allclose(fit.predict(run).predicted, run.force, atol=1e-9)
    robot = model.robot
    export_robot_file(robot, 1.3 * robot.standard_parameters(), tmp_path / "five_bar.urdf")
    copy(robot.path, tmp_path)
    with pytest.raises(DataError, match=r"differs by .* there \(bodies that load joints count"):
        load_fit(path, robot=tmp_path / "five_bar.yaml")


def test_c_code_refuses_it(loaded):
    pytest.importorskip("casadi")
    from loopid.export import c_source

    with pytest.raises(OptionError, match=r"C code cannot have left_crank_joint\.Fl"):
        c_source(loaded[0])


@pytest.mark.parametrize("draws", [1, pytest.param(6, marks=pytest.mark.validate)])
def test_it_predicts_where_the_bodies_of_the_robot_file_are_off(loaded, draws):
    """Compared with no friction of passive joints, and with a constant one."""
    model, values, motions = loaded
    robot, terms = model.robot, model.joint_terms
    others = [
        loopid.force_model(robot, "full", JointTerms.of(robot, choice), search="qr")
        for choice in ("Fc,Fv", "Fc,Fv; left_crank_joint: Fc; passive: Fc")
    ]
    errors, off = [], []
    for seed in range(draws):
        bodies = scaled_bodies(robot, 0.3, seed=seed)
        fitted, unseen = (
            record(robot, motion, (terms, values), bodies, noise, seed)
            for motion, noise in zip(motions, (0.02, 0.0), strict=True)
        )
        fits = [(each, quiet_fit(each.samples(fitted))) for each in (model, *others)]
        errors.append([np.std(each.samples(unseen).residual(f.values)) for each, f in fits])
        mine = [model.parameters.labels.index(f"{side}_coupler_joint.Fl") for side in SIDES]
        off.append(np.abs(fits[0][1].values[mine] / 0.02 - 1).mean())
    by_load, without, constant = np.mean(errors, axis=0)
    assert without > 40 * by_load
    assert constant > 6 * by_load
    assert np.mean(off) < 0.3
