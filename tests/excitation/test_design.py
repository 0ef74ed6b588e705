import sys
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest

import loopid
from closure_robots import Y, body, files, joint, urdf
from linkages import five_bar as five_bar_of
from loopid import DesignOptions, MotionLimits
from loopid.errors import AssemblyError, DataWarning, MissingExtraError, OptionError
from loopid.identification.fitting import quiet_fit
from loopid.kinematics import closed_motion
from loopid.logs import Log

# With noise that is given, none has to be assumed from a first motion.
QUICK = DesignOptions(
    starts=1, evaluations=3, solver="slsqp", rate=20.0, size=2, duration=5.0, noise=0.1
)
FINE = replace(QUICK, rate=100.0)
GOOD = replace(FINE, noise=0.01, evaluations=8, size=None)  # enough to gain


@pytest.fixture(scope="module", autouse=True)
def one_start():
    """One random motion is tried to start from: how good the first one is, is no matter."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("loopid.excitation.search"), "DRAWS", 1)
        yield


@pytest.fixture(scope="module")
def gravity(five_bar):
    return loopid.force_model(five_bar, joint_terms=None)


@pytest.fixture(scope="module")
def full(five_bar):
    return loopid.force_model(five_bar, "full", None)


@pytest.fixture(scope="module")
def quick(gravity, once):
    return once("quick design", lambda: loopid.design_motion(gravity, options=QUICK))


@pytest.fixture(scope="module")
def design(full, once):
    return once("good design", lambda: loopid.design_motion(full, options=GOOD))


def test_the_motion_keeps_all_limits_by_an_independent_check(five_bar, design):
    assert design.violations == 0
    motion, model = design.joint_motion, five_bar.model
    q, v, a = motion.configurations, motion.velocities, motion.accelerations
    whole = closed_motion(five_bar, q, v, a)
    lower, upper = five_bar.position_limits
    assert (motion.configurations >= lower).all()
    assert (motion.configurations <= upper).all()
    assert (np.abs(whole.velocities) <= model.velocityLimit).all()
    K = loopid.regressors.motion_regressor(five_bar, closed_motion(five_bar, q, v, a))
    forces = K @ five_bar.standard_parameters()
    np.testing.assert_allclose(forces, design.forces, atol=1e-9)
    assert (np.abs(forces) <= model.effortLimit[five_bar.velocity_indices(five_bar.actuated)]).all()
    assert motion.singularity.min() >= 0.02
    for values in (design.motion.velocity, design.motion.acceleration):
        np.testing.assert_allclose(values[[0, -1]], 0.0, atol=1e-9)


def log_of(design, noise=0.0, seed=0, **options):
    """A simulated log of the motion."""
    robot, motion = design.force_model.robot, design.joint_motion
    run = loopid.simulate(robot, motion, loopid.motion.Noise(gaussian=noise), seed=seed)
    return Log.from_arrays(run.time, run.position, run.force, robot.actuated, **options)


def fit_of(design, log):
    return quiet_fit(design.force_model.samples(loopid.prepare(design.force_model.robot, log)))


def test_estimates_scatter_as_promised(five_bar, design):
    run, draws = loopid.prepare(five_bar, log_of(design)), 3000
    shape = len(design.motion), len(run.actuators) * draws
    errors = run.history.lowpass.apply(np.random.default_rng(0).normal(size=shape), 100.0)
    errors = 0.01 * errors[run.history.rows].reshape(len(run), -1, draws) * run.used[:, :, None]
    X = design.force_model.samples(run).regressor * run.used[:, :, None]
    W = X.reshape(-1, X.shape[2])
    values = np.linalg.lstsq(W, errors.reshape(len(W), draws), rcond=None)[0]
    np.testing.assert_allclose(values.std(axis=1), design.standard_errors, rtol=0.05)


def test_a_fit_of_a_log_says_what_was_promised(design):
    fit = fit_of(design, log_of(design, 0.01, seed=1))
    np.testing.assert_allclose(fit.standard_errors, design.standard_errors, rtol=0.35)


def test_poses_are_told_by_forces_of_motors_that_stand(gravity):
    options = replace(FINE, shape="poses", noise=0.5, size=None)
    found = loopid.design_motion(gravity, options=options)
    assert found.violations == 0
    fit = fit_of(found, log_of(found, 0.5, seed=1, idle_speed=0.0))
    np.testing.assert_allclose(fit.standard_errors, found.standard_errors, rtol=0.25)


def test_it_is_better_than_where_it_started(design):
    assert (design.standard_errors < design.errors_before).all()


@pytest.mark.validate
def test_each_criterion_wins_by_its_own_measure(gravity):
    found = {
        name: loopid.design_motion(
            gravity, options=replace(QUICK, criterion=name, evaluations=15)
        ).criteria
        for name in ("D", "A", "E", "condition")
    }
    assert max(found, key=lambda name: found[name].log_det) == "D"
    assert found["A"].trace < found["D"].trace
    assert found["E"].least_eigenvalue > found["D"].least_eigenvalue
    assert found["condition"].condition_number < found["D"].condition_number


def test_ranges_of_platform_coordinates_are_kept(load_once):
    robot = load_once("3ups_rpu")
    limits = MotionLimits(workspace={"x_m": (-0.1, 0.1)}, singularity_threshold=0.05)
    options = replace(QUICK, evaluations=1)
    found = loopid.design_motion(
        loopid.force_model(robot, joint_terms=None), limits=limits, options=options
    )
    assert found.violations == 0
    x = loopid.kinematics.platform_coordinates(robot, found.joint_motion.configurations)
    assert np.abs(x[:, 0]).max() <= 0.1
    assert found.joint_motion.singularity.min() >= 0.05


def test_a_log_and_the_motion_together_tell_what_the_log_does_not(full, one_crank):
    told = loopid.identification.identifiability(full, [one_crank])
    options = replace(FINE, size=None, noise=None)
    leads = [next(iter(each.terms)) for each in told.unidentifiable]
    assert set(leads) <= set(told.leads)
    found = loopid.design_motion(full, after=[one_crank], parameters=leads, options=options)
    unknown = [full.parameters.labels.index(lead) for lead in leads]
    assert (found.errors_before[unknown] > 1e3).all()
    assert (found.standard_errors < 1.0).all()
    # The noise is that of the log, which has a fifth of the samples in a second.
    np.testing.assert_allclose(found.noise, 0.01 * 5**0.5, rtol=0.4)
    everything = loopid.design_motion(full, after=[one_crank], options=options)
    chosen = found.standard_errors[unknown].prod()
    assert chosen <= everything.standard_errors[unknown].prod() * 1.2


@pytest.mark.validate
def test_a_payload_alone_is_known_better_than_with_all_others(full, design):
    found = loopid.design_motion(full, payload="left_coupler", options=GOOD)
    assert {name.partition(".")[0] for name in found.parameters.labels} == {"left_coupler"}
    errors = dict(zip(design.parameters.labels, design.standard_errors, strict=True))
    for name, error in zip(found.parameters.labels, found.standard_errors, strict=True):
        assert error < errors.get(name, np.inf)


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        ({"positions": {"left_crank_joint": (10.0, 12.0)}}, "position of left_crank_joint"),
        pytest.param({"forces": {"all": 1e-3}}, "force", marks=pytest.mark.validate),
    ],
)
def test_what_cannot_be_met_is_named(gravity, limits, name):
    with pytest.raises(AssemblyError, match=name):
        loopid.design_motion(gravity, limits=MotionLimits(**limits), options=QUICK)


def test_advice_on_what_cannot_be_met_works(gravity):
    with pytest.raises(AssemblyError) as refused:
        loopid.design_motion(
            gravity, limits=MotionLimits(singularity_threshold=0.95), options=QUICK
        )
    facts = refused.value.facts
    assert facts["bound"] == "singularity measure"
    limits = MotionLimits(singularity_threshold=0.95 - 1.2 * facts["missing"] - 0.01)
    assert loopid.design_motion(gravity, limits=limits, options=QUICK).violations == 0


@pytest.mark.parametrize(
    "options",
    [
        {"criterion": "Q"},
        {"shape": "steps"},
        {"solver": "simplex"},
        {"noise": {"left_crank_joint": 0.0}},
        {"noise": 0.0},
        {"duration": 0.0},
        {"rate": -1.0},
        {"starts": 0},
        {"evaluations": -1},
        {"size": 10**8},
        {"size": 1},
        {"time_limit": 0.0},
        {"seed": -1},
    ],
    ids=str,
)
def test_bad_options_are_refused_when_they_are_made(options):
    with pytest.raises(OptionError) as refused:
        DesignOptions(**options)
    assert refused.value.facts["given"] == next(iter(options.values()))


@pytest.mark.parametrize(
    "task",
    [
        {"options": DesignOptions(noise={"nothing": 1.0})},
        {"options": DesignOptions(criterion="A"), "parameters": ["left_crank.m"]},
        {"parameters": ["nothing.m"]},
        {"payload": "nothing"},
        {"limits": MotionLimits(positions={"nothing": (0.0, 1.0)})},
        {"limits": MotionLimits(speeds={"nothing": 1.0})},
        {"limits": MotionLimits(workspace={"x": (0.0, 1.0)})},
    ],
    ids=str,
)
def test_what_does_not_go_with_the_model_is_refused(gravity, task):
    with pytest.raises(OptionError):
        loopid.design_motion(gravity, **task)


def test_standing_tells_no_full_model(full):
    with pytest.raises(OptionError, match="standing in poses"):
        loopid.design_motion(full, options=replace(QUICK, shape="poses"))


@pytest.mark.parametrize(
    "limits",
    [
        {"positions": {"a": (1.0, 0.5)}},
        {"workspace": {"x": (0.0, 0.0)}},
        {"speeds": {"a": 0.0}},
        {"share": 0.0},
        {"singularity_threshold": 1.5},
    ],
    ids=str,
)
def test_limits_that_nothing_keeps_are_refused(limits):
    with pytest.raises(OptionError) as refused:
        MotionLimits(**limits)
    assert refused.value.facts["argument"] == next(iter(limits))


def test_ipopt_keeps_the_limits(gravity):
    pytest.importorskip("ipyopt", reason="has wheels for Linux on x86-64 alone")
    assert loopid.design_motion(gravity, options=replace(QUICK, solver="ipopt")).violations == 0


def test_without_ipopt_slsqp_designs_and_the_extra_is_named(gravity, quick, monkeypatch):
    monkeypatch.setitem(sys.modules, "ipyopt", None)
    monkeypatch.setattr("loopid.excitation.problem.find_spec", lambda _: None)
    by_default = loopid.design_motion(gravity, options=replace(QUICK, solver=None))
    assert by_default.violations == 0
    np.testing.assert_array_equal(by_default.motion.position, quick.motion.position)
    with pytest.raises(MissingExtraError, match="excite"):
        loopid.design_motion(gravity, options=replace(QUICK, solver="ipopt"))


@pytest.mark.validate
def test_more_evaluations_never_give_a_worse_motion(gravity):
    found = [
        loopid.design_motion(gravity, options=replace(QUICK, starts=2, evaluations=most))
        for most in (0, 3, 7, 12, 25)
    ]
    volumes = [design.criteria.log_det for design in found]
    # The criterion counts samples of the grid of the design, not those of the run.
    np.testing.assert_array_less(np.array(volumes[:-1]) - 0.2, volumes[1:])
    assert volumes[-1] > volumes[0]
    assert [design.evaluations for design in found] == [0, 3, 7, 12, 25]
    assert not any(design.violations for design in found)


def test_the_clock_stops_and_changes_nothing_else(gravity, quick):
    """Not even the last bit: the same seed gives the same motion."""
    slow = loopid.design_motion(gravity, options=replace(QUICK, time_limit=1000.0))
    np.testing.assert_array_equal(slow.motion.position, quick.motion.position)
    assert slow.checks == quick.checks
    found = loopid.design_motion(gravity, options=replace(QUICK, time_limit=1e-3))
    assert found.evaluations == 0
    assert not found.converged
    assert found.violations == 0


def test_the_first_interrupt_keeps_the_best(gravity):
    import os
    import signal

    def interrupt(done, total, best):
        if done == 2:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    found = loopid.design_motion(gravity, options=replace(QUICK, evaluations=5), progress=interrupt)
    assert not found.converged
    assert found.evaluations < 5
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
    found = loopid.design_motion(
        loopid.force_model(loopid.load(file), joint_terms=None), options=QUICK
    )
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
    return loopid.force_model(loopid.load(folder / "robot.yaml"), joint_terms=None)


def test_a_motor_that_moves_no_closed_frame_is_no_singularity(wrist):
    found = loopid.design_motion(wrist, options=QUICK)
    assert found.violations == 0
    assert np.isfinite(found.standard_errors).all()
    assert not any(check.name.startswith("force") for check in found.checks)


@pytest.mark.validate
def test_what_no_motion_within_the_limits_excites_is_named(wrist):
    still = MotionLimits(positions={"wrist_joint": (0.0, 1e-9)})
    with pytest.warns(DataWarning, match=r"does not excite .* position of wrist_joint is nearest"):
        found = loopid.design_motion(wrist, limits=still, options=replace(QUICK, evaluations=1))
    assert np.isinf(found.standard_errors).any()


@pytest.mark.validate
def test_without_other_word_noise_is_a_share_of_the_forces(full):
    """Errors are in proportion to it, and it is of the size of the forces of any good motion."""
    one, two = (
        loopid.design_motion(full, options=replace(QUICK, noise=None, noise_share=share))
        for share in (0.01, 0.02)
    )
    np.testing.assert_allclose(two.noise, 2 * one.noise)
    np.testing.assert_allclose(two.errors_before, 2 * one.errors_before)
    shares = one.noise / np.sqrt((one.forces**2).mean(axis=0))
    assert (shares > 0.01 / 3).all()
    assert (shares < 0.01 * 3).all()


@pytest.mark.parametrize("size", [0, -1.0, np.nan, np.inf, "1"])
def test_noise_that_is_none_is_refused_by_its_joint(size):
    with pytest.raises(OptionError, match=r"noise must be a number above 0, not .* of elbow"):
        DesignOptions(noise={"elbow": size})
