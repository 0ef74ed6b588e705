"""Logs of robots whose base floats: its pose is measured, and the wrenches of its feet."""

from dataclasses import replace

import numpy as np
import pytest

import loopid
from floating_robots import BASE, FEET, biped, walk
from linkages import rssr
from loopid import JointTerms, Log, read_log
from loopid.errors import DataError, DataWarning, LogError, OptionError
from loopid.identification.fitting import quiet_fit
from loopid.logs import FilterOptions, LogMapping
from made_runs import identify_unjudged, quietly

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

UNFILTERED = FilterOptions(cutoff=None)
FRICTION = [1.0, 2.0, 1.5, 3.0]


@pytest.fixture(scope="module")
def model(load_files):
    robot = load_files(*biped())
    return loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Fc", "Fv")))


@pytest.fixture(scope="module")
def truth(model):
    return model.base.values(np.append(model.robot.standard_parameters(), FRICTION))


@pytest.fixture(scope="module")
def walked(model, truth):
    return walk(model, truth)


def log_of(robot, run, **changes):
    given = {"free": {BASE: run.pose}, "wrenches": run.wrenches, **changes}
    log = Log.from_arrays(
        run.motion.time, run.position, run.force, robot.actuated, idle_speed=0.0, **given
    )
    return replace(log, checked=True)  # its limits are no matter


@pytest.fixture(scope="module")
def recording(model, walked):
    return loopid.prepare(model.robot, log_of(model.robot, walked), filter=UNFILTERED)


def test_the_motion_is_that_of_base_and_motors(recording, walked):
    motion, true = recording.motion, walked.motion
    np.testing.assert_allclose(motion.configurations, true.configurations, atol=1e-9)
    inside = slice(4, -4)
    # Differences of fourth order at 100 Hz; at the ends they are one-sided.
    for found, wanted, off in (
        (motion.velocities, true.velocities, 1e-4),
        (motion.accelerations, true.accelerations, 1e-3),
    ):
        np.testing.assert_allclose(found[inside], wanted[inside], atol=off)


def test_feet_carry_the_base(recording, model, truth):
    """No motor acts on it, and the wrenches are what it needs."""
    assert recording.used.all()
    np.testing.assert_array_equal(recording.motor_force[:, 2:], 0)
    predicted = model.regressor(recording.motion) @ truth
    inside = slice(3, -3)
    size = np.abs(predicted[:, 2:]).max()
    np.testing.assert_allclose(predicted[inside], recording.force[inside], atol=0.01 * size)


def test_parameters_from_noisy_sensors(model, truth, walked):
    """Also those that only the base feels, such as the mass of the whole."""
    robot, generator = model.robot, np.random.default_rng(0)

    def noisy(values, scale):
        return values + generator.normal(scale=scale, size=values.shape)

    run = replace(
        walked,
        force=noisy(walked.force, 0.3),
        wrenches=[replace(one, values=noisy(one.values, 0.3)) for one in walked.wrenches],
        pose=noisy(walked.pose, 1e-6),
    )
    found = quiet_fit(model.samples(quietly(loopid.prepare, robot, log_of(robot, run))))
    off = (found.values - truth) / found.standard_errors
    assert np.sqrt(np.mean(off**2)) < 2
    assert np.abs(off).max() < 5
    assert (found.standard_errors[:3] < 0.1 * np.abs(truth).max()).all()
    bare = quietly(loopid.prepare, robot, log_of(robot, run, wrenches=()))
    lost = quiet_fit(model.samples(bare))
    assert np.abs((lost.values - truth) / found.standard_errors).max() > 50


@pytest.mark.validate
def test_an_identification_of_a_robot_on_its_feet(model):
    """Bodies that are not those of the file, from what sensors tell, with intervals."""
    robot, generator = model.robot, np.random.default_rng(5)
    heavier = robot.standard_parameters() * 1.3
    run = walk(model, model.base.values(np.append(heavier, FRICTION)))
    noisy = replace(run, force=run.force + generator.normal(scale=0.3, size=run.force.shape))
    recording = quietly(loopid.prepare, robot, log_of(robot, noisy))
    found = identify_unjudged(model, recording)
    judged = found.candidates["all parameters"].validation
    sizes = np.sqrt(np.mean(recording.force**2, axis=0))
    assert (np.array(judged.residual_rms) < 0.1 * sizes).all()
    (mass,) = (k for k, p in enumerate(model.parameters) if p.label == "left.m")
    assert found.fit.values[mass] == pytest.approx(
        model.base.values(np.append(heavier, FRICTION))[mass], rel=0.02
    )


def test_quaternions_may_change_their_sign(model, walked, recording):
    pose = walked.pose.copy()
    pose[::3, 3:] *= -1
    log = log_of(model.robot, walked, free={BASE: pose})
    again = loopid.prepare(model.robot, log, filter=UNFILTERED)
    np.testing.assert_allclose(again.force, recording.force, atol=1e-9)
    assert np.abs(np.diff(again.motion.velocities, axis=0)).max() < 0.1


def test_without_wrenches_it_counts_as_flying(model, walked):
    log = log_of(model.robot, walked, wrenches=())
    with pytest.warns(DataWarning, match="free flight"):
        loopid.prepare(model.robot, log, filter=UNFILTERED)


WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
COLUMNS = ["px", "py", "pz", "qx", "qy", "qz", "qw"]


@pytest.fixture
def text(model, walked):
    motors = model.robot.actuated
    names = [f"{motor}.{kind}" for kind in ("position", "force") for motor in motors]
    wrenches = [f"w{k}_{axis}" for k in range(2) for axis in WRENCH]
    header = ["time", *names, "px [mm]", *COLUMNS[1:], *wrenches]
    rows = np.hstack(
        [
            walked.motion.time[:, None],
            walked.position,
            walked.force,
            walked.pose * [1e3, *[1] * 6],
            *(one.values for one in walked.wrenches),
        ]
    )[:400]
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    return "\n".join([",".join(header), *lines, ""])


def test_a_file_names_the_columns_of_the_pose(model, walked, text, write_text):
    wrenches = [
        {
            "frame": foot,
            "columns": [f"w{k}_{axis}" for axis in ("Fx", "Fy", "Fz", "Mx", "My", "Mz")],
        }
        for k, foot in enumerate(FEET)
    ]
    mapping = LogMapping(free={BASE: COLUMNS}, wrenches=wrenches, idle_speed=0.0)
    log = quietly(read_log, write_text(text), model.robot, mapping=mapping)
    np.testing.assert_allclose(log.free[BASE], walked.pose[:400], atol=1e-9)
    read = loopid.prepare(model.robot, log, filter=UNFILTERED)
    assert read.wrenches == FEET
    with pytest.raises(LogError, match="qw"):
        read_log(write_text(text), model.robot, mapping=LogMapping(free={BASE: COLUMNS[:6]}))


@pytest.mark.parametrize(
    ("free", "error", "said"),
    [
        ({}, OptionError, "measure root_joint"),
        ({"left_joint": "angle"}, OptionError, "unknown free joint"),
        ({BASE: "angle"}, DataError, "shape"),
        ({BASE: "twice"}, DataError, "no unit quaternion"),
    ],
)
def test_what_does_not_tell_where_the_base_is(model, walked, free, error, said):
    values = {"angle": walked.position[:, 0], "twice": 2 * walked.pose}
    given = {name: values[which] for name, which in free.items()}

    def prepare():
        log = log_of(model.robot, walked, free=given)
        loopid.prepare(model.robot, log, filter=UNFILTERED)

    with pytest.raises(error, match=said) as failure:
        prepare()
    assert "\n" not in str(failure.value)


def test_the_spin_of_a_rod_cannot_be_measured(load_files):
    robot = load_files(*rssr("SPHERICAL"))
    time = np.arange(50) / 10
    log = Log.from_arrays(time, np.sin(time), np.cos(time), robot.actuated)
    with pytest.raises(OptionError, match="lock them") as failure:
        loopid.prepare(robot, log)
    assert "measure" not in str(failure.value)


def test_a_passive_joint_may_have_an_encoder(load_files):
    """One leg of the biped swings free, and its angle is measured."""
    parts, description = biped()
    robot = load_files(parts, description | {"name_mot": ["left_joint"]})
    assert len(robot.free) == 7
    time = np.arange(0, 4, 0.01)
    start = robot.reference[[robot.joint(name).idx_q for name in robot.measured]]
    angles = start + 0.2 * np.sin(np.stack([time, 1.3 * time], axis=1))
    pose = np.tile([0, 0, 1.0, 0, 0, 0, 1], (len(time), 1))
    (other,) = (name for name in robot.measured if name not in robot.actuated)
    log = Log.from_arrays(
        time, angles[:, :1], np.cos(time), robot.actuated, free={BASE: pose, other: angles[:, 1]}
    )
    found = quietly(loopid.prepare, robot, log, filter=UNFILTERED)
    index = robot.joint(other).idx_q
    rows = np.isin(time, found.motion.time)
    np.testing.assert_allclose(found.motion.configurations[:, index], angles[rows, 1], atol=1e-9)
