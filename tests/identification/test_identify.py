"""What recordings say about a robot: the truth where they tell it, its name where they do not."""

import pickle
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from loopid import JointTerms
from loopid.errors import DataError, DataWarning, OptionError, RankError
from loopid.identification import (
    FitOptions,
    WeightedLeastSquares,
    eliminate,
    fit,
    identifiability,
    identify,
    load_fit,
    split_recordings,
)
from loopid.identification.correlation import CORRECTIONS, within_runs
from loopid.identification.fitting import quiet_fit
from loopid.identification.selection import judge_essential
from loopid.logs import Recording
from loopid.motion import Noise
from made_runs import changed, friction, modelled, quietly, record, stand, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "none_missing")

DRAWS = 10
REFUSE = FitOptions(unidentifiable="error")


def deviations(result, truth):
    """Errors in standard errors."""
    return (result.values - truth) / result.standard_errors


@pytest.fixture(scope="module")
def found(knee_model, motions, truth, once):
    """An identification of the robot of the file."""
    pair = [[modelled(knee_model, motion, truth, seed=k)] for k, motion in enumerate(motions)]
    return once("true knee", lambda: quietly(identify, knee_model, pair[0], validation=pair[1]))


def test_the_fit_is_unbiased_and_most_intervals_cover_the_true_values(
    found, knee_model, motions, truth
):
    recordings = [modelled(knee_model, motions[0], truth, seed=2 * draw) for draw in range(DRAWS)]
    fits = [quiet_fit(knee_model.samples(recording)) for recording in recordings]
    np.testing.assert_allclose(found["all parameters"].fit.values, fits[0].values, rtol=1e-6)
    errors = np.array([deviations(each, truth) for each in fits])
    assert np.abs(errors).max() < 4
    assert np.abs(errors.mean(axis=0)).max() < 4 / np.sqrt(DRAWS)
    assert 0.8 < errors.std() < 1.2
    intervals = np.array([each.intervals() for each in fits])
    covered = (intervals[:, :, 0] <= truth) & (truth <= intervals[:, :, 1])
    assert 0.9 < covered.mean() < 1.0


def test_the_baseline_holds_the_robot_file_and_the_friction_of_the_data(found, knee_model, truth):
    bodies, joints = knee_model.body_columns, knee_model.joint_columns
    baseline = found.baseline
    np.testing.assert_array_equal(baseline.fit.values[bodies], truth[bodies])
    assert (baseline.name, baseline.fitted) == ("robot file", 8)
    assert not baseline.fit.covariance[bodies].any()
    errors = baseline.fit.values[joints] - truth[joints]
    spread = np.sqrt(np.diag(baseline.fit.covariance)[joints])
    assert np.abs(errors / spread).max() < 4.5


def test_a_summary_fits_in_ten_lines(found):
    for thing in (found, *found.candidates.values(), found.force_model):
        assert len(repr(thing).splitlines()) <= 10
    assert all(name in repr(found) for name in ("3ups_rpu", "wls", "robot file", "23 of 23"))
    assert found._repr_html_().count("<tr>") == 4


def test_a_true_robot_file_is_not_beaten_and_errors_on_new_data_are_those_of_the_noise(found):
    for candidate in found.candidates.values():
        assert not candidate.beats_baseline
        assert np.abs(candidate.validation.residual_rms - 1).max() < 0.15


def test_nearly_exact_data_give_nearly_exact_parameters(knee_model, motions, truth):
    pair = [[modelled(knee_model, motion, truth, 1e-3, seed=4)] for motion in motions]
    found = quietly(identify, knee_model, pair[0], validation=pair[1])
    for candidate in found.candidates.values():
        np.testing.assert_allclose(candidate.fit.values, truth, atol=1e-2, rtol=1e-4)


@pytest.fixture(scope="module")
def heavier(knee, knee_model, motions, terms, once):
    """The platform carries 2 kg that the robot file does not know."""
    standard = changed(knee, platform_m=2.0)
    pair = [
        [record(knee, motion, terms, standard, seed=seed)] for seed, motion in enumerate(motions)
    ]
    return once("heavier", lambda: quietly(identify, knee_model, pair[0], validation=pair[1]))


@pytest.fixture(scope="module")
def essential(heavier):
    """Its essential parameters, and these as a candidate."""
    reduction = eliminate(heavier)
    return reduction, judge_essential(heavier, reduction)


def test_a_mass_that_was_changed_is_found_and_nothing_else(essential, knee_model):
    reduction, candidate = essential
    labels = reduction.result.parameters.labels
    assert [label for label in labels if not label.endswith((".Fc", ".Fv"))] == ["platform.m"]
    column = knee_model.parameters.labels.index("platform.m")
    off = candidate.fit.values - knee_model.prior
    error = np.sqrt(candidate.fit.covariance[column, column])
    assert off[column] == pytest.approx(2.0, abs=max(4 * error, 0.05))
    others = np.setdiff1d(knee_model.body_columns, [column])
    assert not off[others].any()


def test_corrections_of_a_wrong_robot_file_predict_better(heavier, essential):
    baseline, full, informed = heavier.candidates.values()
    supported = essential[1]
    assert all(each.beats_baseline for each in (supported, full, informed))
    assert (baseline.validation.residual_rms > supported.validation.residual_rms).all()
    assert supported.fitted == 9
    assert heavier.recommended is informed
    assert heavier.fit is informed.fit
    assert heavier.verdict.ratio == heavier.recommended.error_ratio
    assert "not clearly better" not in str(heavier.verdict)
    column = heavier.force_model.parameters.labels.index("platform.m")
    mass = heavier.fit[heavier.force_model.base.expressions[column]]
    off = mass.value - heavier.force_model.prior[column]
    assert off == pytest.approx(2.0, abs=4 * mass.standard_error)
    assert mass.interval[0] < mass.value < mass.interval[1]
    assert mass.unit == "kg"


def test_names_that_are_not_there_come_with_those_that_are(heavier):
    with pytest.raises(OptionError) as refused:
        heavier.fit["platform.mas"]
    assert refused.value.facts["valid"][0].startswith("platform.m ")
    with pytest.raises(OptionError, match="did you mean 'robot file'"):
        heavier["robot fil"]
    assert list(heavier.fit) == list(heavier.fit.parameters.names)


def test_a_table_has_a_row_for_each_parameter(heavier):
    table = heavier.fit.to_polars()
    assert table["parameter"].to_list() == list(heavier.fit)
    np.testing.assert_array_equal(table["value"].to_numpy(), heavier.fit.values)


def test_an_identification_is_a_value(heavier):
    again = pickle.loads(pickle.dumps(heavier.fit))
    assert again == heavier.fit
    assert hash(again) == hash(heavier.fit)
    assert heavier.identifiability == pickle.loads(pickle.dumps(heavier.identifiability))
    assert heavier.data == pickle.loads(pickle.dumps(heavier.data))
    assert heavier.options == FitOptions()
    assert heavier["robot file"] != heavier["all parameters"]


def test_recordings_count_together(found, knee_model, motions, truth):
    parts = [modelled(knee_model, motion, truth, seed=k) for k, motion in enumerate(motions)]
    both = quietly(identify, knee_model, parts, validation=parts)
    assert len(both.data) == 1002
    errors = [each["all parameters"].fit.standard_errors for each in (both, found)]
    assert (errors[0] < errors[1]).all()


def test_a_robot_that_stands_tells_no_friction_and_hardly_a_body(knee, knee_model, motions):
    for model, count, lead in (
        (knee_model, 19, "leg1_stroke.Fc"),
        (loopid.force_model(knee, joint_terms=None), 11, "platform.my"),
    ):
        fitted, fresh = (
            [modelled(model, motion, model.prior)] for motion in (stand(knee), motions[1])
        )
        with pytest.raises(RankError) as refused:
            quietly(identify, model, fitted, validation=fresh, options=REFUSE)
        assert len(refused.value.facts["unidentifiable"]) == count
        assert lead in refused.value.facts["leads"]


def test_a_short_way_names_what_it_does_not_tell(knee_model, motions, truth):
    fitted, fresh = motions
    short = fitted.select(np.arange(60))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = identify(
            knee_model,
            [modelled(knee_model, short, truth)],
            validation=[modelled(knee_model, fresh, truth, seed=1)],
        )
    assert all(warning.category is DataWarning for warning in caught)
    said = [str(warning.message) for warning in caught]
    told = found.identifiability
    assert str(told.findings[-1]) in said
    assert told.findings[-1].why == told.weak_message
    assert told.weak_message.startswith(f"{len(told.weak)} of 23 combinations")
    assert told.weak[0].text in told.weak_message
    assert told.leads[0] in told.weak_message
    assert not found["all parameters"].beats_baseline
    assert len(eliminate(found).columns) < 12


def test_friction_from_logs_of_its_own_is_held(knee_model, motions, truth):
    fitted, fresh = motions
    other = truth.copy()
    other[knee_model.joint_columns] *= 1.5
    found = quietly(
        identify,
        knee_model,
        [modelled(knee_model, fitted, truth)],
        validation=[modelled(knee_model, fresh, truth, seed=1)],
        friction=[modelled(knee_model, fresh, other, seed=2)],
    )
    joints, labels = knee_model.joint_columns, knee_model.parameters.labels
    whole = found["all parameters"].fit
    assert whole.parameters.labels == labels
    # Friction is the warm-up's, half as large again, not that of the data.
    errors = whole.values[joints] - other[joints]
    assert np.abs(errors / whole.standard_errors[joints]).max() < 4
    # The baseline is the robot file with the friction of the fitted data.
    assert np.abs(found.baseline.fit.values - truth)[joints].max() < 60


def test_the_wrong_estimator_and_no_recordings_are_refused(knee_model, motions, truth):
    recording = modelled(knee_model, motions[0], truth)
    with pytest.raises(OptionError) as refused:
        FitOptions(estimator="best")
    assert refused.value.facts["valid"][:2] == ("ols", "wls")
    for fitted, fresh in (([], [recording]), ([recording], []), ([], None)):
        with pytest.raises((DataError, OptionError), match=r"[Rr]ecording"):
            quietly(identify, knee_model, fitted, validation=fresh)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("unidentifiable", "ignore"),
        ("fraction", 1.0),
        ("fraction", float("nan")),
        ("n_jobs", 0),
    ],
)
def test_options_check_themselves(name, value):
    with pytest.raises(OptionError, match=name):
        FitOptions(**{name: value})


def test_an_actuator_that_stands_while_validating_does_not_count(knee_model, motions, truth):
    fresh = modelled(knee_model, motions[1], truth, seed=1)
    used = fresh.used.copy()
    used[:, 2] = False
    fitted = [modelled(knee_model, motions[0], truth)]
    found = quietly(identify, knee_model, fitted, validation=[replace(fresh, used=used)])
    ratios = np.array([candidate.error_ratio for candidate in found.candidates.values()])
    assert np.isfinite(ratios).all()
    assert np.isnan(found.baseline.validation.residual_rms).tolist() == [False, False, True, False]


def test_recordings_are_split_in_time(knee_model, motions, truth):
    recordings = [modelled(knee_model, motion, truth) for motion in motions]
    training, validation = split_recordings(recordings, 0.25)
    for whole, early, late in zip(recordings, training, validation, strict=True):
        assert len(early) + len(late) == len(whole)
        assert early.motion.time[-1] < late.motion.time[0]
        share = early.motion.time[-1] / whole.motion.time[-1]
        assert share == pytest.approx(0.25, abs=0.01)
    for fraction in (0.0, 1.0, -0.5, 1.5):
        with pytest.raises(OptionError, match="between 0 and 1"):
            split_recordings(recordings, fraction)
    with pytest.raises(OptionError, match="fraction must be a finite number"):
        split_recordings(recordings, float("nan"))


def test_a_serial_robot_with_its_drives_is_identified_in_full(arm):
    terms = JointTerms(arm.actuated, ("Ia", "Fc", "Fv"))
    values = np.array([0.9, 6.0, 3.0, 0.4, 3.0, 1.5])
    model = loopid.force_model(arm, "full", terms)
    truth = model.base.values(np.concatenate([arm.standard_parameters(), values]))
    pair = []
    for seed in (1, 2):
        motion = wander(arm, seed, seconds=10.0, rate=50.0, size=(1.2, 1.5))
        pair.append([record(arm, motion, (terms, values), noise=0.3, seed=seed)])
    options = FitOptions(estimator="ols")
    found = quietly(identify, model, pair[0], validation=pair[1], options=options)
    assert np.abs(deviations(found.fit, truth)).max() < 4
    # The baseline takes the drives from the data, so only the bodies are those of the file.
    errors = np.sqrt(np.diag(found.baseline.fit.covariance))[model.joint_columns]
    off = (found.baseline.fit.values - truth)[model.joint_columns]
    assert np.abs(off / errors).max() < 4
    assert found.fit.estimator == "ols"


@pytest.mark.validate
def test_an_industrial_robot_is_identified(robot_data, load_once):
    ur5 = load_once(robot_data / "ur_description/urdf/ur5_robot.urdf")
    model = loopid.force_model(ur5, "full", None)
    pair = []
    for seed in (1, 2):
        motion = wander(ur5, seed, seconds=10.0, rate=40.0, size=(1.5,) * 6)
        pair.append([record(ur5, motion, noise=0.1, seed=seed)])
    found = quietly(identify, model, pair[0], validation=pair[1])
    assert len(found.fit.values) == 36
    assert np.abs(deviations(found["all parameters"].fit, model.prior)).max() < 4
    assert not judge_essential(found, eliminate(found)).beats_baseline


@pytest.mark.validate
def test_the_full_model_tells_a_changed_drive_of_a_closed_loop(knee):
    kinds = ("Ia", "Fc", "Fv")
    terms = JointTerms(knee.actuated, kinds)
    values = np.column_stack([np.full(4, 40.0), friction(knee)[1].reshape(4, 2)]).ravel()
    model = loopid.force_model(knee, "full", terms)
    truth = model.base.values(np.concatenate([knee.standard_parameters(), values]))
    pair = []
    for seed in (1, 2):
        motion = wander(knee, seed, seconds=12.0, rate=25.0)
        pair.append([record(knee, motion, (terms, values), noise=0.1, seed=seed)])
    found = quietly(identify, model, pair[0], validation=pair[1])
    assert len(found.fit.values) == 63
    assert np.abs(deviations(found["all parameters"].fit, truth)).max() < 4
    drives = [j for j, name in enumerate(model.parameters) if name.kind == "Ia"]
    assert np.abs(found.baseline.fit.values - truth)[drives].max() < 10


@pytest.fixture(scope="module")
def cranks(crank_model, crank_data):
    """An identification of the five-bar of which both cranks move."""
    return quietly(identify, crank_model, crank_data[1], validation=crank_data[1])


def test_unidentifiable_combinations_are_an_error_with_the_motion_to_add(crank_model, crank_data):
    one, both = crank_data
    found = identifiability(crank_model, one)
    with pytest.raises(RankError, match="unidentifiable='prior'") as refused:
        quietly(identify, crank_model, one, validation=both, options=REFUSE)
    texts = tuple(direction.text for direction in found.unidentifiable)
    assert refused.value.facts["unidentifiable"] == texts
    assert refused.value.facts["leads"] == found.leads
    for direction in found.unidentifiable[:3]:
        assert direction.text in str(refused.value)
    with pytest.raises(RankError, match=r"right_crank\.Izz"):  # so does a fit of the samples alone
        quietly(fit, crank_model.samples(one[0]))


def test_an_identification_says_what_it_took_from_the_robot_file(crank_model, crank_data, tmp_path):
    one, both = crank_data
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = identify(crank_model, one, validation=both)
    told, places = found.identifiability, {str(each.message): each.filename for each in caught}
    assert [places[str(each)] for each in told.findings] == [__file__] * 2
    assert set(told.findings) <= set(found.findings)
    whole = found["all parameters"]
    assert whole.fit.assumed == told.assumed
    assert set(whole.fit.assumed) <= set(whole.fit.insignificant())
    assert "right_crank_joint.Fc" in whole.fit.assumed
    assert load_fit(whole.fit.save(tmp_path / "fit.yaml")) == whole.fit
    assert whole.fitted == len(whole.fit.values) - len(told.assumed)
    # What is unidentifiable is not essential.
    reduction = eliminate(found)
    labels = reduction.result.parameters.labels
    assert not {"right_crank_joint.Fc", "right_crank_joint.Fv"} & set(labels)
    assert len(reduction.steps[0].labels) == told.rank
    kept = [j for j, name in enumerate(crank_model.parameters.labels) if name not in labels]
    np.testing.assert_array_equal(reduction.fit.values[kept], crank_model.prior[kept])
    assert all(len(step.values) == 15 for step in reduction.steps)


def test_instruments_come_from_a_reference_motion(crank_model, crank_runs, crank_data, cranks):
    both, reference = crank_data[1], crank_runs[1]

    def found(estimator, references):
        options = FitOptions(estimator=estimator)
        given = {"validation": both, "references": references, "options": options}
        return quietly(identify, crank_model, both, **given)

    by_instruments = found("iv", [reference])
    assert by_instruments.fit.estimator == "iv"
    # The reference is the motion itself: nothing changes.
    np.testing.assert_allclose(
        by_instruments.fit.values, cranks["all parameters"].fit.values, rtol=1e-6
    )
    for estimator, references in (("iv", []), ("wls", [reference]), ("iv", [reference] * 2)):
        with pytest.raises(OptionError, match="references"):
            found(estimator, references)


def test_friction_from_its_own_log_needs_a_log_that_excites_it(crank_model, crank_data):
    one, both = crank_data
    for fitted, friction_log in ((both, one), (one, both)):
        with pytest.raises(RankError) as refused:
            quietly(
                identify,
                crank_model,
                fitted,
                validation=both,
                friction=friction_log,
            )
        assert refused.value.facts["unidentifiable"]
    found = quietly(identify, crank_model, both, validation=both, friction=both)
    bodies = crank_model.parameters.select(crank_model.body_columns)
    assert found.identifiability.parameters == bodies


@pytest.fixture(scope="module")
def logged(mechanism, real_recording, once, taken_as_prepared):
    def identified():
        terms = JointTerms(mechanism.actuated, ("Fc", "Fv"))
        model = loopid.force_model(mechanism, "gravity", terms)
        return quietly(identify, model, [real_recording])

    return once(f"identified {mechanism.name}", identified)


def test_segments_are_predicted_better_than_by_the_robot_file(logged):
    assert logged.recommended.beats_baseline
    essential = judge_essential(logged, eliminate(logged))
    assert essential.error_ratio[0] < 1
    assert (essential.validation.r_squared > 0.7).all()


def test_what_is_not_significant_is_named(logged):
    whole = logged["all parameters"].fit
    weak = whole.insignificant()
    assert len(weak) >= 5
    # Intervals of the weakest exceed what such a link can have by far: they say so.
    assert max(whole[name].standard_error for name in weak) > 5
    assert len(eliminate(logged).columns) < len(whole.parameters) / 2


def test_the_model_of_the_errors_converges(logged):
    first, whole, longer = (
        within_runs(WeightedLeastSquares().fit_samples(logged.data), count).result
        for count in (0, CORRECTIONS, 12)
    )
    np.testing.assert_allclose(longer.standard_errors, whole.standard_errors, rtol=0.01)
    # A fit takes up what is slow: errors are larger and slower than residuals as of white ones.
    # How many samples they are worth may go either way.
    assert (whole.noise.deviation >= first.noise.deviation).all()
    assert (whole.noise.lag_one >= first.noise.lag_one).all()
    assert (whole.standard_errors >= first.standard_errors).all()


@pytest.mark.parametrize("model", few_of(["gravity", "full"], "full"))
def test_the_baseline_has_no_negative_friction_or_drive_inertia(load_once, model):
    """A log without any friction, of which least squares makes as many negative as positive."""
    robot = load_once("five_bar")
    motion = wander(robot, 3, 20.0, 20.0, size=(0.4, 0.4))
    run = loopid.simulate(robot, motion, Noise(gaussian=1.0), seed=2)
    recording = Recording.of_motion(motion, run.force, robot.actuated)
    force_model = loopid.force_model(robot, model, "Fc,Fv,Fo" + ",Ia" * (model == "full"))
    found = quietly(identify, force_model, [recording])
    joints = force_model.joint_columns
    kinds = [parameter.kind for parameter in force_model.parameters]
    lower = [force_model.prior[j] if kinds[j] in ("Fc", "Fv", "Ia") else -np.inf for j in joints]
    left = found.data.reduced(joints, force_model.prior)
    free = quiet_fit(left)
    assert (free.values < lower).any()  # or nothing is tested
    values = found.baseline.fit.values[joints]
    assert (values >= lower).all()
    # No other values as high are better [Karush1939]: the gradient is zero, or asks for less.
    R = left.problem.weighted(free.weights)
    gradient = R[:, :-1].T @ (R @ np.append(values, -1.0))
    size = np.linalg.norm(R[:, :-1], axis=0) * np.linalg.norm(R[:, -1])
    inside = values > np.array(lower) + 1e-9
    assert (np.abs(gradient[inside]) < 1e-7 * size[inside]).all()
    assert (gradient[~inside] > -1e-7 * size[~inside]).all()
    standard = found.baseline.fit.standard_parameters
    np.testing.assert_allclose(force_model.base.values(standard), found.baseline.fit.values)


@pytest.mark.parametrize("factor", [1e-6, 1e-7, 1e-9, 1e-12])
def test_forces_in_another_unit_are_refused_with_the_scale_that_fits(
    knee_model, motions, truth, factor
):
    run = modelled(knee_model, motions[0], truth)
    with pytest.raises(DataError, match="in which unit are the forces") as refused:
        identify(knee_model, [replace(run, force=factor * run.force)])
    scale = float(
        re.search(r"'force_scale' in a mapping \((\S+) would fit\)", str(refused.value))[1]
    )
    assert 0.1 < scale * factor < 10


def test_motors_without_any_force_are_named(knee_model, motions, truth):
    run = modelled(knee_model, motions[0], truth)
    for columns, named in (([1], "leg2_stroke"), (range(4), "leg1_stroke, leg2_stroke, leg3_st")):
        force = run.force.copy()
        force[:, columns] = 0.0
        with pytest.raises(DataError, match=rf"the force of {named}.* is zero in all samples"):
            identify(knee_model, [replace(run, force=force)])


def test_a_log_is_given_once(knee_model, motions, truth):
    run, other = (modelled(knee_model, motions[0], truth, seed=seed) for seed in (0, 1))
    link = knee_model.robot.bodies[0].link
    for refused in (
        lambda: identify(knee_model, [run, other, run]),
        lambda: loopid.identify_payload(knee_model, run, run, link=link),
    ):
        with pytest.raises(DataError, match=r"the forces of two logs are the same .*each log once"):
            refused()
