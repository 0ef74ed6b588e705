"""Options of loading, and what ``loopid check`` says of mobility, each on a robot that has it."""

import re

import numpy as np
import pytest

from bank_robots import count
from closure_robots import body, files, joint, urdf
from linkages import BARS, LINKAGES, four_bar

BASE = [f"root_joint.{part}" for part in ("vx", "vy", "vz", "wx", "wy", "wz")]
ARM = urdf(body("arm"), joint("shoulder", "ground", "arm", axis=(0, 1, 0)))
FINGER = body("finger", mass=0.3) + joint("finger_joint", "arm", "finger", (0.4, 0, 0), (0, 1, 0))
GRIPPER = ARM.replace("</robot>", FINGER + "</robot>").replace(
    '<joint name="finger_joint" type="revolute">',
    '<joint name="finger_joint" type="revolute"><mimic joint="shoulder" multiplier="-2"/>',
)
FLAT = dict(zip(("crank_joint", "coupler_joint", "rocker_joint"), (0, 0, np.pi), strict=True))


@pytest.fixture
def write(write_files):
    """Path of a linkage's YAML."""
    return lambda name: write_files(*files(*LINKAGES[name]))


@pytest.fixture
def write_urdf(tmp_path):
    def written(text):
        (tmp_path / "robot.urdf").write_text(text)
        return tmp_path / "robot.urdf"

    return written


def summary(text, what):
    """What the last table of a check says of something."""
    return re.search(rf"^ *{what}  +(.*?) *$", text, re.MULTILINE)[1]


def test_redundant_rows_are_counted(run, run_json):
    # A pin in a plane needs two equations of a ball's three.
    record = run_json("check", "four_bar")
    assert [record[f"closure_{key}"] for key in ("rows", "rank")] == [3, 2]
    assert record["redundant_rows"] == 1
    assert summary(run("check", "four_bar").out, "closure rank") == "2 of 3 rows, 1 redundant"


def test_free_coordinates_are_named_and_can_be_locked(run, run_json, write):
    file = write("ball rssr")
    done = run("check", file)
    assert summary(done.out, "left free by the motors") == "ball.wx"
    assert "the motors leave ball.wx free" in done.err
    free = run_json("check", file)
    assert free["undetermined"] == ["ball.wx"]
    assert free["independent"] == ["crank_joint", "ball.wx"]
    locked = run_json("check", file, "--lock", "ball.wz")
    assert locked["undetermined"] == []
    assert {"ball_X", "ball_Y"} <= {joint["name"] for joint in locked["joints"]}
    # At rest: two first moments of the rocker, and two of the rod across its length. The crank's
    # axis is upright. All of them are felt however the rod is stopped.
    ranks = [run_json("base", file, *lock)["rank"] for lock in ((), ("--lock", "ball.wz"))]
    assert ranks == [4, 4]


def test_redundant_motors_are_named(run, run_json, write):
    file = write("redundant five-bar")
    assert run_json("check", file)["redundant_actuation"] == ["left_elbow"]
    assert summary(run("check", file).out, "redundant motors") == "left_elbow"


def test_a_singular_reference_is_said(run, run_json, write_files):
    parts, description = four_bar("hinge", BARS | {"rocker": 0.2, "coupler": 0.5})
    file = write_files(*files(parts, description | {"reference": FLAT}))
    record = run_json("check", file)
    assert record["singular_reference"]
    freedoms = [record["degrees_of_freedom"], record["generic_degrees_of_freedom"]]
    assert freedoms == [2, 1]
    done = run("check", file)
    assert summary(done.out, "degrees of freedom") == "2 (singular reference: 1 around it)"
    assert "the reference is singular" in done.err


def test_links_that_are_not_identical_are_said(run, run_json, urdf_folder, tmp_path):
    text = (urdf_folder / "3rrr.urdf").read_text()
    changed = re.sub(
        r'(<link name="leg2_upper">.*?<mass value=")[^"]*', r"\g<1>9", text, flags=re.S
    )
    assert changed != text
    (tmp_path / "3rrr.urdf").write_text(changed)
    (tmp_path / "3rrr.yaml").write_text((urdf_folder / "3rrr.yaml").read_text())
    assert run_json("check", "3rrr")["unequal_links"] == []
    (difference,) = run_json("check", tmp_path / "3rrr.yaml")["unequal_links"]
    for word in ("leg1_upper, leg2_upper, leg3_upper", "declared identical", " m differ", ", 9,"):
        assert word in difference
    done = run("check", tmp_path / "3rrr.yaml")
    assert f"loopid: warning: {tmp_path}/3rrr.yaml: {difference}\n" in done.err
    assert "not identical in the file" in done.out


def test_tied_links_share_their_parameters(run, run_json):
    for tied, column in (((), "full"), (("--tied",), "full, alike")):
        record = run_json("base", "3rrr", "--model", "full", *tied)
        assert record["rank"] == count("3rrr", column)
        links = {
            name.partition(".")[0] for row in record["base_parameters"] for name in row["terms"]
        }
        assert ("upper" in links, "leg1_upper" in links) == (bool(tied), not tied)
    done = run("base", "3ups_rpu", "--tied")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "declares no identical links" in done.err


def test_a_floating_base_frees_six_coordinates(run_json, write_urdf):
    file = write_urdf(ARM.replace('<link name="ground"/>', body("ground", mass=2.0)))
    fixed, floating = (run_json("check", file, *o) for o in ((), ("--floating-base",)))
    assert (fixed["independent"], floating["independent"]) == (["shoulder"], ["shoulder", *BASE])
    assert floating["undetermined"] == BASE
    assert [j["type"] for j in floating["joints"]] == ["floating", "revolute"]
    # Held by its hand, a body shows mass and first moments: those of base and arm, the arm's mass
    # and what lies along the axis with the base's. Fixed, mx and mz of the arm are left.
    ranks = [run_json("base", file, *o)["rank"] for o in ((), ("--floating-base",))]
    assert ranks == [2, 6]


def test_mimics_follow_or_are_free(run_json, write_urdf):
    held = run_json("check", write_urdf(GRIPPER))
    assert held["independent"] == held["actuated"] == ["shoulder"]
    assert [closure["joints"] for closure in held["closures"]] == [["finger_joint", "shoulder"]]
    free = run_json("check", write_urdf(GRIPPER), "--free-mimics")
    assert free["independent"] == free["actuated"] == ["shoulder", "finger_joint"]
    assert free["closures"] == []


def test_a_search_out_of_time_is_not_certified(run, run_json):
    options = ("base", "3ups_rpu", "--model", "full", "--criterion", "regressor")
    record = run_json(*options, "--time-limit", "1e-9")
    assert not record["search"]["certified"]
    assert "not certified: " in run(*options, "--time-limit", "1e-9").out
    whole = run_json(*options)
    assert whole["search"]["certified"]
    assert whole["search"]["gap"] == pytest.approx(1, abs=whole["search"]["tolerance"])
    if record["search"]["gap"] is not None:
        bound = record["search"]["condition_number"] / record["search"]["gap"]
        assert bound <= whole["search"]["condition_number"] * (1 + 1e-9)
    assert record["rank"] == whole["rank"]
    done = run(*options, "--time-limit", "0")
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "time_limit must be positive" in done.err
