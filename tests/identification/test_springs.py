"""Springs in logs: they are found, intervals cover them, and they are rejected where none is."""

import numpy as np
import pytest

import loopid
from loopid import JointTerms
from loopid.errors import DataError
from loopid.identification.fitting import quiet_fit
from loopid.motion import Motion, joint_motion
from made_runs import ARM, modelled, wander

# Linear at a motor, polynomial at the other one, piecewise linear at a passive joint.
SPRINGS = (
    "Fc=0.1,Fv=0.05; left_crank_joint: Ks=0.8,Fo=-1.2; right_crank_joint: Ks3=0.3,Ks2=-0.4,Ks=0.5;"
    "left_coupler_joint: Ks=0.4,Ks@-1.4=0.7,Fo=0.2"
)
DRAWS = 25


@pytest.fixture(scope="module")
def sprung(load_once):
    """A force model with springs, its true values, and a motion that excites all of it."""
    robot = load_once("five_bar")
    terms, values = JointTerms.with_values(robot, SPRINGS)
    model = loopid.force_model(robot, "full", terms)
    truth = model.base.values(np.concatenate([robot.standard_parameters(), values]))
    return model, truth, wander(robot, 4, 20.0, 20.0, size=(0.5, 0.5), harmonics=8)


def test_springs_are_found_exactly_without_noise(sprung):
    model, truth, motion = sprung
    samples = model.samples(modelled(model, motion, truth, noise=0.0))
    found = quiet_fit(samples).values
    assert len(model.joint_columns) == 13  # as many as there are terms: none is folded
    np.testing.assert_allclose(found, truth, rtol=1e-6, atol=1e-8)


def test_intervals_of_springs_cover_them(sprung):
    model, truth, motion = sprung
    samples = model.samples(modelled(model, motion, truth, noise=0.0))
    inside = []
    for seed in range(DRAWS):
        error = np.random.default_rng(seed).normal(scale=0.02, size=samples.force.shape)
        intervals = quiet_fit(samples.with_force(samples.force + error)).intervals()
        covered = (intervals[:, 0] <= truth) & (truth <= intervals[:, 1])
        inside.append(covered[model.joint_columns])
    assert 0.92 <= np.mean(inside) <= 0.98


@pytest.mark.parametrize(
    ("kind", "about"), [("continuous", 0.0), ("continuous", 3.0), ("revolute", 3.0)]
)
def test_springs_of_joints_that_count_no_turns_are_refused_past_the_end(tmp_path, kind, about):
    (tmp_path / "arm.urdf").write_text(ARM.replace('type="revolute"', f'type="{kind}"'))
    robot = loopid.load(tmp_path / "arm.urdf")
    time = np.arange(0, 5, 0.05)
    way = np.column_stack([about + 0.5 * np.sin(time), np.cos(time)])
    rates = np.gradient(way, time, axis=0), np.zeros_like(way)
    motion = joint_motion(robot, Motion(robot.measured, time, way, *rates))
    model = loopid.force_model(robot, "gravity", "Fv; shoulder: Ks")
    run = modelled(model, motion, model.prior, noise=0.0)
    if kind == "continuous" and about:
        with pytest.raises(
            DataError, match=r"shoulder turns past ±π at 0.30 s, where its Ks jumps"
        ):
            model.samples(run)
    else:
        assert len(model.samples(run).force) == len(time)
