"""``loopid identify`` where a log does not show everything, and with other ways to fit."""

import json
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from loopid import JointTerms, load_mechanism
from loopid.kinematics import measured_coordinates
from loopid.saved import read_fit
from loopid.trajectories import Motion, joint_motion
from made_runs import logged


@pytest.fixture(scope="module")
def elbow_log(arm_files, tmp_path_factory):
    """A log of the serial robot in which only the elbow moves."""
    arm = load_mechanism(arm_files[0])
    time = np.arange(1000) / 50
    position, velocity, acceleration = (np.zeros((len(time), 2)) for _ in range(3))
    position += measured_coordinates(arm).read(arm.reference[None].copy())
    position[:, 1] += np.sin(2 * time)
    velocity[:, 1], acceleration[:, 1] = 2 * np.cos(2 * time), -4 * np.sin(2 * time)
    motion = joint_motion(arm, Motion(arm.measured, time, position, velocity, acceleration))
    terms = JointTerms(arm.actuated), np.array([3.0, 1.0, 2.0, 0.5])
    path = tmp_path_factory.mktemp("elbow") / "elbow.csv"
    path.write_text(logged(arm, motion, terms, noise=0.1))
    return str(path)


def error_of(done):
    assert (done.code, done.out) == (2, "")
    last = done.err.splitlines()[-1]
    assert last.startswith("loopid: error: ")
    return last


def test_what_a_log_does_not_show_is_refused_with_the_motion_to_add(run, arm_files, elbow_log):
    said = error_of(run("identify", arm_files[0], elbow_log))
    assert "the data do not show" in said
    assert "shoulder.Fc" in said
    assert "lit by" in said
    assert "--on-dark truncate" in said


def test_truncation_is_marked_everywhere(run, run_json, arm_files, elbow_log, tmp_path):
    command = "identify", arm_files[0], elbow_log, "--on-dark", "truncate"
    done = run(*command, "--out", tmp_path)
    assert done.code == 0, done.err
    assert "loopid: warning: the data do not show" in done.err
    record = run_json(*command)
    assert record == json.loads((tmp_path / "identification.json").read_text())
    support, assumed = record["support"], record["fit"]["estimate"]["assumed"]
    assert {"shoulder.Fc", "shoulder.Fv"} <= set(assumed)
    assert read_fit(tmp_path / "parameters.yaml").result.assumed == tuple(assumed)
    dark = [weak for weak in support["weak"] if weak["dark"]]
    assert len(dark) == support["structural_rank"] - support["rank"] > 0
    assert all(weak["standard_error"] is None for weak in dark)
    page = (tmp_path / "report.md").read_text()
    for weak in dark:
        assert weak["combination"].split()[0] in done.out
        assert f"| {weak['combination']} | 0 | dark | {weak['lighting']['text']} |" in page
        assert weak["lighting"]["joints"] == record["actuators"]
        assert np.linalg.norm(weak["lighting"]["direction"]) == pytest.approx(1)
    for entry in record["fit"]["base_parameters"]:
        unbounded = entry["interval_95_percent"] == [None, None]
        assert unbounded == (entry["name"] in assumed)
    assert any("rest on it" in sentence for sentence in record["findings"])


@pytest.mark.parametrize("estimator", ["ols", "wls", "huber", "bisquare", "bayes"])
def test_every_estimator_has_its_name(run_json, arm_files, estimator):
    found = run_json("identify", *arm_files[:2], "--estimator", estimator)
    assert found["fit"]["estimate"]["estimator"] == estimator
    values = {entry["name"]: entry["value"] for entry in found["fit"]["base_parameters"]}
    for name, value in (("shoulder.Fc", 3.0), ("elbow.Fc", 2.0)):
        assert values[name] == pytest.approx(value, rel=0.1)


def test_instruments_are_read_from_a_reference_log(run, run_json, arm_files):
    robot, log, _ = arm_files
    found = run_json("identify", robot, log, "--estimator", "iv", "--reference", log)
    assert found["fit"]["estimate"]["estimator"] == "iv"
    said = error_of(run("identify", robot, log, "--estimator", "iv"))
    assert "reference" in said
    said = error_of(run("identify", robot, log, "--reference", log))
    assert "'wls'" in said


def test_the_width_of_the_prior_is_an_option(run, run_json, arm_files):
    command = "identify", *arm_files[:2], "--estimator", "bayes", "--prior-deviation"
    found = [run_json(*command, width) for width in ("1e-5", "1e3")]
    prior = np.array(found[0]["robot_file"])
    known = prior != 0
    values = [np.array([e["value"] for e in each["fit"]["base_parameters"]]) for each in found]
    np.testing.assert_allclose(values[0][known], prior[known], rtol=1e-3)
    assert np.abs(values[1] - prior)[known].max() > np.abs(values[0] - prior)[known].max()
    assert "above 0" in error_of(run(*command, "0"))
    said = error_of(run("identify", *arm_files[:2], "--prior-deviation", "0.1"))
    assert "'bayes'" in said


def test_bodies_that_can_exist_are_written(run, run_json, arm_files, tmp_path):
    pytest.importorskip("cvxpy")
    command = "identify", *arm_files[:2], "--consistent", "entropic"
    done = run(*command, "--out", tmp_path)
    assert done.code == 0, done.err
    record = run_json(*command)["consistent"]
    assert "physically consistent bodies (entropic)" in done.out
    saved = YAML(typ="safe").load((tmp_path / "standard_parameters.yaml").read_text())
    assert saved == record
    said = error_of(run(*command[:-1], "best"))
    assert "entropic" in said


def test_without_the_option_no_bodies_are_written(run, arm_files, tmp_path):
    assert run("identify", *arm_files[:2], "--out", tmp_path).code == 0
    assert not (tmp_path / "standard_parameters.yaml").exists()


def test_a_floating_base_is_refused_by_name(run, arm_files):
    said = error_of(run("identify", *arm_files[:2], "--floating-base"))
    assert "root_joint.vx" in said
    assert "--lock" in said


def test_mimics_that_are_free_need_signals_of_their_own(run, tmp_path, arm_files):
    text = (
        Path(arm_files[0])
        .read_text()
        .replace(
            '<joint name="elbow" type="revolute">',
            '<joint name="elbow" type="revolute"><mimic joint="shoulder" multiplier="0.5"/>',
        )
    )
    (tmp_path / "mimic.urdf").write_text(text)
    command = "identify", tmp_path / "mimic.urdf", arm_files[1]
    free = run(*command, "--free-mimics", "--json")
    assert free.code == 0, free.err
    assert json.loads(free.out)["actuators"] == ["shoulder", "elbow"]


def test_the_table_of_what_is_weak_is_the_record(run_json, arm_files, elbow_log):
    record = run_json("identify", arm_files[0], elbow_log, "--on-dark", "truncate")
    effects = record["support"]["effects"]
    assert effects == sorted(effects, reverse=True)
    assert record["support"]["better_than_robot_file"] <= record["support"]["rank"]
    doubtful = [weak for weak in record["support"]["weak"] if not weak["dark"]]
    assert all(weak["standard_error"] > 1 for weak in doubtful)
