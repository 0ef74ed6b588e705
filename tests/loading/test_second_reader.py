"""yourdfpy as a second reader of URDFs: where it agrees, and what is told where it does not."""

import warnings

import pytest
import yourdfpy
from small_urdf import BRANCHES, body, joint, robot

from loopid.errors import ModelWarning
from loopid.loading import second_opinion
from loopid.loading.urdf import read_again

# Its links have no names: refused by both.
NAMELESS = "ur3.urdf"


def assert_agreement(files):
    found = {file.name: read_again(file) for file in files}
    assert {
        name: reading.differences for name, reading in found.items() if reading.differences
    } == {}
    assert all(reading.links == reading.joints + 1 for reading in found.values())


def test_both_readers_agree_on_every_bundled_robot(urdf_folder):
    assert_agreement(urdf_folder.glob("*.urdf"))


def test_both_readers_agree_on_robots_of_others(robot_data, shared):
    files = [file for file in robot_data.rglob("*.urdf") if file.name != NAMELESS]
    assert len(files) > 60
    assert_agreement([*files, *(shared / "models").glob("**/*.urdf")])


@pytest.fixture
def written(tmp_path):
    def write(*parts, space=""):
        (tmp_path / "robot.urdf").write_text(robot(*parts, space=space))
        return tmp_path / "robot.urdf"

    return write


@pytest.fixture
def seen_otherwise(monkeypatch):
    """Have yourdfpy see something else than it reads."""

    def change(edit):
        load = yourdfpy.URDF.load

        def changed(*arguments, **options):
            found = load(*arguments, **options)
            edit(found.robot)
            return found

        monkeypatch.setattr(yourdfpy.URDF, "load", changed)

    return change


def set_mass(robot):
    robot.links[1].inertial.mass = 2.5


def set_product(robot):
    robot.links[1].inertial.inertia[1, 2] = 0.25


def leave_inertial(robot):
    robot.links[1].inertial = None


def set_type(robot):
    robot.joints[0].type = "prismatic"


def set_parent(robot):
    robot.joints[1].parent = "base"


def set_multiplier(robot):
    robot.joints[3].mimic.multiplier = 3.0


def leave_mimic(robot):
    robot.joints[3].mimic = None


def leave_joint(robot):
    del robot.joints[2]


def add_link(robot):
    robot.links.append(yourdfpy.urdf.Link("ghost"))


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (set_mass, "link arm: mass is 1.0, by yourdfpy 2.5"),
        (set_product, "link arm: iyz is 0.0, by yourdfpy 0.25"),
        (leave_inertial, "link arm: <inertial> is there, by yourdfpy none"),
        (set_type, "joint shoulder: type is revolute, by yourdfpy prismatic"),
        (set_parent, "joint wrist: parent is arm, by yourdfpy base"),
        (set_multiplier, "joint finger: multiplier is 2.0, by yourdfpy 3.0"),
        (leave_mimic, "joint finger: <mimic> is wrist, by yourdfpy none"),
        (leave_joint, "joint hub: yourdfpy does not see it"),
        (add_link, "link ghost: only yourdfpy sees it"),
    ],
)
def test_a_difference_names_the_element_and_both_values(written, seen_otherwise, edit, expected):
    follows = '<mimic joint="wrist" multiplier="2" offset="0.5"/>'
    file = written(*BRANCHES, body("tip"), joint("finger", "hand", "tip", inside=follows))
    assert read_again(file).differences == ()
    seen_otherwise(edit)
    with pytest.warns(ModelWarning, match=f"robot.urdf: {expected}"):
        assert second_opinion(file).differences == (expected,)


def test_a_reader_that_fails_is_a_difference_and_no_crash(written):
    shell = '<link name="shell"><visual><geometry/></visual></link>'
    mount = joint("mount", "base", "shell", kind="fixed")
    (difference,) = read_again(written(*BRANCHES, shell, mount)).differences
    assert difference.startswith("yourdfpy cannot read the file: IndexError")


def test_tags_in_a_namespace_are_read_by_loopid_alone(written):
    found = read_again(written(*BRANCHES, space='xmlns="http://example.org/robot"'))
    assert found.links == 4
    assert "link base: yourdfpy does not see it" in found.differences


def test_an_mjcf_has_no_second_reader(tmp_path):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert second_opinion(tmp_path / "robot.xml") is None
