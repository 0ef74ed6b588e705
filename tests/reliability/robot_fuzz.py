"""Fuzz robot files: ``python tests/reliability/robot_fuzz.py --draws 2000 [--seed 0]``.

Three draws of four are damage: the file must be answered or refused in one sentence, within
``fuzz.PATIENCE``, and write nothing. The others change nothing of the physics: rank, condition
numbers and the chosen parameters, up to names, must stay.
A draw can be repeated by its number: ``--only``.
"""

import argparse
import faulthandler
import json
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from random import Random

import beside_tests  # noqa: F401
from fuzz import HANGING, Call, faults, run
from lxml import etree
from spoiling import FAMILY, FAMILY_YAML, spoil

from loopid.loading.files import bundled_directory
from made_runs import ARM

NEUTRAL = 0.25
BUNDLED = ("four_bar", "five_bar", "parallelogram", "3rpr")
INERTIAL = '<inertial pos="0.2 0.01 0" quat="0.8 0 0.6 0" mass="{}" diaginertia="0.02 0.03 0.04"/>'
MJCF = f"""<mujoco model="five bars">
  <compiler angle="radian"/><option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="left" pos="0 0 0">{INERTIAL.format(1.0)}
      <joint name="left_hinge" axis="0 1 0" range="-2.5 -0.5" ref="-1.6" armature="0.1"/>
      <body name="left_rod" pos="0.4 0 0" quat="0.9 0 0.3 0">{INERTIAL.format(0.7)}
        <joint name="left_elbow" axis="0 1 0" damping="0.1"/>
      </body>
    </body>
    <body name="right" pos="0.5 0 0">{INERTIAL.format(1.1)}
      <joint name="right_hinge" axis="0 1 0" range="-2.5 -0.5" ref="-1.6" frictionloss="0.2"/>
      <body name="right_rod" pos="0.4 0 0" quat="0.9 0 -0.3 0">{INERTIAL.format(0.8)}
        <joint name="right_elbow" axis="0 1 0" stiffness="2"/>
      </body>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="left_rod" body2="right_rod" anchor="0.4 0 0.05"/></equality>
  <actuator><motor joint="left_hinge"/><motor joint="right_hinge"/></actuator>
</mujoco>
"""
LINK = """<link name="{0}"><inertial><origin xyz="0.2 0.01 0.02"/><mass value="{1}"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.04"/></inertial></link>
<joint name="{0}_joint" type="revolute" independent="{3}"><parent link="{2}"/><child link="{0}"/>
<origin xyz="{4}" rpy="0 {5} 0"/><axis xyz="0 1 0"/><dynamics damping="0.1"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
"""
URDF_PLUS = f"""<robot name="loop"><link name="stand"/>
{LINK.format("crank", 1.0, "stand", "true", "0 0 0", -1.2)}
{LINK.format("rod", 0.6, "crank", "false", "0.2 0 0", 1.0)}
{LINK.format("rocker", 0.8, "stand", "false", "0.5 0 0", -1.0)}
<loop name="pin" type="revolute"><predecessor link="rod"><origin xyz="0.5 0 0"/></predecessor>
<successor link="rocker"><origin xyz="0.4 0 0"/></successor><axis xyz="0 1 0"/></loop>
</robot>
"""
# Of joints that no file calls motors or lists, in branches and in a loop that some would drive.
HINGES = MJCF.partition("<actuator>")[0] + "</mujoco>"
BRANCHES = URDF_PLUS.replace(' independent="true"', "").replace(' independent="false"', "")
BRANCHES = BRANCHES.replace("</robot>", LINK.format("tool", 0.3, "crank", "", "0.1 0.2 0", 0.4))
BRANCHES = BRANCHES.replace(' independent=""', "") + "</robot>"
BAR = """<link name="{0}"><pose>{3} {4} 0 {5} 0</pose><inertial><pose>0.2 0.01 0.02 0 0 0</pose>
<mass>{1}</mass><inertia><ixx>0.02</ixx><iyy>0.03</iyy><izz>0.04</izz></inertia></inertial></link>
<joint name="{0}_joint" type="revolute"><parent>{2}</parent><child>{0}</child>
<axis><xyz>0 1 0</xyz><limit><lower>-3</lower><upper>3</upper></limit>
<dynamics><damping>0.1</damping></dynamics></axis></joint>
"""
# A parallelogram, whose rocker has a second parent.
SDF = f"""<sdf version="1.9"><model name="bars"><link name="stand"/>
<joint name="mount" type="fixed"><parent>world</parent><child>stand</child></joint>
{BAR.format("crank", 1.0, "stand", 0, "0 0", -1.2)}
{BAR.format("rocker", 0.8, "stand", 0.5, "0 0", -1.2)}
{BAR.format("rod", 0.6, "crank", 0.14494311017906694, "0 0.37281563438689053", 0)}
<joint name="pin" type="revolute"><parent>rod</parent><child>rocker</child>
<pose relative_to="rod">0.5 0 0 0 0 0</pose><axis><xyz>0 1 0</xyz></axis></joint>
</model></sdf>
"""
XACRO = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass" default="2"/><xacro:property name="reach" value="0.5"/>
<xacro:macro name="bar" params="name parent at">
<link name="${name}"><inertial><origin xyz="${0.5 * at + 0.1} 0 0.02"/><mass value="$(arg mass)"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="${name}_joint" type="revolute"><parent link="${parent}"/><child link="${name}"/>
<origin xyz="${at} 0 0"/><axis xyz="0 1 0"/><limit lower="${-pi}" upper="${pi}"/></joint>
</xacro:macro>
<link name="ground"/><xacro:bar name="first" parent="ground" at="0"/>
<xacro:if value="${reach > 0}"><xacro:bar name="second" parent="first" at="${reach}"/></xacro:if>
</robot>
"""


@cache
def robots() -> dict[str, dict[str, bytes]]:
    """Files of each robot by name, the one to be given first."""
    folder = bundled_directory()
    found = {
        name: {f"{name}.{end}": (folder / f"{name}.{end}").read_bytes() for end in ("yaml", "urdf")}
        for name in BUNDLED
    }
    family = {"robot.yaml": FAMILY_YAML, "robot.urdf": FAMILY}
    texts = {"arm": {"arm.urdf": ARM}, "loop": {"loop.urdf": URDF_PLUS}, "bars": {"bars.xml": MJCF}}
    texts |= {"branches": {"branches.urdf": BRANCHES}, "hinges": {"hinges.xml": HINGES}}
    texts |= {"gazebo": {"gazebo.sdf": SDF}, "macros": {"macros.urdf.xacro": XACRO}}
    for name, files in {**texts, "family": family}.items():
        found[name] = {
            file: text if isinstance(text, bytes) else text.encode() for file, text in files.items()
        }
    return found


@dataclass(frozen=True)
class Draw:
    """Files of a robot, changed, and the names that its links and joints had."""

    number: int
    robot: str
    files: dict[str, bytes]
    neutral: bool
    names: dict[str, str]

    @staticmethod
    def of(seed: int, number: int) -> "Draw":
        """The draw of a number; it depends on seed and number alone."""
        random = Random(f"{seed} {number}")
        name = random.choice(sorted(robots()))
        files = dict(robots()[name])
        if random.random() < NEUTRAL:
            files, names = changed(files, random)
            return Draw(number, name, files, True, names)
        wrong = random.choice(sorted(files))
        files[wrong] = spoil(files[wrong], random)
        return Draw(number, name, files, False, {})


# Words of the formats, which are not names even where a link is called so.
RESERVED = {
    *("platform", "frame", "world", "axis", "loop", "base", "lower", "upper", "x", "y", "z")
}


SHUFFLED = ("robot", "link", "joint", "inertial", "body", "worldbody")


def changed(files: dict[str, bytes], random: Random) -> tuple[dict[str, bytes], dict[str, str]]:
    """The same robot, written in another way."""
    trees = {name: text for name, text in files.items() if not name.endswith("yaml")}
    ((tree, text),) = trees.items()
    root = etree.fromstring(text)
    given = {str(tag.get("name")) for tag in root.iter("link", "joint", "body")}
    old = {name for name in given - {"None"} - RESERVED if "$" not in name}
    kinds = random.sample(("tags", "attributes", "comments", "names", "quaternions", "lines"), 3)
    if "tags" in kinds and not tree.endswith("xacro"):  # macros come before they are used
        for tag in list(root.iter(*SHUFFLED)):
            _shuffle(tag, random)
    if "quaternions" in kinds:
        for tag in root.iterfind(".//*[@quat]"):
            tag.set("quat", " ".join(str(-float(word)) for word in tag.get("quat").split()))
    if "attributes" in kinds:
        for tag in root.iter("*"):
            pairs = list(tag.attrib.items())
            random.shuffle(pairs)
            tag.attrib.clear()
            tag.attrib.update(pairs)
    if "comments" in kinds:
        for tag in random.sample(list(root.iter("*")), 5):
            tag.insert(0, etree.Comment("<mass value='3'/>"))
            tag.append(etree.Comment("<mass value='3'/>"))
    found = dict(files) | {tree: etree.tostring(root)}
    names = {}
    if "names" in kinds:
        fresh = [f"n{random.randrange(10**9)}" for _ in old]
        names = dict(zip(sorted(old), fresh, strict=True))
        pattern = re.compile("|".join(rf"(?<![\w.-]){re.escape(n)}(?![\w-])" for n in names))
        for file, content in found.items():
            new = pattern.sub(lambda match: names[match[0]], content.decode())
            found[file] = new.encode()
    if "lines" in kinds:
        found[tree] = found[tree].replace(b"><", b">\r\n\t<")
    return found, {new: name for name, new in names.items()}


def _shuffle(tag: etree._Element, random: Random) -> None:
    """Children in another order; joints of a body are a chain, whose order counts."""
    children = list(tag)
    chain = [child for child in children if tag.tag == "body" and child.tag in ("joint",)]
    random.shuffle(children)
    order = iter(chain)
    tag[:] = [next(order) if child in chain else child for child in children]


STRUCTURE = ("rank", "nonzero_parameters", "standard_parameters")


def structure(record: dict, names: dict[str, str]) -> dict:
    """What must not depend on how a robot is written, its names put back."""
    return {key: record[key] for key in STRUCTURE} | {
        "condition numbers": [
            None if record[key] is None else f"{record[key]:.8g}"
            for key in ("nullspace_condition_number", "condition_number")
        ],
        "chosen": sorted(
            f"{names.get(link, link)}.{kind}"
            for link, _, kind in (p["name"].rpartition(".") for p in record["base_parameters"])
        ),
    }


MODELS = ("gravity", "full")


def base_words(draw: Draw, file: Path) -> tuple[str, ...]:
    model = MODELS[draw.number % len(MODELS)]
    return "base", str(file), "--model", model, "--samples", "60", "--json"


@cache
def unchanged(robot: str, model_of: int, folder: Path) -> dict:
    """Structure of a robot as it is written."""
    place = folder / f"sound{robot}"
    place.mkdir(exist_ok=True)
    for name, content in robots()[robot].items():
        (place / name).write_bytes(content)
    draw = Draw(model_of, robot, robots()[robot], True, {})
    outcome = run(Call(0, base_words(draw, place / next(iter(draw.files)))), folder)
    return {"refused": True} if outcome.code else structure(json.loads(outcome.out), {})


def wrong_with(draw: Draw, folder: Path) -> Iterator[str]:
    """What is wrong with the answers to a draw."""
    place = folder / "drawn"
    place.mkdir(exist_ok=True)
    for old in place.iterdir():
        old.unlink()
    for name, content in draw.files.items():
        (place / name).write_bytes(content)
    file = place / next(iter(draw.files))
    words = base_words(draw, file)
    for call in (Call(draw.number, words), Call(draw.number, ("check", str(file)))):
        outcome = run(call, folder)
        found = list(faults(call, outcome))
        if any("/" in sentence for sentence in outcome.errors):  # a file that this one names
            found = [fault for fault in found if not fault.startswith("names no cause")]
        yield from (f"{call.words[0]}: {fault}" for fault in found)
        if draw.neutral and call.words == words and not found:
            before, now = (
                unchanged(draw.robot, draw.number % len(MODELS), folder),
                {"refused": True},
            )
            if not outcome.code:
                now = structure(json.loads(outcome.out), draw.names)
            for key in {**before, **now}:
                if now.get(key) != before.get(key):
                    change = f"was {before.get(key)!r:.400} and is {now.get(key)!r:.400}"
                    yield f"{key} of {draw.robot} {change}"


def fuzz_robots(folder: Path, numbers: range, seed: int = 0, report=None) -> dict[int, list[str]]:
    """Try draws; faults by number."""
    found = {}
    for number in numbers:
        with suppress(ValueError):  # no file to write to, as where pytest captures the streams
            faulthandler.dump_traceback_later(2 * HANGING, exit=True)
        draw = Draw.of(seed, number)
        wrong = list(wrong_with(draw, folder))
        faulthandler.cancel_dump_traceback_later()
        if wrong:
            found[number] = wrong
        if report is not None:
            report(draw, wrong)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", type=int, help="Number of a single draw.")
    given = parser.parse_args()
    numbers = range(given.first, given.draws)
    if given.only is not None:
        numbers = range(given.only, given.only + 1)

    def report(draw: Draw, wrong: list[str]) -> None:
        for fault in wrong:
            sys.stdout.write(f"{draw.number} ({draw.robot}): {fault}\n")
        sys.stdout.flush()

    with tempfile.TemporaryDirectory() as folder:
        found = fuzz_robots(Path(folder), numbers, given.seed, report)
    sys.stdout.write(f"{len(found)} of {len(numbers)} draws broke a promise\n")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
