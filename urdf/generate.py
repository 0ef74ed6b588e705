"""Write the robot files of the reconfigurable knee-rehabilitation robots.

The 3UPS+RPU and its successor, the 5P, are one machine whose base and platform points can be
moved. This script turns a row of ``geometry.yaml`` into the URDF of the open tree and the YAML
with the loop closures:

    python urdf/generate.py                                    # the committed files
    python urdf/generate.py --robot 3ups_rpu --configuration 8 --out DIR

The tree is limb 4 (R, P) carrying the platform through two revolutes, and limbs 1 to 3 (U, P),
whose stem tips the loop closures pin to the platform points. Link frames are the paper's.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from math import atan2, cos, hypot, pi, radians, sin
from pathlib import Path
from typing import Any

from lxml import etree
from ruamel.yaml import YAML

HERE = Path(__file__).parent
TABLE = HERE / "geometry.yaml"
COMMITTED = (("3ups_rpu", 1), ("5p", 1))
LEGS = (1, 2, 3)

Vector = tuple[float, float, float]
ORIGIN: Vector = (0.0, 0.0, 0.0)
QUARTER_TURN_X: Vector = (pi / 2, 0.0, 0.0)
# Link 42 has axes x = -x41, y = -z41, z = -y41; this rotation is its own inverse.
STEM_4_AXES: Vector = (-pi / 2, 0.0, pi)


@dataclass(frozen=True)
class RobotFiles:
    """Texts of one robot: the URDF of the open tree and the YAML that closes its loops."""

    urdf: str
    yaml: str

    def write(self, directory: Path, stem: str) -> None:
        """Write ``<stem>.urdf`` and ``<stem>.yaml`` into a directory."""
        directory.mkdir(parents=True, exist_ok=True)
        (directory / f"{stem}.urdf").write_text(self.urdf)
        (directory / f"{stem}.yaml").write_text(self.yaml)


def read_table(path: Path = TABLE) -> dict[str, Any]:
    """Read the geometry table: robot name to configurations, strokes and inertials."""
    return dict(YAML(typ="safe").load(path))


def base_points(geometry: dict[str, float]) -> dict[int, Vector]:
    """Centres A_i of the universal joints of limbs 1 to 3, fixed frame, in m."""
    return _points(geometry, "R", "beta_F")


def platform_points(geometry: dict[str, float]) -> dict[int, Vector]:
    """Centres B_i of the spherical joints of limbs 1 to 3, platform frame, in m."""
    return _points(geometry, "Rm", "beta_M")


def _points(geometry: dict[str, float], radius: str, angle: str) -> dict[int, Vector]:
    right, left = radians(geometry[angle + "D"]), radians(geometry[angle + "I"])
    r1, r2, r3 = (geometry[f"{radius}{leg}"] for leg in LEGS)
    return {
        1: (-r1, 0.0, 0.0),
        2: (r2 * cos(right), r2 * sin(right), 0.0),
        3: (r3 * cos(left), -r3 * sin(left), 0.0),
    }


def reference_configuration(geometry: dict[str, float], home: list[float]) -> dict[str, float]:
    """All joint coordinates (m, rad) at a platform pose, by the closed-form inverse kinematics."""
    x_m, z_m, theta, psi = home
    base, platform = base_points(geometry), platform_points(geometry)
    joints: dict[str, float] = {}
    for leg in LEGS:
        bx, by, _ = platform[leg]
        along, across = bx * cos(psi) - by * sin(psi), bx * sin(psi) + by * cos(psi)
        tip = (x_m + along * cos(theta), across, z_m - along * sin(theta))
        dx, dy, dz = (tip[k] - base[leg][k] for k in range(3))
        joints[f"leg{leg}_universal_1"] = atan2(dz, dx)
        joints[f"leg{leg}_universal_2"] = atan2(hypot(dx, dz), -dy)
        joints[f"leg{leg}_stroke"] = hypot(dx, dy, dz)
    tilt = atan2(geometry["ds"] - x_m, z_m)
    joints["leg4_revolute"] = tilt
    joints["leg4_stroke"] = hypot(x_m - geometry["ds"], z_m)
    return joints | {"platform_pitch": theta + tilt, "platform_yaw": psi}


def robot_files(name: str, geometry: dict[str, float], robot: dict[str, Any]) -> RobotFiles:
    """Make the two files of a robot.

    Parameters
    ----------
    name : str
        Name of the robot, and of the URDF the YAML points to.
    geometry : dict
        R1 R2 R3 ds Rm1 Rm2 Rm3 (m) and beta_FD beta_FI beta_MD beta_MI (degrees).
    robot : dict
        ``home``, ``strokes``, ``drive_force`` and ``inertials``, as in ``geometry.yaml``.
    """
    return RobotFiles(_urdf(name, geometry, robot), _yaml(name, geometry, robot))


def _urdf(name: str, geometry: dict[str, float], robot: dict[str, Any]) -> str:
    root = etree.Element("robot", name=name)
    root.append(etree.Comment(" Written by urdf/generate.py from urdf/geometry.yaml "))
    _base(root, geometry)
    for leg, point in base_points(geometry).items():
        _leg(root, leg, point, robot)
    _limb_4(root, geometry, robot)
    _platform(root, geometry, robot)
    etree.indent(root, "  ")
    header = '<?xml version="1.0" encoding="utf-8"?>\n'
    return header + etree.tostring(root, encoding="unicode") + "\n"


def _base(root: etree._Element, geometry: dict[str, float]) -> None:
    link = add_link(root, "base")
    add_cylinder(link, "base", 0.02, max(geometry[f"R{leg}"] for leg in LEGS), (0, 0, -0.05))
    for point in (*base_points(geometry).values(), (geometry["ds"], 0.0, 0.0)):
        add_sphere(link, "joint", 0.025, point)


def _leg(root: etree._Element, leg: int, base_point: Vector, robot: dict[str, Any]) -> None:
    """Limbs 1 to 3: universal joint with a massless cross, prismatic joint along z."""
    cross, cylinder, stem = (f"leg{leg}_{part}" for part in ("cross", "cylinder", "stem"))
    housing, rod = _visual_lengths(robot, leg)
    add_link(root, cross)
    link = add_link(root, cylinder, robot)
    add_cylinder(link, "cylinder", housing, 0.03, (0, 0, housing / 2))
    link = add_link(root, stem, robot)
    add_cylinder(link, "stem", rod, 0.012, (0, 0, -rod / 2))
    first, second = f"leg{leg}_universal_1", f"leg{leg}_universal_2"
    _turn(root, first, ("base", cross), (0, -1, 0), (0, pi), xyz=base_point)
    _turn(root, second, (cross, cylinder), (0, 1, 0), (0, pi), rpy=QUARTER_TURN_X)
    _stroke(root, leg, (0, 0, 1), robot)


def _limb_4(root: etree._Element, geometry: dict[str, float], robot: dict[str, Any]) -> None:
    housing, rod = _visual_lengths(robot, 4)
    link = add_link(root, "leg4_cylinder", robot)
    add_cylinder(link, "cylinder", housing, 0.03, (0, 0, housing / 2))
    link = add_link(root, "leg4_stem", robot)
    add_cylinder(link, "stem", rod, 0.015, (0, rod / 2, 0), QUARTER_TURN_X)
    pair, foot = ("base", "leg4_cylinder"), (geometry["ds"], 0.0, 0.0)
    _turn(root, "leg4_revolute", pair, (0, -1, 0), (-pi / 2, pi / 2), xyz=foot)
    _stroke(root, 4, (0, -1, 0), robot, rpy=STEM_4_AXES)


def _platform(root: etree._Element, geometry: dict[str, float], robot: dict[str, Any]) -> None:
    """The platform on the universal joint of limb 4, with the points B_i as frames."""
    add_link(root, "platform_cross")
    link = add_link(root, "platform", robot)
    points = platform_points(geometry)
    for x, y, _ in points.values():
        half_way, along = (x / 2, y / 2, 0.0), (0.0, pi / 2, atan2(y, x))
        add_cylinder(link, "platform", hypot(x, y), 0.015, half_way, along)
        add_sphere(link, "joint", 0.025, (x, y, 0))
    limits, pair = (-pi / 2, pi / 2), ("leg4_stem", "platform_cross")
    _turn(root, "platform_pitch", pair, (0, 1, 0), limits, rpy=STEM_4_AXES)
    _turn(root, "platform_yaw", ("platform_cross", "platform"), (0, 0, 1), limits)
    for leg, point in points.items():
        frame = f"platform_B{leg}"
        add_link(root, frame)
        add_joint(root, f"{frame}_mount", "fixed", ("platform", frame), point, ORIGIN)


def _turn(
    root: etree._Element,
    name: str,
    links: tuple[str, str],
    axis: Vector,
    limits: tuple[float, float],
    xyz: Vector = ORIGIN,
    rpy: Vector = ORIGIN,
) -> None:
    """A revolute joint, all of which are passive."""
    joint = add_joint(root, name, "revolute", links, xyz, rpy)
    add_travel(joint, axis, limits, effort=0.0)


def _stroke(
    root: etree._Element, leg: int, axis: Vector, robot: dict[str, Any], rpy: Vector = ORIGIN
) -> None:
    """The actuated prismatic joint of a limb; its coordinate is the length of the limb."""
    limb = f"leg{leg}"
    links = (f"{limb}_cylinder", f"{limb}_stem")
    joint = add_joint(root, f"{limb}_stroke", "prismatic", links, ORIGIN, rpy)
    add_travel(joint, axis, robot["strokes"][limb], robot["drive_force"][limb])


def add_link(
    root: etree._Element, name: str, robot: dict[str, Any] | None = None
) -> etree._Element:
    """Append a link; with a robot given, the link's CAD inertial from the table."""
    link = etree.SubElement(root, "link", name=name)
    if robot is not None:
        mass, centre, inertia = robot["inertials"][name]
        inertial = etree.SubElement(link, "inertial")
        etree.SubElement(inertial, "origin", xyz=_text(centre), rpy="0 0 0")
        etree.SubElement(inertial, "mass", value=_text([mass]))
        names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        etree.SubElement(
            inertial,
            "inertia",
            {key: _text([value]) for key, value in zip(names, inertia, strict=True)},
        )
    return link


def add_joint(
    root: etree._Element, name: str, kind: str, links: tuple[str, str], xyz: Vector, rpy: Vector
) -> etree._Element:
    """Append a joint between two links, parent and child, at a place in the parent."""
    joint = etree.SubElement(root, "joint", name=name, type=kind)
    etree.SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(rpy))
    etree.SubElement(joint, "parent", link=links[0])
    etree.SubElement(joint, "child", link=links[1])
    return joint


def add_travel(
    joint: etree._Element, axis: Vector, limits: tuple[float, float], effort: float
) -> None:
    """Give a joint its axis, limits in m or rad, and largest force in N or N m."""
    etree.SubElement(joint, "axis", xyz=_text(axis))
    lower, upper = (_text([value]) for value in limits)
    # URDF demands a velocity limit; none is published for this machine.
    etree.SubElement(joint, "limit", lower=lower, upper=upper, effort=_text([effort]), velocity="1")


def _visual_lengths(robot: dict[str, Any], leg: int) -> tuple[float, float]:
    """Lengths in m of a limb's cylinder and stem that overlap over the whole stroke."""
    shortest, longest = robot["strokes"][f"leg{leg}"]
    return 0.7 * shortest, longest - 0.6 * shortest


COLOURS = {
    "base": "0.35 0.38 0.42 1",
    "cylinder": "0.20 0.45 0.70 1",
    "stem": "0.80 0.82 0.84 1",
    "platform": "0.90 0.55 0.15 1",
    "joint": "0.15 0.15 0.15 1",
    "mass": "0.55 0.70 0.85 1",
}


def add_cylinder(
    link: etree._Element,
    colour: str,
    length: float,
    radius: float,
    xyz: Vector,
    rpy: Vector = ORIGIN,
) -> None:
    """Draw a cylinder along z of its own frame; lengths in m."""
    shape = etree.Element("cylinder", length=_text([round(length, 4)]), radius=_text([radius]))
    _visual(link, colour, shape, xyz, rpy)


def add_sphere(link: etree._Element, colour: str, radius: float, xyz: Vector) -> None:
    """Draw a sphere; lengths in m."""
    _visual(link, colour, etree.Element("sphere", radius=_text([radius])), xyz, ORIGIN)


def _visual(
    link: etree._Element, colour: str, shape: etree._Element, xyz: Vector, rpy: Vector
) -> None:
    visual = etree.SubElement(link, "visual")
    etree.SubElement(
        visual, "origin", xyz=_text([round(value, 4) for value in xyz]), rpy=_text(rpy)
    )
    etree.SubElement(visual, "geometry").append(shape)
    material = etree.SubElement(visual, "material", name=colour)
    etree.SubElement(material, "color", rgba=COLOURS[colour])


def _text(values: Any) -> str:
    """Numbers as the shortest text that reads back as the same double."""
    return " ".join(repr(float(value)).removesuffix(".0") for value in values)


def _yaml(name: str, geometry: dict[str, float], robot: dict[str, Any]) -> str:
    closures = ", ".join(f"[leg{leg}_stem, platform_B{leg}]" for leg in LEGS)
    strokes = ", ".join(f"leg{leg}_stroke" for leg in (*LEGS, 4))
    joints = reference_configuration(geometry, robot["home"])
    reference = "\n".join(f"  {joint}: {value!r}" for joint, value in joints.items())
    return f"""\
# Written by urdf/generate.py from urdf/geometry.yaml
urdf: {name}.urdf
# Pairs of frames that coincide ('3d': their origins), and the actuated joints.
closed_loop: [{closures}]
type: ['3d', '3d', '3d']
name_mot: [{strokes}]
# A closed configuration (m, rad); it chooses the assembly branch.
reference:
{reference}
# Pose of the platform: translations along x and z, then rotations about its y and z axes.
platform:
  frame: platform
  coordinates: {{x_m: x, z_m: z, theta: ry, psi: rz}}
"""


def main() -> None:
    """Write the committed robots, or one configuration of one robot."""
    table = read_table()
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--robot", choices=list(table))
    parser.add_argument("--configuration", type=int, default=1)
    parser.add_argument("--out", type=Path, default=HERE)
    arguments = parser.parse_args()
    wanted = [(arguments.robot, arguments.configuration)] if arguments.robot else list(COMMITTED)
    for robot, configuration in wanted:
        geometries = table[robot]["configurations"]
        if configuration not in geometries:
            parser.error(f"{robot} has configurations {list(geometries)}, not {configuration}")
        stem = robot if configuration == 1 else f"{robot}_configuration{configuration}"
        files = robot_files(stem, geometries[configuration], table[robot])
        files.write(arguments.out, stem)


if __name__ == "__main__":
    main()
