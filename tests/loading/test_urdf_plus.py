"""Loops, couplings and independent joints of URDF+."""

import numpy as np
import pinocchio as pin
import pytest
from small_urdf import BRANCHES, body, frame, joint, robot

from loopid import gravity_regressor, load_mechanism, random_configurations
from loopid.errors import RobotFileError
from loopid.loading.urdf import read_urdf

AXIS = '<axis xyz="0 0 2"/>'


@pytest.fixture
def read(tmp_path):
    def written(*parts):
        (tmp_path / "robot.urdf").write_text(robot(*parts))
        return read_urdf(tmp_path / "robot.urdf")

    return written


def end(side, link, inside=""):
    return f'<{side} link="{link}">{inside}</{side}>'


def loop(kind="revolute", inside=AXIS, one="hand", other="wheel", name="pin"):
    ends = end("predecessor", one) + end("successor", other)
    return f'<loop name="{name}" type="{kind}">{ends}{inside}</loop>'


def coupling(one="hand", other="wheel", inside='<ratio value="3"/>', name="belt"):
    ends = end("predecessor", one) + end("successor", other)
    return f'<coupling name="{name}" type="rolling">{ends}{inside}</coupling>'


# Loops.


@pytest.mark.parametrize(
    ("kind", "closure"),
    [("revolute", "hinge"), ("continuous", "hinge"), ("prismatic", "prismatic"),
     ("cylindrical", "cylindrical")],
)  # fmt: skip
def test_a_loop_about_an_axis(read, kind, closure):
    (found,) = read(*BRANCHES, loop(kind)).description.all_closures
    assert found.type == closure
    assert found.frames == ("pin_predecessor", "pin_successor")
    assert found.axes == ((0, 0, 2), (0, 0, 2))


@pytest.mark.parametrize(("kind", "closure"), [("spherical", "3d"), ("fixed", "6d")])
def test_a_loop_without_an_axis(read, kind, closure):
    (found,) = read(*BRANCHES, loop(kind, "")).description.all_closures
    assert (found.type, found.axes) == (closure, None)


def test_the_frames_of_a_loop_are_at_its_origins(read):
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
    ends = end("predecessor", "peg", origin) + end("successor", "wheel", '<origin xyz="1 0 0"/>')
    tag = f'<loop name="pin" type="fixed">{ends}</loop>'
    model = read(*BRANCHES, frame("peg", "hand"), tag).model
    one, other = (model.frames[model.getFrameId(f"pin_{side}")]
                  for side in ("predecessor", "successor"))  # fmt: skip
    assert model.names[one.parentJoint] == "wrist"
    np.testing.assert_allclose(one.placement.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(one.placement.rotation, pin.rpy.rpyToMatrix(0.4, 0.5, 0.6))
    np.testing.assert_allclose(other.placement.homogeneous[:3, 3], [1, 0, 0])
    np.testing.assert_allclose(other.placement.rotation, np.eye(3))


# Couplings.


def test_a_coupling_sums_the_joints_of_both_branches(read):
    source = read(*BRANCHES, coupling())
    (found,) = source.description.all_closures
    assert found.joints == {"hub": 1, "shoulder": -3, "wrist": -3}
    assert found.offset == 0
    assert source.description.name_mot == ["shoulder", "wrist"]


def test_a_coupling_starts_where_the_branches_part(read):
    rotor = (body("rotor"), frame("spindle", "arm"), joint("spin", "spindle", "rotor"))
    (found,) = read(*BRANCHES, *rotor, coupling("hand", "rotor")).description.all_closures
    assert found.joints == {"spin": 1, "wrist": -3}


# Motors.


def test_joints_declared_dependent_have_no_motors(read):
    parts = [*BRANCHES[:-1], joint("hub", "base", "wheel", attributes='independent="False"')]
    source = read(*parts, coupling("arm", "wheel"))
    assert source.description.name_mot == ["shoulder", "wrist"]


def test_the_declaration_overrules_the_direction_of_a_coupling(read):
    parts = [part.replace('"shoulder"', '"shoulder" independent="false"') for part in BRANCHES]
    source = read(*parts, coupling("arm", "wheel"))
    assert source.description.name_mot == ["wrist", "hub"]


# Whole robots.


def test_samples_of_the_format_load(shared):
    folder = shared / "models" / "urdf_plus"
    six_bar = load_mechanism(folder / "six_bar.urdf")
    assert six_bar.actuated == ("joint1", "joint2", "joint3")
    with pytest.warns(UserWarning, match="no body has these inertias"):
        leg = load_mechanism(folder / "mini_cheetah_leg.urdf")
    assert leg.actuated == ("base_to_abduct", "abduct_to_thigh_j", "thigh_to_knee_j")
    assert leg.model.nv == 6


def test_a_loop_closes_what_a_pair_of_frames_closes(four_bars, write_files):
    bar = four_bars["3d"]
    text = bar.path.with_suffix(".urdf").read_text()
    tag = loop("revolute", '<axis xyz="0 -1 0"/>', "end", "pivot")
    reference = bar.path.read_text().partition("reference:")[2]
    yaml = f"urdf: robot.urdf\nname_mot: [crank_joint]\nreference:{reference}"
    closed = load_mechanism(write_files(text.replace("</robot>", f"{tag}</robot>"), yaml))
    assert [closure.kind for closure in closed.closures] == ["hinge"]
    np.testing.assert_allclose(closed.reference, bar.reference, atol=1e-9)
    poses = random_configurations(bar, 5, seed=1)
    np.testing.assert_allclose(
        gravity_regressor(closed, poses), gravity_regressor(bar, poses), atol=1e-9
    )


# Refusals.

NO_END = '<loop name="pin" type="revolute"><successor link="arm"/></loop>'
HALF = '<coupling name="belt"><predecessor link="arm"/><ratio value="1"/></coupling>'
DEPENDENT = joint("hub", "base", "wheel", attributes='independent="fasle"')
FLIGHT = (body("drone"), joint("flight", "base", "drone", kind="floating"))
WRONG = {
    "loop without predecessor": ([NO_END], ("<loop name='pin'>", "no <predecessor>")),
    "unknown link": ([loop(one="leg")], ("pin", "'leg'", "<predecessor>", "base, wheel, arm")),
    "one link": ([loop(one="arm", other="arm")], ("<loop name='pin'>", "'arm'")),
    "no axis": ([loop(inside="")], ("<loop name='pin'>", "<axis> is missing")),
    "axis zero": ([loop(inside='<axis xyz="0 0 0"/>')], ("pin", "<axis> is zero")),
    "axis of two": ([loop(inside='<axis xyz="0 1"/>')], ("pin", "<axis> xyz", "'0 1'")),
    "axis without xyz": ([loop(inside="<axis/>")], ("pin", "<axis> has no xyz")),
    "unknown type": ([loop("planar")], ("pin", "'planar'", "continuous, cylindrical, fixed")),
    "two names": ([loop(), loop()], ("<loop name='pin'>", "2 times")),
    "no name": ([loop(name="")], ("<loop", "has no name")),
    "frame taken": ([loop(), frame("pin_successor", "arm")], ("pin", "'pin_successor'", "taken")),
    "origin NaN": (
        [loop("fixed").replace("</pre", '<origin rpy="nan 0 0"/></pre')],
        ("<loop name='pin'>", "<origin> rpy", "finite"),
    ),
    "coupling without successor": ([HALF], ("<coupling name='belt'>", "no <successor>")),
    "no ratio": ([coupling(inside="")], ("belt", "<ratio> is missing")),
    "ratio NaN": ([coupling(inside='<ratio value="nan"/>')], ("belt", "<ratio> value", "'nan'")),
    "ratio zero": ([coupling(inside='<ratio value="0"/>')], ("belt", "<ratio> is zero")),
    "nothing between": ([coupling("arm", "hand")], ("belt", "no joint moves", "predecessor 'arm'")),
    "floating": ([*FLIGHT, coupling("drone", "wheel")], ("belt", "flight", "floating")),
    "neither true nor false": ([DEPENDENT], ("hub", "independent", "'fasle'")),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_tag_is_refused_by_name(read, refusal, case):
    parts, fragments = WRONG[case]
    branches = BRANCHES[:-1] if DEPENDENT in parts else BRANCHES
    with pytest.raises(RobotFileError) as failure:
        read(*branches, *parts)
    refusal(failure, "robot.urdf: ", *fragments)
