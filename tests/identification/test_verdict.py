"""When a verdict may say that values are parameters of the robot: never over a wrong model."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid import FitOptions, JointTerms, identify
from loopid.errors import OptionError
from loopid.findings import SEVERITIES, Finding
from loopid.identification.unseen import UnseenErrors, outstanding
from loopid.logs import Log, Recording
from loopid.motion import Noise, Waypoint, joint_motion, point_to_point, scaled_bodies
from made_runs import ARM, centre, quietly, record, simulated, wander

PRAISE = "as parameters of the robot"


@pytest.fixture(scope="module")
def robot(load_once):
    return load_once("five_bar")


def recording(robot, wrong="nothing", seed=0):
    """A fast motion of bodies that are 20 % off the file's, with one thing wrong."""
    motion = wander(robot, 4, 12.0, 50.0, size=(0.5, 0.5))
    terms = JointTerms.with_values(robot, "Fc=0.1,Fv=0.05")
    run = record(robot, motion, terms, scaled_bodies(robot, 0.2), 0.01, seed)
    force = run.force.copy()
    q = motion.configurations.copy()
    first = robot.joint("left_crank_joint").idx_q
    if wrong == "a spring":
        force[:, 0] += 2.0 * (q[:, first] - q[:, first].mean())
    elif wrong == "a sign":
        force[:, 0] *= -1
    elif wrong == "a zero":
        read = loopid.kinematics.measured_coordinates(robot).read(q)
        read[:, robot.independent.index("left_crank_joint")] += 0.2
        q = loopid.Dynamics(robot).assemble(read, trajectory=True)
    return Recording.of_motion(replace(motion, configurations=q), force, robot.actuated)


@pytest.fixture(scope="module")
def identified(robot, once):
    """What such a recording identifies; by the model of slow motion where gravity is wrong."""

    def found(wrong="nothing"):
        model = loopid.force_model(robot, "gravity" if wrong == "gravity" else "full")
        return quietly(identify, model, [recording(robot, wrong)])

    return lambda wrong="nothing": once(f"verdict on {wrong}", lambda: found(wrong))


@pytest.mark.parametrize("wrong", few_of(["a spring", "gravity", "a sign", "a zero"], "a spring"))
def test_a_wrong_model_is_never_praised(identified, wrong):
    assert PRAISE not in str(identified(wrong).verdict)


@pytest.mark.parametrize("terms", few_of(["Fc,Fv,Fo", "Fc,Fv,Fo,Ia"], "Fc,Fv,Fo"))
def test_an_arm_whose_rotors_are_missing_is_not(tmp_path, terms):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    arm = loopid.load(path)
    motion = wander(arm, 4, 12.0, 50.0, size=(0.8, 0.8))
    truth = JointTerms.with_values(arm, "Fc=0.5,Fv=0.5,Ia=0.3")
    run = record(arm, motion, truth, scaled_bodies(arm, 0.2), 0.02)
    found = quietly(identify, loopid.force_model(arm, "full", terms), [run])
    assert (PRAISE in str(found.verdict)) == ("Ia" in terms)


@pytest.mark.validate
@pytest.mark.parametrize("length", few_of(["0.24", "0.2448"], "0.2448"))
def test_a_robot_whose_length_is_off_by_two_percent_is_not(tmp_path, robot, length):
    """Its errors are above the noise of the sensors, as the log has it."""
    for path in (robot.path, robot.path.with_suffix(".urdf")):
        text = path.read_text().replace('xyz="0.24 0 0"', f'xyz="{length} 0 0"')
        (tmp_path / path.name).write_text(text)
    motion = wander(robot, 4, 12.0, 50.0, size=(0.5, 0.5))
    terms = JointTerms.with_values(robot, "Fc=0.1,Fv=0.05")
    read = simulated(robot, motion, Noise(gaussian=0.01), 0, scaled_bodies(robot, 0.2), terms)
    log = Log.from_arrays(read.time, read.position, read.force, robot.actuated)
    other = loopid.load(tmp_path / robot.path.name)
    run = quietly(loopid.prepare, other, log)
    in_time = FitOptions(undo_delay=False)
    found = quietly(identify, loopid.force_model(other, "full"), [run], options=in_time)
    assert (PRAISE in str(found.verdict)) == (length == "0.24")


def test_a_right_one_is(identified):
    found = identified()
    assert PRAISE in str(found.verdict)
    assert not any("changes its sign" in each.title for each in found.findings)
    # Its error is the worst of all looks, and no look is far from another.
    shares = np.array(list(found.unseen.shares.values()))
    assert found.verdict.error == pytest.approx(np.nanmax(shares))
    assert np.nanmax(shares) < 2 * np.nanmin(shares)
    # What is saved, drawn and exported knows them.
    rms = found["consistent"].fit.unseen_rms
    assert (rms >= found["consistent"].validation.residual_rms).all()


def test_it_says_below_which_speed_friction_is_unknown(identified):
    found = identified()
    use = found.fit.use
    assert found.verdict.slowest == max(use.slowest / use.fastest) > 0
    part = loopid.numbers.number(100 * found.verdict.slowest, 1)
    assert f"below {part} % of a motor's top speed" in str(found.verdict)
    none = replace(found.verdict, slowest=0.0)
    assert "top speed" not in str(none)


@pytest.fixture(scope="module")
def rubbing(robot, once):
    """What a robot with much friction identifies, and that friction."""
    known = JointTerms.with_values(robot, "Fc=1,Fv=0.05")
    run = record(robot, wander(robot, 4, 12.0, 50.0, size=(0.5, 0.5)), known, noise=0.01)
    return once("fit of much friction", lambda: quietly(identify, robot, [run])), known


def test_it_says_what_errors_may_be_at_speeds_below(robot, rubbing):
    """Friction that rises there by half is within two deviations; the log shows none of it."""
    found, known = rubbing
    slow = wander(robot, 5, 600.0, 2.0, size=(0.5, 0.5))
    risen = 0.5 * np.exp(-((slow.velocities / 0.02) ** 2)) * np.sign(slow.velocities)
    force = record(robot, slow, known, noise=0.01).force + risen
    prediction = found.fit.predict(Recording.of_motion(slow, force, robot.actuated))
    error = (prediction.moving.residual_rms / found.unseen.force).max()
    assert error > 2 * found.verdict.error
    assert found.verdict.error < found.verdict.slow_error < error < 2 * found.verdict.slow_error
    said = f"errors may be {loopid.numbers.number(100 * found.verdict.slow_error, 2)} % there"
    assert said in str(found.verdict)


def test_the_band_holds_what_friction_holds_while_motors_stand(robot, rubbing):
    """Anything up to breakaway, by chance another at each stop; and no more than twice that."""
    found, known = rubbing
    rng = np.random.default_rng(0)
    _, middle = centre(robot)
    points = middle + rng.uniform(-0.4, 0.4, size=(30, 2))
    ways = [Waypoint(point, seconds=s) for point in points for s in (0.6, 0.6)]
    motion = joint_motion(robot, point_to_point(robot.measured, middle, ways, rate=200.0))
    read = simulated(robot, motion, Noise(gaussian=0.01), 0, None, known)
    stands = np.abs(motion.velocities).max(axis=1) < 1e-9
    stops = np.cumsum(np.diff(stands, prepend=False)) * stands
    held = rng.uniform(-1, 1, size=(stops.max() + 1, 2))[stops] * stands[:, None]
    log = Log.from_arrays(read.time, read.position, read.force + held, robot.actuated)
    prediction = found.fit.predict(quietly(loopid.prepare, robot, log))
    at = np.interp(prediction.recording.motion.time, read.time, stands) == 1
    at &= ~prediction.recording.used.any(axis=1)
    inside = np.abs(prediction.residual) <= prediction.reach
    assert at.sum() > 100
    assert (inside[at].mean(axis=0) > 0.95).all()
    assert (prediction.inside > 0.95).all()
    assert (prediction.reach[at] < 2.5).all()
    assert np.median(prediction.reach[prediction.recording.resting < 1e-3]) < 0.1


def test_it_says_which_speeds_and_accelerations_were_seen(identified):
    """By unit, of the slowest motor and the fastest; of one that stands, none."""
    found = identified()
    run, used = found.training[0], found.data.used.copy()
    ends = [
        np.percentile(np.abs(each), 99, axis=0)
        for each in (run.motion.velocities, run.motion.accelerations)
    ]

    def said(motors):
        numbers = (" to ".join(f"{x:.2g}" for x in sorted(each[motors])) for each in ends)
        return "{} rad/s and {} rad/s²".format(*numbers)

    assert f"Motors reached {said([0, 1])}." in str(found.verdict)
    used[:, 1] = False
    standing = replace(found, data=replace(found.data, used=used))
    assert standing.verdict.reached == said([0])


def test_errors_that_are_those_of_the_file_are_neither_smaller_nor_larger(identified):
    """As of one motor in line, whose body and rotor are one: the rest is round-off."""
    verdict = identified().verdict
    same = "Over all motors they are as large as with the given bodies."
    assert same not in str(verdict)
    assert "smaller than with the given bodies" in str(verdict)
    for ratio in (1 + 1e-14, 1 - 1e-14, 1.005):
        assert same in str(replace(verdict, ratio=(ratio, 1e-14)))


def test_a_motor_that_never_moves_is_named_first(identified):
    found = identified()
    used = found.data.used.copy()
    used[:, 1] = False
    standing = replace(found, data=replace(found.data, used=used))
    motor = found.data.actuators[1]
    assert f"with {motor} at standstill" in standing.verdict.use
    assert standing.findings[0].title == f"{motor} never moves"
    assert not any("never moves" in each.title for each in found.findings)


def test_forces_of_a_single_move_are_not_praised(identified):
    """However small errors are: what judges the fit is of the same move."""
    found = identified()
    rates = found.training[0].motion.velocities[:, 1]
    used = found.data.used.copy()
    longest = max(
        np.split(np.arange(len(rates)), np.flatnonzero(np.diff(np.sign(rates))) + 1), key=len
    )
    used[np.setdiff1d(np.arange(len(rates)), longest), 1] = False
    once = replace(found, data=replace(found.data, used=used))
    motor = found.data.actuators[1]
    said = f"Not fit for use beyond its own moves, as {motor} moves only once"
    assert once.verdict.use == said
    assert once.verdict.forces == "no"
    assert "moves to and fro" in once.verdict.improvement
    # New data judge what they have.
    judged = replace(once, validation=found.training)
    assert judged.verdict.use != said


def of_a_drive(robot, lacking, seed=4):
    """Forces without what the drive of the left crank adds in proportion to its speed."""
    motion = wander(robot, seed, 6.0, 50.0, size=(0.5, 0.5))
    run = record(robot, motion, JointTerms.with_values(robot, "Fc=3,Fv=0.05"), noise=0.01)
    force = run.force.copy()
    force[:, 0] -= lacking * motion.velocities[:, robot.joint("left_crank_joint").idx_v]
    return Recording.of_motion(motion, force, robot.actuated)


TURNING = "friction of left_crank_joint changes its sign with speed"


@pytest.mark.validate
@pytest.mark.parametrize("lacking", [0.0, 12.0])
def test_a_force_without_what_the_drive_adds_in_proportion_to_speed_is_named(robot, lacking):
    """Its friction brakes at low speed and drives at high speed, as none does."""
    model = loopid.force_model(robot, "full", "Fc,Fv")
    found = quietly(identify, model, [of_a_drive(robot, lacking)])
    assert (TURNING in [each.title for each in found.findings]) == (lacking > 0)
    assert ("log the whole force" in str(found.verdict)) == (lacking > 0)
    # Terms that are chosen by name are friction, which does not drive.
    assert found.fit["left_crank_joint.Fv"].value >= 0


def test_default_terms_hold_what_the_drive_adds(robot, tmp_path):
    """Another motion is predicted, and the other motor's friction is right; none is exported."""
    found = quietly(identify, loopid.force_model(robot, "full"), [of_a_drive(robot, 12.0)])
    fit, other = found.fit, of_a_drive(robot, 12.0, seed=5)
    assert fit.turning == ("left_crank_joint",)
    assert (fit.predict(other).moving.residual_rms < 1.5 * 0.01).all()
    assert fit["left_crank_joint.Fc"].value == pytest.approx(3, rel=0.02)
    assert fit["left_crank_joint.Fv"].value == pytest.approx(0.05 - 12, rel=0.02)
    assert fit["right_crank_joint.Fc"].value == pytest.approx(3, rel=0.02)
    assert str(found.verdict).startswith(f"Not fit for use, as {TURNING}")
    assert TURNING in [each.title for each in found.findings]
    fit.save(tmp_path / "fit.yaml")
    saved = loopid.load_fit(tmp_path / "fit.yaml", robot)
    for each in (fit, saved):
        with pytest.raises(OptionError, match=r"left_crank_joint would drive.*whole force"):
            each.to_c(tmp_path / "c")


def test_a_fit_that_is_not_at_its_best_is_not(identified):
    found = identified()
    best = found["consistent"]
    unsettled = replace(best, fit=replace(best.fit, settled=False))
    found = replace(found, candidates={**found.candidates, "consistent": unsettled})
    assert PRAISE not in str(found.verdict)
    assert any("not at its best" in each.title and each.do for each in found.findings)


def test_errors_are_looked_at_where_they_are_worst(identified):
    """Of forces with more noise in a segment and at low speed, and that are off at standstill."""
    found = identified()
    run, new, rng = found.training[0], found.new, np.random.default_rng(0)
    rates = np.abs(run.motion.velocities)
    slow = rates <= np.percentile(rates, 10, axis=0)
    late = np.arange(len(run))[:, None] >= 0.8 * len(run)

    def looked(rows, used=new.used, scale=0.5, off=0.0):
        force = new.force + np.where(rows, off + rng.normal(scale=scale, size=used.shape), 0.0)
        samples = replace(new, force=force, used=used)
        return UnseenErrors.of(found.recommended, samples, [run])

    assert looked(late).worst[0] == "part"
    assert looked(slow).worst[0] == "slow"
    standing = looked(slow, new.used & ~slow, 0.01, 1.0)
    assert standing.worst[0] == "standstill"
    # A force that changes while nothing moves is carried by friction, or a brake.
    braked = looked(slow, new.used & ~slow)
    assert (braked.standstill < 0.5 * standing.standstill).all()
    # Breakaway is no error: a force may be anything up to it.
    held = replace(new, used=new.used & ~slow)
    alone = UnseenErrors.of(found.recommended, held, [run])
    assert (alone.standstill < 0.05).all()


@pytest.mark.parametrize("stronger", ["Fc+", "Fc-"])
def test_breakaway_is_that_of_the_stronger_direction(load_once, stronger):
    robot = load_once("five_bar")
    model = loopid.force_model(robot, "full", loopid.JointTerms(robot.actuated, ("Fc+", "Fc-")))
    values = np.array(model.prior)
    for column in model.joint_columns:
        values[column] = 0.5 if model.parameters[column].kind == stronger else 0.1
    run = loopid.prepare(robot, loopid.read_log("urdf/logs/five_bar.csv", robot, rows=(1, 800)))
    samples, rates = model.samples(run), np.abs(run.motion.velocities)
    slow = rates <= 0.04 * np.percentile(rates, 99, axis=0)
    bodies = np.where(np.isin(np.arange(len(values)), model.joint_columns), 0.0, values)
    held = np.where(slow, 0.4, samples.predicted(values) - samples.predicted(bodies))
    new = replace(samples, force=samples.predicted(bodies) + held, used=~slow)
    fit = loopid.Fit.of(model, values)
    judged = loopid.identification.judge(fit, new, new, name="all", against=fit)
    found = UnseenErrors.of(judged, new, [run]).standstill
    assert np.isfinite(found).any()
    assert np.nanmax(found) < 1e-6


@pytest.mark.parametrize(
    "wrong",
    few_of(["nothing", "a spring", "gravity", "a sign", "a zero"], "nothing", "a spring"),
)
def test_findings_are_two_lines_at_most_the_most_important_first(identified, wrong):
    found = identified(wrong)
    assert found.findings
    order = [SEVERITIES.index(each.severity) for each in found.findings]
    assert order == sorted(order)
    for each in found.findings:
        assert len(f"{each.severity}: {each.title}") <= 80
        assert len(each.title.split()) <= 8
        assert len(f"{each.severity}: {each.brief}") <= 2 * 80


@pytest.mark.parametrize("steps", few_of([1, 20], 1))
def test_a_force_in_coarse_steps_is_named_and_no_cause_in_the_robot(robot, steps):
    """Nine of ten samples below a step are 0; of 20 steps none says so."""
    log = loopid.read_log("urdf/logs/five_bar.csv", robot)
    step, force = np.percentile(np.abs(log.force[:, 1]), 90) / steps, log.force.copy()
    force[:, 1] = step * np.trunc(force[:, 1] / step)
    coarse = replace(log, force=force)
    found = quietly(identify, robot, coarse, options=FitOptions(undo_delay=False))
    said = [each for each in found.findings if "coarse steps" in each.title]
    assert len(said) == (steps == 1)
    for each in said:
        assert robot.actuated[1] in each.title
        assert each.do == found.verdict.improvement
        part = float(each.why.split(" % of the samples")[0].split()[-1])
        assert 85 < part <= 100
        causes = [one for one in found.findings if "not explained" in one.title]
        assert not any(robot.actuated[1] in one.title for one in causes)


@pytest.mark.parametrize("model", few_of(["gravity", "full"], "full"))
def test_a_log_of_a_standstill_is_fit_for_nothing(robot, model, tmp_path):
    """However small its errors are beside the weight that the motors hold all along."""
    time, rng = np.arange(0, 10, 0.02), np.random.default_rng(0)
    u = np.tile([2.09, 0.71], (len(time), 1))
    force = loopid.Dynamics(robot).gravity(u) + 0.1 * rng.normal(size=u.shape)
    log = Log.from_arrays(time, u + 1e-6 * rng.normal(size=u.shape), force, robot.actuated)
    found = quietly(identify, robot, log, options=FitOptions(model=model, undo_delay=False))
    verdict = found.verdict
    assert verdict.error < 0.1
    assert verdict.use == "Not fit for use, as no force follows the motion"
    assert verdict.forces == "no"
    assert "record a motion in which the forces change" in str(verdict)
    assert [each.title for each in found.findings].count("no force follows the motion") == 1
    saved = tmp_path / "fit.yaml"
    for kept in (found.fit, found["all parameters"].fit):
        for use in (kept.save, partial(kept.to_robot_file, overwrite=True), kept.to_c):
            with pytest.raises(OptionError, match=r"not fit for use, as no force .*: record a mot"):
                use(saved.with_suffix(".yaml" if use == kept.save else ".urdf"))
    found.fit.save(saved, anyway=True)
    with pytest.raises(OptionError, match="no force follows the motion"):
        loopid.load_fit(saved).to_c(tmp_path)


def test_singular_poses_are_why_a_log_is_not_fit(identified):
    found = identified("a spring")
    singular = Finding("warning", "the motion passes singular poses", "", "move elsewhere")
    faults = (replace(found.log_faults[0], mistakes=(), singular=singular),)
    found = replace(found, log_faults=faults)
    assert singular in found.findings
    half = replace(found.unseen, whole=found.unseen.force / 2, standstill=found.unseen.force)
    object.__setattr__(found, "unseen", half)  # as a cached property does
    assert str(found.verdict).startswith("Not fit for use, as the motion passes singular poses. ")
    assert "Next: move elsewhere" in str(found.verdict)


def test_a_push_is_named_with_its_time(identified):
    found = identified("a spring")
    assert found.outstanding is None  # it errs all along
    data, time = found.data, found.training[0].motion.time
    pushed = (time > 4.0) & (time < 4.5)
    force = data.force + 3.0 * np.outer(pushed, [0.0, 1.0])
    burst = outstanding(found.fit, replace(data, force=force), found.training)
    assert burst.motor == "right_crank_joint"
    assert 4.0 < burst.start < burst.end < 4.5
    found = replace(found)
    object.__setattr__(found, "outstanding", burst)  # as a cached property does
    said = "errors of right_crank_joint stand out between 4.0"
    assert any(each.title.startswith(said) for each in found.findings)
    assert "look at what happened then" in str(found.verdict)
