"""Mistakes in logs are named, motor by motor, whatever the masses of the robot file."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from ruamel.yaml import YAML

import loopid
from bank_robots import few_of
from loopid import JointTerms, read_log
from loopid.files import csv_text
from loopid.findings import PAGE
from loopid.identification import log_faults, log_timing
from loopid.identification.data import recordings_of
from loopid.identification.evidence import Evidence, Explanation
from loopid.identification.log_mistakes import _clear, _finds, log_faults_by_log
from loopid.identification.log_timing import late_by_seconds
from loopid.identification.mistake_kinds import KINDS, Find
from loopid.kinematics import measured_coordinates
from loopid.logs import FilterOptions, Log, LogMapping, Recording
from loopid.motion import Motion, Noise, Waypoint, joint_motion, point_to_point, scaled_bodies
from loopid.regressors import force_parts
from made_runs import (
    ARM,
    THREE_HINGES,
    friction,
    quietly,
    record,
    simulated,
    stand,
    unchecked,
    wander,
)

FIVE_BAR, KNEE = ("left_crank_joint", "right_crank_joint"), tuple(f"leg{k}_stroke" for k in "1234")


@pytest.fixture(scope="module")
def runs(load_once):
    """What is suspected of a log of a robot; bodies up to half as heavy again as in its file."""

    @cache
    def run(name, seed, seconds):
        robot = load_once(name)
        size = {"3ups_rpu": (0.06, 0.04, 0.2, 0.2), "3rrr": (0.2, 0.2, 0.2)}.get(name, (0.5, 0.5))
        motion = wander(robot, seed, seconds=seconds, rate=1500.0 / seconds, size=size)
        terms = JointTerms(robot.actuated), np.tile([0.5, 0.2], len(robot.actuated))
        terms = friction(robot) if name == "3ups_rpu" else terms
        bodies = robot.standard_parameters().reshape(-1, 10)
        factors = np.random.default_rng(seed).uniform(0.5, 1.5, size=(len(bodies), 1))
        standard = (factors * bodies).ravel()
        exact = simulated(robot, motion, None, seed, standard, terms)
        noise = Noise(gaussian=0.02 * np.sqrt((exact.force**2).mean()), encoder_step=2e-6)
        return robot, simulated(robot, motion, noise, seed, standard, terms)

    def spoilt(name, seed, spoil, factor=1.0, seconds=30.0, velocities=False):
        robot, found = run(name, seed, seconds)
        position, force = found.position.copy(), found.force.copy()
        spoil(position, force)
        time = factor * found.time
        speed = np.gradient(position, time, axis=0) if velocities else None
        return unchecked(time, position, force, robot.actuated, velocity=speed, name="run")

    @cache
    def suspected(
        name,
        seed,
        spoil=lambda position, force: None,
        factor=1.0,
        seconds=30.0,
        velocities=False,
    ):
        robot, log = (
            run(name, seed, seconds)[0],
            spoilt(name, seed, spoil, factor, seconds, velocities),
        )
        options = FilterOptions(cutoff=75.0 / seconds / factor)
        return log_faults(robot, [quietly(loopid.prepare, robot, log, filter=options)])

    suspected.log = spoilt
    return suspected


@cache
def times(factor, column=0):
    def spoil(position, force):
        force[:, column] *= factor

    return spoil


@cache
def exchanged(positions, forces):
    def spoil(position, force):
        for values, flag in ((position, positions), (force, forces)):
            if flag:
                values[:, :2] = values[:, [1, 0]]

    return spoil


@cache
def geared(ratio, column):
    def spoil(position, force):
        position[:, column] *= ratio

    return spoil


# The five-bar is symmetric: with positions and forces exchanged it is another like it.
CASES = [
    ("five_bar", times(1e3), "the force of {0} is in mN m", "force_scale: {{{0}: 0.001}}"),
    ("five_bar", times(-1e3), "{0} is in mN m with the wrong", "force_scale: {{{0}: -0.001}}"),
    ("five_bar", times(100.0), "the force of {0} is in N cm", "force_scale: {{{0}: 0.01}}"),
    ("five_bar", times(-1.0), "the force of {0} has the wrong sign", "force_scale: {{{0}: -1}}"),
    ("five_bar", times(1e3, ...), "the force of all motors is in mN m", "scale: 0.001 in"),
    ("five_bar", times(-1.0, ...), "all motors has the wrong sign", "force_scale: -1 in"),
    ("five_bar", exchanged(False, True), "the forces of {0} and {1} are exchanged", "mapping"),
    ("five_bar", geared(2.0, 1), "the positions of {1} are ", "position_scale: {{{1}: 0."),
    ("five_bar", geared(-1.0, 1), "positions of {1} have the wrong sign", "_scale: {{{1}: -1}}"),
    ("five_bar", geared(-1.0, ...), "of all motors have the wrong sign", "_scale: -1 in"),
    ("3ups_rpu", times(2.0, 1), "the force of {1} is ", "force_scale: {{{1}: 0.5"),
    ("3ups_rpu", exchanged(True, True), "positions and forces of {0} and {1}", "mapping"),
]


SYMPTOMS = re.findall(r'"([^"]+)"', (Path(__file__).parents[2] / PAGE).read_text())


def on_the_page(title):
    """Whether a symptom of the page that verdicts link, but for its names and numbers, is this."""
    pieces = (re.split(r"\.\.\.|[\d.]+", symptom) for symptom in SYMPTOMS)
    return any(all(piece.strip() in title for piece in own) for own in pieces)


# One a kind of cause.
ORDINARY = [CASES[k] for k in (1, 3, 5, 6, 7)]


@pytest.mark.parametrize(("name", "spoil", "words", "advice"), few_of(CASES, *ORDINARY))
def test_a_mistake_is_called_by_its_cause(runs, name, spoil, words, advice):
    (found,) = runs(name, 0, spoil).mistakes
    motors = FIVE_BAR if name == "five_bar" else KNEE
    assert found.severity == "mistake"
    assert words.format(*motors) in found.title
    assert advice.format(*motors) in found.do
    assert on_the_page(found.title)
    assert not on_the_page("the forces of elbow are green")
    assert len(f"mistake: {found.title}") <= 80
    assert len(f"mistake: {found.brief}") <= 2 * 80


def test_one_motor_may_have_either_sign_wrong(runs):
    """Of a single motor a turned position looks like a turned force: both remedies are named."""
    (found,) = runs("four_bar", 0, times(-1.0)).mistakes
    assert found.title == "the force of crank_joint has the wrong sign"
    for remedy in ("force_scale: {crank_joint: -1}", "position_scale: {crank_joint: -1}"):
        assert remedy in found.do


@cache
def moved(offset, column):
    def spoil(position, force):
        position[:, column] += offset

    return spoil


@cache
def late(rows):
    def spoil(position, force):
        force[:] = np.roll(force, rows, axis=0)

    return spoil


ADVISED = [
    (times(-1.0), 1.0),
    (geared(2.0, 1), 1.0),
    (moved(0.3, 1), 1.0),
    (late(200), 1.0),
    (lambda position, force: None, 2.0),
]


@pytest.mark.parametrize(("spoil", "factor"), few_of(ADVISED, ADVISED[1], ADVISED[-1]))
def test_advice_as_it_is_printed_mends_a_log(runs, load_once, tmp_path, spoil, factor):
    robot, seconds = load_once("five_bar"), 8.0 if factor != 1 else 30.0
    log = runs.log("five_bar", 0, spoil, factor, seconds)
    file, options = tmp_path / "run.csv", FilterOptions(cutoff=75.0 / seconds / factor)
    names = [f"{joint}.{what}" for what in ("position", "force") for joint in log.joints]
    file.write_text(csv_text(["time", *names], log.time, log.position, log.force))

    def suspected(mapping):
        run = quietly(read_log, file, robot, mapping=mapping)
        found = quietly(loopid.prepare, robot, run, filter=options)
        return log_faults(robot, [found]).mistakes

    (said,) = suspected(LogMapping())
    key, value = re.search(r"set (\w+): (.+?) in the mapping", said.do).groups()
    options = FilterOptions(cutoff=75.0 / seconds)
    assert suspected(LogMapping(**{key: YAML(typ="safe").load(value)})) == ()


def test_what_was_found_before_stays_mended_in_the_next_advice(runs):
    def both(position, force):
        force[:] *= [-1.0, 1e3]

    first, second = runs("five_bar", 0, both).mistakes
    assert "-1" in first.do + second.do
    assert {"-1", "0.001"} == {*re.findall(r": (-?[\d.]+)[,}]", second.do)}


@pytest.mark.parametrize("zero", few_of([0.2, 0.3], 0.2))
def test_the_zero_of_an_encoder_is_named(runs, zero):
    (said,) = runs("five_bar", 0, moved(zero, 1)).mistakes
    off = re.search(r"zero of right_crank_joint is off by ([-\d.]+) rad", said.title)
    assert abs(float(off.group(1)) - zero) < 0.1


@pytest.mark.parametrize("stiffness", few_of([1.0, 4.0], 4.0))
def test_a_spring_that_the_model_lacks_is_no_mistake(load_once, stiffness):
    robot = load_once("five_bar")
    motion = wander(robot, 0, seconds=30.0, rate=50.0, size=(0.5, 0.5))
    terms = JointTerms(robot.actuated, ("Fc", "Fv", "Ks")), np.tile([0.5, 0.2, stiffness, 0.0], 2)
    exact = simulated(robot, motion, None, 0, None, terms)
    noise = Noise(gaussian=0.02 * np.sqrt((exact.force**2).mean()), encoder_step=2e-6)
    read = simulated(robot, motion, noise, 0, None, terms)
    log = unchecked(read.time, read.position, read.force, robot.actuated)
    run = quietly(loopid.prepare, robot, log, filter=FilterOptions(cutoff=2.5))
    assert log_faults(robot, [run]).mistakes == ()


def test_friction_that_would_give_energy_tells_a_sign(runs):
    """Neither gravity nor inertia loads the motors of a planar robot that moves slowly."""
    (found,) = runs("3rrr", 0, times(-1.0, 2), seconds=60.0).mistakes
    assert found.title == "the force of leg3_base has the wrong sign"
    assert runs("3rrr", 0, seconds=60.0).mistakes == ()


def test_forces_of_another_time_are_late_by_seconds(runs):
    def shift(position, force):
        force[:] = np.roll(force, 200, axis=0)  # 4 s at 50 Hz

    (found,) = runs("five_bar", 0, shift).mistakes
    assert found.title == "the forces are 4 s late"
    assert "delay: 4 in" in found.do


def test_few_samples_that_a_shift_leaves_are_explained_by_chance(load_once):
    """Smooth forces of other motions belong to no shift, though one of 6 of 10 s leaves little."""
    robot, found = load_once("five_bar"), []
    terms = JointTerms(robot.actuated), np.tile([0.5, 0.2], 2)
    options = {"seconds": 10.0, "rate": 25.0, "size": (0.5, 0.5), "harmonics": 2}
    for seed in range(10):
        motion, other = (wander(robot, k, **options) for k in (seed, 1000 + seed))
        force = simulated(robot, other, None, terms=terms).force
        run = Recording.of_motion(motion, force, robot.actuated)
        found.append(late_by_seconds(robot, [run]))
    assert sum(each is not None for each in found) <= 1


@pytest.mark.parametrize(("independent", "named"), [(0.6, False), (100.0, True)])
def test_a_shift_that_explains_few_independent_samples_is_chance(
    load_once, monkeypatch, independent, named
):
    """Some of a hundred shifts does, of a motor that sticks most of the time."""
    robot, lags = load_once("five_bar"), np.arange(-50, 51) / 5
    errors = np.where(np.isclose(lags, 2.0), 0.02, 0.2)
    found = lags, errors, np.full(len(lags), independent)
    monkeypatch.setattr(log_timing, "_errors_by_lag", lambda *_: found)
    run = record(robot, wander(robot, 0, seconds=20.0, rate=5.0))
    late = late_by_seconds(robot, [run])
    assert (late is not None) == named
    assert late is None or late.title == "the forces are 2 s late"


@pytest.mark.parametrize("seed", few_of(range(3), 0))
def test_forces_of_a_robot_that_mostly_stands_are_not_late(load_once, seed):
    """A shift that leaves a standstill alone is explained by an offset, even with a spring."""
    robot = load_once("delta")
    middle = measured_coordinates(robot).read(robot.reference[None].copy())[0]
    moves = np.random.default_rng(seed).uniform(-0.3, 0.3, (12, 3))
    ways = [(14.0, 0.2), *((1.0, each) for each in moves), (1.0, -0.1), (15.0, -0.1)]
    ways = [Waypoint(middle + each, seconds) for seconds, each in ways]
    motion = joint_motion(robot, point_to_point(robot.measured, middle, ways, rate=25.0))
    terms = JointTerms(robot.actuated, ("Fc", "Fv", "Ks")), np.tile([0.3, 0.1, 4.0, 0.0], 3)
    read = simulated(robot, motion, Noise(gaussian=0.02, encoder_step=2e-6), seed, None, terms)
    log = unchecked(read.time, read.position, read.force, robot.actuated)
    assert late_by_seconds(robot, [quietly(loopid.prepare, robot, log)]) is None


MISSED = {"force scales": times(0.5, 1), "zeros": moved(0.3, 1), "time axis": times(1.0)}


SPANS = [(what, seconds) for what in MISSED for seconds in (8.0, 30.0, 240.0)]


@pytest.mark.parametrize(("what", "seconds"), few_of(SPANS, SPANS[0], SPANS[6], SPANS[8]))
def test_a_mistake_is_named_or_said_not_to_be_told(runs, what, seconds):
    factor = 2.0 if what == "time axis" else 1.0
    found = runs("five_bar", 0, MISSED[what], factor=factor, seconds=seconds)
    assert found.mistakes or what in found.hidden.title


def test_a_log_that_moves_fast_tells_all_and_a_slow_one_no_time_axis(runs):
    assert runs("five_bar", 0, seconds=8.0).hidden is None
    slow = runs("five_bar", 0, seconds=240.0).hidden
    assert slow.severity == "warning"
    assert "time axis" in slow.title
    assert len(slow.brief) <= 2 * 80 - len("warning: ")


def test_velocities_of_the_log_prove_the_scale_of_positions(runs):
    (found,) = runs("five_bar", 0, geared(2.0, 1)).mistakes
    assert "positions" in found.title
    said = runs("five_bar", 0, geared(2.0, 1), velocities=True).mistakes
    assert not any("positions" in each.title for each in said)


@pytest.mark.parametrize("factor", few_of([0.1, 0.5, 2.0], 0.1, 2.0))
def test_a_time_axis_that_is_a_factor_off_is_named(runs, factor):
    (said,) = runs("five_bar", 0, factor=factor, seconds=8.0).mistakes
    assert "time axis" in said.title
    size, reach = map(float, re.search(r"([\d.]+) ± ([\d.]+) times", said.why).groups())
    assert abs(size - factor) < 2 * reach < 0.6 * factor


def test_without_gravity_forces_in_another_unit_look_like_another_time_axis(load_once):
    planar = load_once("five_bar")
    model = planar.model.copy()
    model.gravity.linear = np.zeros(3)
    robot = replace(planar, model=model)
    motion = wander(robot, 0, seconds=8.0, rate=100.0, size=(0.5, 0.5))
    terms = JointTerms.with_values(robot, "Fc=0.1,Fv=0.05")
    run = record(robot, motion, terms, scaled_bodies(robot, 0.2), 0.01, 0)
    run = Recording.of_motion(motion, 16 * run.force, robot.actuated)
    said = quietly(log_faults, robot, [run]).mistakes[0]
    for what, advice in (("the time axis", "multiply its times"), ("the force", "force_scale")):
        assert what in said.title
        assert advice in said.do


@pytest.mark.parametrize("seed", few_of(range(3), 0))
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_forces_without_inertia_and_friction_are_of_a_robot_that_a_hand_moves(
    load_once, friction, seed
):
    """Motors with friction made the motion: what inertia lacks then is the time axis."""
    robot = load_once("five_bar")
    motion = wander(robot, seed, seconds=10.0, rate=50.0, size=(0.5, 0.5))
    scaled = scaled_bodies(robot, 0.2, seed=seed)
    state = motion.configurations, motion.velocities, motion.accelerations
    force = force_parts(robot, *state, standard_parameters=scaled).gravity
    force = force + friction * np.sign(motion.velocities)
    noise = np.random.default_rng(seed).normal(scale=0.02, size=force.shape)
    run = Recording.of_motion(motion, force + noise, robot.actuated, name="run")
    (said,) = log_faults(robot, [run]).mistakes
    assert said.title.startswith("the time axis" if friction else "the robot was moved by hand")


@pytest.mark.parametrize(("rows", "what"), [(5, "positions"), (4, "forces")])
def test_values_that_a_slower_bus_holds_are_named(runs, rows, what):
    def hold(position, force):
        values = {"positions": position, "forces": force}[what]
        values[:] = np.repeat(values[::rows], rows, axis=0)[: len(values)]

    (said,) = (each for each in runs("five_bar", 0, hold).mistakes if "bus" in each.title)
    assert said.title == f"a slower bus holds the {what}"
    assert f"in one of {rows} rows, at {50 / rows:g} Hz" in said.why


def test_a_coarse_encoder_is_no_slower_bus(runs):
    def round_off(position, force):
        position[:] = 0.02 * np.round(position / 0.02)
        force[:] = 0.5 * np.round(force / 0.5)

    assert not any("bus" in each.title for each in runs("five_bar", 0, round_off).mistakes)


def test_exchanged_positions_that_hardly_ever_close_are_no_explanation(runs):
    (said,) = runs("five_bar", 70, times(0.005774, 0)).mistakes
    assert "scaled by 0.0" in said.title


@pytest.mark.parametrize("what", few_of(["position", "force"], "position"))
def test_exchanged_columns_are_named_where_motors_mostly_stand(load_once, what):
    robot = load_once("3ups_rpu")
    log = read_log("urdf/logs/3ups_rpu.csv", robot)
    exchanged = {what: getattr(log, what)[:, [1, 0, 2, 3]]}
    run = quietly(loopid.prepare, robot, replace(log, **exchanged))
    assert run.used[:, 0].mean() < 0.5
    (said,) = log_faults(robot, [run]).mistakes
    assert said.title == f"the {what}s of leg1_stroke and leg2_stroke are exchanged"


def test_forces_of_another_source_have_no_size(load_once):
    """As the current of a lift beside its counterweight: near constant, whatever the arm does."""
    robot = load_once("five_bar")
    run = record(robot, wander(robot, 1, seconds=10.0, rate=50.0))
    noise = np.random.default_rng(0).normal(size=len(run.force))
    force = np.stack([run.force[:, 0], 0.003 * (1 + 0.1 * noise)], axis=1)
    (said,) = log_faults(robot, [replace(run, force=force)]).mistakes
    assert re.match(r"the force of right_crank_joint is below \S+ % of what", said.title)
    assert "scale" not in said.do
    assert KINDS["gain"].cause(0.0018, 0.002) is None
    assert KINDS["gain"].cause(0.0010, 0.0003) == (1e-3, "in kN m")


@pytest.mark.parametrize("name", few_of(["five_bar", "3ups_rpu"], "five_bar"))
def test_nothing_is_suspected_of_what_is_right(runs, name):
    found = runs(name, 0)
    assert found.mistakes == ()
    assert [one.joint for one in found.gains] == list(FIVE_BAR if name == "five_bar" else KNEE)
    for one in found.gains:
        assert one.interval[0] < 1.05
        assert one.interval[1] > 0.95
        assert one.interval[1] - one.interval[0] < 0.3


def test_a_mistake_that_sends_bodies_away_is_none(load_once):
    """As filtered forces near singular poses do, which the bodies of 3rrr then make up for."""
    robot = load_once("five_bar")
    model = Evidence(robot, [record(robot, wander(robot, 0, seconds=5.0, rate=40.0))], None)
    before = model.weighed(model.recorded)
    unit = np.eye(len(before.values))[0]
    far, further, half = (
        before._replace(values=size * np.sqrt(model.sensed) * unit) for size in (2.0, 2.1, 0.9)
    )
    assert not model.near(further, far)
    assert model.near(far, further)
    assert model.near(half, before)


def test_many_mistakes_that_are_tried_are_together_no_likelier_than_none(load_once):
    """Beforehand: what each keeps of its evidence are parts of one [Scott2006]."""
    robot = load_once("3rrr")
    motion = wander(robot, 0, seconds=5.0, rate=40.0, size=(0.2, 0.2, 0.2))
    model = Evidence(robot, [record(robot, motion)], None)
    # Errors are large, so that all kinds are tried.
    found = model.explained([model.recorded])[0]._replace(error=model.size)
    finds = [one for closed in (False, True) for one in _finds(model, found, assembled=closed)]
    kept = sum(np.exp(one.evidence - one.after.evidence) for one in finds)
    assert {one.kind for one in finds} >= {"gain", "forces", "factor"}
    assert 0 < kept <= 1


def passing(run, measure, larger):
    """A log that passes a pose of some singularity measure, with forces that are larger there."""
    singularity, force = np.ones(len(run)), run.force.copy()
    singularity[40:50], force[40:50] = measure, larger * force[40:50]
    return replace(run, force=force, motion=replace(run.motion, singularity=singularity))


@pytest.mark.parametrize(("measure", "larger", "named"), [(0.02, 9, 1), (0.02, 1, 0), (0.5, 9, 0)])
def test_singular_poses_are_named_and_mistakes_beside_them(load_once, measure, larger, named):
    robot = load_once("five_bar")
    run = record(robot, wander(robot, 0, seconds=5.0, rate=40.0), noise=0.01)
    found = log_faults(robot, [passing(replace(run, force=1e3 * run.force), measure, larger)])
    assert bool(found.singular) == named
    assert bool(found.mistakes) == (larger == 1 or named)
    assert log_faults(robot, [passing(run, measure, larger)]).mistakes == ()
    if named:
        for said in ("0.02 at 1.00 s", "below 0.1, a tenth"):
            assert said in found.singular.why
        assert found.findings == (*found.mistakes, found.singular)
        assert on_the_page(found.singular.title)


@pytest.mark.parametrize("name", few_of(["four_bar", "five_bar", "3ups_rpu", "delta"], "five_bar"))
def test_nothing_is_suspected_of_what_stands_or_is_short(load_once, name):
    robot = load_once(name)
    terms = JointTerms(robot.actuated), np.tile([0.5, 0.2], len(robot.actuated))
    short = wander(robot, 3, rate=20.0).select(slice(0, 60))
    for motion in (stand(robot), short):
        run = record(robot, motion, terms, noise=0.01)
        assert log_faults(robot, [run]).mistakes == ()


def test_an_offset_does_not_stand_for_friction_of_a_motor_that_turns_one_way(tmp_path):
    """One way they are the same force, but only one of them takes in energy."""
    (tmp_path / "arm.urdf").write_text(ARM.replace('"-3" upper="3"', '"-30" upper="30"'))
    robot, time = loopid.load(tmp_path / "arm.urdf"), np.arange(0, 20, 0.04)
    swing = np.column_stack([0.8 * np.sin(1.3 * time), 1.5 * np.sin(2.0 * time)])
    speed = np.column_stack([1.04 * np.cos(1.3 * time), 3.0 * np.cos(2.0 * time)])
    drift, bends = np.array([0.9, -1.1]), swing * [-1.69, -4.0]
    states = drift * time[:, None] + swing, drift + speed, bends
    motion = joint_motion(robot, Motion(robot.measured, time, *states))
    terms = JointTerms(robot.actuated, ("Fc", "Fv", "Ia")), np.tile([0.4, 0.3, 0.02], 2)
    log = simulated(robot, motion, Noise(gaussian=0.05), 3, None, terms)
    run = loopid.prepare(robot, unchecked(log.time, log.position, log.force, robot.actuated))
    kinds = JointTerms(robot.actuated, ("Fc", "Fv", "Fo", "Ia"))
    assert log_faults(robot, [run], kinds).mistakes == ()


def test_curves_of_friction_explain_no_mistake(load_once):
    """Their columns do not grow with the time axis as those of bodies do."""
    robot = load_once("five_bar")
    motion = wander(robot, 3, seconds=20.0, rate=50.0)
    run = record(robot, motion, (JointTerms(robot.actuated), np.full(4, 0.3)), noise=0.01)
    kinds = dict.fromkeys(robot.actuated, ("Fc", "Fv", "Fk0~0.05", "Fk~0.1", "Fk~0.5"))
    assert log_faults(robot, [run], JointTerms.of_kinds(kinds)) == log_faults(
        robot, [run], JointTerms(robot.actuated)
    )


@pytest.mark.validate
def test_nothing_is_suspected_of_the_real_robots(mechanism, real_recording):
    first, _ = real_recording.split(0.6)
    assert log_faults(mechanism, [first]).mistakes == ()


@pytest.mark.validate
@pytest.mark.parametrize(("k", "factor"), [(0, 1 / 28.5), (1, -1.0), (2, 1e-3), (3, 1 / 247)])
def test_mistakes_in_logs_of_the_real_robots(mechanism, real_recording, k, factor):
    force = real_recording.force.copy()
    force[:, k] *= factor
    (said,) = log_faults(mechanism, [replace(real_recording, force=force)]).mistakes
    assert f"the force of leg{k + 1}_stroke " in said.title


@pytest.mark.validate
@pytest.mark.parametrize("name", ["five_bar", "3ups_rpu"])
def test_volts_for_newtons_are_named_always_and_nothing_without_reason(runs, name):
    motors, random = FIVE_BAR if name == "five_bar" else KNEE, np.random.default_rng(0)
    for seed in range(100):
        assert runs(name, seed).mistakes == (), seed
        column, factor = random.integers(len(motors)), 10.0 ** random.uniform(-3, -1)
        (said,) = runs(name, seed, times(factor, column)).mistakes
        assert said.title.startswith(f"the force of {motors[column]} is"), (seed, said)


@pytest.mark.validate
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (exchanged(True, True), "the positions and forces of leg1_stroke and leg2_stroke"),
    ],
)
def test_most_mistakes_in_a_leg_are_named(runs, spoil, words):
    said = [" ".join(map(str, runs("3ups_rpu", seed, spoil).mistakes)) for seed in range(10)]
    assert sum(words in each for each in said) >= 9, said


@pytest.fixture(scope="module")
def mounted(load_files):
    """An arm whose base stands, hangs, or is on a wall, by gravity in its frame."""
    return lambda *gravity: load_files(THREE_HINGES, {"gravity": gravity})


MOUNTED = [(g, seed) for g in ((0, 0, 9.81), (9.81, 0, 0), (0, -9.81, 0)) for seed in (0, 1)]


@pytest.mark.parametrize(("gravity", "seed"), few_of(MOUNTED, MOUNTED[2]))
def test_a_base_that_is_not_mounted_as_the_file_has_it_is_named(mounted, gravity, seed):
    """Whatever the bodies; with the gravity that is advised, nothing is suspected."""
    drawn, hung = mounted(0, 0, -9.81), mounted(*gravity)
    motion = wander(hung, seed, seconds=30.0, rate=50.0, size=(0.8,) * 3)
    bodies = hung.standard_parameters().reshape(-1, 10)
    factors = np.random.default_rng(seed).uniform(0.6, 1.5, size=(len(bodies), 1))
    terms = JointTerms(hung.actuated), np.tile([0.5, 0.2], 3)
    run = simulated(hung, motion, Noise(0.05, 1e-5), seed, (factors * bodies).ravel(), terms)
    log = unchecked(run.time, run.position, run.force, hung.actuated)

    def suspected(robot):
        filtered = FilterOptions(cutoff=2.0)
        return log_faults(robot, [quietly(loopid.prepare, robot, log, filter=filtered)]).mistakes

    (found,) = suspected(drawn)
    assert found.title == "gravity has another direction than in the file"
    advised = map(float, re.search(r"gravity: \[(.*)\]", found.do)[1].split(","))
    assert tuple(advised) == pytest.approx(gravity, abs=1e-3)
    assert suspected(hung) == ()


@pytest.mark.parametrize(
    ("size", "reach", "most"),
    [(2.0, 0.1, 0.15), (0.03, 0.01, 0.6), (0.2, 0.01, 0.15), (30.0, 5.0, 0.15)],
)
def test_a_motor_with_a_small_part_of_its_force_may_have_any_bodies(size, reach, most):
    """No missing force takes all of a force away but for a part of the same shape."""
    found = Find("gain", (0,), after=None, evidence=0.0, size=size, reach=reach)
    assert found.shape == most


@pytest.mark.parametrize(("reach", "worth"), [(4.5, True), (5.5, False)])
def test_no_size_is_named_whose_interval_is_wider_than_itself(reach, worth):
    found = Find("ratio", (0,), after=None, evidence=0.0, size=10.0, reach=reach)
    assert found.worth(None) == worth


@pytest.mark.parametrize("seed", few_of(range(6), 0))
def test_a_gain_of_all_motors_has_bodies_as_heavy_as_the_file_on_average(tmp_path, seed):
    """Not lighter ones where bodies are nearer to the file than they may be."""
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    arm = loopid.load(path)
    motion = wander(arm, seed, 8.0, 50.0, size=(0.8, 0.8))
    run = record(
        arm, motion, JointTerms.with_values(arm, "Fc=0.5"), scaled_bodies(arm, 0.1, seed=seed)
    )
    run = Recording.of_motion(motion, 20 * run.force, arm.actuated)
    model = Evidence(arm, [run], None)
    found = _finds(model, model.weighed(model.recorded), assembled=False)
    (size,) = (one.size for one in found if one.kind == "common_gain")
    assert size == pytest.approx(20, rel=0.2)


@pytest.mark.parametrize(("after", "worth"), [((31.0, 8.0), False), ((31.0, 5.0), True)])
def test_inertia_is_missing_where_a_motor_lacks_it(after, worth):
    before, after = (
        Explanation(None, 0.0, None, np.array(error), *(None,) * 4)
        for error in ((32.0, 9.0), after)
    )
    found = Find("factor", (0, 1), after=after, evidence=4.0, size=0.004, reach=0.43)
    assert found.worth(before) == worth


@pytest.mark.parametrize(
    ("before", "after", "clear"),
    [
        ((0.09, 0.7), (0.02, 0.7), False),  # as of a differential, which is none of what is tried
        ((0.09, 0.7), (0.02, 0.03), True),
        ((0.02, 0.03), (0.01, 0.03), True),  # sought as bodies are far from those of the file
    ],
)
def test_a_mistake_of_positions_mends_the_motor_that_is_explained_worst(before, after, clear):
    found, mended = (
        Explanation(None, evidence, None, np.array(error), *(None,) * 4)
        for evidence, error in ((0.0, before), (30.0, after))
    )
    model = SimpleNamespace(
        errors=lambda one: one.error,
        near=lambda *_: True,
        explains=lambda *_, **__: True,
        beside_rivals=lambda one: one,
    )
    find = Find("zero", (0,), after=mended, evidence=30.0, size=1.0, reach=0.1)
    assert KINDS["zero"].assembled
    assert bool(_clear(model, [find], found, [])) == clear


@pytest.mark.parametrize(
    ("error", "carried", "worth"), [(0.01, 0.1, False), (0.5, 0.1, True), (0.01, 0.9, True)]
)
def test_no_gain_turns_forces_that_are_explained_into_those_of_springs(
    load_once, error, carried, worth
):
    robot = load_once("five_bar")
    model = Evidence(robot, [record(robot, wander(robot, 0, seconds=5.0, rate=40.0))], None)
    plain = model.weighed(model.recorded)
    assert plain.carried == pytest.approx(plain.shape, rel=0.05)  # its bodies explain its forces
    found, after = (
        plain._replace(error=error * plain.shape),
        plain._replace(carried=carried * plain.shape),
    )
    assert Find("common_gain", (0, 1), after, 0.0, 0.02, 0.005).worth(found) == worth


def test_a_motor_that_stands_all_the_time_leaves_evidence_of_the_others(load_once):
    robot = load_once("five_bar")
    motion = wander(robot, 0, seconds=10.0, rate=20.0, size=(0.5, 0.5))
    run = record(robot, motion, noise=0.1)
    stands = replace(run, used=run.used & [True, False])
    model = Evidence(robot, [stands], None)
    assert len(model.q) == len(Evidence(robot, [run], None).q)  # as many samples to look at
    assert np.isfinite(model.beside_rivals(model.weighed(model.recorded)).evidence)
    assert log_faults(robot, [stands]).mistakes == ()
    (found,) = log_faults(robot, [replace(stands, force=1e3 * stands.force)]).mistakes
    assert found.title == "the force of left_crank_joint is in mN m"


def test_a_mistake_of_positions_shows_in_the_force_of_any_motor(load_once):
    robot = load_once("five_bar")
    model = Evidence(robot, [record(robot, wander(robot, 0, seconds=5.0, rate=40.0))], None)
    plain = model.weighed(model.recorded)._replace(error=np.array([0.1, 0.5]))
    after = plain._replace(error=np.array([0.11, 0.1]))
    zero = Find("zero", (0,), after, plain.evidence + 9.0, 0.3, 0.05).finding(model, plain)
    figures = re.search(
        r"are (\S+) % of the force of right_crank_joint instead of (\S+) %", zero.why
    )
    assert float(figures[1]) == pytest.approx(float(figures[2]) / 5, rel=0.1)


def test_a_size_is_called_by_a_cause_that_its_interval_holds():
    time = KINDS["factor"]
    assert time.cause(3.94, 0.7) is None
    assert time.cause(3.94, 1.1) == (5.0, "")
    assert time.cause(1.95, 0.01) == (2.0, "")


def test_logs_of_one_name_are_told_apart_and_parts_of_a_log_are_not(load_once):
    """A wrong sign in the second of two logs without names was lost in both."""
    robot = load_once("five_bar")
    log = read_log("urdf/logs/five_bar.csv", robot)
    half = len(log) // 2
    first, second = (
        Log.from_arrays(log.time[rows], log.position[rows], sign * log.force[rows], FIVE_BAR)
        for rows, sign in ((slice(half), 1), (slice(half, None), -1))
    )
    ((good, bad),) = recordings_of(robot, [first, second])
    faults = log_faults_by_log(robot, [good, bad])
    assert [each.recording for each in faults] == ["log", "log 2"]
    assert not faults[0].mistakes
    (mistake,) = faults[1].mistakes
    assert mistake.title == "log 2: the force of all motors has the wrong sign"
    (parts,) = recordings_of(robot, [*loopid.prepare(robot, log).split(0.5)])
    assert {each.name for each in parts} == {log.name}


def test_of_sizes_without_signs_nothing_else_is_said_unless_they_are_explained(load_once):
    robot = load_once("five_bar")
    run = record(robot, wander(robot, 0, seconds=10.0, rate=50.0), noise=0.01)
    bounce = np.abs(np.sin(4 * run.motion.time))[:, None] * np.ones(2)
    log = unchecked(run.motion.time, run.motion.velocities, bounce, robot.actuated)
    (said,) = log_faults(robot, [replace(run, log=log, force=bounce)]).mistakes
    assert said.title == "forces are sizes without their signs"
    assert on_the_page(said.title)
    assert log_faults(robot, [replace(run, log=log)]).mistakes == ()
