"""MJCF with new inertials: the same forces when it is loaded again, and nothing else changed."""

import re

import numpy as np
import pytest
from feasible_changes import changed, forces, forces_of_file, relative
from lxml import etree

import loopid
from loopid.errors import DataError, OptionError, RobotFileError
from loopid.export.robot_file import export_robot_file, updated_robot_file

pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
pytestmark = pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning")

# Every way to say an inertia: tensors, moments with and without axes, geoms, frames, no names.
ROBOT = """<?xml version="1.0"?>
<!-- <body name="fake"><inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/></body> -->
<mujoco model="arm">
  <compiler angle="degree"/>
  <default><geom density="700"/></default>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body name="one" pos="0 0 0.2" euler="10 20 30"><!-- kept -->
      <joint axis="1 2 -1" pos="0.05 0.1 -0.2"/>
      <inertial pos="0.1 -0.2 0.3"\tmass='2' fullinertia="0.3 0.2 0.25 0.01 0.02 -0.03"/>
      <body name="two" pos="0 0.5 0">
        <joint type="slide" axis="0 1 0"/>
        <inertial pos="0 0 0.05" mass="0.4" diaginertia="0.01 0.02 0.015"/>
        <frame euler="0 45 0">
          <body name="three" pos="0.1 0 0">
            <inertial euler="10 20 30" diaginertia=".01 .02 .025" mass=".3" pos="0 .1 0"/>
            <joint type="ball" pos="0.02 0 0"/>
            <body pos="0.2 0 0"><joint axis="0 1 0"/><geom type="box" size=".1 .02 .03"/></body>
            <body name="lid" pos="0 0 0.1"><geom size="0.02"/></body>
          </body>
        </frame>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def without_inertials(content):
    """All that a file holds in order, but inertials and space."""
    nodes = etree.fromstring(content).getroottree().iter()
    return [(n.tag, dict(n.attrib), (n.text or "").strip()) for n in nodes if n.tag != "inertial"]


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ROBOT)
    return loopid.load(path)


@pytest.mark.parametrize("model", ["full", "gravity"])
def test_round_trip(arm, tmp_path, model):
    parameters = changed(arm, model)
    path = export_robot_file(arm, parameters, tmp_path / "new.xml")
    again = loopid.load(path)
    assert relative(forces_of_file(again, model), forces(arm, parameters, model)) < 1e-9
    old, new = (without_inertials(content) for content in (ROBOT.encode(), path.read_bytes()))
    assert new == old
    # The body made of a geom has one now, and its neighbour of one geom is part of another body.
    assert path.read_text().count("<inertial") == ROBOT.count("<inertial") + 1


def test_the_files_own_parameters_change_no_byte(arm):
    for model in ("full", "gravity"):
        assert updated_robot_file(arm, arm.standard_parameters(model)).decode() == ROBOT


def test_what_keeps_its_axes_keeps_its_form(tmp_path):
    # Twice the mass in the same places, of bodies that are one link each.
    text = re.sub(r'<body name="lid".*?</body>', "", ROBOT)
    (tmp_path / "arm.xml").write_text(text)
    arm = loopid.load(tmp_path / "arm.xml")
    new = updated_robot_file(arm, 2 * arm.standard_parameters()).decode()
    old, new = (re.findall(r"<inertial\b.*?/>", content)[1:4] for content in (text, new))
    for one, two in zip(old, new, strict=True):
        names, others = (re.findall(r"(\w+)=", inertial) for inertial in (one, two))
        assert names == others
        before, after = (
            np.array(re.search(r"(?:diag|full)inertia=.(.*?)[\"']", inertial)[1].split(), float)
            for inertial in (one, two)
        )
        np.testing.assert_allclose(after, 2 * before, rtol=1e-12)


def test_a_yaml_beside_it_round_trips(arm, tmp_path):
    (tmp_path / "robot.yaml").write_text("mjcf: arm.xml\nname_mot: [one_hinge]\n")
    with pytest.warns(UserWarning, match="free"):
        mechanism = loopid.load(tmp_path / "robot.yaml")
    parameters = changed(mechanism)
    again = loopid.load(export_robot_file(mechanism, parameters, tmp_path / "new.xml"))
    np.testing.assert_allclose(again.standard_parameters(), parameters, rtol=1e-11, atol=1e-13)


def test_impossible_bodies_are_refused_by_name(arm, tmp_path):
    rows = arm.standard_parameters().reshape(-1, 10).copy()
    rows[0] *= -1
    with pytest.raises(DataError, match=r"link one .*mass is not positive \(-2"):
        export_robot_file(arm, rows.ravel(), tmp_path / "new.xml")
    assert not (tmp_path / "new.xml").exists()
    with pytest.raises(OptionError) as refused:
        export_robot_file(arm, changed(arm), tmp_path / "new.urdf")
    assert refused.value.facts == {"given": ".urdf", "valid": (".xml",)}


@pytest.mark.filterwarnings("ignore:.*settotalmass. is deprecated")
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('angle="degree"', 'angle="degree" inertiafromgeom="true"', "inertiafromgeom .*overrules"),
        ('angle="degree"', 'angle="degree" settotalmass="9"', "settotalmass .*overrules"),
        ("<worldbody>", '<include file="more.xml"/><worldbody>', "only 5 of its 6 bodies"),
    ],
)
def test_what_cannot_be_edited_is_refused(tmp_path, old, new, words):
    (tmp_path / "more.xml").write_text(
        '<mujoco><worldbody><body name="more"><joint/><geom size=".1"/></body></worldbody></mujoco>'
    )
    path = tmp_path / "arm.xml"
    path.write_text(ROBOT.replace(old, new))
    mechanism = loopid.load(path)
    with pytest.raises(RobotFileError, match=words):
        updated_robot_file(mechanism, changed(mechanism))


def test_included_files_without_bodies_do_no_harm(tmp_path):
    (tmp_path / "more.xml").write_text('<mujoco><option gravity="0 0 -5"/></mujoco>')
    path = tmp_path / "arm.xml"
    path.write_text(ROBOT.replace("<worldbody>", '<include file="more.xml"/><worldbody>'))
    mechanism = loopid.load(path)
    parameters = changed(mechanism)
    again = loopid.load(export_robot_file(mechanism, parameters, tmp_path / "new.xml"))
    assert again.model.gravity.linear[2] == -5
    assert relative(forces_of_file(again), forces(mechanism, parameters)) < 1e-9
