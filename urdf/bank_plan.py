"""The files of a robot whose bodies are solid balls on massless sticks.

A ``Plan`` collects links, joints, closures and motors; ``Plan.files`` writes them out. Such bodies
can be made, so that their inertias are those of bodies, full and off the axes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from math import atan2, hypot, pi
from typing import Any

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from generate import (
    ORIGIN,
    RobotFiles,
    Vector,
    add_cylinder,
    add_joint,
    add_link,
    add_sphere,
    add_travel,
)

Array = NDArray[np.float64]
Ball = tuple[float, Vector]  # mass in kg, centre in m
ALUMINIUM = 2700.0  # kg/m³
LEG = re.compile(r"leg\d+[a-z]?_")


def kind(name: str) -> str:
    """Name of a link or joint without that of its leg; one kind shares one row of the table."""
    return LEG.sub("", name)


def radius(mass: float) -> float:
    """Radius in m of a ball of aluminium."""
    return float((3 * mass / (4 * pi * ALUMINIUM)) ** (1 / 3))


def inertial(balls: list[Ball]) -> tuple[float, list[float], list[float]]:
    """Mass, centre of mass, and Ixx Ixy Ixz Iyy Iyz Izz about it, of balls put together."""
    masses, points = np.array([m for m, _ in balls]), np.array([point for _, point in balls])
    centre = masses @ points / masses.sum()
    tensor = np.sum([_about(m, point - centre) for m, point in zip(masses, points, strict=True)], 0)
    return float(masses.sum()), centre.tolist(), tensor[np.triu_indices(3)].tolist()


def _about(mass: float, offset: Array) -> Array:
    """Inertia of a ball about a point at an offset from its centre (Steiner)."""
    own = 0.4 * mass * radius(mass) ** 2
    return (own + mass * offset @ offset) * np.eye(3) - mass * np.outer(offset, offset)


@dataclass
class Plan:
    """A robot that is being put together.

    Attributes
    ----------
    name : str
    table : dict
        ``bodies`` (kind of link to balls), ``limits`` and ``effort`` (kinds of joints) and what
        the mechanism itself asks for, as in ``bank.yaml``.
    """

    name: str
    table: dict[str, Any]
    closures: list[tuple[str, str]] = field(default_factory=list)
    motors: list[str] = field(default_factory=list)
    reference: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.root = etree.Element("robot", name=self.name)
        self.root.append(etree.Comment(" Written by urdf/generate_bank.py from urdf/bank.yaml "))
        self.alike: dict[str, list[str]] = {}
        self.link("base")

    def link(self, name: str) -> None:
        """Append a link, with the body of its kind if there is one."""
        balls = self.table["bodies"].get(kind(name))
        if balls is None:
            add_link(self.root, name)
            return
        element = add_link(self.root, name, {"inertials": {name: inertial(balls)}})
        for mass, point in balls:
            add_sphere(element, "mass", radius(mass), point)
            _stick(element, point)
        if kind(name) != name:
            self.alike.setdefault(kind(name), []).append(name)

    def move(
        self,
        joint: str,
        links: tuple[str, str],
        axis: Vector,
        xyz: Vector = ORIGIN,
        rpy: Vector = ORIGIN,
        motion: str = "revolute",
    ) -> None:
        """Append a joint and the link that it moves."""
        self.link(links[1])
        limits = self.table["limits"].get(joint) or self.table["limits"][kind(joint)]
        effort = self.table["effort"] if joint in self.motors else 0.0
        add_travel(add_joint(self.root, joint, motion, links, xyz, rpy), axis, limits, effort)

    def mark(self, frame: str, link: str, xyz: Vector) -> None:
        """Append a frame at a point of a link."""
        add_link(self.root, frame)
        add_joint(self.root, f"{frame}_mount", "fixed", (link, frame), xyz, ORIGIN)

    def files(self) -> RobotFiles:
        """URDF and YAML."""
        etree.indent(self.root, "  ")
        header = '<?xml version="1.0" encoding="utf-8"?>\n'
        return RobotFiles(header + etree.tostring(self.root, encoding="unicode") + "\n", self._yaml)

    @property
    def _yaml(self) -> str:
        pairs = ", ".join(f"[{first}, {second}]" for first, second in self.closures)
        reference = "\n".join(f"  {joint}: {q!r}" for joint, q in self.reference.items())
        groups = "".join(f"  {name}: [{', '.join(ls)}]\n" for name, ls in self.alike.items())
        return f"""\
# Written by urdf/generate_bank.py from urdf/bank.yaml
urdf: {self.name}.urdf
# Pairs of frames whose origins coincide, and the actuated joints.
closed_loop: [{pairs}]
type: [{", ".join(["'3d'"] * len(self.closures))}]
name_mot: [{", ".join(self.motors)}]
# A closed configuration (m, rad); it chooses the assembly branch.
reference:
{reference}
""" + (f"# Links made alike.\nidentical:\n{groups}" if groups else "")


def _stick(link: etree._Element, point: Vector) -> None:
    """The stick from a link's origin to a ball, massless."""
    x, y, z = point
    half_way, along = (x / 2, y / 2, z / 2), (0.0, atan2(hypot(x, y), z), atan2(y, x))
    add_cylinder(link, "stem", hypot(x, y, z), 0.006, half_way, along)
