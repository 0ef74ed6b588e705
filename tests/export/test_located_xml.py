"""Places of tags and attributes: edits change what they should and nothing else."""

import re

import pytest
from feasible_changes import changed
from hypothesis import given, strategies as st
from lxml import etree

from loopid import load_mechanism
from loopid.errors import RobotFileError
from loopid.export import updated_robot_file
from loopid.export.located_xml import LocatedXml

ENCODINGS = ("utf-8", "utf-8-sig", "iso-8859-1", "ascii")
# Found without loopid: what an inertial holds, and the numbers in quotes there.
INERTIAL = re.compile(r"<inertial\b.*</inertial\s*>", re.DOTALL)
NUMBERS = re.compile(r"(=\s*)([\"'])[-+.0-9eE&#;\s]+\2")
SPACES = st.sampled_from(["", " ", "\n\t", "\r\n  ", "  "])
GAPS = SPACES.filter(bool)
# What looks like tags and is none, and what other programs leave in robot files.
NOISE = st.sampled_from(
    [
        "<!-- <inertial><mass value='1'/></inertial> -->",
        "<!-- > -- \" ' -->".replace(" -- ", " - "),
        "<?robot <mass value='2'/>?>",
        '<gazebo reference="arm"><mass value="3"/><note>a &gt; b &amp; "c"</note></gazebo>',
        "<transmission name='t'><type>x > y</type><![CDATA[<link name='arm'>]]></transmission>",
        '<material name="a>b" note=\'say "hi"\'/>',
        '<xacro:property xmlns:xacro="x" name="m" value="${2 > 1}"/>',
    ]
)


@st.composite
def tags(draw, name, attributes, children=None):
    """A tag with attributes in any order, any quotes and any space."""
    parts = [f"<{name}"]
    for key, value in draw(st.permutations(list(attributes.items()))):
        quote = draw(st.sampled_from("\"'"))
        space = draw(SPACES)
        parts.append(f"{draw(GAPS)}{key}{space}={draw(SPACES)}{quote}{value}{quote}")
    if children is None:
        return "".join(parts) + draw(SPACES) + "/>"
    return "".join(parts) + draw(SPACES) + f">{draw(SPACES)}{children}{draw(SPACES)}</{name}>"


@st.composite
def inertials(draw):
    """An inertial with its tags in any order; the origin, or parts of it, may be missing."""
    moments = {
        "ixx": "0.02",
        "ixy": "+1e-3",
        "ixz": ".0",
        "iyy": "3E-2",
        "iyz": "-0",
        "izz": "0.04",
    }
    places = {"xyz": " 0.1\t-0.2 3e-1", "rpy": "0 0.3 0"}
    kept = draw(st.sets(st.sampled_from(["xyz", "rpy"])))
    found = [
        draw(tags("mass", {"value": draw(st.sampled_from(["2", "2.0", " 2 ", "&#50;"]))})),
        draw(tags("inertia", moments)),
    ]
    if draw(st.booleans()):
        found.append(draw(tags("origin", {key: places[key] for key in kept})))
    found.append(draw(NOISE))
    content = draw(SPACES).join(draw(st.permutations(found)))
    return draw(tags("inertial", {}, content))


@st.composite
def robots(draw):
    """Text of a pendulum."""
    arm = draw(tags("link", {"name": draw(st.sampled_from(["arm", " arm", "a&#114;m"]))},
                    draw(NOISE) + draw(inertials())))  # fmt: skip
    hinge = (
        '<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>'
        '<axis xyz="0 1 0"/></joint>'
    )
    parts = draw(st.permutations([arm, hinge, '<link name="base"/>', draw(NOISE)]))
    return draw(tags("robot", {"name": "pendulum"}, draw(SPACES).join(parts)))


def encoded(text, encoding):
    declared = {"utf-8-sig": "utf-8"}.get(encoding, encoding)
    return f'<?xml version="1.0" encoding="{declared}"?>\n{text}\n<!-- é -->'.encode(
        encoding, "xmlcharrefreplace"
    )


def attributes_of(content):
    """All attributes in the order of the tags, by another parser."""
    elements = etree.fromstring(content).iter("*")
    return [(element.tag, dict(element.attrib)) for element in elements]


@given(text=robots(), encoding=st.sampled_from(ENCODINGS), seed=st.integers(0, 99))
def test_only_numbers_of_the_inertial_change(tmp_path_factory, text, encoding, seed):
    path = tmp_path_factory.mktemp("robot") / "robot.urdf"
    path.write_bytes(encoded(text, encoding))
    mechanism = load_mechanism(path)
    parameters = changed(mechanism, seed=seed)
    old, new = path.read_bytes(), updated_robot_file(mechanism, parameters)
    path.write_bytes(new)
    again = load_mechanism(path)
    assert abs(again.standard_parameters() - parameters).max() < 1e-13
    before, after = attributes_of(old), attributes_of(new)
    inserted = len(after) - len(before)
    assert inserted == ("<origin" not in text)
    after = [(tag, a) for tag, a in after if not inserted or tag != "origin"]
    for (tag, one), (other_tag, other) in zip(before, after, strict=True):
        assert tag == other_tag
        if tag not in ("mass", "inertia", "origin"):
            assert one == other
    text, other = (without_numbers(LocatedXml(content).text) for content in (old, new))
    if text != other:  # an origin or its xyz had to be added
        added = r"(?<=<origin) xyz=#" if "<origin" in text else r"\s*<origin xyz=#/>"
        text, other = text, re.sub(added, "", other, count=1)
    assert text == other


def without_numbers(text):
    return INERTIAL.sub(lambda match: NUMBERS.sub(r"\1#", match.group()), text)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"<robot><link></robot>", "closes nothing"),
        (b"<robot/><robot/>", "do not form one tree"),
        (b"<robot>", "do not form one tree"),
        ("<robot/>".encode("utf-16"), "do not form one tree"),
    ],
)
def test_what_cannot_be_edited_is_refused(content, words):
    with pytest.raises(RobotFileError, match=words):
        LocatedXml(content)
