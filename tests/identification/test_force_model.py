"""The force model: base parameters of bodies and joints together, over any motion."""

import numpy as np
import pytest

import loopid
from loopid import JointTerms, random_configurations
from loopid.errors import DataError
from loopid.identification import FitProblem, FitSamples, WeightedLeastSquares
from loopid.identification.information import body_sizes
from loopid.kinematics import closed_motion, random_motions
from loopid.motion import JointMotion
from loopid.regressors import force_parts
from made_runs import record

KINDS = ("Ia", "Fc+", "Fc-", "Fv", "Ks2", "Ks", "Fo")


def random_motion(robot, count, seed):
    """Unrelated closed samples, as a motion."""
    q = random_configurations(robot, count, seed=seed)
    v, a = random_motions(robot, count, seed=seed)
    return JointMotion(np.arange(count) / 10, q, v, a, np.ones(count))


def joint_forces(robot, terms, motion, values):
    whole = closed_motion(robot, motion.configurations, motion.velocities, motion.accelerations)
    return terms.columns(robot, whole) @ values


def parts_of(robot, motion, standard=None):
    state = motion.configurations, motion.velocities, motion.accelerations
    return force_parts(robot, *state, standard_parameters=standard)


@pytest.fixture(
    scope="module",
    params=[("knee", "gravity"), ("knee", "full"), ("arm", "gravity"), ("arm", "full")],
    ids=" ".join,
)
def case(request, knee, arm):
    """A robot, its terms and its force model."""
    name, model = request.param
    robot = {"knee": knee, "arm": arm}[name]
    terms = JointTerms(robot.actuated, KINDS)
    return robot, terms, loopid.force_model(robot, model, terms)


def test_base_values_of_any_parameters_give_the_forces_of_all_parts(case):
    robot, terms, model = case
    motion, generator = random_motion(robot, 25, seed=4), np.random.default_rng(5)
    standard = generator.normal(size=len(robot.parameters()))
    friction = generator.normal(size=len(terms.parameters(robot)))
    parts = parts_of(robot, motion, standard)
    bodies = parts.total if model.model == "full" else parts.gravity
    labels = robot.parameters().labels
    columns = [labels.index(label) for label in robot.parameters(model.model).labels]
    values = model.base.values(np.concatenate([standard[columns], friction]))
    expected = bodies + joint_forces(robot, terms, motion, friction)
    np.testing.assert_allclose(
        model.regressor(motion) @ values, expected, atol=1e-9 * np.abs(expected).max()
    )


def test_the_prior_gives_the_forces_of_the_robot_file(case):
    robot, _, model = case
    motion = random_motion(robot, 25, seed=6)
    parts = parts_of(robot, motion)
    expected = parts.total if model.model == "full" else parts.gravity
    np.testing.assert_allclose(
        model.regressor(motion) @ model.prior, expected, atol=1e-9 * np.abs(expected).max()
    )


def test_every_column_belongs_to_bodies_or_to_joints(case):
    robot, _, model = case
    bodies, joints = set(model.body_columns), set(model.joint_columns)
    assert not bodies & joints
    assert bodies | joints == set(range(len(model.parameters)))
    labels = model.parameters.labels
    assert {labels[j].rpartition(".")[0] for j in joints} <= set(robot.actuated)
    assert {labels[j].rpartition(".")[0] for j in bodies} <= {body.link for body in robot.bodies}
    assert {label for j in joints for label in [labels[j].rpartition(".")[2]]} <= set(KINDS)


@pytest.mark.parametrize("chunk", [1, 7, 30])
def test_memory_does_not_change_the_regressor(case, monkeypatch, chunk):
    robot, _, model = case
    motion = random_motion(robot, 30, seed=7)
    whole = model.regressor(motion)
    monkeypatch.setattr("loopid.identification.force_models.CHUNK", chunk)
    parts = model.regressor(motion)
    assert parts.shape == whole.shape
    np.testing.assert_allclose(parts, whole, atol=1e-12 * np.abs(whole).max())


def test_without_joint_terms_all_columns_are_bodies(knee):
    model = loopid.force_model(knee, joint_terms=None)
    assert (len(model.parameters), len(model.joint_columns)) == (15, 0)
    np.testing.assert_array_equal(model.body_columns, np.arange(15))
    np.testing.assert_allclose(model.prior, model.base.values(knee.standard_parameters("gravity")))


def test_samples_keep_forces_masks_and_segments(knee, knee_model):
    motion, generator = random_motion(knee, 30, seed=8), np.random.default_rng(9)
    recording = record(knee, motion)
    masked = type(recording)(
        name=recording.name,
        actuators=recording.actuators,
        motion=motion,
        force=recording.force,
        used=generator.random((30, 4)) < 0.6,
        segments=np.repeat([0, 1, 4], 10),
    )
    samples = knee_model.samples(masked)
    assert samples.parameters == knee_model.parameters
    assert samples.actuators == knee.actuated
    np.testing.assert_array_equal(samples.regressor, knee_model.regressor(motion))
    np.testing.assert_array_equal(samples.force, masked.force)
    np.testing.assert_array_equal(samples.used, masked.used)
    np.testing.assert_array_equal(samples.problem.samples, masked.used.sum(axis=0))
    assert [(piece.start, piece.stop) for piece in samples.pieces] == [(0, 10), (10, 20), (20, 30)]


def test_sizes_are_those_of_the_bodies_whatever_the_link_frame_is_turned(knee):
    sizes = body_sizes(knee, "full").reshape(-1, 10)
    values = knee.standard_parameters().reshape(-1, 10)
    np.testing.assert_allclose(sizes[:, 0], values[:, 0])
    np.testing.assert_allclose(sizes[:, 1:4] ** 2, sizes[:, :1] * sizes[:, 4:7])
    # ∫ |x|² dm is half the trace of the inertia.
    np.testing.assert_allclose(2 * sizes[:, 4], values[:, [4, 6, 9]].sum(axis=1))
    # No body's first moment is larger than its mass times how far it reaches.
    assert (np.linalg.norm(values[:, 1:4], axis=1) <= sizes[:, 1] * (1 + 1e-12)).all()
    np.testing.assert_array_equal(body_sizes(knee, "gravity"), sizes[:, :4].ravel())


@pytest.fixture(scope="module")
def recordings(knee, terms, motions):
    return [
        record(knee, motion, terms, seed=k, name=f"run {k}") for k, motion in enumerate(motions)
    ]


@pytest.mark.validate
def test_processes_change_no_bit(knee_model, motions, monkeypatch):
    monkeypatch.setattr("loopid.identification.force_models.CHUNK", 97)
    one, two = (knee_model.regressor(motions[0], n_jobs=n_jobs) for n_jobs in (1, 2))
    np.testing.assert_array_equal(one, two)


def test_factors_of_each_recording_make_those_of_all(knee_model, recordings):
    parts = [part for recording in recordings for part in recording.split(0.3)]
    expected = FitSamples.combined([knee_model.samples(part) for part in parts]).problem
    found = FitProblem.combined([knee_model.samples(part).problem for part in parts])
    np.testing.assert_array_equal(found.samples, expected.samples)
    scale = np.abs(expected.factors).max()
    squares = found.factors.transpose(0, 2, 1) @ found.factors
    expected_squares = expected.factors.transpose(0, 2, 1) @ expected.factors
    np.testing.assert_allclose(squares, expected_squares, atol=1e-12 * scale**2)
    one, other = (WeightedLeastSquares().fit(problem) for problem in (found, expected))
    np.testing.assert_allclose(one.values, other.values, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(one.standard_errors, other.standard_errors, rtol=1e-7)


def test_recordings_without_samples_are_refused_by_name(knee_model, recordings):
    with pytest.raises(DataError, match="has no samples"):
        knee_model.samples(recordings[0].select(np.zeros(len(recordings[0].motion), dtype=bool)))


def test_notebooks_show_tables(crank_model):
    html = crank_model.robot._repr_html_()
    assert (html.count("<tr>"), html.count("<td>")) == (5, 20)
    assert "left_coupler_joint" in html


@pytest.mark.parametrize("text", ["Fk0~0.1=2,Fc=1,Ks=3,Fv=4", "Ft=1,Fh@0.01=2,Fv=3"])
def test_parameters_are_in_the_order_in_which_terms_were_given(load_once, text):
    """So that values of the bodies, then of the terms, are those of the model."""
    robot = load_once("five_bar")
    terms, values = JointTerms.with_values(robot, text)
    model = loopid.force_model(robot, "full", terms)
    labels = robot.parameters("full").labels + terms.parameters(robot).labels
    assert model.base.parameters.labels == labels
    found = model.base.values(np.concatenate([robot.standard_parameters(), values]))
    own = dict(zip(labels[-len(values) :], values, strict=True))
    kept = dict(zip(model.parameters.labels, found, strict=True))
    assert {label: kept[label] for label in own} == pytest.approx(own)
