"""``loopid check`` and ``loopid base``: counts, loading options, refusals, all bundled robots."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import yaml
from lxml import html

from bank_robots import count, few_of
from closure_robots import body, files, joint, urdf
from folded_robots import folded_row
from linkages import BARS, LINKAGES, four_bar
from loopid.report import check_report
from others_robots import ROWS, path

URDF = Path(__file__).parents[2] / "urdf"
BASE_KEYS = {
    "mechanism",
    "model",
    "standard_parameters",
    "nonzero_parameters",
    "rank",
    "rank_gap",
    "condition_number",
    "search",
    "base_parameters",
}
SEARCH_KEYS = {
    "name",
    "criterion",
    "condition_number",
    "certified",
    "candidates",
    "evaluated",
    "seconds",
}


@pytest.fixture
def both(run, tmp_path):
    """What a command prints, and its record, of one run."""

    def call(command, *arguments):
        done = run(command, *arguments, "--out", tmp_path / "told")
        assert done.code == 0, done.err
        return done, json.loads((tmp_path / "told" / f"{command}.json").read_text())

    return call


@pytest.fixture
def base(run_json, once):
    """What the command says of the knee robot."""
    return once("base", lambda: run_json("base", str(URDF / "3ups_rpu.yaml")))


def test_base_json_has_the_promised_keys_and_counts(base):
    record = base
    assert record.keys() >= BASE_KEYS
    assert record["search"].keys() >= SEARCH_KEYS
    counts = (record["standard_parameters"], record["nonzero_parameters"], record["rank"])
    assert counts == (36, 30, 15)
    assert record["search"]["candidates"] == 155_117_520
    assert record["search"]["certified"] is True
    assert len(record["base_parameters"]) == record["rank"]
    for parameter in record["base_parameters"]:
        assert next(iter(parameter["terms"].values())) == 1.0


@pytest.mark.parametrize(
    ("criterion", "searches"), [("nullspace", ["subgroup", "qr"]), ("regressor", ["qr"])]
)
def test_every_search_and_criterion_answers_and_none_beats_the_exact_one(
    run_json, criterion, searches
):
    options = ("base", "3rrr", "--criterion", criterion, "--samples", "50", "--search")
    exact, *others = (run_json(*options, search)["search"] for search in ("exact", *searches))
    for search, found in zip(searches, others, strict=True):
        assert (found["name"], found["criterion"]) == (search, criterion)
        assert exact["condition_number"] <= found["condition_number"] * (1 + 1e-9)


@pytest.mark.validate
def test_a_seed_gives_the_same_answer_again(run_json):
    file = str(URDF / "four_bar.yaml")  # loaded anew
    first, second = (run_json("base", file, "--seed", "7") for _ in range(2))
    first["search"].pop("seconds")
    second["search"].pop("seconds")
    assert first == second


def test_base_works_from_any_folder(run, base, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert "platform.mx - 0.3 leg1_stem.m + 0.1928 leg2_stem.m" in run("base", "3ups_rpu").out
    (row,) = [row for row in base["base_parameters"] if row["name"].startswith("platform.my + ")]
    assert row["expression"] == "platform.my + 0.2298 leg2_stem.m - 0.3 leg3_stem.m"


def test_check_reports_mobility_and_closure(both):
    _, record = both("check", "3ups_rpu")
    assert record["inertia_defects"] == []
    assert (record["closure_rows"], record["closure_rank"]) == (9, 9)
    assert record["degrees_of_freedom"] == len(record["actuated"]) == 4
    assert record["coordinates"] == len(record["actuated"]) + len(record["passive"])
    assert record["closure_residual"] < 1e-10
    assert 0 < record["singularity_measure"] < 1
    assert not record["near_singularity"]
    assert [closure["frames"] for closure in record["closures"]] == [
        [f"leg{leg}_stem", f"platform_B{leg}"] for leg in (1, 2, 3)
    ]


def test_check_prints_the_same_as_tables(both, run):
    done, record = both("check", "5p")
    for word in ("leg4_stroke", "leg2_stem - platform_B2", "degrees of freedom", "singularity"):
        assert word in done.out
    assert len(done.out.splitlines()) <= 25
    assert "leg1_universal_1   revolute    passive" in run("check", "5p", "--verbose").out
    # No solid body has this inertia.
    (defect,) = record["inertia_defects"]
    assert defect.startswith("leg4_stem: its principal moments of inertia 0, ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["base", "missing.yaml"], ["missing.yaml", "3ups_rpu"]),
        (["base", "four_bar", "--search", "genetic"], ["genetic", "exact", "subgroup", "qr"]),
        (["base", "four_bar", "--criterion", "best"], ["best", "nullspace", "regressor"]),
        (["base", "four_bar", "--model", "half"], ["half", "gravity", "full"]),
        (["base", "four_bar", "--samples", "0"], ["samples", "0"]),
        (["base", "3ups_rpu", "--samples", "2"], ["rank", "samples"]),
        (["base", "four_bar", "--lock", "elbow"], ["elbow", "crank_joint"]),
        (["base", "3ups_rpu", "--model", "full", "--search", "subgroup"], ["GiB"]),
        (["check", str(URDF / "generate.py")], ["generate.py", ".yaml", ".urdf"]),
        (["check", str(URDF)], ["urdf", "3ups_rpu"]),
    ],
)
def test_refusals_are_one_sentence_and_exit_code_2(run, arguments, words):
    done = run(*arguments)
    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert done.err.startswith("loopid: error: ")
    for word in words:
        assert word in done.err


@pytest.mark.parametrize(
    "arguments", [["base"], ["base", "5p", "--samples", "many"], ["base", "5p", "--depth"], ["fly"]]
)
def test_usage_errors_exit_with_2_and_no_traceback(run, arguments):
    done = run(*arguments)
    assert done.code == 2
    assert "Traceback" not in done.err


# Options of loading, each on a robot that needs it

ROOT_PARTS = [f"root_joint.{part}" for part in ("vx", "vy", "vz", "wx", "wy", "wz")]
ARM = urdf(body("arm"), joint("shoulder", "ground", "arm", axis=(0, 1, 0)))
FINGER = body("finger", mass=0.3) + joint("finger_joint", "arm", "finger", (0.4, 0, 0), (0, 1, 0))
GRIPPER = ARM.replace("</robot>", FINGER + "</robot>").replace(
    '<joint name="finger_joint" type="revolute">',
    '<joint name="finger_joint" type="revolute"><mimic joint="shoulder" multiplier="-2"/>',
)


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
    return re.search(rf"^ *{what} +(.*?) *$", text, re.MULTILINE)[1]


def test_free_coordinates_are_named_and_can_be_locked(both, run_json, write):
    file = write("ball rssr")
    done, free = both("check", file)
    assert summary(done.out, "left free by the motors") == "ball.wx"
    assert "the motors leave ball.wx free" in done.err
    assert free["undetermined"] == ["ball.wx"]
    assert free["independent"] == ["crank_joint", "ball.wx"]
    locked = run_json("check", file, "--lock", "ball.wz")
    assert locked["undetermined"] == []
    assert {"ball_X", "ball_Y"} <= {joint["name"] for joint in locked["joints"]}
    # At rest: two first moments of the rocker, and two of the rod across its length. The crank's
    # axis is upright. All of them have an effect however the rod is stopped.
    ranks = [run_json("base", file, *lock)["rank"] for lock in ((), ("--lock", "ball.wz"))]
    assert ranks == [4, 4]


@pytest.mark.parametrize(("model", "ranks"), [("gravity", (2, None)), ("full", (4, 3))])
def test_motors_may_feel_no_weight(both, write_urdf, model, ranks):
    # A cart that a motor pushes on level ground, and a pole that swings freely on it.
    parts = [body("cart"), body("pole", (0.05, 0.02, 0.4))]
    parts += [joint("push", "ground", "cart", axis=(1, 0, 0), kind="prismatic")]
    parts += [joint("hinge", "cart", "pole", (0, 0, 0.1), (0, 1, 0))]
    file = write_urdf(urdf(*parts)).with_suffix(".yaml")
    file.write_text("name_mot: [push]")
    done, record = both("base", file, "--model", model, "--verbose")
    alone = record["motors_alone"]
    assert (record["rank"], alone and alone["rank"]) == ranks
    said = summary(done.out, "sensed by the motors alone")
    assert said.startswith("no parameter: only rows '= 0'") == (alone is None)


def test_a_robot_of_slides_has_base_parameters(run_json, write_urdf):
    # A gantry: each motor feels the mass that it carries.
    parts = [body("bridge"), body("tool", mass=0.5)]
    parts += [joint("x", "ground", "bridge", axis=(1, 0, 0), kind="prismatic")]
    parts += [joint("z", "bridge", "tool", kind="prismatic")]
    assert run_json("base", write_urdf(urdf(*parts)), "--model", "full")["rank"] == 2


def test_redundant_rows_and_motors_are_told(both, write):
    # A pin in a plane needs two equations of a ball's three.
    done, record = both("check", "four_bar")
    rows = [record[key] for key in ("closure_rows", "closure_rank", "redundant_rows")]
    assert rows == [3, 2, 1]
    assert summary(done.out, "closure rank") == "2 of 3 rows, 1 redundant"
    done, record = both("check", write("redundant five-bar"))
    assert record["redundant_actuation"] == ["left_elbow"]
    assert summary(done.out, "redundant motors") == "left_elbow"


def test_a_singular_reference_is_said(both, write_files):
    # Outside the limits of its motor, so that there is no regular pose a step away.
    parts, description = four_bar("hinge", BARS | {"rocker": 0.25})
    flat = {"crank_joint": np.pi, "coupler_joint": np.pi, "rocker_joint": 0.0}
    file = write_files(*files(parts, description | {"reference": flat}))
    done, record = both("check", file)
    assert record["singular_reference"]
    freedoms = [record["degrees_of_freedom"], record["generic_degrees_of_freedom"]]
    assert freedoms == [2, 1]
    assert summary(done.out, "degrees of freedom") == "2 (singular reference: 1 around it)"
    assert "the reference is singular" in done.err


def test_links_that_are_not_identical_are_said(both, run_json, urdf_folder, tmp_path):
    text = (urdf_folder / "3rrr.urdf").read_text()
    changed = re.sub(
        r'(<link name="leg2_upper">.*?<mass value=")[^"]*', r"\g<1>9", text, flags=re.S
    )
    assert changed != text
    (tmp_path / "3rrr.urdf").write_text(changed)
    (tmp_path / "3rrr.yaml").write_text((urdf_folder / "3rrr.yaml").read_text())
    assert run_json("check", "3rrr")["unequal_links"] == []
    done, record = both("check", tmp_path / "3rrr.yaml")
    (difference,) = record["unequal_links"]
    for word in ("leg1_upper, leg2_upper, leg3_upper", "declared identical", " m differ", ", 9,"):
        assert word in difference
    assert f"loopid: warning: {tmp_path}/3rrr.yaml: {difference}\n" in done.err
    assert "not identical in the file" in done.out


@pytest.mark.validate
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
    assert (fixed["independent"], floating["independent"]) == (
        ["shoulder"],
        ["shoulder", *ROOT_PARTS],
    )
    assert floating["undetermined"] == ROOT_PARTS
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


def test_a_search_out_of_time_is_not_certified(both, run, run_json):
    options = ("base", "3rrr", "--model", "full", "--criterion", "regressor")
    done, record = both(*options, "--time-limit", "1e-9")
    assert not record["search"]["certified"]
    assert "not certified (time limit): " in done.out
    whole = run_json(*options)
    assert whole["search"]["certified"]
    assert whole["search"]["gap"] == pytest.approx(1, abs=whole["search"]["tolerance"])
    if record["search"]["gap"] is not None:
        bound = record["search"]["condition_number"] / record["search"]["gap"]
        assert bound <= whole["search"]["condition_number"] * (1 + 1e-9)
    assert record["rank"] == whole["rank"]
    done = run(*options, "--time-limit", "0")
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert "--time-limit must be" in done.err


# Every robot of docs/mechanisms.md

LEVEL = "urdf_plus/six_bar.urdf"


def consistent(record):
    """Whether the numbers and the names of a check fit together."""
    free = record["coordinates"] - record["closure_rank"]
    driven = len(record["actuated"]) - len(record["redundant_actuation"])
    return (
        record["degrees_of_freedom"] == free == len(record["independent"])
        and driven + len(record["undetermined"]) == free
        and record["closure_rows"] - record["closure_rank"] == record["redundant_rows"]
        and {joint["name"] for joint in record["joints"]}
        == {*record["actuated"], *record["passive"]}
        and record["closure_residual"] < 1e-10
        and not record["singular_reference"]
    )


def test_a_robot_of_a_bank_is_checked_and_counted(run_json):
    record = run_json("check", "delta")
    assert consistent(record)
    assert record["undetermined"] == record["redundant_actuation"] == []
    record = run_json("base", "delta")
    assert record["rank"] == len(record["base_parameters"]) == count("delta", "gravity")
    assert record["search"]["certified"]


def test_a_model_of_others_is_checked(run_json, shared):
    record = run_json("check", path(shared, "mjcf/robotiq_2f85.xml"))
    assert consistent(record)
    assert len(record["undetermined"]) == int(ROWS["mjcf/robotiq_2f85.xml"]["left free"])


@pytest.mark.validate
def test_a_level_robot_has_no_parameters_at_rest(run, shared):
    done = run("base", path(shared, LEVEL))
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1
    assert "gravity moves no joint" in done.err


def test_check_prints_the_reference_that_chooses_another_mode(both, run_json, write_files):
    file = write_files(*files(*folded_row()))
    done, record = both("check", file, "--verbose")
    assert "differ (full model): 3 in mode 1, 8 in mode 2" in " ".join(done.err.split())
    printed = done.out.partition("to choose mode 2, put this into the YAML")[2]
    text = printed[printed.index("reference:") : printed.index("}") + 1]
    other = file.with_name("other.yaml")
    other.write_text(f"{yaml.safe_dump(yaml.safe_load(file.read_text()))}{text}\n")
    assert [mode["rank"] for mode in record["assembly_modes"]] == [3, 8]
    assert run_json("check", other)["assembly_modes"] == []
    assert run_json("base", other, "--model", "full")["rank"] == 8


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--search", "subgroup", "--alpha", "0.9"), ["alpha", "0.5 or less", "0.9"]),
        (("--search", "subgroup", "--cond-limit", "0"), ["--cond-limit", "above 1", "0"]),
        (("--search", "subgroup", "--variant", "x"), ["variant", "gap, pseudocode"]),
        (("--alpha", "0.3"), ["--alpha", "exact", "--search subgroup"]),
        (("--cond-limit", "10"), ["--cond-limit must", "exact", "--search subgroup"]),
    ],
)
def test_bad_options_of_the_subgroup_search_are_one_sentence(run, options, words):
    done = run("base", "four_bar", *options)
    assert (done.code, done.out) == (2, "")
    (line,) = done.err.splitlines()
    assert all(word in line for word in words)


def test_options_of_the_subgroup_search_reach_it(run_json):
    options = ("--alpha", "0.5", "--cond-limit", "100", "--variant", "pseudocode")
    record = run_json("base", "four_bar", "--search", "subgroup", *options)
    told = record["search"]["subgroups"]
    assert (told["alpha"], told["condition_limit"], told["variant"]) == (0.5, 100, "pseudocode")
    assert told["rule"] == "as printed in the paper"


SLIDERS = """<robot name="sliders"><link name="ground"/>
{links}</robot>"""
SLIDER = """<link name="{n}"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.003"/></inertial></link>
<joint name="{n}_joint" type="prismatic"><parent link="ground"/><child link="{n}"/>
<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="{n}_tip"/><joint name="{n}_end" type="fixed"><parent link="{n}"/>
<child link="{n}_tip"/></joint>"""


def test_a_loop_that_its_closure_hardly_takes_part_in_comes_before_thin_rods(run, tmp_path):
    links = "\n".join(SLIDER.format(n=name) for name in ("left", "right"))
    (tmp_path / "sliders.urdf").write_text(SLIDERS.format(links=links))
    (tmp_path / "sliders.yaml").write_text(
        "urdf: sliders.urdf\nclosed_loop: [[left_tip, right_tip]]\ntype: [6d]\n"
        "name_mot: [left_joint]\n"
    )
    told = run("check", tmp_path / "sliders.yaml").out
    said = " ".join(told.split())
    assert "Look at this first: the loop hardly depends on closure" in said
    assert "1 of its 6 rows (6d): look at its frames" in said
    assert "1 degree of freedom for 1 motor" in said
    assert "1 degrees" not in said


RIGHT = ("6d loop", "universal four-bar", "geared five-bar", "differential")


@pytest.mark.parametrize("name", few_of(LINKAGES, *RIGHT))
def test_loops_that_are_as_they_should_be_are_no_news(linkage, name):
    assert "hardly depends on" not in check_report(linkage(name)).verdict


def test_the_next_step_that_a_page_shows_can_be_typed(run, tmp_path):
    assert run("check", "3ups_rpu", "--rounding", "1e-6", "--out", tmp_path).code == 0
    shown, _ = html.parse(tmp_path / "report.html").findall(".//pre")  # and that of this run
    assert shown.text == "loopid base 3ups_rpu --rounding 1e-06"
    done = run(*shlex.split(shown.text)[1:])
    assert done.code == 0, done.err
    assert "base parameter" in done.out
