import numpy as np
import pytest

import loopid
from closure_robots import Y, body, files, joint, urdf
from linkages import five_bar as five_bar_of
from loopid import MotionLimits, design_excitation, find_force_model
from loopid.errors import (
    AssemblyError,
    DataWarning,
    MissingExtraError,
    OptionError,
)
from loopid.identification import quiet_fit
from loopid.kinematics import closed_motion
from loopid.logs import (
    Log,
    prepare_recording,
)

QUICK = {"starts": 1, "iterations": 10, "time_limit": 120.0, "solver": "slsqp", "rate": 20.0}
FINE = QUICK | {"rate": 100.0}


@pytest.fixture(scope="module")
def gravity(five_bar):
    return find_force_model(five_bar, joint_terms=None)


@pytest.fixture(scope="module")
def full(five_bar):
    return find_force_model(five_bar, "full", None)


@pytest.fixture(scope="module")
def design(full):
    return design_excitation(full, noise=0.01, **FINE)


def test_the_motion_keeps_all_limits_by_an_independent_check(five_bar, design):
    assert design.violations == 0
    motion, model = design.joint_motion, five_bar.model
    whole = closed_motion(five_bar, motion.configurations, motion.velocities, motion.accelerations)
    lower, upper = five_bar.position_limits
    assert (motion.configurations >= lower).all()
    assert (motion.configurations <= upper).all()
    assert (np.abs(whole.velocities) <= model.velocityLimit).all()
    forces = (
        loopid.dynamic_regressor(
            five_bar, motion.configurations, motion.velocities, motion.accelerations
        )
        @ five_bar.standard_parameters()
    )
    np.testing.assert_allclose(forces, design.forces, atol=1e-9)
    assert (np.abs(forces) <= model.effortLimit[five_bar.velocity_indices(five_bar.actuated)]).all()
    assert motion.singularity.min() >= 0.02
    for values in (design.motion.velocity, design.motion.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-9)


def log_of(design, noise=0.0, seed=0, **options):
    """A simulated log of the motion."""
    robot, motion = design.force_model.mechanism, design.joint_motion
    run = loopid.simulate_measurement(robot, motion, loopid.Noise(gaussian=noise), seed)
    return Log.from_arrays(run.time, run.position, run.force, robot.actuated, **options)


def fit_of(design, log):
    return quiet_fit(
        design.force_model.samples(prepare_recording(design.force_model.mechanism, log))
    )


def test_estimates_scatter_as_promised(five_bar, design):
    run, draws = prepare_recording(five_bar, log_of(design)), 3000
    shape = len(design.motion), len(run.actuators) * draws
    errors = run.history.lowpass.apply(np.random.default_rng(0).normal(size=shape), 100.0)
    errors = 0.01 * errors[run.history.rows].reshape(len(run), -1, draws) * run.used[:, :, None]
    X = design.force_model.samples(run).regressor * run.used[:, :, None]
    W = X.reshape(-1, X.shape[2])
    values = np.linalg.lstsq(W, errors.reshape(len(W), draws), rcond=None)[0]
    np.testing.assert_allclose(values.std(axis=1), design.standard_errors, rtol=0.05)


def test_a_fit_of_a_log_says_what_was_promised(design):
    fit = fit_of(design, log_of(design, 0.01, seed=1))
    np.testing.assert_allclose(fit.standard_errors, design.standard_errors, rtol=0.25)


def test_poses_are_told_by_forces_of_motors_that_stand(gravity):
    quick = FINE | {"iterations": 4}
    found = design_excitation(gravity, shape="poses", noise=0.5, **quick)
    assert found.violations == 0
    fit = fit_of(found, log_of(found, 0.5, seed=1, idle_speed=0.0))
    np.testing.assert_allclose(fit.standard_errors, found.standard_errors, rtol=0.25)


def test_it_is_better_than_where_it_started(design):
    assert (design.standard_errors < design.before.standard_errors).all()


def test_the_same_seed_gives_the_same_motion(full, design):
    again = design_excitation(full, noise=0.01, **FINE)
    np.testing.assert_array_equal(again.motion.position, design.motion.position)


def test_each_criterion_wins_by_its_own_measure(gravity):
    found = {
        name: design_excitation(gravity, criterion=name, **(QUICK | {"iterations": 15})).criteria
        for name in ("D", "A", "E", "condition")
    }
    assert max(found, key=lambda name: found[name].log_det) == "D"
    assert found["A"].trace < found["D"].trace
    assert found["E"].least_eigenvalue > found["D"].least_eigenvalue
    assert found["condition"].condition_number < found["D"].condition_number


def test_splines_keep_the_limits_too(gravity):
    found = design_excitation(gravity, shape="spline", **(QUICK | {"iterations": 4}))
    assert found.violations == 0
    assert np.isfinite(found.standard_errors).all()


def test_platform_coordinates():
    robot = loopid.load_mechanism("3ups_rpu")
    limits = MotionLimits(workspace={"x_m": (-0.1, 0.1)}, singularity=0.05)
    quick = QUICK | {"iterations": 1}
    found = design_excitation(robot, limits=limits, coordinates="platform", size=2, **quick)
    assert found.violations == 0
    assert found.motion.names == robot.platform.names
    x = loopid.kinematics.platform_coordinates(robot, found.joint_motion.configurations)
    assert np.abs(x[:, 0]).max() <= 0.1
    assert found.joint_motion.singularity.min() >= 0.05


def test_a_log_and_the_motion_together_tell_what_the_log_does_not(full, one_crank):
    told = loopid.identifiability(full, [one_crank])
    leads = [next(iter(each.terms)) for each in told.unidentifiable]
    assert set(leads) <= set(told.leads)
    found = design_excitation(full, after=[one_crank], parameters=leads, **FINE)
    unknown = [full.parameters.labels.index(lead) for lead in leads]
    assert (found.before.standard_errors[unknown] > 1e3).all()
    assert (found.standard_errors < 1.0).all()
    # The noise is that of the log, which has a fifth of the samples in a second.
    np.testing.assert_allclose(found.noise, 0.01 * 5**0.5, rtol=0.4)
    everything = design_excitation(full, after=[one_crank], **FINE)
    chosen = found.standard_errors[unknown].prod()
    assert chosen <= everything.standard_errors[unknown].prod() * 1.2


def test_a_payload_alone_is_known_better_than_with_all_others(full, design):
    found = design_excitation(full, payload="left_coupler", noise=0.01, **FINE)
    assert {name.partition(".")[0] for name in found.parameters.labels} == {"left_coupler"}
    errors = dict(zip(design.parameters.labels, design.standard_errors, strict=True))
    for name, error in zip(found.parameters.labels, found.standard_errors, strict=True):
        assert error < errors.get(name, np.inf)


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        ({"positions": {"left_crank_joint": (10.0, 12.0)}}, "position of left_crank_joint"),
        ({"forces": {"all": 1e-3}}, "force"),
    ],
)
def test_what_cannot_be_met_is_named(gravity, limits, name):
    with pytest.raises(AssemblyError, match=name):
        design_excitation(gravity, limits=MotionLimits(**limits), **QUICK)


def test_advice_on_what_cannot_be_met_works(gravity):
    with pytest.raises(AssemblyError, match=r"singularity measure .* misses it by") as refused:
        design_excitation(gravity, limits=MotionLimits(singularity=0.95), **QUICK)
    missing = float(str(refused.value).partition("misses it by ")[2].split(",")[0])
    limits = MotionLimits(singularity=0.95 - 1.2 * missing - 0.01)
    assert design_excitation(gravity, limits=limits, **QUICK).violations == 0


@pytest.mark.parametrize(
    "options",
    [
        {"criterion": "Q"},
        {"shape": "steps"},
        {"coordinates": "platform"},
        {"parameters": ["nothing.m"]},
        {"payload": "nothing"},
        {"noise": {"nothing": 1.0}},
        {"noise": 0.0},
        {"duration": 0.0},
        {"starts": 0},
        {"iterations": -1},
        {"n_jobs": 0},
        {"size": 10**8},
        {"time_limit": 0.0},
        {"limits": MotionLimits(positions={"nothing": (0.0, 1.0)})},
        {"limits": MotionLimits(workspace={"x": (0.0, 1.0)})},
    ],
    ids=str,
)
def test_bad_options_are_refused(gravity, options):
    with pytest.raises(OptionError):
        design_excitation(gravity, **(QUICK | options))


def test_standing_tells_no_full_model(full):
    with pytest.raises(OptionError, match="standing in poses"):
        design_excitation(full, shape="poses", **QUICK)


def test_empty_limits_are_refused():
    with pytest.raises(OptionError, match="empty"):
        MotionLimits(positions={"a": (1.0, 0.5)})


def test_ipopt_keeps_the_limits_and_is_named_where_it_is_missing(gravity):
    try:
        found = design_excitation(gravity, **(QUICK | {"solver": "ipopt"}))
    except MissingExtraError as error:
        assert "excite" in str(error)  # noqa: PT017
    else:
        assert found.violations == 0


def test_no_time_gives_a_motion_all_the_same(gravity):
    found = design_excitation(gravity, rate=20.0, time_limit=1e-3)
    assert found.stopped
    assert found.violations == 0


def test_the_first_interrupt_keeps_the_best(gravity):
    import os
    import signal

    def interrupt(spent, total, best):
        if np.isfinite(best):
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    found = design_excitation(gravity, rate=20.0, solver="slsqp", progress=interrupt)
    assert found.stopped
    assert found.violations == 0
    assert signal.getsignal(signal.SIGINT) is before


def test_a_robot_with_couplings_and_no_loops_has_no_singularities(tmp_path):
    followed = joint("second", "first", "gripper", (0.5, 0, 0)).replace(
        "</joint>", '<mimic joint="turn" multiplier="0.5"/></joint>'
    )
    file = tmp_path / "gripper.urdf"
    file.write_text(
        urdf(body("first"), body("gripper"), joint("turn", "ground", "first", axis=Y), followed)
    )
    found = design_excitation(loopid.load_mechanism(file), **QUICK)
    assert found.violations == 0
    assert found.min_singularity_measure == 1.0


@pytest.fixture(scope="module")
def wrist(tmp_path_factory):
    """A five-bar with one more motor behind the loop; its file bounds no force."""
    folder = tmp_path_factory.mktemp("wrist")
    parts, description = five_bar_of(("left_joint", "right_joint", "wrist_joint"))
    parts += [body("wrist"), joint("wrist_joint", "left_coupler", "wrist", (0.35, 0, 0), Y)]
    tree, described = files(parts, description)
    (folder / "robot.urdf").write_text(tree.replace('effort="1"', 'effort="1.7e308"'))
    (folder / "robot.yaml").write_text(described)
    return find_force_model(loopid.load_mechanism(folder / "robot.yaml"), joint_terms=None)


def test_a_motor_that_moves_no_closed_frame_is_no_singularity(wrist):
    found = design_excitation(wrist, **(QUICK | {"iterations": 5}))
    assert found.violations == 0
    assert np.isfinite(found.standard_errors).all()
    assert not any(check.name.startswith("force") for check in found.checks)


def test_what_no_motion_within_the_limits_excites_is_named(wrist):
    still = MotionLimits(positions={"wrist_joint": (0.0, 1e-9)})
    with pytest.warns(DataWarning, match=r"does not excite .*position of wrist_joint"):
        found = design_excitation(wrist, limits=still, **(QUICK | {"iterations": 3}))
    assert np.isinf(found.standard_errors).any()


@pytest.mark.validate
def test_processes_change_nothing_but_the_time(five_bar):
    options = QUICK | {"starts": 2, "time_limit": 600.0}
    alone, shared = (design_excitation(five_bar, n_jobs=n, **options) for n in (1, 2))
    np.testing.assert_array_equal(alone.motion.position, shared.motion.position)
