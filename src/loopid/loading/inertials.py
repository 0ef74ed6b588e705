"""Inertials of links as robot files write them, and what it takes to edit such a file."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from loopid.arguments import BoolArray, FloatArray
from loopid.inertia import central_moments, centre, inertia_tensor
from loopid.records import record

# Numbers whose change moves no more than this part of the second moments about the link's origin
# stay as they are written.
KEPT = 1e-14


@record
class Inertial:
    """A mass, its centre, and a tensor about the centre along axes that are turned from the link's.

    Attributes
    ----------
    mass : float
        In kg.
    centre : FloatArray
        (3,) in m, seen from the link.
    axes : FloatArray
        (3, 3), as columns.
    tensor : FloatArray
        (3, 3) in kg m².
    """

    mass: float
    centre: FloatArray
    axes: FloatArray
    tensor: FloatArray

    @classmethod
    def of(cls, P: FloatArray, axes: FloatArray | None = None) -> Inertial:
        """What says a pseudo-inertia (4, 4), along the link's or other axes (3, 3)."""
        turn = np.eye(3) if axes is None else axes
        tensor = turn.T @ inertia_tensor(central_moments(P)) @ turn
        return cls(float(P[3, 3]), centre(P), turn, tensor)

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Pseudo-inertia (4, 4), seen from the link."""
        inertia = pin.Inertia(self.mass, self.centre, self.axes @ self.tensor @ self.axes.T)
        return np.array(pin.PseudoInertia.FromInertia(inertia).toMatrix())

    def changes_to(self, new: Inertial) -> tuple[bool, bool, BoolArray]:
        """Whether mass, centre, and which entries of the tensor (3, 3), change beyond round-off."""
        spread = float(np.trace(new.P[:3, :3]))
        mass = abs(new.mass - self.mass) > KEPT * abs(self.mass)
        moved = np.abs(new.centre - self.centre).max() > KEPT * np.sqrt(spread / new.mass)
        tensor = np.abs(new.tensor - self.tensor) > KEPT * spread
        return bool(mass), bool(moved), np.asarray(tensor)


class InertialFile(ABC):
    """A robot file whose inertials can be replaced.

    Attributes
    ----------
    path : Path
    inertials : mapping
        Of all links that have one, by the link's name.
    """

    path: Path
    inertials: Mapping[str, Inertial]

    @abstractmethod
    def replaced(self, new: Mapping[str, FloatArray]) -> bytes:
        """Content of the file with new pseudo-inertias (4, 4), each seen from its link.

        Raises
        ------
        RobotFileError
            When the file cannot say it.
        """


class XmlFile:
    """An XML that is edited: comments, order and encoding stay, as lxml keeps them."""

    def __init__(self, path: Path) -> None:
        parser = etree.XMLParser(resolve_entities=False)
        self._tree = etree.parse(path, parser)
        self.root = self._tree.getroot()

    def content(self) -> bytes:
        """The file as it is now."""
        encoding = self._tree.docinfo.encoding or "utf-8"
        head = f'<?xml version="{self._tree.docinfo.xml_version}" encoding="{encoding}"?>\n'
        body = etree.tostring(self._tree, encoding=encoding, xml_declaration=False)
        return head.encode(encoding) + body + b"\n"


def add_first(parent: etree._Element, element: etree._Element) -> None:
    """Add an element as the first one inside another, indented as its children are."""
    element.tail, parent.text = parent.text, parent.text
    parent.insert(0, element)


def written(*numbers: float) -> str:
    """Numbers as the shortest text that is read as the very same numbers."""
    return " ".join(repr(float(number)) for number in numbers)
