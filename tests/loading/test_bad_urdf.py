"""A URDF that contradicts itself or physics is refused by name, in one sentence."""

import pytest

from loopid import LoopidError, load_mechanism
from loopid.errors import RobotFileError

JOINT = '<joint name="leg1_universal_1" type="revolute">'
STROKE = r'(<joint name="leg1_stroke".*?)<limit [^>]*/>'
BROKEN = {
    # Physics: the pattern, what takes its place, and what the refusal must say.
    "negative mass": ('mass value="9.82033"', 'mass value="-2"', ("platform", "-2 kg")),
    "mass too large": ('mass value="9.82033"', 'mass value="1e300"', ("platform", "1e300")),
    "mass NaN": ('mass value="9.82033"', 'mass value="nan"', ("platform", "mass", "finite")),
    "mass infinite": ('mass value="9.82033"', 'mass value="inf"', ("platform", "mass", "finite")),
    "inertia NaN": ('ixx="0.26398"', 'ixx="nan"', ("platform", "<inertia>", "finite")),
    "centre of mass NaN": ('xyz="0.00393 ', 'xyz="nan ', ("platform", "<origin>", "finite")),
    "joint origin NaN": (
        JOINT + r'\s*<origin xyz="-0.4 ',
        JOINT + '<origin xyz="nan ',
        ("leg1_universal_1", "<origin>", "finite"),
    ),
    "axis NaN": (
        r'(<child link="leg1_cross"/>\s*<axis xyz=)"0 -1 0"',
        r'\1"0 nan 0"',
        ("leg1_universal_1", "<axis>", "finite"),
    ),
    "axis zero": (
        r'(<child link="leg1_cross"/>\s*<axis xyz=)"0 -1 0"',
        r'\1"0 0 0"',
        ("leg1_universal_1", "<axis>", "zero"),
    ),
    "limit NaN": ('lower="0.6537"', 'lower="nan"', ("leg1_stroke", "<limit>", "finite")),
    "limits crossed": ('lower="0.6537"', 'lower="2"', ("leg1_stroke", "lower 2", "0.9337")),
    "limit missing": (STROKE, r"\1", ("leg1_stroke", "prismatic", "<limit>")),
    "no effort": ('effort="0" velocity', "velocity", ("leg1_universal_1", "<limit>", "effort")),
    "effort negative": ('effort="0"', 'effort="-1"', ("leg1_universal_1", "effort", "-1")),
    "no mass": ('<mass value="9.82033"/>', "", ("platform", "<mass>")),
    "no inertia": ("<inertia ixx=.0.26398[^>]*/>", "", ("platform", "no <inertia>")),
    "no moment": ('ixx="0.26398"', "", ("platform", "<inertia>", "ixx")),
    "no inertials": ("<inertial>.*?</inertial>", "", ("<inertial>", "nothing to identify")),
    # Structure.
    "link twice": (
        '<link name="leg1_cross"/>',
        '<link name="leg1_cross"/><link name="leg1_cross"/>',
        ("link", "leg1_cross", "2 times"),
    ),
    "joint twice": ('joint name="leg2_stroke"', 'joint name="leg1_stroke"', ("leg1_stroke",)),
    "cycle": (
        f'({JOINT}.*?)parent link="base"',
        r'\1parent link="leg1_stem"',
        ("leg1_cross", "leg1_cylinder", "leg1_stem", "cycle"),
    ),
    "two roots": (f"{JOINT}.*?</joint>", "", ("one root", "base", "leg1_cross")),
    "no root": (
        "</robot>",
        '<joint name="back" type="fixed"><parent link="platform"/><child link="base"/></joint>'
        "</robot>",
        ("one root", "none"),
    ),
    "two parents": (
        'child link="leg1_cross"',
        'child link="leg2_cross"',
        ("leg2_cross", "2 joints", "not a tree"),
    ),
    "unknown parent": (
        'parent link="leg1_cylinder"',
        'parent link="leg9_cylinder"',
        ("leg1_stroke", "leg9_cylinder"),
    ),
    "unknown child": (
        'child link="leg1_stem"',
        'child link="leg9_stem"',
        ("leg1_stroke", "leg9_stem"),
    ),
    "joint of the ground": (
        'joint name="leg1_stroke"',
        'joint name="universe"',
        ("universe", "rename it"),
    ),
    "link without a name": ('<link name="leg1_cross"/>', "<link/>", ("<link>", "name")),
    "joint without a name": ('joint name="leg1_stroke"', "joint", ("<joint>", "name")),
    "no links": (r"\A.+", '<robot name="nothing"/>', ("<link>",)),
    # Grammar.
    "XML cut off": ("</robot>.*", "", ("not a valid URDF", "line")),
    "not a robot": (r"\A.+", "<sdf/>", ("not a valid URDF", "<sdf>", "<robot>")),
    "not XML": (r"\A.+", "solid robot", ("not a valid URDF",)),
    "empty file": (r"\A.+", "", ("not a valid URDF",)),
    "mass not a number": ('mass value="9.82033"', 'mass value="heavy"', ("heavy",)),
    "axis of two numbers": (
        r'(<child link="leg1_cross"/>\s*<axis xyz=)"0 -1 0"',
        r'\1"0 -1"',
        ("leg1_universal_1",),
    ),
    "mass without value": ('mass value="9.82033"', "mass", ("platform", "<mass>", "no value")),
    "joint without parent": (
        '<parent link="leg1_cylinder"/>',
        "",
        ("leg1_stroke", "<parent>", "missing"),
    ),
    "unknown joint type": (
        'name="leg1_stroke" type="prismatic"',
        'name="leg1_stroke" type="screw"',
        ("leg1_stroke", "'screw'", "prismatic", "planar"),
    ),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_urdf_is_refused_by_name(case, edited, refusal):
    pattern, replacement, fragments = BROKEN[case]
    file = edited("urdf", pattern, replacement)
    with pytest.raises(RobotFileError) as failure:
        load_mechanism(file)
    assert isinstance(failure.value, LoopidError)
    refusal(failure, str(file.with_suffix(".urdf")), *fragments)


def test_a_prefix_without_a_namespace_is_harmless(edited):
    file = edited("urdf", "</robot>", "<gazebo:plugin/></robot>")
    assert load_mechanism(file).name == "3ups_rpu"


def test_the_unedited_copy_loads(edited):
    assert load_mechanism(edited()).name == "3ups_rpu"
