"""Wrenches of the surroundings: their power, and the ways in which they are read."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from simulated_logs import EPOCH, table

import loopid
from loopid import ExternalWrench, Log, random_configurations
from loopid.errors import DataError, LogError, OptionError
from loopid.kinematics import closed_motion, random_motions
from loopid.kinematics.poses import integrate
from loopid.logs import LogMapping, read_log, wrench_forces
from loopid.logs.preparing import prepare_again

COUNT, STEP = 6, 1e-6
POINT = (0.3, -0.2, 0.5)
PLACES = {
    "knee": ("3ups_rpu", "platform"),
    "crank": ("five_bar", "right_coupler"),
    "rotating": ("6ups", "leg6_rod"),
}


def placed(robot, q, frame):
    """Where a frame is, by Pinocchio alone."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return data.oMf[robot.model.getFrameId(frame)]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("axes", "about"), [("frame", None), ("world", None), ("world", POINT)])
def test_the_power_is_that_of_the_moving_frame(load_once, place, axes, about):
    """Force and moment times the velocity of the frame, from two poses a moment apart."""
    name, frame = PLACES[place]
    robot, rng = load_once(name), np.random.default_rng(1)
    q = random_configurations(robot, COUNT, seed=2)
    rates, _ = random_motions(robot, COUNT, seed=3)
    values = rng.normal(size=(COUNT, 6))
    forces = wrench_forces(robot, q, [ExternalWrench(frame, values, axes, about)])
    v = closed_motion(robot, q, rates, np.zeros_like(rates)).velocities
    before, after = (integrate(robot, q, sign * STEP * v) for sign in (-1, 1))
    for k in range(COUNT):
        here = placed(robot, q[k], frame)
        first, last = placed(robot, before[k], frame), placed(robot, after[k], frame)
        turn = pin.log3(last.rotation @ first.rotation.T) / (2 * STEP)
        point = here.translation if about is None else np.array(about)
        # The velocity of the body's point where the moment is told about.
        speed = (last.translation - first.translation) / (2 * STEP)
        speed += np.cross(turn, point - here.translation)
        force, moment = values[k, :3], values[k, 3:]
        if axes == "frame":
            force, moment = here.rotation @ force, here.rotation @ moment
        power = force @ speed + moment @ turn
        assert forces[k] @ rates[k] == pytest.approx(power, rel=1e-6, abs=1e-7)


def test_wrenches_add_up(knee):
    q = random_configurations(knee, COUNT, seed=2)
    values = np.random.default_rng(1).normal(size=(2, COUNT, 6))
    both = [ExternalWrench("platform", values[0]), ExternalWrench("leg1_stem", values[1], "world")]
    one_by_one = sum(wrench_forces(knee, q, [one]) for one in both)
    np.testing.assert_allclose(wrench_forces(knee, q, both), one_by_one, atol=1e-12)
    assert not wrench_forces(knee, q, []).any()


# ---- from files -------------------------------------------------------------------------------


@pytest.fixture
def loads(truth):
    """A wrench on the platform that changes slowly."""
    phase = 0.4 * truth.time[:, None] + np.arange(6)
    return np.array([40, 30, 400, 8, 6, 4]) * np.sin(phase)


@pytest.fixture
def with_loads(truth, knee, loads):
    """Text of a log with force and moment in other units, of the robot on the plate."""
    text = table(truth.time, truth.position, truth.force, knee.actuated)
    names = [f"F{axis} [kN]" for axis in "xyz"] + [f"M{axis} [N mm]" for axis in "xyz"]
    header, *rows = text.splitlines()
    units = np.array([1e-3] * 3 + [1e3] * 3)
    cells = [",".join(map(repr, row)) for row in (units * loads).tolist()]
    rows = [f"{row},{more}" for row, more in zip(rows, cells, strict=True)]
    return "\n".join([f"{header},{','.join(names)}", *rows, ""])


COLUMNS = [f"F{axis}" for axis in "xyz"] + [f"M{axis}" for axis in "xyz"]


def test_columns_of_a_wrench_are_read_in_their_units(knee, with_loads, loads, write_text, tmp_path):
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(f"wrenches:\n  - {{frame: platform, columns: [{', '.join(COLUMNS)}]}}\n")
    (wrench,) = read_log(write_text(with_loads), knee, mapping=mapping).wrenches
    assert (wrench.frame, wrench.axes, wrench.about) == ("platform", "frame", None)
    np.testing.assert_allclose(wrench.values, loads, atol=1e-9)


def test_a_force_plate_measures_what_the_robot_exerts(knee, with_loads, loads, write_text):
    scale = [-1e3] * 3 + [-1e-3] * 3
    plate = {"frame": "platform", "columns": COLUMNS, "axes": "world", "about": POINT}
    mapping = LogMapping(wrenches=[{**plate, "scale": scale, "offset": 2.0}])
    (wrench,) = read_log(write_text(with_loads), knee, mapping=mapping).wrenches
    assert (wrench.axes, wrench.about) == ("world", POINT)
    np.testing.assert_allclose(wrench.values, 2.0 - loads, atol=1e-9)


def test_a_wrench_in_a_stream_of_its_own_rate(knee, truth, loads, write_folder):
    stamps = EPOCH * 10**9 + np.round(1e9 * truth.time).astype(np.int64)
    every = slice(0, None, 4)
    folder = write_folder(
        position=(stamps, truth.position),
        force=(stamps, truth.force),
        plate=(stamps[every], loads[every]),
    )
    mapping = LogMapping(wrenches=[{"frame": "platform", "stream": "plate"}])
    log = read_log(folder, knee, mapping=mapping)
    # Interpolated on lines, over 40 ms.
    bound = 400 * 0.4**2 * 0.04**2 / 8
    assert np.abs(log.wrenches[0].values - loads[: len(log)]).max() < bound


@pytest.mark.parametrize(
    ("given", "error", "named"),
    [
        ({"frame": "plattform", "columns": COLUMNS}, OptionError, "plattform"),
        ({"frame": "base", "columns": COLUMNS}, OptionError, "base"),
        ({"frame": "platform", "columns": COLUMNS[3:] + COLUMNS[:3]}, LogError, "Mx [N mm]"),
        ({"frame": "platform", "columns": [*COLUMNS[:5], "Mw"]}, LogError, "Mw"),
        ({"frame": "platform", "columns": [*COLUMNS[:5], "Fx"]}, LogError, "Fx [kN]"),
        ({"frame": "platform", "stream": "log"}, LogError, "wrench on platform"),
    ],
)
def test_wrenches_that_are_none_are_refused(knee, with_loads, write_text, given, error, named):
    with pytest.raises(error) as refusal:
        read_log(write_text(with_loads), knee, mapping=LogMapping(wrenches=[given]))
    assert named in str(refusal.value)


@pytest.mark.parametrize(
    "given",
    [
        {"columns": COLUMNS},
        {"frame": "platform"},
        {"frame": "platform", "columns": COLUMNS[:5]},
        {"frame": "platform", "columns": COLUMNS, "axes": "plate"},
        {"frame": "platform", "columns": COLUMNS, "scale": [1.0, 2.0]},
        {"frame": "platform", "columns": COLUMNS, "about": [0.0, 1.0]},
    ],
)
def test_mappings_of_wrenches_are_checked(given):
    with pytest.raises(OptionError, match="wrenches"):
        LogMapping(wrenches=[given])


# ---- in logs and recordings -------------------------------------------------------------------


def test_logs_of_arrays_hold_wrenches(knee, truth, loads):
    given = truth.time, truth.position, truth.force, knee.actuated
    wrench = ExternalWrench("platform", loads)
    even = Log.from_arrays(*given, wrenches=[wrench])
    assert even.wrenches == (wrench,)
    good = np.arange(len(even)) % 300 > 0
    np.testing.assert_array_equal(even.select(good).wrenches[0].values, loads[good])
    # Uneven samples are put on the grid, all alike.
    rows = np.flatnonzero(np.random.default_rng(0).uniform(size=len(even)) < 0.9)
    picked = (values[rows] for values in given[:3])
    uneven = Log.from_arrays(*picked, knee.actuated, wrenches=[replace(wrench, values=loads[rows])])
    exact = [np.interp(uneven.time, truth.time, column) for column in loads.T]
    np.testing.assert_allclose(uneven.wrenches[0].values, np.transpose(exact), atol=2e-2)
    with pytest.raises(DataError, match="wrench on platform"):
        Log.from_arrays(*given, wrenches=[replace(wrench, values=loads[:-1])])


def test_recordings_hold_and_tell_the_wrenches(knee, truth, loads):
    """The force that comes out is that of the motors and G^T J^T w of the same filtered samples."""
    given = truth.time, truth.position, truth.force, knee.actuated
    wrenches = [
        ExternalWrench("platform", loads),
        ExternalWrench("leg1_stem", 0.1 * loads, "world"),
    ]
    bare = loopid.prepare(knee, Log.from_arrays(*given))
    full = loopid.prepare(knee, Log.from_arrays(*given, wrenches=wrenches))
    assert full.wrenches == ("platform", "leg1_stem")
    assert "with wrenches on platform, leg1_stem" in repr(full)
    np.testing.assert_allclose(full.motor_force, bare.force, atol=1e-9)
    rows = np.searchsorted(truth.time, full.motion.time - 1e-6)
    slow = [replace(one, values=one.values[rows]) for one in wrenches]
    exact = wrench_forces(knee, full.motion.configurations, slow)
    assert np.abs(full.external - exact).max() < 1e-3 * np.abs(exact).max()
    np.testing.assert_allclose(prepare_again(knee, [full])[0].external, full.external, rtol=1e-9)
    part = full.select(slice(10, 20))
    np.testing.assert_array_equal(part.external, full.external[10:20])
    assert bare.external is None
    np.testing.assert_array_equal(bare.motor_force, bare.force)
