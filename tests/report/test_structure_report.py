"""Records and tables of ``loopid check``, ``base`` and ``motions``."""

import json
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis.strategies import floats
from rich.console import Console

import loopid
from bank_robots import few_of
from closure_robots import chain, files
from linkages import rssr
from loopid import bundled_robots
from loopid.base_parameters import RankTolerances, expression, find_base
from loopid.errors import AccuracyWarning, ModelWarning
from loopid.motion.joints import JointRange, MotionReview
from loopid.regressors import structural_observation
from loopid.report import check_report
from loopid.report.structure import (
    base_record,
    base_report,
    base_tables,
    certificate,
    check_record,
    motions_record,
    motions_table,
)

REVIEW = MotionReview((), 0.05, 2.5, 0.01, {"a": 0.3})


@pytest.fixture(scope="module")
def base(knee):
    return find_base(structural_observation(knee))


def assert_strict(record):
    assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_records_are_strict_json(knee, base):
    assert_strict(base_record(knee, "gravity", base))
    assert_strict(check_record(knee))


def test_a_search_without_a_certificate_says_how_much_is_proven(knee, base):
    base = find_base(structural_observation(knee), "qr")
    records = {
        gap: base_record(knee, "gravity", replace(base, search=replace(base.search, gap=gap)))
        for gap in (inf, 1.16914, 3.3906)
    }
    for record in records.values():
        assert_strict(record)
    found = {gap: (r["search"]["gap"], certificate(r["search"])) for gap, r in records.items()}
    assert found == {
        inf: (None, "not certified: a better choice may exist"),
        1.16914: (1.16914, "not certified: at most 17 % above the least possible"),
        3.3906: (3.3906, "not certified: at most 3.4 times the least possible"),
    }


@pytest.mark.parametrize("zeros", [3, 30, 600])  # the last beyond floats
def test_a_number_of_choices_fits_its_card_on_a_phone(knee, base, zeros):
    many = replace(base, search=replace(base.search, candidates=10**zeros))
    said = base_report(knee, "gravity", many).card.figures[3].what
    assert said == {3: "for 1,000 choices"}.get(zeros, f"for 1.0e+{zeros} choices")


@pytest.mark.parametrize("gap", [inf, 1.0, 1.2, 5.0])
def test_the_reason_for_no_certificate_is_said(gap):
    search = {"certified": False, "gap": None if gap == inf else gap, "reason": "near ties"}
    assert "(near ties)" in certificate(search)
    assert certificate(search).startswith("not certified")


def test_the_best_of_an_unclear_rank_is_proven_for_that_rank_only():
    search = {"certified": False, "gap": 1.0, "reason": "unclear rank"}
    assert certificate(search) == "best for this rank, which is unclear"
    assert certificate(search | {"gap": 2.0}) == "not certified (unclear rank)"


@given(gap=floats(1 + 1e-6, 1e12))
def test_a_printed_bound_holds(gap):
    said = certificate({"certified": False, "gap": gap, "reason": "time limit"})
    (number,) = [float(word) for word in said.split() if word[0].isdigit()]
    printed = 1 + number / 100 if "%" in said else number
    assert gap <= printed * (1 + 1e-12)
    assert printed - 1 < 1.011 * (gap - 1)


def test_doubtful_combinations_are_listed_with_their_rounding(knee):
    observation = structural_observation(knee)
    with (
        pytest.warns(AccuracyWarning, match="doubtful"),
        pytest.warns(AccuracyWarning, match="rank is unclear: it lies between"),
    ):
        base = find_base(observation, tolerances=RankTolerances(least=0.05))
    assert (base.search.certified, base.search.reason) == (False, "unclear rank")
    record = base_record(knee, "gravity", base)
    assert len(record["doubtful"]) == len(base.doubtful) == 15 - len(base)
    for told, one in zip(record["doubtful"], base.doubtful, strict=True):
        assert told["terms"] == dict(one.terms)
        assert told["singular_value"] == one.singular_value < 0.05
        assert told["rounding"] == one.rounding > 1e-5
    console = Console(width=200)
    with console.capture() as shown:
        console.print(*base_tables(json.loads(json.dumps(record))))
    for told in record["doubtful"]:
        assert f" {next(iter(told['terms']))} " in shown.get()


def test_terms_rebuild_the_matrix(knee, base):
    record = base_record(knee, "gravity", base)
    labels = base.parameters.labels
    for parameter, row in zip(record["base_parameters"], base.matrix, strict=True):
        assert list(row) == [parameter["terms"].get(label, 0.0) for label in labels]


def test_what_the_motors_alone_sense_stands_beside_all_that_has_an_effect(tmp_path):
    """The free spin of a rod in ball joints has a row "= 0", which no motor feels."""
    for name, text in zip(("robot.urdf", "robot.yaml"), files(*rssr("SPHERICAL")), strict=True):
        (tmp_path / name).write_text(text)
    with pytest.warns(ModelWarning):
        robot = loopid.load(tmp_path / "robot.yaml")
    assert len(robot.free) == 1
    observed = structural_observation(robot, "full")
    assert 2 * observed.motors_alone.rows == observed.rows
    base, alone = map(find_base, (observed, observed.motors_alone))
    assert len(alone) <= len(base)
    record = base_record(robot, "full", base, alone)
    assert_strict(record)
    assert record["undetermined"] == list(robot.free)
    assert record["motors_alone"]["rank"] == len(alone)
    sums = [row["expression"] for row in record["motors_alone"]["base_parameters"]]
    assert sums == list(alone.expressions)
    titles = [str(table.title) for table in base_tables(record)]
    assert "what the motors alone sense" in titles
    findings = [str(cell) for cell in base_tables(record)[-1].columns[0].cells]
    assert "sensed by the motors alone" in findings


def test_without_free_coordinates_the_motors_feel_all(knee, base):
    record = base_record(knee, "gravity", base)
    assert structural_observation(knee).motors_alone is None
    assert (record["undetermined"], record["motors_alone"]) == ([], None)


def test_a_motion_is_recorded_with_its_nearest_limit():
    ranges = (JointRange("a", -1.0, 1.0, -2.0, 3.0), JointRange("b", 0.0, 0.5, -0.2, np.inf))
    review = MotionReview(ranges, 0.05, 2.5, 0.01, {"a": 0.3})
    record = motions_record("robot", {"up": review}, {"up": 12.0})
    assert_strict(record)
    (motion,) = record["motions"]
    assert (motion["name"], motion["seconds"]) == ("up", 12.0)
    assert (motion["nearest_limit"], motion["clearance"]) == ("b", 0.2)
    assert motion["ranges"] == {"a": [-1.0, 1.0], "b": [0.0, 0.5]}
    assert (motion["singularity"], motion["singular_time"]) == (0.05, 2.5)
    assert motion["problems"] == []


@pytest.mark.parametrize("ranges", [(), (JointRange("a", -1.0, 1.0, -np.inf, np.inf),)])
def test_a_robot_without_limits_is_recorded_in_strict_json(ranges):
    review = MotionReview(ranges, 0.05, 2.5, 0.01, {"a": 0.3})
    record = motions_record("robot", {"up": review}, {"up": 12.0})
    assert_strict(record)
    assert record["motions"][0]["clearance"] is None


@pytest.mark.parametrize(
    ("terms", "text"),
    [
        ({"a.m": 1.0}, "a.m"),
        ({"a.m": -1.0, "b.m": 1.0}, "-a.m + b.m"),
        ({"a.m": 1.0, "b.m": -0.25, "c.mx": 2.0}, "a.m - 0.25 b.m + 2 c.mx"),
        ({"a.m": -np.pi}, "-3.142 a.m"),
        ({}, ""),
    ],
)
def test_expressions_read_as_sums(terms, text):
    assert expression(terms) == text


def test_a_motion_that_breaks_a_limit_is_said_so():
    record = motions_record("robot", {"1": replace(REVIEW, singularity_threshold=0.9)}, {"1": 12.0})
    table = motions_table(record)
    assert "singularity measure falls" in str(next(iter(table.columns[-1].cells)))


# At 80 columns.

LARGE = [f"gepetto/{name}/robot.yaml" for name in ("cassie_like", "digit_like", "talos_like")]
LARGE += ["mjcf/cassie.xml", "mjcf/robotiq_2f85.xml", "urdf_plus/six_bar.urdf"]


def whole(table):
    """Whether all numbers of a table are printed as they are, within 80 columns."""
    console = Console(width=80)
    with console.capture() as shown:
        console.print(table)
    text = shown.get()
    assert max(map(len, text.splitlines()), default=0) <= 80
    words = set(text.split())
    for column in table.columns:
        for cell in map(str, column.cells):
            if column.justify == "right":
                assert set(cell.split()) <= words, cell
            assert all(word in words for word in cell.split() if len(word) < 12), cell


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", bundled_robots())
def test_tables_of_every_bundled_robot_fit_the_terminal(name, load_once):
    for table in check_report(load_once(name)).brief:
        whole(table)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", few_of(LARGE, LARGE[-2]))
def test_tables_of_large_robots_fit_the_terminal(name, shared, load_once):
    if name.endswith("xml"):
        pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    report = check_report(load_once(shared / "models" / name))
    for table in report.brief:
        whole(table)
    page = report.page().html()
    assert len(page) < 1_000_000


def test_the_terminal_shows_one_screen_of_base_parameters(write_files):
    """All of a small robot; of a large one the first, and where the others are."""
    for count, screen in ((2, False), (7, True)):
        robot = loopid.load(write_files(*files(chain(count), {})))
        found = find_base(structural_observation(robot, "full"))
        brief, *_ = base_report(robot, "full", found).brief
        last = str([*brief.columns[1].cells][-1])
        assert brief.row_count == (17 if screen else found.structure.rank)
        assert last.endswith("more, and all terms, in the report") == screen


def test_a_joint_that_turns_without_end_has_an_angle_and_no_limits(four_bars):
    robot = four_bars["3d"]
    model = robot.model.copy()
    model.upperPositionLimit = np.full(model.nq, np.finfo(float).max)  # as readers say it
    robot = replace(robot, model=model)
    crank, *others = check_record(robot)["joints"]
    assert robot.joint(crank["name"]).nq == 2
    assert crank["reference"] == pytest.approx([1.0])
    assert (crank["lower"], crank["upper"]) == (None, None)
    assert all(joint["upper"] is None for joint in others)
    assert all(joint["lower"] == -7.0 for joint in others)
