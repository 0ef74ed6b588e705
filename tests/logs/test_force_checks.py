"""Forces that belong to another motor, point the other way or are in other units are noticed."""

import itertools
import warnings
from dataclasses import replace

import numpy as np
import pytest
from logged_runs import LOGS

from loopid.errors import AssemblyError, LogWarning
from loopid.logs import Recording, checks, prepare_recording, read_log


def check_forces(robot, recording):
    checks.check_forces(robot, recording.name, recording.motion, recording.force, recording.used)


@pytest.fixture(scope="module")
def simulated(knee, truth):
    return Recording.of_motion("run", knee.actuated, truth.motion, truth.force)


@pytest.fixture(scope="module")
def logged(mechanism, shared):
    folder = shared / "data" / "upv" / "logs" / LOGS[mechanism.name]
    return prepare_recording(mechanism, read_log(folder, mechanism))


PAIRS = list(itertools.combinations(range(4), 2))


def exchanged(recording, pair):
    order = np.arange(4)
    order[list(pair)] = pair[::-1]
    return replace(recording, force=recording.force[:, order])


@pytest.mark.parametrize("pair", PAIRS)
def test_exchanged_forces_of_a_simulation(knee, simulated, pair):
    names = ", ".join(knee.actuated[k] for k in pair)
    with pytest.warns(LogWarning, match=f"run: the forces or positions of {names} look exchanged"):
        check_forces(knee, exchanged(simulated, pair))


@pytest.mark.parametrize("pair", PAIRS)
def test_exchanged_forces_of_the_real_robots(mechanism, logged, pair):
    with pytest.warns(LogWarning, match="look exchanged"):
        check_forces(mechanism, exchanged(logged, pair))


def test_forces_in_order_pass(knee, simulated, mechanism, logged):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_forces(knee, simulated)
        check_forces(mechanism, logged)


@pytest.mark.parametrize("joint", range(4))
def test_a_turned_sign(mechanism, logged, joint):
    force = logged.force.copy()
    force[:, joint] *= -1
    name = mechanism.actuated[joint]
    with pytest.warns(LogWarning, match=f"the force of {name} points the other way"):
        check_forces(mechanism, replace(logged, force=force))


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_another_unit(mechanism, logged, factor):
    with pytest.warns(LogWarning, match="times as large as the robot file predicts .* kN, mN or V"):
        check_forces(mechanism, replace(logged, force=factor * logged.force))


def test_a_close_call_is_none(knee, simulated, monkeypatch):
    # Each of two forces holds a little more of the other motor's than of its own.
    force = simulated.force.copy()
    own, other = force[:, 0] / force[:, 0].std(), force[:, 1] / force[:, 1].std()
    force[:, 0], force[:, 1] = 0.45 * own + 0.55 * other, 0.55 * own + 0.45 * other
    mixed = replace(simulated, force=force)
    check_forces(knee, mixed)
    monkeypatch.setattr(checks, "CLEARLY_BETTER", 1.0)
    with pytest.warns(LogWarning, match="leg1_stroke, leg2_stroke look exchanged"):
        check_forces(knee, mixed)


def test_few_samples_prove_nothing_and_that_is_said(knee, simulated):
    rows = np.zeros(len(simulated), dtype=bool)
    rows[100:125] = True
    few = exchanged(simulated.select(rows), (0, 3))
    with pytest.warns(LogWarning, match=r"25 samples are too few to compare the forces of leg1_st"):
        check_forces(knee, few)


def test_a_motor_that_stands_hides_no_wrong_sign(knee, simulated):
    used, force = simulated.used.copy(), simulated.force.copy()
    used[:, 0] = False
    check_forces(knee, replace(simulated, used=used))
    force[:, 2] *= -1
    with pytest.warns(LogWarning, match="leg3_stroke points the other way"):
        check_forces(knee, replace(simulated, used=used, force=force))


@pytest.mark.parametrize("pair", PAIRS)
def test_exchanged_positions_of_the_real_robots(mechanism, shared, pair):
    log = read_log(shared / "data" / "upv" / "logs" / LOGS[mechanism.name], mechanism)
    order = np.arange(4)
    order[list(pair)] = pair[::-1]
    wrong = replace(log, position=log.position[:, order])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            prepare_recording(mechanism, wrong)
        except AssemblyError:
            return
    assert caught
