"""The consistent fit: an optimum of solid bodies, whatever the frames, the units and the data."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from oracles import bodies_of, body_columns, fitted, shaken

import loopid
from loopid import JointTerms
from loopid.errors import DataError, ModelWarning
from loopid.identification import FitSamples, consistent, consistent_fit
from loopid.identification.consistent import (
    FASTEST,
    LEAST_OFF,
    NU,
    WIDTH,
    _minimised,
    _most_likely,
    _Program,
    _State,
    consistent_parameters,
    quiet_consistent_fit,
)
from loopid.identification.fitting import quiet_fit
from loopid.identification.joint_priors import JointPriors
from loopid.inertia import FLAT, body_defect, nearest_solid, parameters_of, pseudo_inertia
from made_runs import ARM, modelled, wander
from smooth_data import autoregressive

SMALL = 1e-6  # steps of finite differences


def rms(forces):
    return np.sqrt((forces**2).mean(axis=0))


def noise_of(samples):
    return quiet_fit(samples).noise


def solid(case, found):
    """All bodies solid, friction and drive inertia not negative, base parameters those of them."""
    standard, parameters = found.standard_parameters, case.base.parameters
    assert (np.linalg.eigvalsh(bodies_of(parameters, standard)) > 0).all()
    positive = [j for j, p in enumerate(parameters) if p.kind in ("Ia", "Fc", "Fv")]
    # At a limit they are there, not next to it by round-off.
    assert all(value == 0 or value > 1e-12 for value in standard[positive])
    np.testing.assert_allclose(case.base.values(standard), found.values, rtol=1e-12)
    return True


@pytest.fixture(scope="module")
def off(arm_case):
    """Noisy samples of bodies that are not the file's, and their true parameters."""
    truth = shaken(arm_case.base.parameters, arm_case.truth, 0.3, 1)
    return arm_case.samples(0.3, truth=truth), truth


def priors(start, deviations):
    """Of joint terms that are not negative, the last three of them a group of correlated ones."""
    count = len(start)
    factor = np.eye(count)
    factor[-3:, -3:] = np.linalg.cholesky(0.5 + 0.5 * np.eye(3))
    box = np.array([np.zeros(count), np.full(count, np.inf)])
    group = np.where(np.arange(count) < count - 3, -1, 0)
    return JointPriors(
        start=start,
        deviations=np.where(group < 0, deviations, 1.0),
        names=("arm: group",),
        group=group,
        factor=factor,
        bounds=np.array([[1e-4, 1.0]]),
        box=box,
        limits=np.eye(count),
        least=np.zeros(count),
    )


@pytest.fixture
def program(arm_case):
    """A program of made-up data, and a state away from the file."""
    generator = np.random.default_rng(0)
    base, own = arm_case.base, body_columns(arm_case.base.parameters)
    start = arm_case.truth[own.size :]
    L = np.linalg.cholesky(bodies_of(base.parameters, arm_case.prior)[:, ::-1, ::-1])
    file = L[:, ::-1, ::-1]
    q = _Program(
        effects=generator.normal(size=(len(base), len(base.parameters))),
        target=generator.normal(size=len(base)),
        names=("upper", "lower"),
        file=file,
        columns=own,
        terms=priors(start, 1.0 + generator.random(len(start))),
    )
    factors = file @ (np.eye(4) + np.triu(0.2 * generator.normal(size=file.shape)))
    return q, _State(factors, start + 0.5, np.array([0.4, 0.7]), np.array([0.3]))


def test_gradient_and_hessian_are_those_of_finite_differences(program):
    q, state = program
    step = q.step(state)
    count = len(step.g)
    hessian = np.eye(count) + step.J.T @ step.J
    units = SMALL * np.eye(count)

    def value(z):
        return q.value(q.moved(state, z))

    slopes = [(value(z) - value(-z)) / (2 * SMALL) for z in units]
    np.testing.assert_allclose(slopes, step.gradient, atol=1e-6 * np.abs(step.gradient).max())
    turned = [
        (q.step(q.moved(state, z)).g - q.step(q.moved(state, -z)).g)[: 2 * WIDTH] for z in units
    ]
    assert np.isfinite(turned).all()
    wide = 1e-3 * np.eye(count)
    middle = value(0 * units[0])
    for j, k in [(0, 0), (3, 3), (2, 7), (12, 19), (5, count - 1), (count - 2, count - 1)]:
        a, b = wide[j], wide[k]
        found = value(a + b) - value(a - b) - value(b - a) + value(-a - b)
        assert found / 4e-6 == pytest.approx(hessian[j, k], abs=1e-3 * np.abs(hessian).max())
    assert middle == pytest.approx(q.value(state))


def test_it_is_the_optimum_that_an_independent_program_finds(arm_case, off):
    samples, _ = off
    noise = noise_of(samples)
    spread = np.full(6, 0.3)
    start = arm_case.truth[-6:]
    columns, known = (
        arm_case.model.joint_columns,
        loopid.Fit.of(arm_case.model, arm_case.model.prior),
    )
    values, covariance = np.array(known.values), np.zeros(2 * known.values.shape)
    values[columns], covariance[columns, columns] = start, spread**2
    known = replace(known, values=values, covariance=covariance)
    found = consistent_fit(arm_case.model, samples, noise, known=known)
    R = samples.problem.weighted(found.weights)
    file = np.concatenate([arm_case.prior[:-6], start])
    expected = fitted(arm_case.base, R, file, found.deviation.own, spread)
    own = body_columns(arm_case.base.parameters)
    size = np.abs(file[own]).max()
    np.testing.assert_allclose(found.standard_parameters[own], expected[own], atol=2e-3 * size)
    errors = found.standard_errors
    values = arm_case.base.values(expected)
    np.testing.assert_allclose(found.values / errors, values / errors, atol=2e-2)


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.parametrize("noise", [1e-12, 0.1, 3.0, 1e3])
def test_every_body_is_solid_whatever_the_noise(arm_case, noise):
    for seed in range(3):
        truth = shaken(arm_case.base.parameters, arm_case.truth, 0.5, seed)
        samples = arm_case.samples(noise, seed, truth)
        assert solid(arm_case, consistent_fit(arm_case.model, samples, noise_of(samples)))


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
@pytest.mark.filterwarnings("ignore::loopid.errors.DataWarning")  # one does not settle
def test_forces_of_no_robot_give_solid_bodies(arm_case):
    samples = arm_case.samples(0.1)
    for force in (-3 * samples.force, 100 * samples.force[:, ::-1], 1e4 + samples.force):
        wrong = samples.with_force(force)
        assert solid(arm_case, consistent_fit(arm_case.model, wrong, noise_of(wrong)))


@pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")
def test_a_part_is_fitted_alike_from_wherever_the_search_begins(arm_case, off):
    model, every = arm_case.model, off[0]
    for samples in (every, every.with_force(-3 * every.force)):
        noise = noise_of(samples)
        like = consistent_fit(model, samples, noise)
        used = samples.used & (np.arange(len(samples)) % 3 > 0)[:, None]
        begins = [like, replace(like, standard_parameters=model.standard_prior)]
        part = replace(samples, used=used)
        near, far = (consistent_parameters(model, part, noise, like=one) for one in begins)
        assert not np.allclose(near, like.standard_parameters, rtol=1e-3)
        found = [samples.predicted(arm_case.base.values(one)) for one in (near, far)]
        np.testing.assert_allclose(*found, atol=1e-4 * rms(samples.force).max())


def test_the_whole_knee_is_fitted(knee_case):
    truth = shaken(knee_case.base.parameters, knee_case.truth, 0.2, 0)
    samples = knee_case.samples(5.0, truth=truth)
    plain = quiet_fit(samples)
    found = consistent_fit(knee_case.model, samples, plain.noise)
    assert solid(knee_case, found)
    exact = knee_case.regressor @ knee_case.base.values(truth)
    errors = [np.linalg.norm(knee_case.regressor @ f.values - exact) for f in (plain, found)]
    assert errors[1] < errors[0]


def test_without_noise_it_is_least_squares(arm_case):
    truth = shaken(arm_case.base.parameters, arm_case.truth, 0.2, 3)
    samples = arm_case.samples(0.0, truth=truth)
    found = consistent_fit(arm_case.model, samples, noise_of(samples))
    np.testing.assert_allclose(
        arm_case.regressor @ found.values, samples.force, atol=1e-6 * np.abs(samples.force).max()
    )


def test_the_more_data_the_nearer_to_least_squares(arm_case, off):
    samples, _ = off
    noise, plain = noise_of(samples), quiet_fit(samples)
    apart = []
    for precision in (1.0, 1e-2, 1e-4):
        known = replace(noise, deviation=precision * noise.deviation)
        found = consistent_fit(arm_case.model, samples, known)
        apart.append(np.linalg.norm(arm_case.regressor @ (found.values - plain.values)))
    assert apart[0] > 10 * apart[1]
    assert apart[1] > 10 * apart[2]


def test_a_prior_has_its_degrees_of_freedom_and_data_add_to_them(arm_case, off):
    """Scales of the prior have NU of their own; what the data determine of a body counts beside."""
    samples, _ = off
    noise, found = noise_of(samples), []
    for deviation in (1e4, 1e2, 10.0, 1.0):  # from data that say nothing to some that do
        known = replace(noise, deviation=deviation * noise.deviation)
        found.append(consistent_fit(arm_case.model, samples, known).degrees_of_freedom)
    assert (np.array(found) >= NU).all()
    assert found[0].min() < NU + 0.01
    assert (found[-1] > found[0]).all()


def test_units_of_length_do_not_matter(tmp_path):
    """A robot in millimetres: lengths and forces' arms are a thousand times as many."""
    found = []
    for scale in (1.0, 10.0):
        path = tmp_path / f"arm{scale}.urdf"
        path.write_text(ARM)
        robot = loopid.load(path)
        model = loopid.force_model(robot, "full", JointTerms(robot.actuated, ("Fv",)))
        run = modelled(model, wander(robot, 1, size=(1, 1)), 1.3 * model.prior + 0.1, noise=0.1)
        samples = model.samples(run)
        samples = replace(samples, regressor=samples.regressor * scale, force=samples.force * scale)
        noise = noise_of(samples)
        found.append(consistent_fit(model, samples, noise))
    np.testing.assert_allclose(
        found[0].standard_parameters, found[1].standard_parameters, rtol=1e-6, atol=1e-9
    )
    np.testing.assert_allclose(found[0].deviation.own, found[1].deviation.own, rtol=1e-6)


def test_frames_do_not_matter(program):
    """Bodies seen from other frames, in other units of length, take the same steps."""
    q, state = program
    A = np.eye(4)
    A[:3, :3] = 1000 * np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    A[:3, 3] = (3.0, -2.0, 5.0)
    back = np.linalg.inv(A)

    def seen(factors):
        P = A @ factors @ factors.swapaxes(1, 2) @ A.T
        return np.linalg.cholesky(P[:, ::-1, ::-1])[:, ::-1, ::-1]

    units = pseudo_inertia(np.eye(10))
    T = parameters_of(back @ units @ back.T).T
    effects = np.array(q.effects)
    for columns in q.columns:
        effects[:, columns] = q.effects[:, columns] @ T
    other = replace(q, file=seen(q.file), effects=effects)
    moved = replace(state, factors=seen(state.factors))
    assert other.value(moved) == pytest.approx(q.value(state), rel=1e-8)
    free = np.zeros((0, len(q.step(state).g))), np.zeros(0)
    pairs = (q, state), (other, moved)
    values = [own.moved(at, 0.1 * own.step(at).solution(*free)) for own, at in pairs]
    assert other.value(values[1]) == pytest.approx(q.value(values[0]), rel=1e-8)


def test_what_no_force_depends_on_stays_as_in_the_file(arm_case, off):
    samples, _ = off
    found = consistent_fit(arm_case.model, samples, noise_of(samples))
    base, own = arm_case.base, body_columns(arm_case.base.parameters)
    change = found.standard_parameters - arm_case.prior
    P, P0 = (bodies_of(base.parameters, v) for v in (found.standard_parameters, arm_case.prior))
    # At the optimum the change of the inverse is in the span of the regressor.
    gradient = np.zeros(len(change))
    for k, columns in enumerate(own):
        G = np.linalg.inv(P0[k]) - np.linalg.inv(P[k])
        weight = found.deviation.own[k] ** 2
        gradient[columns] = np.einsum("kij,ij->k", pseudo_inertia(np.eye(10)), G) / weight
    rest = gradient[own.ravel()]
    M = base.matrix[:, own.ravel()]
    left = rest - M.T @ np.linalg.lstsq(M.T, rest, rcond=None)[0]
    assert np.abs(left).max() < 1e-3 * np.abs(rest).max()


def test_a_log_that_does_not_move_gives_the_file(arm_case):
    samples = arm_case.samples(0.1)
    still = replace(
        samples,
        regressor=0 * samples.regressor,
        force=np.random.default_rng(0).normal(size=samples.force.shape),
    )
    noise = replace(noise_of(samples), deviation=np.ones(2))
    found = consistent_fit(arm_case.model, still, noise)
    np.testing.assert_allclose(found.standard_parameters, arm_case.prior, atol=1e-12)


def test_friction_is_not_negative_and_its_interval_holds_zero(arm_case):
    truth = arm_case.truth.copy()
    truth[-4] = -0.02  # an Fv that drives
    samples = arm_case.samples(0.3, truth=truth)
    found = consistent_fit(arm_case.model, samples, noise_of(samples))
    solid(arm_case, found)
    name = arm_case.base.parameters.labels[-4]
    low, high = found[name].interval
    assert low <= 0 <= high


def test_a_body_that_is_far_off_does_not_loosen_the_others(knee_case):
    truth, own = knee_case.truth.copy(), body_columns(knee_case.base.parameters)
    heavy = int(np.argmax(truth[own[:, 0]]))
    truth[own[heavy]] *= 3
    samples = knee_case.samples(1.0, truth=truth)
    found = consistent_fit(knee_case.model, samples, noise_of(samples)).deviation
    assert found.own[heavy] == found.own.max()
    assert found.own[heavy] > 1.5 * np.median(found.own)
    assert found.common == LEAST_OFF
    assert not found.fault


def test_a_file_that_the_forces_deny_yields_though_their_errors_are_slow(arm):
    """Errors over the length of the log leave few samples of a mean, and more of what moves."""
    model = loopid.force_model(arm, "gravity", JointTerms(arm.actuated, ("Fc", "Fv")))
    W = model.regressor(wander(arm, seed=1, seconds=20.0, rate=20.0, size=(1.0, 1.0)))
    heavy = np.append(3 * arm.standard_parameters("gravity"), [0.5, 0.3, 0.4, 0.2])
    force = W @ model.base.values(heavy)
    for seed in (2, 3):
        slow = autoregressive(np.random.default_rng(seed), force.shape, 0.999, lead=20_000)
        given = force + 0.2 * rms(force) * slow
        samples = FitSamples.of(model.parameters, arm.independent, W, given)
        plain = quiet_fit(samples)
        found = quiet_consistent_fit(model, samples, plain.noise).result
        assert plain.noise.effective_samples.min() < 5
        off, least = (rms(samples.predicted(each.values) - force) for each in (found, plain))
        assert (off < 1.2 * least).all()


def test_a_force_that_the_model_lacks_is_suspected(arm_case):
    truth = arm_case.truth.copy()
    truth[-6::3] = 0.3  # drive inertia
    samples = arm_case.samples(0.1, truth=truth)
    robot = arm_case.model.robot
    model = loopid.force_model(robot, "full", "Fc,Fv")
    motion = wander(robot, seed=1, seconds=10.0, rate=20.0, size=(1.0, 1.0))
    lacking = replace(samples, parameters=model.parameters, regressor=model.regressor(motion))
    with pytest.warns(ModelWarning, match="lacks a force"):
        found = consistent_fit(model, lacking, noise_of(lacking))
    assert found.deviation.fault


def test_gravity_models_keep_the_inertias_about_the_centres(knee_gravity):
    truth = knee_gravity.truth.copy()
    truth[:4] *= 1.2
    samples = knee_gravity.samples(1.0, truth=truth)
    found = consistent_fit(knee_gravity.model, samples, noise_of(samples))
    assert len(found.standard_parameters) == len(knee_gravity.base.parameters)
    masses = [j for j, p in enumerate(knee_gravity.base.parameters) if p.kind == "m"]
    assert (found.standard_parameters[masses] > 0).all()
    np.testing.assert_allclose(
        knee_gravity.base.values(found.standard_parameters), found.values, rtol=1e-12
    )


def test_options_and_data_that_do_not_fit_are_refused(arm_case, off, load_once):
    samples, _ = off
    noise = noise_of(samples)
    other = loopid.force_model(load_once("five_bar"), "full", None)
    with pytest.raises(DataError, match="of the force model"):
        consistent_fit(other, samples, noise)
    with pytest.raises(DataError, match="that is known must be of the parameters"):
        consistent_fit(arm_case.model, samples, noise, known=loopid.Fit.of(other, other.prior))


# Bodies of the file that are none.


@pytest.mark.parametrize(
    "own",
    [
        [1.0, 0, 0, 0, 0, 0, 0.5, 0, 0, 0.5],  # a rod
        [1.0, 0, 0, 0, FLAT / 2, 0, 0.5, 0, 0, 0.5],
        [1.0, 0.1, 0, 0, 0, 0, 0.01, 0, 0, 0.01],  # a point
        [-1.0, 0, 0, 0, 1, 0, 1, 0, 0, 1],
        [0.0, 0.1, 0, 0, 1, 0, 1, 0, 0, 1],
        [1.0, 0, 0, 0, 3, 0, 1, 0, 0, 1],
        [1.0, 5, 0, 0, 1, 0, 1, 0, 0, 1],
    ],
)
def test_the_nearest_solid_body_is_solid(own):
    P = pseudo_inertia(np.array(own))
    assert body_defect(P)
    found = nearest_solid(P, 0.01, 0.1)
    assert not body_defect(found)
    if own[0] > 0:
        np.testing.assert_allclose(found[3], P[3], atol=1e-15)


def test_bodies_of_a_file_that_are_none_are_named_and_fitted(tmp_path, arm_case):
    path = tmp_path / "flat.urdf"
    path.write_text(ARM)
    robot = loopid.load(path)
    inertia = robot.model.inertias[2]
    inertia.inertia = 0 * inertia.inertia
    robot.model.inertias[2] = inertia
    model = replace(arm_case.model, robot=robot)
    samples = arm_case.samples(0.3)
    with pytest.warns(ModelWarning, match="no solid bodies have the inertials of lower"):
        found = consistent_fit(model, samples, noise_of(samples))
    assert solid(arm_case, found)


def test_massless_bodies_stay_massless(tmp_path, arm_case):
    path = tmp_path / "light.urdf"
    path.write_text(ARM)
    robot = loopid.load(path)
    robot.model.inertias[2] = pin.Inertia.Zero()
    model = replace(arm_case.model, robot=robot)
    samples = arm_case.samples(0.3)
    found = consistent_fit(model, samples, noise_of(samples))
    own = body_columns(arm_case.base.parameters)
    assert not found.standard_parameters[own[1]].any()
    assert found.deviation.bodies == ("upper",)
    np.testing.assert_allclose(arm_case.base.values(found.standard_parameters), found.values)


def test_files_without_masses_get_bodies_with_the_base_parameters_of_least_squares(
    tmp_path, arm_case
):
    path = tmp_path / "empty.urdf"
    path.write_text(ARM)
    robot = loopid.load(path)
    for k in (1, 2):
        robot.model.inertias[k] = pin.Inertia.Zero()
    model = replace(arm_case.model, robot=robot)
    samples = arm_case.samples(0.01)
    plain = quiet_fit(samples)
    with pytest.warns(ModelWarning, match="gives no masses"):
        found = consistent_fit(model, samples, plain.noise)
    assert solid(arm_case, found)
    apart = arm_case.regressor @ (found.values - plain.values)
    assert np.linalg.norm(apart) < 1e-3 * np.linalg.norm(samples.force)


@pytest.mark.parametrize(
    ("name", "noise"),
    [
        ("arm_case", 0.5),
        pytest.param("tied_case", 1.0, marks=pytest.mark.validate),
        pytest.param("floating_case", 1.0, marks=pytest.mark.validate),
    ],
)
def test_intervals_hold(name, noise, request):
    """Of robots about their file: 95 % intervals of values that rest on the file as well."""
    case, inside = request.getfixturevalue(name), []
    for seed in range(12):
        truth = shaken(case.base.parameters, case.truth, 0.12, seed)
        samples = case.samples(noise, seed, truth)
        found = consistent_fit(case.model, samples, noise_of(samples))
        low, high = found.intervals().T
        exact = case.base.values(truth)
        inside.append((low <= exact) & (exact <= high))
    assert 0.88 < np.mean(inside) < 0.995


def test_forces_that_no_bodies_have_are_fitted_by_the_best_ones(arm_case, off):
    """By nearly flat ones, along whose limits steps of bodies alone are short."""
    samples, _ = off
    turned = samples.with_force(-samples.force)
    found = quiet_consistent_fit(arm_case.model, turned, noise_of(samples)).result
    assert found.settled
    assert solid(arm_case, found)


def test_steps_of_a_deviation_that_go_on_in_one_direction_grow(program, monkeypatch):
    """They end where steps that do not grow end, in less than half as many."""
    q, state = program
    at_file = replace(state, factors=q.file, joints=q.terms.start, groups=np.array([1.0]))
    noise = np.random.default_rng(0).normal(size=len(q.target))
    found = []
    for effect in (0.3, 3.0):
        effects = q.effects * np.append(np.ones(q.effects.shape[1] - 3), np.full(3, effect))
        target = effects @ q.standard(at_file) + noise
        for fastest in (FASTEST, 1.0):
            steps = []

            def counted(*given, steps=steps):
                steps.append(given)
                return _minimised(*given)

            monkeypatch.setattr(consistent, "FASTEST", fastest)
            monkeypatch.setattr(consistent, "_minimised", counted)
            state, _ = _most_likely(replace(q, effects=effects, target=target))
            found.append((len(steps), *state.groups))
        (few, group), (many, expected) = found[-2:]
        assert group == pytest.approx(expected, rel=1e-2)
        assert few < many / 2
