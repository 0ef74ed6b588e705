"""What robot files give beside rigid bodies, as users of the commands meet it."""

import re

import pytest

import loopid
from loopid import JointTerms
from made_runs import logged, wander

pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
pytestmark = pytest.mark.usefixtures("nothing_suspected", "taken_as_prepared", "none_missing")
LINK = """<body name="{0}" pos="{1} 0 0"><inertial pos="0.2 0 0.05" mass="{2}"
diaginertia="0.01 0.02 0.02"/><joint name="{3}" axis="0 1 0" range="-90 90" armature="{4}"
frictionloss="0.1" damping="0.05"/>{5}</body>"""
LOWER = LINK.format("lower", 0.4, 0.5, "elbow", 0.6, "")
ROBOT = f"""<mujoco model="geared"><worldbody>{LINK.format("upper", 0, 1, "shoulder", 3, LOWER)}
</worldbody><actuator><motor joint="shoulder"/><motor joint="elbow"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def geared(tmp_path_factory):
    """A robot whose rotors weigh ten times its links, and a log of it."""
    folder = tmp_path_factory.mktemp("geared")
    (folder / "robot.xml").write_text(ROBOT)
    robot = loopid.load(folder / "robot.xml")
    terms = JointTerms.of(robot, "file")
    motion = wander(robot, 1, seconds=20.0, rate=50.0, size=(1.0, 1.0))
    truth = terms, terms.values(robot)
    (folder / "run.csv").write_text(logged(robot, motion, truth, noise=0.02, seed=1))
    return str(folder / "robot.xml"), str(folder / "run.csv")


@pytest.mark.validate
def test_drive_inertia_of_the_file_is_fitted_by_default(geared, run_json):
    fit = run_json("identify", *geared, "--model", "full", "--cutoff", "8")["all_parameters"]
    found = {p["name"]: p["interval_95_percent"] for p in fit["base_parameters"]}
    for joint in ("shoulder", "elbow"):
        low, high = found[f"{joint}.Fc"]
        assert (low + high) / 2 == pytest.approx(0.1, rel=0.06)
        assert high < low + 0.05


def test_what_chosen_terms_leave_out_is_said_and_the_advice_works(geared, run):
    without = run("identify", *geared, "--model", "full", "--terms", "Fc,Fv")
    (warning,) = [line for line in without.err.splitlines() if "leaves out" in line]
    assert "drive inertia (Ia) of shoulder, elbow" in warning
    advice = re.search(r"--terms \S+", warning)[0].split()
    done = run("identify", *geared, "--model", "full", *advice)
    assert done.code == 0
    assert "leaves out" not in done.err


def test_base_says_what_it_leaves_out_and_includes_it_when_asked(geared, run, run_json):
    robot = geared[0]
    rigid = run("base", robot, "--model", "full", "--json")
    (warning,) = [line for line in rigid.err.splitlines() if "leaves out" in line]
    advice = re.search(r"--terms \S+", warning)[0].split()
    with_terms = run_json("base", robot, "--model", "full", *advice)
    # Each rotor turns with its link, whose inertia it joins but for the second one's.
    assert with_terms["rank"] == 2 * 3 + 2 * 2 + 1
    assert not run("base", robot, *advice).err


def test_check_lists_all_of_it_with_its_size(geared, run, run_json):
    record = run_json("check", geared[0])
    found = {(f["joint"], f["term"]): f for f in record["in_file_not_in_model"]}
    assert set(found) == {(j, k) for j in ("shoulder", "elbow") for k in ("Ia", "Fc", "Fv")}
    assert found["shoulder", "Ia"]["relative_size"] > 1
    assert all(f["included_by"] == 'terms="file"' for f in found.values())
    assert "in the file, not in the model" in run("check", geared[0]).out
    assert run_json("check", "five_bar")["in_file_not_in_model"] == []
