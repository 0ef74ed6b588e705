"""``loopid export``: from the file of a fit to robot files, base parameters and C."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import loopid
from loopid import JointTerms, random_configurations
from loopid.errors import FileError
from loopid.identification import Fit, load_fit
from loopid.identification.quality import Quality
from loopid.kinematics import closed_motion
from loopid.regressors import motion_regressor
from made_runs import first_rows

pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")
ROOT = Path(__file__).parents[2] / "urdf"


def saved(folder, robot="five_bar", model="gravity", kinds=("Fc", "Fv"), factor=1.05, **options):
    """A fit as ``loopid identify`` saves it: all bodies heavier, and friction."""
    mechanism = loopid.load(robot, **options)
    terms = JointTerms(mechanism.actuated, kinds) if kinds else None
    found = loopid.force_model(mechanism, model, terms)
    standard = factor * found.standard_prior
    standard[len(standard) - len(found.joint_values) :] += 0.7
    values = found.base.values(standard)
    dof = np.ones(len(mechanism.independent))
    quality = Quality(dof, dof, dof.astype(int))
    covariance = np.diag(np.arange(1.0, len(values) + 1) ** 2)
    fit = Fit(
        "consistent",
        found.parameters,
        mechanism.independent,
        values,
        covariance,
        1.0,
        50.0,
        quality,
        dof,
        standard_parameters=standard,
    )
    return found, values, loopid.Fit.of(found, fit).save(folder / "parameters.yaml")


@pytest.mark.parametrize("model", [pytest.param("gravity", marks=pytest.mark.validate), "full"])
def test_everything_at_once(run_json, tmp_path, model):
    pytest.importorskip("casadi", reason="needs pip install 'loopid[codegen]'")
    found, values, fit = saved(tmp_path, model=model)
    places = {name: tmp_path / f"new.{name}" for name in ("urdf", "yaml")}
    options = [word for name, place in places.items() for word in (f"--{name}", place)]
    done = run_json("export", "five_bar", fit, *options, "--c", tmp_path / "c")
    code = [tmp_path / "c" / f"five_bar.{kind}" for kind in ("h", "c", "casadi")]
    assert done["written"] == [str(name) for name in (*places.values(), *code)]
    assert load_fit(places["yaml"]).record() == load_fit(fit).record()
    assert "five_bar_values[FIVE_BAR_PARAMETERS]" in (tmp_path / "c" / "five_bar.h").read_text()
    text = (ROOT / "five_bar.yaml").read_text()
    (tmp_path / "new_robot.yaml").write_text(text.replace("five_bar.urdf", "new.urdf"))
    again = loopid.load(tmp_path / "new_robot.yaml")
    q = random_configurations(again, 10, seed=0)
    motion = closed_motion(again, q, *np.random.default_rng(1).standard_normal((2, 10, 2)))
    W = motion_regressor(again, motion, model, joint_terms=found.joint_terms)
    terms = found.joint_terms.values(again)
    np.testing.assert_allclose(terms, 0.7)
    whole = np.concatenate([again.standard_parameters(model), terms])
    expected = found.base.regressor(W) @ values
    np.testing.assert_allclose(W @ whole, expected, atol=1e-9 * np.abs(expected).max())


def test_a_fit_of_a_log_with_a_mistake_is_refused_unless_asked_for_anyway(run, tmp_path):
    found, _, place = saved(tmp_path)
    mistake = "the force of left_crank_joint has the wrong sign"
    fit = replace(load_fit(place), mistakes=(mistake,))
    loopid.Fit.of(found, fit).save(place, anyway=True)
    out = tmp_path / "new.yaml"
    refused = run("export", "five_bar", place, "--yaml", out)
    assert_refused(refused, "not fit for use", mistake, "--anyway")
    assert not out.exists()
    done = run("export", "five_bar", place, "--yaml", out, "--anyway")
    assert done.code == 0, done.err
    assert load_fit(out).mistakes == (mistake,)


def test_a_report_is_written_of_a_fit_that_is_not(run, tmp_path):
    folder, log = tmp_path / "out", tmp_path / "run.csv"
    log.write_text(first_rows("five_bar"))
    own = "--terms", "Fc,Fv,Fs~0.004,Fs~0.005", "--estimator", "ols"
    refused = run("identify", "five_bar", log, *own, "--out", folder)
    assert refused.code == 0
    assert "Not fit for use, as friction of left_crank_joint" in " ".join(refused.out.split())
    said = "warning: parameters.yaml is not written: the fit is not fit for use, as friction of "
    assert said + "left_crank_joint" in refused.err
    assert "--terms Fc,Fv and --estimator wls; --anyway takes it nevertheless" in refused.err
    written = {each.name for each in folder.iterdir()}
    assert "report.html" in written
    assert not {"parameters.yaml", "all_parameters.yaml"} & written
    advised = run(
        *("identify", "five_bar", log, "--terms", "Fc,Fv", "--estimator", "wls", "--out", folder)
    )
    assert advised.code == 0, advised.err


def test_joint_terms_that_a_robot_file_has_no_place_for_are_named(run, tmp_path):
    _, _, fit = saved(tmp_path, kinds=("Fv", "Ks"))
    done = run("export", "five_bar", fit, "--urdf", tmp_path / "new.urdf")
    assert done.code == 0
    assert done.err.count("\n") == 1
    names = [f"{side}_crank_joint.{kind}" for side in ("left", "right") for kind in ("Ks", "Fo")]
    assert done.err.endswith(f"are {', '.join(names)}\n")
    assert (tmp_path / "new.urdf").read_text().count("<dynamics damping=") == 2


@pytest.mark.validate
def test_the_robot_is_loaded_as_for_the_fit(run, tmp_path):
    _, _, fit = saved(tmp_path, "3rrr", tied=True, kinds=("Ia", "Fv"))
    out = tmp_path / "base.yaml"
    done = run("export", "3rrr", fit, "--yaml", out)
    assert done.code == 0, done.err
    assert done.out.splitlines() == [str(out)]
    assert load_fit(out).model.joint_terms.kinds == ("Ia", "Fv")
    _, _, locked = saved(tmp_path, lock=["left_coupler_joint"])
    assert_refused(run("export", "four_bar", locked, "--yaml", out), "left_coupler_joint")


def test_a_fit_of_another_geometry_is_refused(run, tmp_path, monkeypatch):
    """Every name of configuration 8 is one of configuration 1; forces differ by up to 31 N."""
    monkeypatch.chdir(tmp_path)
    _, _, fit = saved(tmp_path, "3ups_rpu")
    command = [sys.executable, ROOT / "generate.py", "--robot", "3ups_rpu"]
    command += ["--configuration", "8", "--out", tmp_path / "8"]
    subprocess.run(command, check=True)
    places = [word for name in ("yaml", "urdf") for word in (f"--{name}", f"x.{name}")]
    done = run("export", next((tmp_path / "8").glob("*.yaml")), fit, *places)
    assert_refused(done, "a fit of 3ups_rpu, not of", "closure", "not the files of the fit")
    assert not list(Path().glob("x.*"))


def assert_refused(done, *words):
    assert done.code == 2
    assert done.out == ""
    assert done.err.startswith("loopid: error: ")
    assert done.err.count("\n") == 1
    for word in words:
        assert word in done.err


def test_refusals(run, tmp_path):
    _, _, fit = saved(tmp_path)
    out = tmp_path / "new"
    assert_refused(run("export", "five_bar", fit), "nothing to export", "--urdf", "--c")
    assert_refused(run("export", "five_bar", "none.yaml", "--yaml", f"{out}.yaml"), "none.yaml")
    assert_refused(run("export", "five_bar", fit, "--yaml", f"{out}.txt"), "'.txt'")
    done = run("export", "five_bar", fit, "--urdf", f"{out}.urdf", "--yaml", f"{out}.npz")
    assert_refused(done, "'.npz'", ".yaml")
    assert_refused(run("export", "five_bar", fit, "--urdf", f"{out}.xml"), "'.xml'", ".urdf")
    (tmp_path / "damaged.json").write_text(json.dumps({"format": "loopid fit"}))
    done = run("export", "five_bar", tmp_path / "damaged.json", "--yaml", f"{out}.yaml")
    assert_refused(done, "damaged.json", "is a fit in form 'unknown'")
    done = run("export", "four_bar", fit, "--yaml", f"{out}.yaml")
    assert_refused(done, "five_bar", "left_crank_joint")
    assert_refused(run("export", "five_bar", fit, "--c", out, "--name", "1"), "letters", "'1'")
    assert not list(tmp_path.glob("new*"))


def test_impossible_bodies_are_refused(run, tmp_path):
    _, _, fit = saved(tmp_path, model="full", factor=-1.0)
    places = [tmp_path / "new.urdf", tmp_path / "new.yaml"]
    done = run("export", "five_bar", fit, "--urdf", places[0], "--yaml", places[1])
    assert_refused(done, "crank")
    assert not any(place.exists() for place in places)


def test_fits_without_bodies_are_refused_with_advice_that_works(run, arm_files, tmp_path):
    out, new = tmp_path / "out", tmp_path / "new.urdf"
    done = run("identify", *arm_files[:2], "--out", out, "--estimator", "ols")
    assert done.code == 0, done.err
    done = run("export", arm_files[0], out / "parameters.yaml", "--urdf", new)
    assert_refused(done, "a fit by ols has base parameters", "default estimator")
    assert run("identify", *arm_files[:2], "--out", out, "--estimator", "wls").code == 0
    assert run("export", arm_files[0], out / "parameters.yaml", "--urdf", new).code == 0


def test_nothing_is_written_over_what_it_is_made_from(run, arm_files, tmp_path):
    for ending in ("urdf", "yaml"):
        shutil.copy(ROOT / f"five_bar.{ending}", tmp_path)
    _, _, fit = saved(tmp_path)
    robot, link = tmp_path / "five_bar.yaml", tmp_path / "link.yaml"
    link.symlink_to(fit)
    before = {path: path.read_bytes() for path in (robot, fit)}
    for place in (robot, fit, link):
        for options in ((), ("--overwrite",)):
            done = run("export", robot, fit, "--yaml", place, *options)
            assert_refused(done, "made from", "name another")
    model = loopid.force_model(loopid.load(robot), joint_terms=None)
    with pytest.raises(FileError, match="made from"):
        loopid.Fit.of(model, np.ones(6)).save(robot)
    assert {path: path.read_bytes() for path in before} == before
    # The results of an identification, too, beside a robot of such a name.
    shutil.copy(robot, tmp_path / "parameters.yaml")
    done = run("identify", tmp_path / "parameters.yaml", arm_files[1], "--out", tmp_path)
    assert_refused(done, "parameters.yaml", "made from")


def test_the_robots_own_file_needs_to_be_asked_for(run, tmp_path):
    for ending in ("urdf", "yaml"):
        shutil.copy(ROOT / f"five_bar.{ending}", tmp_path)
    _, _, fit = saved(tmp_path)
    robot, own = tmp_path / "five_bar.yaml", tmp_path / "five_bar.urdf"
    before = own.read_bytes()
    assert_refused(run("export", robot, fit, "--urdf", own), "robot's own file")
    assert run("export", robot, fit, "--urdf", own, "--overwrite").code == 0
    assert own.read_bytes() != before


def test_nothing_is_written_where_one_of_the_places_is_none(tmp_path, run):
    (*_, fit), taken = saved(tmp_path), tmp_path / "taken"
    taken.write_text("mine")
    before = {path.name for path in tmp_path.iterdir()}
    done = run("export", "five_bar", fit, "--yaml", tmp_path / "new.yaml", "--c", taken / "c")
    assert done.code == 2
    assert f"{taken} is a file: name another folder" in done.err
    assert {path.name for path in tmp_path.iterdir()} == before
