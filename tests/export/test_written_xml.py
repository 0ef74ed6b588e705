"""Edits of XML change what they should: other tags, comments, order and encoding stay."""

from feasible_changes import changed, without_numbers
from hypothesis import given, strategies as st
from lxml import etree

import loopid
from loopid.export.robot_file import updated_robot_file

ENCODINGS = ("utf-8", "utf-8-sig", "iso-8859-1", "ascii")
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


@given(text=robots(), encoding=st.sampled_from(ENCODINGS), seed=st.integers(0, 99))
def test_only_numbers_of_the_inertial_change(tmp_path_factory, text, encoding, seed):
    path = tmp_path_factory.mktemp("robot") / "robot.urdf"
    path.write_bytes(encoded(text, encoding))
    mechanism = loopid.load(path)
    parameters = changed(mechanism, seed=seed)
    old, new = path.read_bytes(), updated_robot_file(mechanism, parameters)
    path.write_bytes(new)
    again = loopid.load(path)
    assert abs(again.standard_parameters() - parameters).max() < 1e-13
    declared = [etree.fromstring(each).getroottree().docinfo.encoding for each in (old, new)]
    assert declared[0].lower() == declared[1].lower()
    assert "é" in new.decode(declared[1]) or encoding == "ascii"
    before, after = (
        [node for node in without_numbers(each) if node[0] not in ("origin", "inertial")]
        for each in (old, new)
    )
    assert after == before
    origins = [
        (node.get("xyz"), node.get("rpy", "0 0 0"))
        for each in (old, new)
        for node in etree.fromstring(each).iter("origin")
    ]
    assert origins[-1][1] == (origins[0][1] if len(origins) == 2 else "0 0 0")
