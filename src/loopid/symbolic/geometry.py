"""Geometry of the robot: where its joints sit on the base and on the platform."""

from __future__ import annotations

from dataclasses import astuple, dataclass, fields
from math import radians
from os import PathLike
from pathlib import Path
from typing import Any

import sympy as sp
from ruamel.yaml import YAML

from loopid.errors import MissingFileError, OptionError, RobotFileError


@dataclass(frozen=True)
class Geometry:
    """Geometric parameters of one configuration (the paper's Table I).

    Angles are in radians; :meth:`from_degrees` takes them as the paper prints them.

    Parameters
    ----------
    R1, R2, R3 : float
        Distances of the base points A_i from the fixed origin, m.
    ds : float
        Position of limb 4's revolute joint along X_F, m.
    beta_FD, beta_FI : float
        Angles of A_2 and A_3 from X_F, rad.
    Rm1, Rm2, Rm3 : float
        Distances of the platform points B_i from the platform origin, m.
    beta_MD, beta_MI : float
        Angles of B_2 and B_3 from the platform's x axis, rad.
    """

    R1: float
    R2: float
    R3: float
    ds: float
    beta_FD: float
    beta_FI: float
    Rm1: float
    Rm2: float
    Rm3: float
    beta_MD: float
    beta_MI: float

    @classmethod
    def from_degrees(cls, **values: float) -> Geometry:
        """Build from lengths in m and angles in degrees, named as the fields."""
        return cls(**{name: _in_radians(name, value) for name, value in values.items()})

    @staticmethod
    def symbols() -> tuple[sp.Symbol, ...]:
        """Symbols of the fields, in field order, as the paper writes them; shape (11,)."""
        names = "R_1 R_2 R_3 d_s beta_FD beta_FI R_m1 R_m2 R_m3 beta_MD beta_MI"
        return tuple(sp.symbols(names))

    def values(self) -> tuple[float, ...]:
        """Values of the fields, in the order of :meth:`symbols`; m and rad, shape (11,)."""
        return astuple(self)

    def substitutions(self) -> dict[sp.Symbol, float]:
        """Value of every symbol, for ``subs``; m and rad."""
        return dict(zip(self.symbols(), self.values(), strict=True))


def base_points() -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix, sp.ImmutableMatrix]:
    """Centres A_i of the universal joints of limbs 1 to 3.

    Returns
    -------
    tuple of Matrix
        Three (3, 1) positions in the fixed frame, m, in the symbols of the geometry.
    """
    R_1, R_2, R_3, _, beta_FD, beta_FI, *_ = Geometry.symbols()
    return _points(R_1, R_2, R_3, beta_FD, beta_FI)


def limb_4_point() -> sp.ImmutableMatrix:
    """Centre of limb 4's revolute joint, about -Y_F; (3, 1) in the fixed frame, m."""
    return sp.ImmutableMatrix([Geometry.symbols()[3], 0, 0])


def platform_points() -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix, sp.ImmutableMatrix]:
    """Centres B_i of the spherical joints of limbs 1 to 3.

    Returns
    -------
    tuple of Matrix
        Three (3, 1) positions in the platform frame, m, in the symbols of the geometry.
    """
    *_, R_m1, R_m2, R_m3, beta_MD, beta_MI = Geometry.symbols()
    return _points(R_m1, R_m2, R_m3, beta_MD, beta_MI)


def read_geometry(path: str | PathLike[str], robot: str, configuration: int) -> Geometry:
    """Read one configuration from the geometry table ``geometry.yaml``.

    Parameters
    ----------
    path : path-like
        The table: robot name to ``configurations``, each with lengths in m, angles in degrees.
    robot : str
        Name of the robot in the table.
    configuration : int
        Number of its configuration.

    Raises
    ------
    MissingFileError
        If there is no such file.
    OptionError
        If the robot or the configuration is not in the table.
    RobotFileError
        If the configuration lacks an entry or has an unknown one.
    """
    if not Path(path).is_file():
        raise MissingFileError(f"no geometry table at {path}")
    table = YAML(typ="safe").load(Path(path))
    configurations = _entry(table, robot, "robot")["configurations"]
    entries = _entry(configurations, configuration, f"configuration of {robot}")
    names = {field.name for field in fields(Geometry)}
    if entries.keys() != names:
        missing, unknown = sorted(names - entries.keys()), sorted(entries.keys() - names)
        raise RobotFileError(
            f"{path}, {robot}, configuration {configuration}: missing {missing}, unknown {unknown}"
        )
    return Geometry.from_degrees(**entries)


def _points(
    r1: sp.Symbol, r2: sp.Symbol, r3: sp.Symbol, right: sp.Symbol, left: sp.Symbol
) -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix, sp.ImmutableMatrix]:
    return (
        sp.ImmutableMatrix([-r1, 0, 0]),
        sp.ImmutableMatrix([r2 * sp.cos(right), r2 * sp.sin(right), 0]),
        sp.ImmutableMatrix([r3 * sp.cos(left), -r3 * sp.sin(left), 0]),
    )


def _in_radians(name: str, value: float) -> float:
    return radians(value) if name.startswith("beta") else float(value)


def _entry(table: dict[Any, Any], key: object, what: str) -> Any:
    if key not in table:
        raise OptionError.unknown(what, key, map(str, table))
    return table[key]
