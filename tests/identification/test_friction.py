"""Friction that data ask for: a curve of each joint, its asymmetry, and what grows with load."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import FilterOptions, JointTerms, load_fit, read_log
from loopid.errors import DataError, OptionError
from loopid.identification import FitSamples, friction_curve
from loopid.identification.consistent import error_weights
from loopid.identification.fitting import quiet_fit
from loopid.identification.friction import (
    curve_kinds,
    curve_rates,
    friction_at_rest,
    friction_findings,
    moving_samples,
)
from loopid.identification.friction_curves import friction_numbers
from loopid.identification.joint_priors import dissipation, joint_parameters
from loopid.identification.prediction import prediction_reach
from loopid.identification.ripple import ripple_columns
from loopid.logs import Recording
from loopid.motion import Motion, Noise, joint_motion, scaled_bodies
from loopid.regressors.joint_laws import JointState, grouped, joint_term
from made_runs import identify_unjudged, logged, quietly, record, simulated, unchecked, wander
from smooth_data import runs

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

LINE, LINE_VALUES = "Fc=0.1,Fv=0.05", {"Fc": 0.1, "Fv": 0.05}
LEFT = "left_crank_joint"


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


@pytest.fixture(scope="module")
def motion(robot):
    return wander(robot, 4, 20.0, 50.0, size=(0.5, 0.5), harmonics=5)


@pytest.fixture(scope="module")
def model(robot):
    return loopid.force_model(robot, "full")


def run(robot, motion, values=LINE, law=None, seed=0, noise=0.01):
    """A recording of a robot whose bodies are 20 % off, with a further law of the rates (N, 2)."""
    terms = JointTerms.with_values(robot, values)
    plain = record(robot, motion, terms, scaled_bodies(robot, 0.2), noise, seed)
    more = 0.0 if law is None else law(motion.velocities)
    return Recording.of_motion(motion, plain.force + more, robot.actuated)


@pytest.fixture(scope="module")
def identified(robot, model, motion, once):
    """What such a recording identifies, computed once."""

    def identify_once(law=None, seed=0):
        name = f"friction {law and law.__qualname__} {seed}"
        recording = run(robot, motion, law=law, seed=seed)
        return once(name, lambda: identify_unjudged(model, recording))

    return identify_once


def found_groups(found):
    """Groups of joint terms by joint."""
    kinds = [p for p in found.force_model.parameters if grouped(p.kind)]
    return {(p.link, joint_term(p.kind).prior.name) for p in kinds}


# The law.


def test_points_of_a_curve_are_linear_between_rates_that_double():
    rates = curve_rates(0.011, 0.77)
    assert rates[-1] == 0.77
    np.testing.assert_allclose(rates[1:] / rates[:-1], 2.0)
    assert 0.011 <= rates[0] < 0.022
    kinds = curve_kinds(0.011, 0.77)
    odd = [kind for kind in kinds if kind.startswith("Fk")]
    even = [kind for kind in kinds if kind.startswith("Fa")]
    v = np.geomspace(1e-4, 10.0, 301)
    c, d = np.random.default_rng(0).normal(size=(2, len(odd)))
    for sign in (1.0, -1.0):
        state = JointState(None, sign * v, None, math=np)
        found = sum(
            x * joint_term(kind).signal(state, len(v)) for x, kind in zip(c, odd, strict=True)
        )
        at = np.append(rates, 10.0)
        expected = np.interp(v, at, [*c, 0.0, 0.0])
        np.testing.assert_allclose(found, sign * expected, atol=1e-12)
        found = sum(
            x * joint_term(kind).signal(state, len(v)) for x, kind in zip(d, even, strict=True)
        )
        expected = np.interp(v, at, [0.0, *d, d[-1]])
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_single_rate_has_no_curve():
    assert curve_kinds(0.5, 0.6) == ()


def test_limits_are_those_of_friction_that_dissipates(robot, model):
    """F at any rate is a positive combination of the limits, so that they hold everywhere."""
    kinds = {LEFT: curve_kinds(0.01, 0.5)}
    terms = joint_parameters(model.with_columns(kinds))
    A = dissipation(terms)
    generator = np.random.default_rng(1)
    rates = np.concatenate([np.geomspace(1e-12, 5.0, 400), curve_rates(0.01, 0.5)])
    v = np.concatenate([rates, -rates])
    state = JointState(None, v, None, math=np)
    friction = [joint_term(term.kind).friction for term in terms]
    own = [j for j, term in enumerate(terms) if term.link == LEFT and friction[j]]
    laws = np.stack([joint_term(terms[j].kind).signal(state, len(v)) for j in own], axis=1)
    touched = 0
    for _ in range(200):
        f = np.zeros(len(terms))
        f[own] = 0.5 * generator.normal(size=len(own))
        f[[j for j in own if terms[j].kind in ("Fc", "Fv")]] = 1.0, 0.5
        held = bool((A @ f >= 0).all())
        assert held == bool((np.sign(v) * (laws @ f[own]) >= -1e-9).all())
        touched += not held
    assert 20 < touched < 180


# What is found.


def stribeck(v):
    return 0.05 * np.exp(-np.abs(v) / 0.1) * np.sign(v)


def test_a_curve_is_found_where_it_is_and_nowhere_else(robot, identified):
    def left(v):
        return stribeck(v) * [1.0, 0.0]

    for law, joints in ((None, set()), (left, {LEFT}), (stribeck, {*robot.actuated})):
        found = identified(law)
        assert found_groups(found) == {(joint, "friction curve") for joint in joints}


@runs(1, 50)
def test_bands_hold_the_true_curve(robot, identified, runs):
    covered, rates = [], np.geomspace(0.0025, 0.5, 40)
    for seed in range(runs):
        found = identified(stribeck, seed)
        for joint in robot.actuated:
            for v in (rates, -rates):
                curve = friction_curve(found.fit, joint, v)
                true = 0.1 * np.sign(v) + 0.05 * v + stribeck(v)
                covered.append((curve.band[:, 0] <= true) & (true <= curve.band[:, 1]))
                assert (np.sign(v) * curve.values >= -1e-12).all()
    assert np.mean(covered) >= 0.9


@runs(1, 10)
def test_no_shape_is_invented(robot, motion, identified, runs):
    curves, line = [], loopid.force_model(robot, "full", "Fc,Fv,Fo,Ia")
    for seed in range(runs):
        found = identified(seed=seed)
        plain = quiet_fit(line.samples(run(robot, motion, seed=seed)))
        rates = np.geomspace(0.005, 0.5, 20)
        for joint in robot.actuated:
            one, other = (friction_curve(fit, joint, rates) for fit in (found.fit, plain))
            inside = (one.band[:, 0] <= other.values) & (other.values <= one.band[:, 1])
            curves.append(inside.all())
    assert np.mean(curves) >= 0.9


def test_an_asymmetry_is_found(identified):
    """Viscous friction by direction; a constant difference is an offset."""

    def law(v):
        return 0.1 * np.abs(v) * [1.0, 0.0]

    found = identified(law)
    assert (LEFT, "friction asymmetry") in found_groups(found)
    v = np.array([0.1, 0.3])
    forward, backward = (friction_curve(found.fit, LEFT, s * v).values for s in (1, -1))
    np.testing.assert_allclose(forward + backward, 0.2 * v, atol=0.012)


def test_below_the_slowest_rate_it_stays_and_above_the_fastest_it_is_a_line(identified):
    found = identified(stribeck)
    slowest, fastest = found.fit.use.of(LEFT)
    names = (p for p in found.fit.parameters if p.link == LEFT and p.kind.startswith("Fk0"))
    (first,) = (joint_term(p.kind).at for p in names)
    assert slowest <= first < 2 * slowest
    below = np.geomspace(first / 1000, first, 5)
    curve = friction_curve(found.fit, LEFT, below)
    left = curve.values - found.fit[f"{LEFT}.Fv"].value * below
    np.testing.assert_allclose(left, left[0], rtol=1e-9)
    widths = np.ptp(curve.band, axis=1)
    assert (np.diff(widths) < 0).all()
    above = 2.5 * fastest * np.arange(1, 5)
    curve = friction_curve(found.fit, LEFT, above)
    line = found.fit[f"{LEFT}.Fc"].value + found.fit[f"{LEFT}.Fv"].value * above
    np.testing.assert_allclose(curve.values, line, rtol=1e-9)
    assert (np.diff(np.ptp(curve.band, axis=1)) > 0).all()


def test_bands_hold_friction_that_rises_below_the_rates_of_the_log(robot, motion, identified):
    fit = identified().fit
    velocities, accelerations = motion.velocities / 500, motion.accelerations / 250000
    slower = replace(motion, velocities=velocities, accelerations=accelerations)

    def higher(v):
        return 0.04 * np.sign(v)

    found = fit.predict(run(robot, slower, law=higher, noise=1e-4))
    below = (np.abs(velocities) > 1e-5) & (np.abs(velocities) < fit.use.slowest / 4)
    assert below.mean() > 0.3
    assert (np.abs(found.residual) <= found.reach)[below].mean() > 0.95
    assert (found.reach[below] > 2 * 1.96 * fit.unseen_rms.max()).mean() > 0.9
    same = run(robot, motion)
    known = np.abs(motion.velocities) > fit.use.slowest
    plain = prediction_reach(
        fit.require_model().samples(same).regressor, fit.covariance, fit.unseen_rms
    )
    np.testing.assert_allclose(fit.predict(same).reach[known], plain[known])


def test_load_friction_is_found_and_predicted(robot, model, motion, tmp_path):
    """A link loads its gear and the rotor beside it does not, though both turn alike."""
    values = f"{LINE},Ia=0.1; {LEFT}: Ft=0.08"
    found = identify_unjudged(model, run(robot, motion, values, seed=1))
    assert found_groups(found) == {(LEFT, "load friction")}
    low, high = found.fit[f"{LEFT}.Ft"].interval
    assert low <= 0.08 <= high
    assert high - low < 0.003
    assert friction_numbers(found.fit)[LEFT]["Ft"].value == found.fit[f"{LEFT}.Ft"].value
    assert friction_findings(found.fit) == [
        (f"friction of {LEFT} grows with load", f"{LEFT} (0.08 of it)")
    ]
    other = wander(robot, 9, 100.0, 10.0, size=(0.4, 0.4), harmonics=3)
    terms = JointTerms.with_values(robot, values)
    exact = simulated(robot, other, Noise(), 0, scaled_bodies(robot, 0.2), terms)
    unseen = Recording.of_motion(other, exact.force, robot.actuated)
    saved = load_fit(found.fit.save(tmp_path / "fit.json"))
    one, two = (fit.predict(unseen) for fit in (found.fit, saved))
    np.testing.assert_allclose(one.predicted, two.predicted, rtol=1e-9, atol=1e-12)
    assert (one.moving.residual_rms < 0.01).all()


def test_gears_that_lose_no_force_have_no_load_friction(identified):
    assert not any(p.kind == "Ft" for p in identified().fit.parameters)


def test_logs_with_filtered_steps_are_asked_too(robot, model, tmp_path):
    motion = wander(robot, 4, 20.0, 100.0, size=(0.5, 0.5), harmonics=5)
    terms = JointTerms.with_values(robot, f"{LINE},Fs~0.1=0.03")
    text = logged(robot, motion, terms, 0.02, 0, scaled_bodies(robot, 0.2))
    (tmp_path / "run.csv").write_text(text)
    recording = quietly(loopid.prepare, robot, quietly(read_log, tmp_path / "run.csv", robot))
    assert recording.history is not None
    found = identify_unjudged(model, recording)
    assert {joint for joint, _ in found_groups(found)} == {*robot.actuated}


@pytest.mark.parametrize("number", [None, 200.0])
def test_ripple_that_the_filter_leaves_at_low_speed_is_no_friction(robot, model, number):
    """Teeth or poles: at top speed it waves far above the band."""
    motion = wander(robot, 4, 12.0, 100.0, size=(0.5, 0.5))
    made = simulated(robot, motion, None, 0, None, JointTerms.with_values(robot, LINE))
    force = made.force + np.random.default_rng(0).normal(size=made.force.shape) * 0.01
    if number is not None:
        force[:, 0] += 0.05 * np.sin(number * made.position[:, 0] + 1.0)
    log = unchecked(made.time, made.position, force, robot.actuated)
    recording = quietly(loopid.prepare, robot, log, filter=FilterOptions(cutoff=8.0))
    assert (number or 200.0) * np.abs(motion.velocities[:, 0]).max() > 2 * np.pi * 1.5 * 8.0
    data = model.samples(recording)
    weights = error_weights(data.problem, quiet_fit(data).noise)
    ripple, said = ripple_columns(model, data, [recording], weights)
    assert ripple.any(axis=(0, 2)).tolist() == [number is not None, False]
    assert (said is None) == (number is None)
    if number is not None:
        assert said.motors == (LEFT,)
        np.testing.assert_allclose(said.number, number, rtol=0.01)
        np.testing.assert_allclose(said.size, 0.05 / np.sqrt(2), rtol=0.1)
        phase = number * made.position[:, :1] + [0.0, np.pi / 2]
        wave, own = recording.lowpassed(np.sin(phase))[data.used[:, 0]], ripple[data.used[:, 0], 0]
        x, *_ = np.linalg.lstsq(own, wave, rcond=None)
        assert np.linalg.norm(own @ x - wave) < 0.1 * np.linalg.norm(wave)
        found = identify_unjudged(model, recording)
        assert not found_groups(found)
        title = f"force of {LEFT} ripples over position"
        (finding,) = [each for each in found.findings if each.title == title]
        assert f"{said.number[0]:.3g} times a turn" in finding.why


# Reading it off.


def test_a_curve_is_the_sum_of_its_terms(robot, motion):
    model = loopid.force_model(robot, "full", f"Fc,Fv,Fs~0.1,Fo,Ia; {LEFT}: Fc~0.05")
    fit = quiet_fit(model.samples(run(robot, motion, law=stribeck)))
    rates = np.array([-0.4, -0.05, 0.05, 0.4])
    curve = friction_curve(fit, LEFT, rates)
    names = ("Fc", "Fv", "Fs~0.1", "Fc~0.05")
    laws = np.sign(rates), rates, np.exp(-((rates / 0.1) ** 2)) * np.sign(rates)
    laws = np.stack([*laws, np.tanh(rates / 0.05)])
    values = np.array([fit[f"{LEFT}.{name}"].value for name in names])
    np.testing.assert_allclose(curve.values, values @ laws, rtol=1e-12)
    columns = [fit.parameters.labels.index(f"{LEFT}.{name}") for name in names]
    spread = fit.covariance[np.ix_(columns, columns)]
    variance = np.einsum("ik,ij,jk->k", laws, spread, laws)
    half = np.ptp(curve.band, axis=1) / 2
    np.testing.assert_allclose(half, 1.96 * np.sqrt(variance), rtol=0.02)
    np.testing.assert_allclose(curve.band.mean(axis=1), curve.values, rtol=1e-12)


def test_curves_of_joints_without_friction_are_refused(robot, motion):
    model = loopid.force_model(robot, "full", f"none; {LEFT}: Fc; right_crank_joint: Fo")
    fit = quiet_fit(model.samples(run(robot, motion)))
    for joint in ("right_crank_joint", "elbow"):
        with pytest.raises(OptionError) as refused:
            friction_curve(fit, joint, np.zeros(3))
        assert refused.value.facts["valid"] == (LEFT,)
    with pytest.raises(DataError):
        friction_curve(fit, LEFT, np.zeros((2, 2)))


def test_widened_samples_are_those_of_the_wider_model(load_once):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full")
    logged = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot, rows=(1, 800)))
    known = Recording.of_motion(logged.motion, logged.force, logged.actuators)  # unfiltered
    wide = model.with_columns({"left_crank_joint": ("Fk0~0.5", "Fk~1", "Fs~0.2")})
    for run in (logged, known):
        found, whole = wide.widened(model.samples(run), [run]), wide.samples(run)
        assert found.parameters == whole.parameters
        np.testing.assert_allclose(found.regressor, whole.regressor, rtol=1e-12, atol=1e-12)


def test_samples_keep_the_columns_that_other_loads_leave(load_once):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full")
    run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot))
    plain, curve = model.samples(run), ("Fk0~0.5", "Fk~1", "Fk~2")
    wide = model.with_columns({"left_crank_joint": (*curve, "Ft")})
    light, heavy = (wide.with_loads(wide.prior, k * wide.standard_prior) for k in (1, 2))
    first = light.widened(plain, [run])
    again = heavy.widened(first, [run])
    np.testing.assert_array_equal(again.regressor, heavy.widened(plain, [run]).regressor)
    changed = (again.regressor != first.regressor).any(axis=(0, 1))
    np.testing.assert_array_equal(np.flatnonzero(changed), wide.load_columns[1])
    unloaded = model.with_columns({"left_crank_joint": curve})
    fewer = unloaded.widened(again, [run])
    assert fewer.parameters == unloaded.parameters
    np.testing.assert_array_equal(fewer.regressor, unloaded.widened(plain, [run]).regressor)


# Friction at rest.


@pytest.fixture(scope="module")
def sticking(robot):
    """Recordings at 200 Hz with some parts less Coulomb friction at rest than in motion."""
    terms = JointTerms.with_values(robot, "Fc=0.1,Fv=0.05")
    motion = wander(robot, 3, 20.0, 200.0, size=(0.4, 0.4))
    made = simulated(robot, motion, None, standard=scaled_bodies(robot, 0.2), terms=terms)
    rate = np.gradient(made.position, made.time, axis=0)
    idle = np.abs(rate) < 0.05 * np.percentile(np.abs(rate), 99, axis=0)
    error = 1e-3 * np.random.default_rng(0).normal(size=rate.shape)

    def recorded(less):
        force = made.exact_force - less * 0.1 * np.sign(rate) * idle + error
        log = unchecked(made.time, made.position, force, robot.actuated)
        return loopid.prepare(robot, log, filter=FilterOptions(cutoff=4.0))

    return recorded


@pytest.mark.parametrize("less", [-0.5, 0.0, 0.5])
def test_friction_that_is_less_at_rest_is_no_shape_of_it(robot, sticking, less):
    """Beside reversals the filter shows it; more friction at rest is that of a curve."""
    recording = sticking(less)
    data = loopid.force_model(robot, "full").samples(recording)
    weights = error_weights(data.problem, quiet_fit(data).noise)
    columns = friction_at_rest(data, [recording], weights)
    assert columns.any(axis=0).tolist() == [less > 0] * 2
    if less > 0:
        beside, without = (
            np.array([fit[f"{joint}.Fc"].value for joint in robot.actuated])
            for fit in (quiet_fit(data), quiet_fit(data.apart_from(columns[:, :, None])))
        )
        assert np.abs(without - 0.1).max() < 1e-3 < 2e-3 < np.abs(beside - 0.1).max()


@pytest.mark.parametrize("part", [0.3, 0.9])
def test_samples_that_show_friction_at_rest_are_left_out_unless_they_are_most(part):
    """Beside a column of it, the first point of a curve could have any size."""
    rng = np.random.default_rng(0)
    rest = np.where(rng.uniform(size=(400, 1)) < part, 0.5, 0.01) * rng.choice([-1, 1], (400, 1))
    names = loopid.parameters.ParameterSet.from_labels(["elbow.Fc", "elbow.Fk0~1"])
    near = np.abs(rest) > 0.1  # the first point of a curve is next to rest, and there alone
    W = np.stack([rng.choice([-1.0, 1.0], (400, 1)), rest * near + 1e-3 * rest], axis=2)
    data = loopid.identification.FitSamples.of(names, ["elbow"], W, W[..., 0])
    moving = moving_samples(data, rest)
    assert moving.used.all() == (part > 0.75)
    kept = np.abs(moving.regressor[..., 1])[moving.used]
    assert kept.max() < (1e-4 if part < 0.75 else 0.5)
    unit = rest * moving.used
    assert np.abs((unit[..., None] * moving.regressor).sum(axis=0)).max() < 1e-9


def test_friction_at_rest_is_in_no_parameter_and_in_all_errors(robot, model, sticking):
    """Those on regions, as others, are of all forces: what is predicted has it, too."""
    found = identify_unjudged(model, sticking(0.5))
    assert not found_groups(found)
    for joint in robot.actuated:
        assert found.fit[f"{joint}.Fc"].value == pytest.approx(0.1, abs=5e-4)
    best = found["consistent"]
    assert (best.regions >= best.fit.quality.residual_rms).all()


def test_while_a_motor_sticks_its_friction_goes_from_before_to_after(robot, model):
    """Else the sign of a rate that is none makes errors of all friction beside reversals."""
    time, step = np.arange(0.0, 10.0, 1 / 200.0), 2 * np.pi / 2**17
    turns, left = np.divmod(time, 1.1)  # motors turn back each second, and stick for 0.1 s
    phase, way = np.pi * (turns + np.minimum(left, 1.0)), np.array([0.4, -0.3])
    omega, before = np.pi * (left < 1.0)[:, None], (1 - 2 * (turns[:, None] % 2)) * -np.sign(way)
    sine, cosine = np.sin(phase)[:, None], np.cos(phase)[:, None]
    rates = -way * omega * sine, -way * omega**2 * cosine
    moved = Motion(robot.actuated, time, np.array([2.088, 0.714]) + way * cosine, *rates)
    terms = JointTerms.with_values(robot, LINE)
    made = simulated(robot, joint_motion(robot, moved), None, terms=terms)
    rests = 0.1 * before * (1.05 - left[:, None]) / 0.05
    force = np.where(omega > 0, made.exact_force, made.exact_force + rests)
    log = unchecked(time, step * np.round(made.position / step), force, robot.actuated)
    recording = loopid.prepare(robot, log, filter=FilterOptions(cutoff=8.0))
    labels, standard = model.base.parameters.labels, robot.standard_parameters()
    values = dict(zip(robot.parameters().labels, standard, strict=True))
    values |= {f"{joint}.{kind}": x for joint in robot.actuated for kind, x in LINE_VALUES.items()}
    true = model.base.values(np.array([values.get(label, 0.0) for label in labels]))
    errors = np.abs(model.samples(recording).residual(true))
    assert errors[recording.used].max() < 0.01
    assert 0.4 < recording.used.mean() < 0.8
    for joint, stuck in zip(robot.actuated, recording.history.stuck.T, strict=True):
        direction = recording.history.directions(joint)
        assert (np.abs(direction[~stuck]) == 1).all()
        assert np.abs(np.diff(direction)[stuck[1:]]).max() < 0.15  # no jump of 2


PENDULUM = """<mujoco model="wrist"><compiler angle="radian"/>
  <option timestep="5e-4" integrator="implicitfast"/><worldbody><body name="link">
  <joint name="motor" axis="0 1 0" armature="0.01" frictionloss="0.2" damping="0.1"
    solreffriction="0.001 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"/>
  <inertial pos="0.02 0 -0.05" mass="0.6" diaginertia="0.002 0.002 0.001"/></body></worldbody>
  <actuator><motor joint="motor"/></actuator></mujoco>"""


@pytest.mark.validate
@pytest.mark.parametrize("frequency", [0.1, 0.3])
def test_a_light_motor_that_sticks_under_a_controller_has_plain_friction(tmp_path, frequency):
    """Another program's physics: PD drives it, and at each reversal it waits for the force."""
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "wrist.xml").write_text(PENDULUM)
    plant = mujoco.MjModel.from_xml_string(PENDULUM)
    state, time = mujoco.MjData(plant), 5e-4 * np.arange(60_000)
    phase = 2 * np.pi * frequency * time
    wanted = 0.8 * np.sin(phase) + 0.3 * np.sin(2.3 * phase)
    rate = np.gradient(wanted, time)
    position, force = np.empty((2, len(time)))
    for k in range(len(time)):
        position[k] = state.qpos[0]
        force[k] = 15.0 * (wanted[k] - state.qpos[0]) + 0.9 * (rate[k] - state.qvel[0])
        state.qfrc_applied[0] = force[k]
        mujoco.mj_step(plant, state)
    rows, step = slice(2000, None, 4), 2 * np.pi / 2**17
    noise = 1e-3 * np.random.default_rng(0).normal(size=len(time[rows]))
    encoder = step * np.round(position[rows] / step)
    robot = quietly(loopid.load, tmp_path / "wrist.xml")
    log = unchecked(
        time[rows] - 1.0, encoder[:, None], (force[rows] + noise)[:, None], robot.actuated
    )
    recording = quietly(loopid.prepare, robot, log)
    assert recording.history.stuck.any()
    found = identify_unjudged(loopid.force_model(robot, "full"), recording)
    assert not found_groups(found)
    assert found.fit["motor.Fc"].value == pytest.approx(0.2, rel=0.01)
    assert found.fit["motor.Fv"].value == pytest.approx(0.1, rel=0.02)


def test_friction_of_one_direction_is_no_friction_of_the_joint():
    names = loopid.parameters.ParameterSet.from_labels(["elbow.Fc+", "elbow.Fc-", "elbow.Fv"])
    rng = np.random.default_rng(0)
    rate = rng.normal(size=(200, 1))
    W = np.stack([rate > 0, -(rate < 0).astype(float), rate], axis=2)
    samples = FitSamples.of(names, ["elbow"], W, W @ [2.0, 3.0, 0.5] + rng.normal(size=(200, 1)))
    numbers = friction_numbers(loopid.identification.fit(samples))
    assert {joint: [*own] for joint, own in numbers.items()} == {"elbow": ["Fv"]}
    assert numbers["elbow"]["Fv"].name == "elbow.Fv"
