"""Delays of forces: found within their intervals, undone, and not seen elsewhere."""

import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid import FilterOptions, JointTerms, identify
from loopid.errors import DataWarning
from loopid.identification import delay as delay_module, find_delay
from loopid.identification.delay import (
    CLEAR,
    USUAL,
    Delay,
    _confirmed,
    _delays_of_logs,
    _disagreement,
    _moved,
    _over_bands,
    _sharpens,
    _undoing,
    delay_forces,
    in_time,
    with_delay_errors,
)
from loopid.identification.fitting import quiet_fit
from loopid.logs import Recording
from loopid.logs.preparing import prepare_again
from loopid.motion import point_to_point, scaled_bodies
from loopid.motion.trajectories import Waypoint
from made_runs import elastic, identify_unjudged, simulated, unchecked, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "none_missing")

RATE, NOISE, SIZE = 200.0, 0.02, (0.4, 0.4)
BAND = 8.0  # Hz, near that which would be chosen
CHANCE = 0.01  # that motors which agree seem to differ
FRICTION = {"five_bar": (0.1, 0.05), "delta": (0.1, 0.05)}


def logged(robot, seconds):
    """A force model, its true values, and a log without noise."""
    terms = JointTerms(robot.actuated, ("Fc", "Fv"))
    model = loopid.force_model(robot, "full", terms)
    size = SIZE if robot.name == "five_bar" else (0.04, 0.04, 0.04)
    motion = wander(robot, 2, seconds, RATE, size=size)
    values = np.tile(FRICTION[robot.name], len(robot.actuated))
    bodies = scaled_bodies(robot, 0.2)
    run = simulated(robot, motion, None, standard=bodies, terms=(terms, values))
    truth = model.base.values(np.concatenate([bodies, values]))
    return model, truth, unchecked(run.time, run.position, run.exact_force, robot.actuated)


@pytest.fixture(scope="module", params=few_of(FRICTION, "five_bar"))
def case(request, load_once):
    return logged(load_once(request.param), 20.0)


@pytest.fixture(scope="module", params=few_of(FRICTION, "five_bar"))
def brief(request, load_once):
    """As a case, of a log that is soon prepared."""
    return logged(load_once(request.param), 4.0)


def noisy(log, delay=0.0, seed=0, noise=1.0):
    """The log with late forces, and so many times the noise of the sensors.

    Of three motors, whose forces are less, a fifth of it: more hides whether friction builds up.
    """
    noise *= NOISE if len(log.joints) == 2 else NOISE / 5
    late = log.delayed(-np.asarray(delay))
    error = noise * np.random.default_rng(seed).normal(size=late.force.shape)
    return unchecked(late.time, late.position, late.force + error, late.joints)


def prepared(model, log):
    return loopid.prepare(model.robot, log)


@pytest.mark.parametrize("delay", few_of([-0.02, 0.0, 0.005, 0.0173, 0.05], 0.0, 0.0173))
def test_a_delay_is_found_within_its_interval(case, delay):
    model, _, log = case
    found = find_delay(model, [prepared(model, noisy(log, delay))], cutoff=None if delay else BAND)
    half = np.ptp(found.interval) / 2
    assert abs(found.common - delay) < 1.7 * half < 0.0045
    assert (np.abs(found.each - delay) < 1.7 * np.ptp(found.intervals, axis=1) / 2).all()
    assert found.clear or abs(delay) < 1.2 * CLEAR * half
    assert not found.clear or delay


@pytest.mark.parametrize("delay", few_of([0.0, 0.3 / RATE, 0.0173], 0.3 / RATE))
def test_a_delay_without_noise_is_exact_and_clear_from_a_fifth_of_a_step(case, delay):
    """Wherever the search begins: its end is the root, to far less than a step of the log."""
    model, _, log = case
    found = find_delay(model, [prepared(model, noisy(log, delay, noise=0.0))], cutoff=BAND)
    assert np.abs([found.common - delay, *(found.each - delay)]).max() < 1e-3 / RATE
    assert found.clear == (delay > 0)


@pytest.mark.parametrize("slip", few_of([1e-5, 5e-4, 2e-2], 5e-4))
def test_friction_that_builds_up_is_no_delay(case, slip):
    model, _, log = case
    if slip > 0.01 and len(log.joints) > 2:
        pytest.skip("over so far, friction of motors that move little tells no delay at all")
    soft = elastic(log, slip)
    clean = find_delay(model, [prepared(model, noisy(soft))], cutoff=BAND)
    assert not clean.clear
    late = find_delay(model, [prepared(model, noisy(soft, 0.03))], cutoff=BAND)
    for found, delay in ((clean, 0.0), (late, 0.03)):
        half = np.ptp(found.interval) / 2
        assert abs(found.common - delay) < 1.7 * half < 0.012
    assert late.clear


@pytest.mark.parametrize("kind", ["load", "ripple"])
@pytest.mark.parametrize("delay", few_of([0.0, 0.02], 0.02))
def test_friction_that_grows_with_load_or_ripples_is_no_delay(load_once, kind, delay):
    """From point to point, where each start and end has more of it."""
    robot = load_once("five_bar")
    terms = JointTerms(robot.actuated, ("Fc", "Fv"))
    middle = np.array([robot.reference[robot.joint(name).idx_q] for name in robot.actuated])
    points = middle + np.random.default_rng(5).uniform(-0.4, 0.4, (10, 2))
    ways = [Waypoint(point, seconds=s) for point in points for s in (0.8, 0.2)]
    motion = point_to_point(robot.actuated, middle, ways, rate=RATE)
    run = simulated(robot, motion, None, terms=(terms, np.tile([0.1, 0.05], 2)))
    force = run.exact_force.copy()
    if kind == "load":
        steady = 0.1 * np.sign(motion.velocity) + 0.05 * motion.velocity
        force += 0.1 * np.sign(motion.velocity) * np.abs(force - steady)
    else:
        force += 0.1 * np.sin(60 * motion.position + [0.3, 1.1])
    model = loopid.force_model(robot, "full", terms)
    log = noisy(unchecked(run.time, run.position, force, robot.actuated), delay, noise=0.3)
    found = find_delay(model, [prepared(model, log)])
    half = np.ptp(found.interval) / 2
    assert abs(found.common - delay) < 1.7 * half < 0.003
    assert found.clear == (delay > 0)


@pytest.mark.parametrize("load", few_of([0.0, 0.1], 0.1))
def test_one_motor_alone_with_friction_that_grows_with_load_has_no_early_forces(
    tmp_path, urdf_folder, load
):
    """That is what the friction looks like where no other motor tells what the gear carries.

    A link that is called "load" is none.
    """
    for name in ("four_bar.urdf", "four_bar.yaml"):
        text = (urdf_folder / name).read_text()
        (tmp_path / name).write_text(text.replace('"coupler"', '"load"'))
    robot = loopid.load(tmp_path / "four_bar.yaml")
    terms, (middle,) = JointTerms(robot.actuated, ("Fc", "Fv")), robot.reference[:1]
    points = middle + np.random.default_rng(3).uniform(-0.8, 0.8, 3)
    ways = [Waypoint([point], seconds=s) for point in (*points,) * 4 for s in (0.8, 0.3)]
    motion = point_to_point(robot.actuated, [middle], ways, rate=RATE)
    bodies = scaled_bodies(robot, 0.2)
    run = simulated(robot, motion, None, standard=bodies, terms=(terms, [0.1, 0.05]))
    steady = 0.1 * np.sign(motion.velocity) + 0.05 * motion.velocity
    force = run.exact_force
    force = force + load * np.sign(motion.velocity) * np.abs(force - steady)
    model = loopid.force_model(robot, "full", "Fc,Fv,Fo,Ia")
    log = unchecked(run.time, run.position, force, robot.actuated)
    found, early = (
        find_delay(model, [prepared(model, noisy(log, -late, noise=0.3))]) for late in (0.0, 0.02)
    )
    assert not found.clear
    assert early.clear == (not load)


def in_a_band(common, half, motors=2):
    """A delay of motors as one band has it, undone."""
    ends, each = np.array([common - half, common + half]), np.full(motors, common)
    names = tuple(map(str, range(motors)))
    each_ends = np.tile(ends, (motors, 1))
    return Delay(names, common, tuple(ends), each, each_ends, 0.01, each, each[:1])


def test_bands_that_disagree_about_a_delay_make_its_interval_wider():
    best = in_a_band(0.03, 0.01)
    for other in (in_a_band(0.032, 0.01 * np.sqrt(2)), in_a_band(0.035, 0.02)):
        same = _over_bands(best, [best, other])
        assert same.clear
        np.testing.assert_allclose(same.interval, best.interval)
    for common, half in ((0.045, 0.012), (0.015, 0.01), (0.012, 0.005)):
        found = _over_bands(best, [best, in_a_band(common, half)])
        assert not found.clear
        assert found.interval[0] < common < found.interval[1]
        assert found.left[0] > best.step / 2


def test_motors_that_agree_seem_to_differ_as_seldom_as_chance_has_it():
    random = np.random.default_rng(0)
    errors = random.uniform(1e-3, 1e-2, (4000, 3))
    found = [_disagreement(0.02 + random.normal(0, own), own) for own in errors]
    assert 0.5 * CHANCE < np.mean(np.array(found) > 1.0) < 2 * CHANCE
    # Two that lie ten errors apart, their mean in between.
    assert _disagreement(np.array([0.0, 0.01]), np.full(2, 1e-3)) == pytest.approx(50**0.5)
    assert _disagreement(np.array([0.0, 0.01]), np.array([1e-3, np.inf])) == 1.0


def test_a_delay_that_is_vague_has_no_interval():
    """From 50 ms either way on."""
    vague = _over_bands(in_a_band(0.2, 0.055), [])
    assert not vague.clear
    assert np.isinf([*vague.interval, *vague.intervals.ravel()]).all()
    assert np.isfinite(_over_bands(in_a_band(0.2, 0.045), []).interval).all()


def test_forces_that_are_moved_are_those_of_a_log_that_is_prepared_again(case):
    model, _, log = case
    every = FilterOptions(decimate=False)
    run = loopid.prepare(model.robot, noisy(log, 0.012), filter=every)
    found = in_a_band(0.012, 0.001, len(log.joints))
    moved = _moved(model.robot, run, found.undone)
    late = replace(run, log=run.log.delayed(found.undone))
    (again,) = prepare_again(model.robot, [late])
    shared = np.isin(moved.motion.time, again.motion.time)
    same = moved.select(shared & moved.used.any(axis=1))
    other = again.select(np.isin(again.motion.time, same.motion.time))
    inside = slice(5, -5)  # a filter that starts elsewhere
    np.testing.assert_allclose(
        same.force[inside], other.force[inside], atol=2e-3 * np.abs(other.force).max()
    )
    assert moved.log is not run.log
    np.testing.assert_array_equal(moved.log.force, again.log.force)


@pytest.mark.validate
@pytest.mark.parametrize("runs", [12])
def test_intervals_hold_the_delay(case, runs):
    model, _, log = case
    inside, widths = [], []
    for seed in range(runs):
        found = find_delay(model, [prepared(model, noisy(log, 0.01, seed))], cutoff=BAND)
        inside.append(found.interval[0] < 0.01 < found.interval[1])
        # The common delay is a mean of the motors', weighted by what each says of it; the interval
        # of one is wider where they seem to differ.
        each, common = np.ptp(found.intervals, axis=1), np.ptp(found.interval)
        widths.append(common * np.sqrt((each**-2).sum()))
    assert min(widths) > 0.9
    assert np.median(widths) < 1.5
    assert sum(inside) >= 0.75 * runs  # by chance fewer of 12 in one of 400


def test_the_fit_of_late_forces_is_that_of_good_ones(case):
    model, truth, log = case
    late = prepared(model, noisy(log, 0.02, noise=0.2))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", DataWarning)
        found = identify(model, [late], validation=[late.select(slice(200))])
    assert any("those of all motors are" in str(each.message) for each in said)
    assert found.delay.clear
    assert np.ptp(found.delay.undone) == 0
    fit = found["all parameters"].fit
    assert (np.abs(fit.values - truth) < 4.5 * fit.standard_errors).all()
    band = FilterOptions(cutoff=found.cutoff.chosen)
    kept = loopid.prepare(model.robot, late.log, filter=band)
    in_band = in_time(model, ((kept,),), undo=False)
    assert in_band.delay is None
    ((same,),) = in_band.groups
    values = quiet_fit(model.samples(same)).values
    worst = np.abs((values - truth) / fit.standard_errors).max()
    assert worst > 6


def test_intervals_hold_a_delay_that_is_not_clear(case):
    model, truth, log = case
    little = 0.003 if len(log.joints) == 2 else 0.0006
    found = identify_unjudged(model, prepared(model, noisy(log, little)))
    delay, fit = found.delay, found["all parameters"].fit
    assert not delay.clear
    error = np.ptp(delay.interval) / 2 / 1.96
    assert min(abs(delay.common), error) < delay.left[0] < np.hypot(delay.common, error)
    given = quiet_fit(found.data)
    np.testing.assert_array_equal(fit.values, given.values)
    wider = fit.covariance - given.covariance
    assert np.linalg.matrix_rank(wider / np.outer(*2 * [given.standard_errors]), tol=1e-6) == 1
    assert (np.abs(fit.values - truth) < 4 * fit.standard_errors).all()


def test_a_delay_moves_estimates_as_far_as_a_fit_to_late_forces_whatever_widens_it(case):
    model, _, log = case
    run = prepared(model, noisy(log))
    delay, data = find_delay(model, [run], cutoff=BAND), model.samples(run)
    fit = quiet_fit(data)
    force = data.force + delay_forces(data, fit.values, [run], delay)[:, :, 0]
    moved = quiet_fit(replace(data, force=force)).values - fit.values
    for most in (1, 30):  # scatter between regions widens each estimate by its own factor
        scale = np.random.default_rng(0).uniform(1, most, len(moved))
        wide = replace(fit, covariance=fit.covariance * np.outer(scale, scale))
        whole = with_delay_errors(wide, data, [run], delay).covariance
        added = np.sqrt(np.diag(whole - wide.covariance).clip(0))
        ratio = np.linalg.norm([added, moved] / fit.standard_errors, axis=1)
        assert 0.3 < ratio[0] / ratio[1] < 3


@pytest.mark.parametrize(("step", "left"), [(0.004, 0.004), (0.05, 0.01)])
def test_of_nothing_known_a_step_is_left_and_a_hundredth_of_a_second_at_most(step, left):
    nothing = replace(in_a_band(0.0, 1e3), step=step)
    assert _undoing(nothing, np.zeros(2)).left == pytest.approx(left)


def test_what_data_do_not_tell_of_a_delay_is_a_usual_one(case):
    model, _, log = case
    found = find_delay(model, [prepared(model, noisy(log, noise=500))], cutoff=BAND)
    assert found.left == pytest.approx(min(USUAL, 1 / RATE), rel=0.1)


def test_motors_that_agree_share_a_delay_and_one_that_does_not_has_its_own(case):
    model, _, log = case
    if len(log.joints) > 2:
        pytest.skip("friction that builds up explains what one of these motors says as well")
    alone = np.zeros(len(log.joints))
    alone[0] = 0.01
    late = prepared(model, noisy(log, alone, noise=0.2))
    found = find_delay(model, [late], cutoff=BAND)
    assert found.undone[0] == found.each[0] == pytest.approx(0.01, abs=0.001)
    assert not found.undone[1:].any()


LOGS = {"none": (0.005,) * 3, "one": (0.005, 0.035, 0.005), "two": (0.005, -0.03)}


@pytest.mark.parametrize("which", few_of(LOGS, "none", "one"))
def test_a_log_with_another_delay_than_the_others_is_named_and_made_like_them(brief, which):
    (model, _, log), delays = brief, LOGS[which]
    logs = [replace(noisy(log, late, k), name=f"log {k}") for k, late in enumerate(delays)]
    groups = [prepared(model, each) for each in logs], [prepared(model, log)]
    (training, judging), found, *_ = in_time(model, groups)
    usual = min(delays, key=abs)
    late = {each.name: d - usual for each, d in zip(logs, delays, strict=True) if d != usual}
    assert list(found.of_logs) == list(late)
    assert list(found.of_logs.values()) == pytest.approx(list(late.values()), abs=0.002)
    assert found.common == pytest.approx(usual, abs=0.002)
    said = [each for each in found.findings if "of other logs" in each.title]
    assert len(said) == bool(late)
    assert all(name in each.title and "undone" in each.title for name in late for each in said)
    # All forces are then as late as those without delay, and those of other groups as the usual.
    for run in training:
        left = find_delay(model, [run], cutoff=BAND)
        assert abs(left.common) < 0.002
    assert find_delay(model, judging, cutoff=BAND).common == pytest.approx(-usual, abs=0.002)


def test_no_log_is_moved_that_cannot_be_told_of(brief, monkeypatch):
    """As where the common delay, which tells of it, is not known."""
    model, _, log = brief
    monkeypatch.setattr(delay_module, "_delay_of", lambda *_: None)
    logs = [replace(noisy(log, late, k), name=f"log {k}") for k, late in enumerate((0.0, 0.04))]
    given = tuple(prepared(model, each) for each in logs)
    found = in_time(model, [given])
    assert found.delay is None
    assert found.groups == (given,)


@pytest.mark.parametrize(("times", "named"), [(0.9, False), (1.1, True)])
def test_a_log_differs_from_the_middle_one_by_more_than_its_interval_is_wide(
    brief, monkeypatch, times, named
):
    """Whatever its delay is beside its positions; and of one that is vague nothing is said."""
    model, _, log = brief
    errors = np.array([0.002, 0.003, 0.001, np.inf])
    late = times * CLEAR * 1.96 * np.hypot(errors[0], errors[1])
    delays = np.array([0.01, 0.01 - late, 0.012, 0.2])
    search = SimpleNamespace(
        delays=(None, True, delays, np.isfinite(errors)),
        errors=lambda _: (errors, 0.0),
        forces=SimpleNamespace(step=0.005),
    )
    monkeypatch.setattr(delay_module, "_Search", lambda *_, **__: search)
    runs = [prepared(model, replace(log, name=name)) for name in "abcd"]
    found = _delays_of_logs(model, runs, None)
    assert list(found) == ["b"] * named
    assert list(found.values()) == pytest.approx([-late] * named)


def test_motors_that_all_differ_have_each_its_own_delay(load_once):
    robot, late = load_once("3rrr"), np.array([0.002, 0.006, 0.01])
    terms = JointTerms(robot.actuated, ("Fc", "Fv"))
    model = loopid.force_model(robot, "full", terms)
    motion = wander(robot, 2, 5.0, RATE, size=(0.2,) * 3)
    run = simulated(robot, motion, None, terms=(terms, np.tile([0.1, 0.05], 3)))
    log = unchecked(run.time, run.position, run.exact_force, robot.actuated)
    found = find_delay(model, [prepared(model, noisy(log, late))], cutoff=BAND)
    assert found.undone == pytest.approx(late, abs=0.001)
    assert (np.abs(found.undone - late) < 2 * np.ptp(found.intervals, axis=1) / 2).all()
    assert found.left == pytest.approx(np.ptp(found.intervals, axis=1) / 2 / 1.96, rel=0.01)


def test_of_motors_that_differ_only_what_another_delay_has_too_is_undone():
    each, ends = np.array([0.01, 0.004, 0.001]), np.array([-0.002, 0.002])
    undone, left = np.array([0.01, 0.004, 0.0]), np.full(3, 0.001)
    between = each[:, None] + ends
    moved = Delay(("a", "b", "c"), 0.005, (0.0, 0.01), each, between, 0.005, undone, left)
    other = replace(moved, intervals=moved.intervals - [[0.0], [0.003], [0.0]])
    kept = _confirmed(moved, other)
    assert kept.undone == pytest.approx([0.01, 0.0, 0.0])
    assert kept.left[0] == pytest.approx(0.002 / 1.96, rel=1e-3)
    assert kept.left[1] > 0.0015
    nothing = replace(moved, intervals=moved.intervals - 0.02)
    assert not _confirmed(moved, nothing).clear


def test_a_motor_with_a_delay_of_its_own_is_kept_beside_a_vaguer_band():
    """The common delay is vague where one motor alone is late, and in that band alone."""
    each, ends = np.array([0.0, 0.008]), np.array([-0.0005, 0.0005])
    undone, left, between = np.array([0.0, 0.008]), np.array([0.0, 0.00025]), each[:, None] + ends
    sharp = Delay(("a", "b"), 0.004, (-0.02, 0.028), each, between, 0.002, undone, left)
    wide = each[:, None] + np.multiply.outer([0.002, 0.01], [-1.0, 1.0])
    vague = replace(sharp, common=0.001, interval=(-0.002, 0.004), intervals=wide)
    assert not _sharpens(vague, sharp)
    assert _sharpens(sharp, vague)


def test_forces_that_the_model_lacks_are_no_delay(case):
    """Viscous friction, drive inertia and offsets that no term has, and friction that is curved."""
    model, _, log = case
    bare = loopid.force_model(model.robot, "full", None)
    velocity = np.gradient(log.position, 1 / RATE, axis=0)
    acceleration = np.gradient(velocity, 1 / RATE, axis=0)
    curved = 0.1 * np.sign(velocity) * np.exp(-((velocity / 0.1) ** 2))
    more = log.force + 0.5 + 0.3 * velocity + 0.05 * acceleration + curved
    spoilt = noisy(unchecked(log.time, log.position, more, log.joints))
    found = find_delay(bare, [prepared(bare, spoilt)], cutoff=BAND)
    assert not found.clear


@pytest.mark.validate
def test_a_log_that_stands_nearly_still_tells_no_delay(case):
    model, _, log = case
    time = np.linspace(0, 60, len(log))
    slow = unchecked(time, log.position, np.zeros_like(log.force), log.joints)
    found = find_delay(model, [prepared(model, noisy(slow))], cutoff=BAND)
    assert found is None or not found.clear


def test_motions_that_are_known_exactly_have_no_delay(case):
    model, _, log = case
    recording = prepared(model, noisy(log))
    exact = Recording.of_motion(recording.motion, recording.force, recording.actuators)
    assert find_delay(model, [exact]) is None
