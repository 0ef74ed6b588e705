"""Logs from a robot file, and forces from a fit: ``loopid simulate`` and ``loopid predict``."""

import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import loopid
from loopid.logs import Recording
from loopid.logs.mapping import mapping_of
from loopid.motion import scaled_bodies

ROOT = Path(__file__).parents[2]
LOG = ROOT / "urdf" / "logs" / "five_bar.csv"


@pytest.fixture(scope="module")
def five_bar(load_once):
    return load_once("five_bar")


@pytest.fixture(scope="module")
def saved(five_bar, tmp_path_factory):
    model = loopid.force_model(five_bar, "full", None)
    path = tmp_path_factory.mktemp("fit") / "fit.yaml"
    return loopid.Fit.of(model, model.prior).save(path)


@pytest.fixture(scope="module")
def sweep(five_bar):
    plan = loopid.motion.read_motion_program("five_bar").motion("sweep", 50)
    motion = loopid.motion.joint_motion(five_bar, plan)
    force = loopid.simulate(five_bar, motion).force
    return Recording.of_motion(motion, force, five_bar.actuated)


def test_the_robot_file_predicts_its_own_forces(five_bar, saved, sweep):
    found = loopid.load_fit(saved).predict(sweep)
    np.testing.assert_allclose(found.predicted, sweep.force, atol=1e-9)
    np.testing.assert_allclose(found.moving.r_squared, 1.0, atol=1e-12)
    assert found.standing.samples.sum() == 0


def test_errors_are_those_of_the_definition(five_bar, saved, sweep):
    used = np.random.default_rng(0).random(sweep.force.shape) < 0.7
    known = Recording("run", sweep.actuators, sweep.motion, sweep.force + 0.3, used, sweep.segments)
    found = loopid.load_fit(saved).predict(known)
    for part, chosen in ((found.moving, used), (found.standing, ~used)):
        np.testing.assert_array_equal(part.samples, chosen.sum(axis=0))
        np.testing.assert_allclose(part.residual_rms, 0.3, rtol=1e-6)
        for k in range(2):
            share = 0.3**2 / np.var(known.force[chosen[:, k], k])
            assert part.r_squared[k] == pytest.approx(1 - share)
    table = np.genfromtxt(found.csv().splitlines(), delimiter=",", names=True)
    np.testing.assert_allclose(table["left_crank_jointpredicted"], found.predicted[:, 0], rtol=1e-8)


def test_another_robot_is_refused(saved, sweep, load_once):
    four_bar = loopid.load("four_bar")
    with pytest.raises(loopid.LoopidError, match="this is a fit of five_bar"):
        loopid.load_fit(saved, robot=four_bar)
    other = replace(sweep, actuators=("crank_joint", "rocker_joint"))
    with pytest.raises(loopid.LoopidError, match="has left_crank_joint"):
        loopid.load_fit(saved).predict(other)
    with pytest.raises(loopid.LoopidError, match="prepare its log with this robot"):
        loopid.identify(load_once("five_bar"), other)
    with pytest.raises(loopid.LoopidError, match="prepare its log with this robot"):
        loopid.load_fit(saved).model.samples(other)


def test_scaled_bodies_stay_bodies(five_bar):
    values = scaled_bodies(five_bar, 0.2, seed=3).reshape(-1, 10)
    factors = values[:, 0] / five_bar.standard_parameters("full").reshape(-1, 10)[:, 0]
    given = five_bar.standard_parameters("full").reshape(-1, 10)
    np.testing.assert_allclose(values, factors[:, None] * given)
    assert 0.5 < factors.min() < factors.max() < 2
    assert np.ptp(factors) > 0
    np.testing.assert_array_equal(scaled_bodies(five_bar, 0.0), given.ravel())


def test_the_log_of_the_repository_is_what_the_command_writes(run, tmp_path):
    """The command is the one on the page."""
    page = (ROOT / "docs" / "identification.md").read_text(encoding="utf-8")
    command = next(
        line for line in page.splitlines() if line.startswith("loopid simulate five_bar")
    )
    path = tmp_path / "run.csv"
    assert run(*command.split()[1:-1], str(path)).code == 0
    here, there = (np.genfromtxt(file, delimiter=",", skip_header=1) for file in (path, LOG))
    np.testing.assert_allclose(here, there, atol=1e-6)
    assert path.read_text().splitlines()[0] == LOG.read_text().splitlines()[0]


def test_a_leg_that_stands_is_not_shaken_in_the_log_of_the_knee_robot(run, tmp_path):
    """Its forces are noise about what it carries; the options are those of the same page."""
    options = "--motion 9 --rate 20 --terms Fc=60,Fv=900 --noise 2 --encoder-step 2e-5"
    path, kept = tmp_path / "run.csv", ROOT / "urdf" / "logs" / "3ups_rpu.csv"
    words = [*options.split(), "--cad-error", "0.2", "--out", str(path)]
    assert run("simulate", "3ups_rpu", *words).code == 0
    here, there = (np.genfromtxt(file, delimiter=",", skip_header=1) for file in (path, kept))
    np.testing.assert_allclose(here, there, atol=1e-6)
    position, force = here[:, 4], here[:, 8]
    changes = np.append(np.diff(position) != 0, True)
    still = np.convolve(changes, np.ones(41), "same") == 0  # for two seconds
    assert still.sum() > 1000
    inside = still[1:] & still[:-1]
    jumps = np.abs(np.diff(force))[inside] > 6 * np.sqrt(2) * 2.0
    assert jumps.mean() < 0.01  # where it starts or ends to creep


@pytest.mark.parametrize("option", ["rate", "noise", "encoder-step", "cad-error", "seed"])
@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_numbers_that_mean_nothing_are_refused_in_one_sentence(run, tmp_path, option, value):
    found = run("simulate", "five_bar", f"--{option}={value}", "--out", tmp_path / "run.csv")
    assert (found.code, "Traceback" in found.err) == (2, False)
    assert f"--{option}" in found.err
    assert not (tmp_path / "run.csv").exists()


def test_no_log_takes_the_place_of_the_robot_or_its_motion(run, tmp_path):
    given = {}
    for name in ("five_bar.urdf", "five_bar.yaml", "five_bar_motions.yaml"):
        given[name] = Path(shutil.copy(ROOT / "urdf" / name, tmp_path))
    robot, motions = given["five_bar.yaml"], given["five_bar_motions.yaml"]
    for place in given.values():
        before = place.read_text()
        done = run("simulate", str(robot), str(motions), "--out", str(place))
        assert (done.code, place.read_text()) == (2, before)
        assert "which this is made from" in done.err


@pytest.mark.parametrize(
    ("name", "said"),
    [("pic.png", "choose among .csv"), ("new.log", "choose among .csv"), ("", "has no name")],
)
def test_no_log_takes_the_place_of_another_kind_of_file(run, tmp_path, name, said):
    (tmp_path / "pic.png").write_text("a picture")
    out = str(tmp_path / name) if name else ""
    refused = run("simulate", "five_bar", "five_bar", "--out", out)
    assert refused.code == 2
    assert said in refused.err
    assert (tmp_path / "pic.png").read_text() == "a picture"


def test_a_log_or_robot_without_a_name_is_refused(run):
    for words in (("identify", "five_bar", ""), ("check", "")):
        refused = run(*words)
        assert refused.code == 2
        assert "has no name: give a path" in refused.err


def test_what_numpy_warns_of_is_said_in_a_sentence(run, monkeypatch):
    def overflowing(*_, **__):
        warnings.warn("invalid value encountered in divide", RuntimeWarning, stacklevel=1)
        return SimpleNamespace(text="time\n")

    monkeypatch.setattr("loopid.motion.simulation.simulate", overflowing)
    said = run("simulate", "five_bar", "five_bar").err
    assert "are the units of all files right?" in said.replace("\n", " ")


@pytest.mark.parametrize("terms", ["Fc", "Fc=a", "Fc=1 Fv=2"])
def test_terms_without_values_are_refused(terms, run):
    found = run("simulate", "five_bar", "--terms", terms)
    assert found.code == 2
    assert "must be kinds with values, such as Fc=60,Fv=900" in found.err


def test_forces_that_are_not_logged_judge_nothing(saved, run, tmp_path):
    rows = [line.split(",") for line in LOG.read_text().splitlines()]
    lacking = tmp_path / "lacking.csv"
    zeros = [["0" if "force" in rows[0][k] else x for k, x in enumerate(row)] for row in rows[1:]]
    lacking.write_text("\n".join(map(",".join, [rows[0], *zeros])))
    found = run("predict", saved, lacking, "--out", tmp_path / "out")
    assert "Predictions that nothing judges: no motor moves with a force" in " ".join(
        found.out.split()
    )
    assert "Not judged" in (tmp_path / "out" / "report.html").read_text()


def test_predict_compares_a_log_with_a_fit(saved, run, tmp_path):
    out = tmp_path / "out"
    found = run("predict", str(saved), str(LOG), "--out", str(out), "--json")
    assert found.code == 0
    (record,) = json.loads(found.out)["recordings"]
    assert min(record["relative_errors"]) > 0.1  # bodies some 20 % off, no friction
    names = {"report.html", "prediction.json", "prediction_five_bar.csv"}
    assert {file.name for file in out.iterdir()} == names
    (part,) = json.loads(run("predict", str(saved), str(LOG), "--rows=1:300", "--json").out)[
        "recordings"
    ]
    assert sum(part["moving"]["samples"]) < sum(record["moving"]["samples"])


def test_a_robot_that_moved_is_asked_for(saved, run, tmp_path):
    text = saved.read_text()
    lost = tmp_path / "lost.yaml"
    lost.write_text(text.replace('"path": "five_bar"', '"path": "gone/five_bar.yaml"'))
    found = run("predict", str(lost), str(LOG))
    assert found.code == 2
    assert "--robot" in found.err
    assert run("predict", str(lost), str(LOG), "--robot", "five_bar").code == 0


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_payload_of_two_logs(five_bar, run, run_json, tmp_path):
    plan = loopid.motion.read_motion_program("five_bar").motion("sweep", 10)
    motion = loopid.motion.joint_motion(five_bar, plan)
    first = five_bar.parameters("full").labels.index("left_coupler.m")
    for name, mass in (("light", 0.0), ("heavy", 1.5)):
        bodies = five_bar.standard_parameters("full").copy()
        bodies[first : first + 3] += mass, 0.1 * mass, 0.0
        measured = loopid.simulate(
            five_bar, motion, loopid.motion.Noise(gaussian=0.02), standard_parameters=bodies
        )
        (tmp_path / f"{name}.csv").write_text(measured.text)
    logs = [f"--unloaded={tmp_path}/light.csv", f"--loaded={tmp_path}/heavy.csv"]
    options = ["--model=full", "--terms=none"]
    found = run_json("payload", "five_bar", "left_coupler", *logs, *options)
    assert found["mass"] == pytest.approx(1.5, rel=0.01)
    assert found["centre"][0] == pytest.approx(0.1, abs=0.005)
    assert found["centre"][2] is None  # a planar robot
    assert found["motors"]["actuators"] == list(five_bar.actuated)
    assert not any("disagree" in each["title"] for each in found["findings"])
    np.testing.assert_allclose(found["motors"]["values"], 1.5, rtol=0.05)
    written = tmp_path / "mapping.yaml"
    known = ["--known-mass=1.5", f"--write-mapping={written}"]
    gains = run_json("payload", "five_bar", "left_coupler", *logs, *options, *known)["gains"]
    np.testing.assert_allclose(gains, 1.0, atol=0.05)
    scales = mapping_of(written).force_scale
    np.testing.assert_allclose([scales[name] for name in five_bar.actuated], gains, rtol=1e-5)
    alone = run("payload", "five_bar", "left_coupler", *logs, f"--write-mapping={written}")
    assert alone.code == 2
    assert "say the mass of the payload, --known-mass KG" in alone.err
    assert "--rows must be M:N" in run("payload", "five_bar", "left_coupler", *logs, "--rows=7").err
    refused = run("payload", "five_bar", "arm", *logs)
    assert refused.code == 2
    assert "left_coupler" in refused.err
