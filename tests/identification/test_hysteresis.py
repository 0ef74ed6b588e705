"""Friction that builds up after reversals: found where it is, and one law for all its users."""

import ctypes
import shutil
from dataclasses import replace

import numpy as np
import pytest

import loopid
from compiled_c import CompiledRobot
from loopid import JointTerms
from loopid.errors import ModelWarning, OptionError
from loopid.export import c_source
from loopid.export.robot_file import updated_robot_file
from loopid.identification.consistent import error_weights
from loopid.identification.fitting import quiet_fit
from loopid.identification.friction import friction_findings, motor_use, possible_hysteresis
from loopid.identification.friction_curves import friction_curve, hysteresis_ways
from loopid.kinematics import measured_coordinates
from loopid.motion import scaled_bodies
from loopid.regressors.joint_laws import joint_term
from loopid.regressors.maxwell_slip import slip_states
from made_runs import elastic, identify_unjudged, simulated, unchecked, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

RATE, NOISE, SLIP = 200.0, 0.001, 5e-3
TERMS = "Fc,Fv,Fh@0.02,Fh@0.002"


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


def log_of(robot, seed, slip, noise=NOISE):
    """A log of friction of 0.1 N m and 0.05 N m s/rad that builds up over a slip."""
    terms = JointTerms(robot.actuated, ("Fc", "Fv"))
    motion = wander(robot, seed, 20.0, RATE, size=(0.4, 0.4))
    given = terms, np.tile((0.1, 0.05), 2)
    run = simulated(robot, motion, None, standard=scaled_bodies(robot, 0.2), terms=given)
    log = unchecked(run.time, run.position, run.exact_force, robot.actuated)
    log = elastic(log, slip) if slip else log
    error = noise * np.random.default_rng(seed).normal(size=log.force.shape)
    return unchecked(log.time, log.position, log.force + error, log.joints)


@pytest.fixture(scope="module")
def found(robot, once):
    """Of friction that builds up over 2 mrad, and of friction that jumps."""

    def identified():
        model = loopid.force_model(robot, "full")
        return {
            slip: identify_unjudged(model, loopid.prepare(robot, log_of(robot, 2, slip)))
            for slip in (0.0, SLIP)
        }

    return once("hysteresis", identified)


def test_what_an_encoder_does_not_resolve_says_nothing_of_friction(robot):
    model, log = loopid.force_model(robot, "full"), log_of(robot, 2, 10 * SLIP)
    least, slowest = [], []
    for step in (0.0, 0.001, 0.004):
        position = step * np.round(log.position / step) if step else log.position
        run = loopid.prepare(robot, replace(log, position=position))
        data = model.samples(run)
        noise = quiet_fit(data).noise
        kinds = possible_hysteresis(
            model, data, [run], error_weights(data.problem, noise), robot.actuated
        )
        assert set(kinds) == set(robot.actuated)
        least.append(min(joint_term(kind).at for own in kinds.values() for kind in own))
        slowest.append(motor_use(model, data, [run]).slowest.min())
        assert (motor_use(model, data, [run]).slowest >= idle_speeds(robot, run)).all()
        assert least[-1] > 3 * step
        assert slowest[-1] >= 3 * step * run.cutoff * (1 - 1e-9)
        assert run.step_of(robot.actuated[0]) == pytest.approx(step, abs=1e-5)
    assert least[0] < least[1] < least[2]
    assert slowest[0] < slowest[2]


def idle_speeds(robot, run):
    """Of motors that turn back: what the filter mixes then is no curve."""
    speeds = np.array([run.idle_speed(joint) for joint in robot.actuated])
    usual = np.percentile(np.abs(run.motion.velocities), 99, axis=0)
    np.testing.assert_allclose(speeds, 0.05 * usual, rtol=0.1)
    return speeds


def error_on(model, values, run):
    """Parts of the forces that values leave on another motion."""
    left = np.where(run.used, model.samples(run).residual(values), 0.0)
    return np.linalg.norm(left, axis=0) / np.linalg.norm(np.where(run.used, run.force, 0.0), axis=0)


def test_it_is_found_with_its_way_and_predicts_another_motion(robot, found):
    fit = found[SLIP]["consistent"].fit
    ways, said = hysteresis_ways(fit), dict(friction_findings(fit))
    assert tuple(ways) == robot.actuated
    for joint, way in ways.items():
        assert way == pytest.approx(SLIP, rel=0.5)
        assert (
            said[f"friction of {joint} builds up after reversals"] == f"over {1e3 * way:.2g} mrad"
        )
        assert fit[f"{joint}.Fc"].value == pytest.approx(0.1, rel=0.03)
        slowest = fit.rates_of(joint)[0]
        (force,) = friction_curve(fit, joint, np.array([0.01 * slowest])).values
        assert force == pytest.approx(0.1, rel=0.05)
    other = loopid.prepare(robot, log_of(robot, 5, SLIP))
    jumps = np.where(["Fh" in label for label in fit.parameters.labels], 0.0, fit.values)
    model = found[SLIP].force_model
    with_slip, without = (error_on(model, values, other) for values in (fit.values, jumps))
    assert (with_slip < 0.3 * without).all()


def test_friction_that_jumps_has_none(found):
    fit = found[0.0]["consistent"].fit
    assert hysteresis_ways(fit) == {}


def test_elements_are_a_part_of_the_friction_that_takes_energy(found):
    fit = found[SLIP]["consistent"].fit
    for joint in hysteresis_ways(fit):
        own = [each for each in fit.estimates if each.name.startswith(f"{joint}.Fh@")]
        values = np.array([each.value for each in own])
        assert (values >= 0).all()
        assert values.sum() <= fit[f"{joint}.Fc"].value * (1 + 1e-6)


def test_it_is_nothing_in_steady_motion_and_the_law_after_a_reversal(robot):
    law = joint_term("Fh@0.01")
    way = np.concatenate([np.linspace(0, 0.05, 51), np.linspace(0.049, 0, 50)])
    rate = np.gradient(way)
    state = loopid.regressors.JointState(None, rate, None, math=np)
    state = state._replace(slips={0.01: slip_states(way, np.array([0.01]))[:, 0]})
    found = law.signal(state, len(way))
    assert np.abs(found[15:50]).max() < 1e-12
    np.testing.assert_allclose(found[52:70], np.maximum(2 - 0.1 * np.arange(2, 20), 0), atol=1e-9)
    with pytest.raises(OptionError, match="displacement above 0"):
        joint_term("Fh@0")


def moved(robot, model):
    """Values, and forces along a small motion to and fro."""
    values = np.array(model.prior)
    values[model.joint_columns] = np.linspace(0.3, 0.9, len(model.joint_columns))
    motion = wander(robot, 1, 5.0, 40.0, size=(0.05, 0.05))
    return values, motion, model.regressor(motion) @ values


def test_dynamics_have_friction_of_steady_motion(robot):
    model = loopid.force_model(robot, "full", TERMS)
    values, motion, _ = moved(robot, model)
    state = motion.configurations, motion.velocities, motion.accelerations
    expected = model.base.regressor(model.standard_regressor(*state)) @ values
    with pytest.warns(
        ModelWarning, match="friction of left_crank_joint, right_crank_joint, which builds"
    ):
        own = loopid.Dynamics(model, values)
    u = np.array(measured_coordinates(robot).read(motion.configurations), order="C")
    np.testing.assert_allclose(own.inverse(u, *state[1:]), expected, atol=1e-9)
    one = [own.inverse(u[k], *(rates[k] for rates in state[1:])) for k in range(len(u))]
    np.testing.assert_allclose(one, expected, atol=1e-9)


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler called cc")
def test_c_code_has_it_along_its_way(robot, tmp_path):
    pytest.importorskip("casadi")
    smooth = replace(JointTerms.of(robot, TERMS), smoothing=0.01)
    model = loopid.force_model(robot, "full", smooth)
    values, motion, expected = moved(robot, model)
    compiled = CompiledRobot(model, c_source(model), tmp_path, ("-O1",))
    u = np.array(measured_coordinates(robot).read(motion.configurations), order="C")
    assert compiled.call("start", u[0]) == 0
    assert not any(compiled.state.slip)
    force = []
    for k in range(len(u)):
        if k == 80:
            saved = type(compiled.state).from_buffer_copy(compiled.state)
        assert compiled.call("assemble", u[k]) == 0
        force.append(compiled.regressor(motion.velocities[k], motion.accelerations[k]) @ values)
    np.testing.assert_allclose(force, expected, atol=1e-9)
    ctypes.memmove(ctypes.byref(compiled.state), ctypes.byref(saved), ctypes.sizeof(saved))
    assert compiled.call("assemble", u[80]) == 0
    again = compiled.regressor(motion.velocities[80], motion.accelerations[80]) @ values
    np.testing.assert_allclose(again, expected[80], atol=1e-9)


def test_a_urdf_says_that_it_is_left_out(robot):
    model = loopid.force_model(robot, "full", TERMS)
    values = np.append(robot.standard_parameters(), np.tile([1.0, 0.5, 0.6, 0.4], 2))
    with pytest.warns(loopid.errors.ModelWarning, match="left_crank_joint builds up .* left out"):
        updated_robot_file(robot, values, parameters=model.base.parameters)


def test_a_simulated_log_has_it(robot):
    model = loopid.force_model(robot, "full", TERMS)
    values, motion, expected = moved(robot, model)
    terms = model.joint_terms
    labels = [each.label for each in terms.parameters(robot)]
    of_terms = np.array([values[model.parameters.labels.index(label)] for label in labels])
    run = simulated(robot, motion, None, terms=(terms, of_terms))
    np.testing.assert_allclose(run.exact_force, expected, atol=1e-9)
