"""Robot descriptions without end or sense are refused in a sentence, in little memory."""

import os
from pathlib import Path

import pytest
from spoiling import LAUGHS

import loopid
from loopid.errors import LoopidError, RobotFileError
from loopid.logs.mapping import mapping_of
from loopid.motion import read_motion_program
from made_runs import ARM

MERGES = "a0: &a0 {x: 1}\n" + "\n".join(
    f"a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}" for k in range(1, 60)
)


@pytest.fixture
def refused(tmp_path):
    """Message of a refusal of a file by one of the functions that read it."""

    def message(name, content, read=loopid.load):
        place = tmp_path / name
        if content is not None:
            place.write_bytes(content if isinstance(content, bytes) else content.encode())
        with pytest.raises(LoopidError) as failure:
            read(place)
        text = str(failure.value)
        assert text.startswith(str(place))
        assert len(text) < 400
        return text

    return message


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (LAUGHS, "is in what has an anchor (&) itself"),
        (b"reference: &a {b: *a}\n", "*a in line 1 is in what has an anchor (&) itself"),
        (MERGES, "anchor"),
        ("a: [" + ",".join(f"&x{k} 1" for k in range(20000)) + "]", "more than the 100 anchors"),
        ("a: '" + "x" * 200_000 + "'", "unknown key 'a'"),
        ("a: '" + "x" * 3_000_000 + "'", "longer than the 0.5 MB"),
        (b"- " * 5000, "nested too deeply"),
        (b"\xff\xfe", "is no text in UTF-8 (line 1): save it in UTF-8"),
        (b"urdf: 2020-13-45\n", "is not YAML: month must be"),
        (b"? [1, 2]\n: 3\n", "unknown key (1, 2)"),
        (b"urdf: !!int ''\n", "tag 'tag:yaml.org,2002:int' in line 1 is not read"),
        (b"floating_base: !!bool x\n", "tag 'tag:yaml.org,2002:bool' in line 1"),
        (b"a: !!python/object/apply:os.system [ls]\n", "in line 1 is not read: remove it"),
        ('name_mot: ["a\\nb"]\n', "printable and on one line, not 'a\\nb'"),
        ('identical: {"\\e[31m": [a, b]}\n', "printable and on one line"),
        (b"reference: {a: 1_6}\n", "'1_6' in line 1 is a number with _"),
        (b"name_mot: [0x10]\n", "'0x10' in line 1 is a number with 0x, 0o or 0b"),
        ("rounding: 0x" + "f" * 5000, "is a number with 0x"),
        ("reference: {a: ١٢}\n", "reference.a"),
    ],
)
def test_a_yaml_without_end_or_sense_is_refused(refused, content, words):
    assert words in refused("robot.yaml", content)


@pytest.mark.parametrize("read", [mapping_of, read_motion_program])
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (LAUGHS, "is in what has an anchor (&) itself"),
        (b"- " * 5000, "nested too deeply"),
        (b"a: !!python/object/apply:os.system [ls]\n", "in line 1 is not read: remove it"),
        (b"rate: 1_6\n", "'1_6' in line 1 is a number with _"),
    ],
)
def test_so_is_any_other_yaml(refused, content, words, read):
    assert words in refused("other.yaml", content, read)


def test_a_yaml_that_may_not_be_read_is_named(tmp_path, monkeypatch):
    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\n")
    monkeypatch.setattr(Path, "open", denied)
    with pytest.raises(RobotFileError, match=r"robot\.yaml cannot be read: Permission denied"):
        loopid.load(tmp_path / "robot.yaml")


ENTITY = """<?xml version="1.0"?><!DOCTYPE robot [<!ENTITY body "<inertial/>">]>\n"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<robot name="', ENTITY + '<robot name="', "write out what &body; stands for"),
        ("</joint>", "</joint>&elsewhere;", "write out what &elsewhere; stands for"),
        ('rpy="0 0 0"', 'rpy="1e308 0 0"', "<origin> rpy is too large: 1e308 0 0"),
        ('mass value="3.0"', 'mass value="1_6"', "must be a finite number, not '1_6'"),
        ('mass value="3.0"', 'mass value="١٢"', "must be a finite number"),
        ("<mass", '<mass value="1"/><mass', "has 2 times <mass>: keep one"),
        ("<origin", '<origin xyz="0 0 0"/><origin', "has 2 times <origin>: keep one"),
        ("</joint>", '<dynamics damping="x"/></joint>', "damping must be a finite number, not 'x'"),
        ('<robot name="', '<robot name="\x9b31m', "the name of <robot> must be printable"),
        ("</robot>", "<!--" + "x" * 21_000_000 + "--></robot>", "longer than the 20 MB"),
    ],
)
def test_a_urdf_that_readers_take_for_another_is_refused(refused, old, new, words):
    assert old in ARM
    start = '<!DOCTYPE robot SYSTEM "other.dtd">\n' if "elsewhere" in new else ""
    assert words in refused("robot.urdf", start + ARM.replace(old, new, 1))


BODY = """<body name="b"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<joint name="j" axis="1 0 0"/></body>"""


def mjcf(rest="", body=BODY):
    return f"<mujoco><worldbody>{body}</worldbody>{rest}</mujoco>"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (mjcf('<include file="robot.xml"/>'), "MuJoCo refuses it"),
        (
            mjcf(body=BODY.replace('axis="1 0 0"', 'axis="1e308 0 0"')),
            "jnt_axis of MuJoCo's model has an axis of length 0",
        ),
        (
            mjcf(body=BODY.replace('pos="0 0 0"', 'pos="1e200 0 0"')),
            "body_ipos of MuJoCo's model must be finite",
        ),
        (mjcf(body=BODY.replace('name="j"', 'name="a&#10;b"')), "printable and on one line"),
        (mjcf(body=BODY.replace('name="b"', 'name="&#27;[31m"')), "no valid XML"),
        (
            ENTITY.replace("robot [", "mujoco [") + mjcf(body="&body;"),
            "write out what &body; stands for",
        ),
        (mjcf(body=BODY + "&elsewhere;"), "elsewhere"),
        ("none", "no valid XML"),
        (
            mjcf(body=BODY.replace("<joint ", '<joint stiffness="1e308" springref="9000" ')),
            "joint_terms.j.Fo: must be a finite number",
        ),
    ],
)
def test_an_mjcf_without_end_or_sense_is_refused(refused, content, words):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    assert words in refused("robot.xml", content)


def test_a_robot_of_more_joints_than_memory_holds_is_refused(refused):
    joint = '<joint name="j{0}" type="continuous"><parent link="l{0}"/><child link="l{1}"/></joint>'
    links = "".join(f'<link name="l{k}"/>' for k in range(302))
    joints = "".join(joint.format(k, k + 1) for k in range(301))
    content = f'<robot name="long">{links}{joints}</robot>'
    assert "joints of 301 coordinates: at most 300" in refused("robot.urdf", content)


def test_files_that_include_each_other_again_and_again_are_refused(refused, tmp_path):
    pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
    for k in range(9):
        content = f'<include file="{k - 1}.xml"/>' * 9 if k else "<option/>"
        (tmp_path / f"{k}.xml").write_text(f"<mujoco>{content}</mujoco>")
    assert "already included" in refused("robot.xml", mjcf('<include file="8.xml"/>'))


@pytest.mark.parametrize("ending", ["urdf", "xml", "yaml"])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_file_is_not_read(refused, tmp_path, ending, kind):
    place = tmp_path / f"robot.{ending}"
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "device":
        place.symlink_to("/dev/zero")
    else:
        place.mkdir()
    words = "is a folder" if kind == "folder" else "is no regular file"
    assert words in refused(place.name, None)
