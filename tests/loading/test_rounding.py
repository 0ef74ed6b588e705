"""Files of six digits: loops that hardly miss are closed, and what is nearly special is named."""

import json
import re
import warnings

import numpy as np
import pytest

from cad_export import cad_export
from closure_robots import ROD, X, Y, Z, body, files, frame, joint, tie
from linkages import four_bar
from loopid import find_base_parameters, load_mechanism, structural_observation
from loopid.errors import (
    AccuracyWarning,
    MobilityError,
    OptionError,
    RankError,
    RobotFileError,
)
from loopid.kinematics import (
    largest_residual,
    mobility,
    nearly_special,
)

# Independent equations and base parameters of the full model: loops that only special geometry
# lets move.
COUNTS = {
    "3d four-bar": (2, 8),
    "6d four-bar": (3, 8),
    "hinge four-bar": (2, 8),
    "five-bar": (2, 11),
    "prismatic slider-crank": (2, 6),
}
BENNETT = (2, 7)


@pytest.mark.parametrize("rounding", [-1.0, 1.0])
def test_a_rounding_is_small(rounding):
    with pytest.raises(OptionError, match="rounding must be from 0 to"):
        load_mechanism("five_bar", rounding=rounding)


def count(robot):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        return len(find_base_parameters(structural_observation(robot, "full"), "qr"))


@pytest.mark.parametrize("name", COUNTS)
def test_six_digits_leave_rank_and_count_as_they_are(name, linkage, write_files):
    file = write_files(*cad_export(linkage(name)))
    with pytest.warns(AccuracyWarning, match=r"numbers are rounded: .* moved by up to .* rad$"):
        robot = load_mechanism(file)
    found = mobility(robot)
    assert (found.rank, found.degrees_of_freedom) == (COUNTS[name][0], len(robot.actuated))
    assert found.rank_gap > 1e12
    assert robot.closure_residual == 0
    assert robot.rounding == 1e-6
    assert count(robot) == COUNTS[name][1]


def test_what_no_directions_repair_is_closed_as_far_as_it_goes(linkage, write_files):
    """Lengths and twists of Bennett's linkage are to fit each other."""
    with pytest.warns(AccuracyWarning, match="then stay open by"):
        robot = load_mechanism(write_files(*cad_export(linkage("bennett"))))
    assert mobility(robot).rank == BENNETT[0]
    assert 0 < robot.closure_residual < 1e-5
    assert count(robot) == BENNETT[1]


@pytest.mark.parametrize("gap", [7e-9, 7e-5])
def test_a_plane_that_is_missed_is_met(gap, write_files):
    """The last pin lies beside the plane of the linkage, whose redundant equation says so."""
    parts, description = four_bar("3d")
    parts = [part.replace('xyz="0.5 0.0 0.0"', f'xyz="0.5 0.0 {gap}"') for part in parts]
    file, options = write_files(*files(parts, description)), {}
    if gap > 1e-5:
        with pytest.raises(RobotFileError, match="say so by --rounding 3e-06"):
            load_mechanism(file)
        options = {"rounding": 3e-6}
    with pytest.warns(AccuracyWarning, match=f"moved by up to {gap:.1e} m"):
        robot = load_mechanism(file, **options)
    assert largest_residual(robot, robot.reference[None])[0] < 1e-12
    assert count(robot) == 8
    with pytest.raises(RobotFileError, match="stays open"):
        load_mechanism(file, rounding=0.0)
    # In the YAML as well.
    content = json.loads(file.read_text())
    file.write_text(json.dumps(content | {"rounding": options.get("rounding", 1e-6)}))
    with pytest.warns(AccuracyWarning, match="moved"):
        assert load_mechanism(file).rounding == options.get("rounding", 1e-6)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(("joint", "tilt"), [(4, 1e-3), (5, 1e-4), (6, 1e-4), (6, 1e-5)])
def test_an_axis_that_is_nearly_parallel_is_made_so_by_doing_what_is_advised(
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
            assert count(load_mechanism(file, rounding=rounding)) == 8
            break
        except (RobotFileError, MobilityError, RankError) as refusal:
            rounding = float(re.search(r"--rounding ([^\s,]+)", str(refusal))[1])
    else:
        pytest.fail(f"the advice leads to --rounding {rounding:g} and no further")


def test_a_weld_where_a_pin_is_meant_is_refused_with_the_kinds_of_pins(write_files):
    parts, description = four_bar("3d")
    weld = description | {"closures": [description["closures"][0] | {"type": "6d"}]}
    with pytest.raises(RobotFileError, match=r"aligns all axes .*: a pin is a hinge, a ball 3d"):
        load_mechanism(write_files(*files(parts, weld)))


SQUARE = {"crank_joint": 1.0, "coupler_joint": -1.0, "rocker_joint": 1.0 - np.pi}


@pytest.fixture
def nearly(write_files):
    """File of a parallelogram whose lengths differ by millionths."""
    bars = {"crank": 0.200001, "coupler": 0.45, "rocker": 0.2, "ground": 0.449998}
    parts, description = four_bar("3d", bars)
    return write_files(*files(parts, description | {"reference": SQUARE}))


def test_nearly_equal_lengths_are_made_equal_when_the_user_agrees(nearly):
    robot = load_mechanism(nearly)
    other, moved = nearly_special(robot)
    assert count(other) == 3
    assert "moved by up to 1." in moved
    with pytest.warns(AccuracyWarning, match=r"moved by up to 1\.\de-06 m"):
        snapped = load_mechanism(nearly, snap=True)
    assert count(snapped) == 3
    assert nearly_special(snapped) is None
    content = json.loads(nearly.read_text())
    nearly.write_text(json.dumps(content | {"snap": True}))
    with pytest.warns(AccuracyWarning, match="moved"):
        assert count(load_mechanism(nearly)) == 3


def spherical(miss):
    """A spherical four-bar: all axes meet in one point, but for some that miss it."""
    axes = np.array([[1, 0, 0], [0.6, 0.7, 0.1], [-0.2, 0.8, 0.5], [0.1, -0.3, 1.0]])
    misses = np.array([[0, 0, 0], [0, 0, miss], [0, -miss, miss], [miss, -miss, miss]])
    pins = [0.1, 0.2, 0.5] + 0.25 * axes + misses
    parts = [
        *(body(name) for name in ("crank", "coupler", "rocker")),
        joint("crank_joint", "ground", "crank", pins[0], axes[0]),
        joint("coupler_joint", "crank", "coupler", pins[1] - pins[0], axes[1]),
        joint("rocker_joint", "coupler", "rocker", pins[2] - pins[1], axes[2]),
        frame("end", "rocker", pins[3] - pins[2]),
        frame("pivot", "ground", pins[3]),
    ]
    closure = tie("hinge", ("end", "pivot"), axes=[axes[3].tolist()] * 2)
    return parts, {"closures": [closure], "name_mot": ["crank_joint"]}


def jointed(miss):
    """Two cranks and a rod on a ball joint that is made of three hinges."""
    parts = [
        *(body(name) for name in ("crank", "cross", "ring", "rod", "rocker")),
        joint("crank_joint", "ground", "crank"),
        joint("cross_joint", "crank", "cross", (0.15, 0, 0.05), Y),
        joint("ring_joint", "cross", "ring", (miss, 0, 0), Z),
        joint("rod_joint", "ring", "rod", (0, -miss, 1.3 * miss), X),
        joint("rocker_joint", "ground", "rocker", (0.5, 0.1, 0.2), (0.3, 1, 0.2)),
        frame("end", "rod", (ROD, 0, 0)),
        frame("tip", "rocker", (0.1, 0.05, 0.35)),
    ]
    closure = tie("universal", ("end", "tip"), axes=[Y, (0.6, 0.8, 0)])
    drawn = {"crank_joint": 0.3, "cross_joint": -1.09, "ring_joint": 0.31, "rocker_joint": -0.98}
    return parts, {"closures": [closure], "name_mot": ["crank_joint"], "reference": drawn}


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("robot", [spherical, jointed])
def test_axes_that_nearly_meet_in_a_point_do_when_the_user_agrees(robot, write_files):
    exact, near = (
        load_mechanism(write_files(*files(*robot(miss))), snap=bool(miss)) for miss in (0.0, 1e-6)
    )
    assert near.closure_residual == 0
    for model in ("gravity", "full"):
        one, other = (
            find_base_parameters(structural_observation(each, model)) for each in (exact, near)
        )
        assert one.names == other.names
        assert other.structure.noise == 0
        assert other.structure.rank_gap > 0.01 * one.structure.rank_gap
        assert other.condition_number == pytest.approx(one.condition_number, rel=1e-3)


@pytest.mark.parametrize("name", ["3ups_rpu", "delta", "four_bar", "parallelogram"])
def test_geometry_that_is_exact_stays_as_it_is(name, load_once):
    assert nearly_special(load_once(name)) is None
    robot = load_mechanism(name, rounding=1e-6, snap=True)
    np.testing.assert_array_equal(robot.reference, load_once(name).reference)
    for one, other in zip(
        robot.model.jointPlacements, load_once(name).model.jointPlacements, strict=True
    ):
        assert one == other
