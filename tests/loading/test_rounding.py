"""Files of six digits: loops that hardly miss stay open by that, and ranks stay what they are."""

import json
import re
import warnings

import numpy as np
import pytest

import loopid
from bank_robots import few_of
from cad_export import cad_export
from closure_robots import files
from linkages import four_bar
from loopid.base_parameters import find_base
from loopid.errors import AccuracyWarning, MobilityError, OptionError, RankError, RobotFileError
from loopid.kinematics import mobility
from loopid.kinematics.constraint import largest_residual
from loopid.regressors import structural_observation

# Independent equations and base parameters of the full model: loops that only special geometry
# lets move. Lengths and twists of Bennett's linkage are to fit each other.
COUNTS = {
    "3d four-bar": (2, 8),
    "6d four-bar": (3, 8),
    "hinge four-bar": (2, 8),
    "five-bar": (2, 11),
    "prismatic slider-crank": (2, 6),
    "bennett": (2, 7),
}


@pytest.mark.parametrize("rounding", [-1.0, 1.0])
def test_a_rounding_is_small(rounding):
    with pytest.raises(OptionError) as refused:
        loopid.load("five_bar", rounding=rounding)
    assert refused.value.facts["given"] == rounding


def count(robot):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return len(find_base(structural_observation(robot, "full"), "qr"))


@pytest.mark.parametrize("name", few_of(COUNTS, "bennett"))
def test_six_digits_leave_rank_and_count_as_they_are(name, linkage, write_files):
    file = write_files(*cad_export(linkage(name)))
    with pytest.warns(AccuracyWarning, match=r"rounded: the loops stay open by up to .* m$"):
        robot = loopid.load(file)
    found = mobility(robot)
    assert (found.rank, found.degrees_of_freedom) == (COUNTS[name][0], len(robot.actuated))
    assert found.rank_gap > 1e5
    assert 0 < robot.closure_residual < 1e-5
    assert robot.rounding == 1e-6
    assert count(robot) == COUNTS[name][1]


@pytest.mark.parametrize("gap", few_of([7e-9, 7e-5], 7e-5))
def test_a_plane_that_is_missed_lets_the_loop_move(gap, write_files):
    """The last pin lies beside the plane of the linkage, whose redundant equation says so."""
    parts, description = four_bar("3d")
    parts = [part.replace('xyz="0.5 0.0 0.0"', f'xyz="0.5 0.0 {gap}"') for part in parts]
    file, options = write_files(*files(parts, description)), {}
    if gap > 1e-5:
        with pytest.raises(RobotFileError) as refused:
            loopid.load(file)
        assert refused.value.facts["rounding"] == 3e-6
        options = {"rounding": 3e-6}
    with pytest.warns(AccuracyWarning, match="the loops stay open by up to"):
        robot = loopid.load(file, **options)
    assert largest_residual(robot, robot.reference[None])[0] < gap
    assert count(robot) == 8
    with pytest.raises(RobotFileError, match="stays open"):
        loopid.load(file, rounding=0.0)
    # In the YAML as well.
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content | {"rounding": options.get("rounding", 1e-6)}))
    with pytest.warns(AccuracyWarning, match="rounded"):
        assert loopid.load(file).rounding == options.get("rounding", 1e-6)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    ("joint", "tilt"), few_of([(4, 1e-4), (5, 1e-4), (6, 1e-4), (6, 1e-5)], (4, 1e-4), (6, 1e-5))
)
def test_an_axis_that_is_nearly_parallel_counts_as_such_by_doing_what_is_advised(
    joint, tilt, write_files
):
    """By what stays open, cannot move, or has no clear rank; each refusal leads on."""
    parts, description = four_bar("3d")
    axis = '<axis xyz="0.0 0.0 1.0"/>'
    assert axis in parts[joint]
    parts[joint] = parts[joint].replace(axis, f'<axis xyz="{tilt} 0.0 1.0"/>')
    file, rounding = write_files(*files(parts, description)), None
    for _ in range(3):
        try:
            assert count(loopid.load(file, rounding=rounding)) == 8
            break
        except (RobotFileError, MobilityError, RankError) as refusal:
            told = re.search(r"rounding[ =]([^\s,:]+)", str(refusal))
            rounding = refusal.facts.get("rounding") or float(told[1])
    else:
        pytest.fail(f"the advice leads to rounding={rounding:g} and no further")


def test_a_weld_where_a_pin_is_meant_is_refused_with_the_kinds_of_pins(write_files):
    parts, description = four_bar("3d")
    weld = description | {"closures": [description["closures"][0] | {"type": "6d"}]}
    with pytest.raises(RobotFileError, match=r"aligns all axes .*: a pin is a hinge, a ball 3d"):
        loopid.load(write_files(*files(parts, weld)))


@pytest.mark.parametrize("name", ["3ups_rpu", "delta", "four_bar", "parallelogram"])
def test_geometry_that_is_exact_stays_as_it_is(name, load_once):
    robot = loopid.load(name, rounding=1e-6)
    np.testing.assert_array_equal(robot.reference, load_once(name).reference)
    for one, other in zip(
        robot.model.jointPlacements, load_once(name).model.jointPlacements, strict=True
    ):
        assert one == other


def test_an_open_loop_is_refused_with_the_facts(write_files):
    parts, description = four_bar("3d", {"crank": 0.2, "coupler": 0.1, "rocker": 0.1, "ground": 2})
    with pytest.raises(RobotFileError) as refused:
        loopid.load(write_files(*files(parts, description)))
    facts = refused.value.facts
    assert facts["closure"] in str(refused.value)
    assert facts["gap"] > 1 > 0 < facts["tolerance"] < 1e-9
    assert "rounding" not in facts
