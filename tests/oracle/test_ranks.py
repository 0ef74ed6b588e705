"""Ranks of robots of every kind of file agree with MuJoCo's."""

import warnings

import numpy as np
import pytest

import folded_robots
import loopid
from bank_robots import few_of
from cad_export import cad_export
from closure_robots import files
from loopid import random_configurations
from loopid.base_parameters import find_base
from loopid.regressors import structural_observation

pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
from mujoco_rank import Oracle

CLEAR = 1e3  # gap of singular values, as loopid asks for
LINKAGES = few_of(
    ("hinge four-bar", "bennett", "ball rssr", "geared five-bar", "cam"), "ball rssr", "cam"
)
INERTIAL = '<inertial pos="0.1 0.02 0.03" mass="1" diaginertia="0.1 0.2 0.25"/>'
# A rod on a ball, a coupled pair, a welded five-bar behind a free body: what MJCF is written of.
FILES = {
    "connect and a ball": f"""<mujoco><worldbody>
        <body name="crank">{INERTIAL}<joint name="crank" axis="0 0.1 1"/>
          <body name="rod" pos="0.2 0 0">{INERTIAL}<joint name="ball" type="ball"/></body></body>
        <body name="rocker" pos="0.75 0.05 0.1">{INERTIAL}<joint name="rocker" axis="0 0.3 1"/>
        </body></worldbody>
        <equality><connect name="end" body1="rod" body2="rocker" anchor="0.5 0 0"/></equality>
        <actuator><motor joint="crank"/></actuator></mujoco>""",
    "weld and polynomial": f"""<mujoco><worldbody>
        <body name="a">{INERTIAL}<joint name="a" axis="0 1 0" range="-60 60"/>
          <body name="b" pos="0.3 0 0">{INERTIAL}<joint name="b" axis="0 1 0"/>
            <body name="c" pos="0.4 0 0.1">{INERTIAL}<joint name="c" axis="0 1 0"/></body></body>
        </body>
        <body name="d" pos="0.6 0 0.3">{INERTIAL}<joint name="d" axis="0 1 0"/>
          <body name="e" pos="0.1 0 0">{INERTIAL}<joint name="e" type="slide" axis="0 0 1"/></body>
        </body></worldbody>
        <equality><weld body1="c" body2="d"/>
        <joint joint1="e" joint2="a" polycoef="0.05 0.2 0.1 -0.05 0.02"/></equality>
        <actuator><motor joint="a"/></actuator></mujoco>""",
    "differential": f"""<mujoco><worldbody>
        <body name="left">{INERTIAL}<joint name="left" axis="0 1 0"/></body>
        <body name="right">{INERTIAL}<joint name="right" axis="0 1 0"/></body>
        <body name="fork" pos="0.2 0 0">{INERTIAL}<joint name="pitch" axis="0 1 0"/>
          <body name="hand" pos="0.1 0 0">{INERTIAL}<joint name="roll" axis="1 0 0"/></body></body>
        </worldbody>
        <tendon><fixed name="sum"><joint joint="left" coef="1"/><joint joint="pitch" coef="-1"/>
        <joint joint="roll" coef="-1"/></fixed><fixed name="difference">
        <joint joint="right" coef="1"/><joint joint="pitch" coef="-1"/>
        <joint joint="roll" coef="1"/></fixed></tendon>
        <equality><tendon tendon1="sum"/><tendon tendon1="difference"/></equality>
        <actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>""",
    "drawn folded": folded_robots.FOLDED_MJCF,
}


def assert_ranks_agree(robot):
    for kind in ("full", "gravity"):
        enough = 5 + int(np.ceil(2 * len(robot.parameters(kind)) / len(robot.independent)))
        configurations = random_configurations(robot, enough, seed=3)
        rank, gap = Oracle.of(robot).rank(configurations, kind)
        assert gap > CLEAR
        assert len(find_base(structural_observation(robot, kind), "qr")) == rank


@pytest.mark.parametrize("name", few_of(["delta", "3ups_rpu"], "delta"))
def test_bundled_robots(name, load_once):
    assert_ranks_agree(load_once(name))


@pytest.mark.parametrize("name", LINKAGES)
def test_linkages(name, linkage):
    assert_ranks_agree(linkage(name))


@pytest.mark.parametrize("name", few_of(FILES, "differential"))
def test_files_of_mujoco(name, tmp_path):
    (tmp_path / "robot.xml").write_text(FILES[name])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert_ranks_agree(loopid.load(tmp_path / "robot.xml"))


@pytest.mark.parametrize(
    "name",
    few_of(["folded_four_bar", "folded_leg", "folded_branches"], "folded_four_bar"),
)
def test_robots_that_are_drawn_folded(name, write_files):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = write_files(*files(*getattr(folded_robots, name)()))
        assert_ranks_agree(loopid.load(path))


@pytest.mark.validate
def test_files_of_six_digits(linkage, write_files):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert_ranks_agree(loopid.load(write_files(*cad_export(linkage("five-bar")))))


# What ``loopid check`` advises to lock, and then ``loopid base`` for a rounding.
DISNEY = {
    "lock": (
        "ankle_universal_2_rev0", "shin_tigh_mirror1_rev1", "motor_link_2_tigh_mirror2_2_rev0"
    ),
    "rounding": 1e-7,
}  # fmt: skip


@pytest.mark.validate
@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize(
    ("name", "options"), [("mjcf/cassie.xml", {}), ("gepetto/disney_like/robot.yaml", DISNEY)]
)
def test_models_of_others(name, options, shared):
    assert_ranks_agree(loopid.load(shared / "models" / name, **options))
