"""Closures, motors and a reference given in Python: the robot of a YAML that says the same."""

import numpy as np
import pytest

import loopid
from loopid.errors import LoopidError, OptionError, RobotFileError
from loopid.export.robot_file import export_robot_file

AXES = (0.0, 0.0, 1.0), (0.0, 0.0, 1.0)


@pytest.fixture
def given(urdf_folder):
    """A URDF whose YAML is left out, and arguments that say the same."""
    robot = loopid.load(urdf_folder / "five_bar.yaml")
    closures = [loopid.Closure(c.frame_a, c.frame_b, c.kind) for c in robot.closures]
    options = {"closures": closures, "motors": robot.actuated}
    q = robot.reference_values(robot.reference)
    return robot, urdf_folder / "five_bar.urdf", options | {"reference": q}


def test_arguments_are_as_good_as_a_yaml(given):
    robot, urdf, options = given
    found = loopid.load(urdf, **options)
    assert (found.closures, found.actuated) == (robot.closures, robot.actuated)
    assert (found.motors_listed, found.motors_known) == (True, True)
    np.testing.assert_allclose(found.reference, robot.reference, atol=1e-6)
    assert loopid.load(urdf, **found.options) == found


def test_a_reference_may_be_a_configuration(given):
    robot, urdf, options = given
    found = loopid.load(urdf, **options | {"reference": robot.reference})
    np.testing.assert_allclose(found.reference, robot.reference, atol=1e-9)
    assert loopid.load(urdf, **found.options) == found
    for wrong in (robot.reference[1:], "home", {robot.actuated[0]: "up"}):
        with pytest.raises(LoopidError, match="reference"):
            loopid.load(urdf, **options | {"reference": wrong})


def test_a_reference_in_python_holds_the_motors(given):
    robot, urdf, options = given
    motor = robot.actuated[0]
    reference = options["reference"] | {motor: options["reference"][motor] + 0.1}
    found = loopid.load(urdf, **options | {"reference": reference})
    assert found.reference_values(found.reference)[motor] == pytest.approx(reference[motor])


def test_saved_fits_and_robot_files_keep_closures_and_motors(given, tmp_path, monkeypatch):
    _, urdf, options = given
    gear = loopid.loading.Coupling(dict.fromkeys(options["motors"], 1.0), offset=3.1)
    options |= {"closures": [*options["closures"], gear], "motors": options["motors"][:1]}
    robot = loopid.load(urdf, **options)
    model = loopid.force_model(robot, "gravity", None)
    saved = loopid.load_fit(loopid.Fit.of(model, model.prior).save(tmp_path / "fit.yaml"))
    again = saved.robot
    assert again == robot
    assert again.options == robot.options
    changed = 1.25 * robot.standard_parameters()
    found = loopid.load(export_robot_file(again, changed, tmp_path / "new.urdf"))
    for name in ("closures", "couplings", "actuated", "independent", "rounding"):
        assert getattr(found, name) == getattr(robot, name)
    np.testing.assert_array_equal(found.reference, robot.reference)
    np.testing.assert_allclose(found.standard_parameters(), changed, atol=1e-12)
    export_robot_file(again, changed, tmp_path / "new.urdf")  # once more, with the same YAML
    (tmp_path / "new.yaml").write_text("urdf: mine.urdf")
    with pytest.raises(loopid.LoopidError, match="is there already"):
        export_robot_file(again, changed, tmp_path / "new.urdf")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(urdf.parent)
    near = loopid.load(urdf.name, **options)
    path = tmp_path / "fit.yaml"
    loopid.Fit.of(loopid.force_model(near, "gravity", None), model.prior).save(path)
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert loopid.load_fit(path).robot.closures == robot.closures


REFUSED = {
    "an unknown kind": (
        lambda: loopid.Closure("a", "b", "4d"),
        "unknown kind of closure '4d' of a-b: choose among 3d, 6d, .*, cable",
    ),
    "one axis": (
        lambda: loopid.Closure("a", "b", "hinge", axes=AXES[0]),
        "two 'axes', one in each",
    ),
    "no length": (lambda: loopid.Closure("a", "b", "distance"), "needs 'length': of the rod, in m"),
    "a length": (
        lambda: loopid.Closure("a", "b", "3d", length=1.0),
        "a-b: a 3d closure has no 'length': leave it out, or choose a kind that has it among dist",
    ),
    "a coupling": (lambda: loopid.Closure("a", "b", "gear"), "give a Coupling"),
    "no joint": (lambda: loopid.loading.Coupling({}), "joints: must have at least 1"),
    "a zero": (lambda: loopid.loading.Coupling({"a": 0.0}), "joints.a: a coefficient is zero"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_fits_no_kind_is_refused_where_it_is_made(case):
    make, words = REFUSED[case]
    with pytest.raises(OptionError, match=words):
        make()


def test_names_that_the_tree_has_not_are_refused_with_its_file(given):
    _, urdf, options = given
    with pytest.raises(RobotFileError, match=r"five_bar\.urdf: unknown frame 'tip': choose among"):
        loopid.load(urdf, **options | {"closures": [loopid.Closure("tip", "left_crank")]})
    with pytest.raises(OptionError, match="joint left_crank_joint is listed twice among"):
        loopid.load(urdf, motors=["left_crank_joint"] * 2)


def test_one_axis_is_enough_where_the_kind_has_one():
    assert loopid.Closure("a", "b", "2d", axes=AXES[0]).description.axes == AXES
    assert loopid.Closure("a", "b", "hinge", axes=AXES).description.axes == AXES


KINDS = ("hinge loop, skew", "2d four-bar", "distance loop", "cable loop", "geared five-bar")


@pytest.mark.parametrize("name", KINDS)
def test_closures_of_a_robot_are_taken_for_a_tree_of_its_own(name, linkage):
    robot = linkage(name)
    options = {"motors": robot.actuated, "reference": robot.reference}
    again = loopid.from_pinocchio(
        robot.model, closures=[*robot.closures, *robot.couplings], **options
    )
    assert (again.closures, again.couplings) == (robot.closures, robot.couplings)
    with pytest.raises(RobotFileError, match="is listed twice"):
        loopid.load(robot.path, closures=robot.closures or robot.couplings)


def test_a_coupling_with_a_curve_stays_in_its_file(linkage):
    robot = linkage("cam")
    with pytest.raises(OptionError, match="has a curve: write it into the YAML"):
        loopid.from_pinocchio(robot.model, closures=robot.couplings)
