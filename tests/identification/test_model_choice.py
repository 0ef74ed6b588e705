"""The model that a log asks for: full dynamics, unless its motion is too slow to show inertia."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

import loopid
from loopid import FitOptions, JointTerms, identify
from loopid.errors import DataError, OptionError
from loopid.identification import choose_model
from loopid.motion import scaled_bodies
from loopid.regressors import force_parts
from made_runs import identify_unjudged, quietly, record, wander

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")

NOISE, REACH = 0.05, (0.6, 0.6)


@pytest.fixture(scope="module")
def five_bar(load_once):
    return load_once("five_bar")


def run_of(robot, seconds, noise=NOISE, seed=0, standard=None, terms="Fc=0.1,Fv=0.05"):
    """A motion with so long a period, of bodies 20 % off."""
    motion = wander(robot, 7, seconds=seconds, rate=300 / seconds, size=REACH, harmonics=3)
    bodies = scaled_bodies(robot, 0.2, seed=3) if standard is None else standard
    return record(robot, motion, JointTerms.with_values(robot, terms), bodies, noise, seed)


def test_slower_and_slower_motion_asks_for_gravity_in_the_end(five_bar):
    choices = [choose_model(five_bar, [run_of(five_bar, T)]) for T in (10.0, 30.0, 300.0)]
    assert [each.model for each in choices] == ["full", "full", "gravity"]
    assert choices[1].share > choices[1].least_share
    assert choices[2].share < choices[2].least_share
    shares = np.array([each.share for each in choices])
    np.testing.assert_allclose(shares[1:] / shares[:-1], [1 / 9, 1 / 100], rtol=0.1)


def test_a_motor_that_moves_in_one_part_of_a_log_does_not_decide(five_bar):
    """Others do not determine its friction: errors of a whole part are one error."""
    models = []
    for seed in (0, 3):
        run = run_of(five_bar, 300.0, seed=seed)
        used = run.used.copy()
        used[:100, 0] = used[130:, 0] = False
        models.append(choose_model(five_bar, [replace(run, used=used)]).model)
    assert models == ["gravity", "gravity"]


def test_shares_are_those_of_the_forces_by_cause(five_bar):
    run = run_of(five_bar, 30.0)
    motion = run.motion
    state = motion.configurations, motion.velocities, motion.accelerations
    parts = force_parts(five_bar, *state)
    expected = np.linalg.norm(parts.inertial + parts.coriolis, axis=0)
    expected /= np.linalg.norm(run.force, axis=0)
    np.testing.assert_allclose(choose_model(five_bar, [run]).shares, expected, rtol=1e-9)


@pytest.mark.validate
def test_the_standard_error_is_that_of_a_factor_of_inertia(five_bar):
    """Of logs with other noise: how far the factor that fits best scatters."""
    runs = [run_of(five_bar, 30.0, noise=0.2, seed=seed) for seed in range(10)]
    motion = runs[0].motion
    state = motion.configurations, motion.velocities, motion.accelerations
    parts = force_parts(five_bar, *state)
    rates = [motion.velocities, np.sign(motion.velocities), np.ones_like(motion.velocities)]
    own = [each[:, :, None] * np.eye(2) for each in rates]
    gravity = loopid.regressors.gravity_regressor(five_bar, motion.configurations)
    inertia = (parts.inertial + parts.coriolis)[:, :, None]
    W = np.concatenate([inertia, gravity, *own], axis=2).reshape(runs[0].force.size, -1)
    W /= np.maximum(np.linalg.norm(W, axis=0), 1e-12)
    scale = np.linalg.norm(inertia)
    factors = [np.linalg.lstsq(W, r.force.ravel(), rcond=1e-8)[0][0] / scale for r in runs]
    told = np.mean([choose_model(five_bar, [run]).factor_error for run in runs[:4]])
    assert told == pytest.approx(np.std(factors, ddof=1), rel=0.5)


def test_identify_and_studies_of_a_robot_choose(five_bar):
    slow = run_of(five_bar, 300.0)
    found = identify_unjudged(five_bar, slow)
    assert found.force_model.model == found.choice.model == "gravity"
    assert found.force_model.automatic
    share = f"inertia is at most {100 * found.choice.share:.2g} % of them"
    assert share in str(found.verdict)
    (said,) = [each for each in found.findings if "too slow to show inertia" in each.title]
    assert said.severity == "note"
    options = FitOptions(terms="Fc", fraction=0.6)
    study = quietly(identify, five_bar, slow, options=options)
    assert study.force_model.model == "gravity"


def test_a_gravity_model_of_fast_motion_is_a_finding_with_the_errors_of_both(five_bar):
    run = run_of(five_bar, 10.0, noise=0.01)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = identify(loopid.force_model(five_bar, "gravity"), [run])
    finding = found.choice.finding
    assert str(finding) in [str(each.message) for each in said]
    assert finding in found.findings
    assert "and as parameters" not in found.verdict.use
    assert found.verdict.improvement == finding.do == 'use model="full"'
    gravity, full = (float(x) for x in re.findall(r"([\d.e+-]+) %", finding.why)[-2:])
    better = quietly(identify, five_bar, [run])
    assert better.force_model.model == "full"
    assert full == pytest.approx(100 * better.verdict.error, rel=0.3)
    assert gravity == pytest.approx(100 * found.verdict.error, rel=0.5)
    assert gravity > 3 * full
    assert not any("gravity" in each.title for each in better.findings)


def test_inertia_that_the_file_knows_nothing_of_shows_by_what_it_predicts(five_bar):
    run = run_of(five_bar, 200.0, terms="Fc=0.1,Fv=0.05,Ia=5")
    found = choose_model(five_bar, [run])
    assert not found.shown
    assert found.model == "full"
    assert choose_model(five_bar, [run_of(five_bar, 200.0)]).model == "gravity"
    assert "by the robot file" not in found.finding.why


def test_rotors_that_the_file_lacks_show_even_where_fits_to_parts_of_a_log_predict_worse(five_bar):
    """Half a period of a slow motion: other segments say little of each, and less of inertia."""
    run, without = (
        run_of(five_bar, 100.0, noise=0.01, seed=1, terms=terms).select(slice(0, 150))
        for terms in ("Fc=0.1,Fv=0.05,Ia=2", "Fc=0.1,Fv=0.05")
    )
    found = choose_model(five_bar, [run])
    assert 2 * found.factor_error > 1  # the file's inertia alone would not show
    assert found.factor > 5 * found.factor_error
    assert (found.errors["full"] > found.errors["gravity"]).all()
    assert found.model == "full"
    assert re.search(r"shows 11 ± 3\.\d times as much", found.finding.why)
    assert choose_model(five_bar, [without]).model == "gravity"


def test_forces_that_lack_inertia_ask_for_gravity_and_say_so(five_bar):
    """As where a hand moves the robot; bodies of half the inertia are bodies."""
    run = run_of(five_bar, 10.0)
    motion = run.motion
    parts = force_parts(five_bar, motion.configurations, motion.velocities, motion.accelerations)
    inertia = parts.inertial + parts.coriolis
    for factor, model in ((0.0, "gravity"), (0.5, "full"), (1.0, "full")):
        force = parts.gravity + factor * inertia
        noise = np.random.default_rng(0).normal(scale=NOISE, size=force.shape)
        found = choose_model(five_bar, [replace(run, force=force + noise)])
        assert found.model == model
        assert abs(found.factor - factor) < 3 * found.factor_error < 0.2
        assert ("no inertia" in found.finding.title) == (factor == 0)


def test_slow_motion_says_nothing_of_how_much_inertia_there_is(load_once):
    """What a slow log does not tell is not missing, whatever the noise makes of it."""
    knee = load_once("3ups_rpu")
    log = quietly(loopid.read_log, knee.path.parent / "logs" / "3ups_rpu.csv", knee)
    choice = choose_model(knee, [quietly(loopid.prepare, knee, log)])
    assert choice.factor + 2 * choice.factor_error < 0.5  # by chance: the truth is 1
    assert not choice.shown
    assert choice.finding.severity == "note"


def test_an_unknown_model_is_refused_with_the_choices(five_bar):
    with pytest.raises(OptionError, match="'slow': choose among auto, gravity, full"):
        identify(five_bar, "run.csv", options=FitOptions(model="slow"))
    with pytest.raises(DataError, match="give at least one"):
        choose_model(five_bar, [])
