"""Drive gains by a load of known mass."""

import numpy as np
import pytest

import loopid
from loopid.diagnosis import KnownLoad
from loopid.diagnosis.gains import GainFit
from loopid.logs import LogMapping, Recording

MASS, CENTRE = 2.5, np.array([0.04, 0.06, 0.1])
GAINS = np.array([1.2, 0.8, 1.1])
ARM = """<robot name="arm">
<link name="base"/>
{links}
</robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="{reach} 0.01 0.02"/><mass value="{mass}"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial></link>
<joint name="{name}_joint" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{start} 0 0"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="500" velocity="9"/></joint>"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """An arm whose first axis is upright, so that no weight turns it."""
    rows = (
        ("pan", "base", "0 0 1", 0.0),
        ("upper", "pan", "0 1 0", 0.1),
        ("lower", "upper", "0 1 0.3", 0.4),
    )
    links = [
        LINK.format(name=name, parent=parent, axis=axis, start=start, mass=4 - k, reach=0.2)
        for k, (name, parent, axis, start) in enumerate(rows)
    ]
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(ARM.format(links="".join(links)))
    return loopid.load(path)


def recorded(robot, model, gains=GAINS, noise=0.0, seed=0):
    """Runs without and with the load, of forces in other units."""
    rng, load = np.random.default_rng(seed), KnownLoad(MASS, CENTRE, 0.01 * np.eye(3))
    first, runs = robot.parameters("full").labels.index("lower.m"), []
    for carried in (0.0, 1.0):
        waves = rng.normal(size=(2, 3, 4)) * 0.4
        series = loopid.motion.FourierSeries(robot.actuated, 0.2, [0.0, 0.5, 0.5], *waves)
        motion = loopid.motion.joint_motion(robot, series.motion(rate=40.0, duration=10.0))
        bodies = robot.standard_parameters("full").copy()
        bodies[first : first + 10] += carried * load.parameters
        rates = [motion.velocities, motion.accelerations]
        if model == "gravity":
            rates = [0 * each for each in rates]
        force = (
            loopid.regressors.motion_regressors.motion_regressor(
                robot, loopid.kinematics.closed_motion(robot, motion.configurations, *rates)
            )
            @ bodies
        )
        force += np.sign(motion.velocities) + noise * force.std(axis=0) * rng.normal(
            size=force.shape
        )
        runs.append([Recording.of_motion(motion, force / gains, robot.actuated)])
    return {"unloaded": runs[0], "loaded": runs[1]}


@pytest.mark.parametrize("load", [KnownLoad(MASS), KnownLoad(MASS, CENTRE)], ids=["mass", "centre"])
def test_gains_without_noise_are_found_to_round_off(arm, load):
    model, runs = loopid.force_model(arm, "full", "Fc"), recorded(arm, "full")
    found = loopid.diagnosis.drive_gains(model, link="lower", load=load, **runs, estimator="ols")
    assert found.actuators == arm.actuated
    np.testing.assert_allclose(found.gains, GAINS, rtol=1e-6)


def test_a_motor_that_cannot_tell_is_named(arm):
    model, runs = loopid.force_model(arm, "gravity", "Fc"), recorded(arm, "gravity")
    found = loopid.diagnosis.drive_gains(
        model, link="lower", load=KnownLoad(MASS), **runs, estimator="ols"
    )
    assert found.undetermined == ("pan_joint",)
    assert found.actuators == ("upper_joint", "lower_joint")
    np.testing.assert_allclose(found.gains, GAINS[1:], rtol=1e-6)


@pytest.mark.validate
def test_noisy_currents_make_no_gain_too_small(arm):
    """Least squares with currents as columns would have them smaller by the square of the noise."""
    model, off = loopid.force_model(arm, "full", "Fc"), []
    for seed in range(3):
        runs = recorded(arm, "full", noise=0.2, seed=seed)
        found = loopid.diagnosis.drive_gains(model, link="lower", load=KnownLoad(MASS), **runs)
        off.append((found.gains - GAINS) / np.sqrt(np.diag(found.covariance)))
        low, high = found.intervals(1 - 1e-4).T
        assert ((low < GAINS) & (high > GAINS)).all()
    assert abs(np.mean(off)) < 3 / np.sqrt(len(off))  # each arm's errors move together


def test_intervals_are_those_of_the_inverse():
    found = GainFit(("motor",), np.array([2.0]), np.array([[0.04]]), 1e9)
    (low, high), scale = found.intervals()[0], 0.5
    reach = 1.959964 * 0.2 / 2.0**2
    np.testing.assert_allclose([low, high], [1 / (scale + reach), 1 / (scale - reach)], rtol=1e-6)
    wide = GainFit(("motor",), np.array([2.0]), np.array([[4.0]]), 1e9)
    assert wide.intervals()[0, 1] == np.inf


LOG = "time,a.position,b.position,a.effort [N cm],b.effort [N cm]\n"


@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")  # of forces beyond their limits
def test_a_mapping_with_gains_gives_so_many_times_the_forces(tmp_path, load_once):
    robot = load_once("five_bar")
    left, right = robot.actuated
    time, rng = np.arange(0, 2, 0.01), np.random.default_rng(0)
    lower = [robot.reference[robot.joint(name).idx_q] for name in robot.actuated]
    wave = 0.1 * np.sin(3 * time)[:, None]
    columns = np.column_stack([time, lower + wave * [1, -1], 300 * rng.normal(size=(200, 2))])
    path = tmp_path / "log.csv"
    head = LOG.replace("a.", f"{left}.").replace("b.", f"{right}.")
    np.savetxt(path, columns, delimiter=",", header=head.strip(), comments="")
    for given in (None, LogMapping(force_scale=0.02, force_offset=3.0, saturation=40.0)):
        log = loopid.read_log(path, robot, mapping=given)
        scales = (log.force_scales,)
        gains = GainFit((left,), np.array([1.25]), np.eye(1), 9.0, (right,), scales)
        written = tmp_path / "mapping.yaml"
        written.write_text(gains.mapping(given).content)
        again = loopid.read_log(path, robot, mapping=written)
        np.testing.assert_allclose(again.force, log.force * [1.25, 1.0], rtol=1e-5)
        if given is not None:
            np.testing.assert_allclose(again.saturation, [50.0, 40.0])


def test_what_makes_no_sense_is_refused(arm):
    model, runs = loopid.force_model(arm, "full", "Fc"), recorded(arm, "full")
    with pytest.raises(loopid.LoopidError, match="mass must be above 0, not -2"):
        KnownLoad(-2.0)
    with pytest.raises(loopid.LoopidError, match="centre must have shape"):
        KnownLoad(2.0, [0.1])
    with pytest.raises(loopid.LoopidError, match="give the centre, too"):
        KnownLoad(2.0, inertia=np.eye(3))
    with pytest.raises(loopid.LoopidError, match="recordings without it, and others with it"):
        loopid.diagnosis.drive_gains(
            model, link="lower", load=KnownLoad(2.0), unloaded=[], loaded=runs["loaded"]
        )
    signs = recorded(arm, "full", gains=np.array([1.0, -1.0, 1.0]))
    with pytest.raises(loopid.LoopidError, match="gain of upper_joint comes out negative"):
        loopid.diagnosis.drive_gains(
            model, link="lower", load=KnownLoad(MASS), **signs, estimator="ols"
        )
    found = loopid.diagnosis.drive_gains(
        model, link="lower", load=KnownLoad(MASS), **runs, estimator="ols"
    )
    with pytest.raises(loopid.LoopidError, match="logs from files"):
        found.mapping()
    with pytest.raises(loopid.LoopidError, match="gains are of joints"):
        LogMapping(joint_maps=[{"joints": ["a"], "motors": ["m"], "matrix": [[1.0]]}]).with_gains(
            {}, [{}]
        )
