"""Reading the geometry table, and the points that it places."""

import math
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import numpy as np
import pytest

from loopid.errors import MissingFileError, OptionError, RobotFileError
from loopid.paper.symbolic import Geometry, base_points, platform_points, read_geometry

TABLE = Path(__file__).parents[2] / "urdf" / "geometry.yaml"


def test_angles_are_read_in_degrees_and_kept_in_radians():
    geometry = read_geometry(TABLE, "3ups_rpu", 1)
    assert geometry.beta_MI == math.radians(90)
    assert len(geometry.symbols()) == len(geometry.values()) == len(fields(Geometry))
    with pytest.raises(FrozenInstanceError):
        geometry.R1 = 1.0


def test_points_lie_on_their_circles():
    geometry = read_geometry(TABLE, "5p", 1)
    for points, radii in (
        (base_points(), (geometry.R1, geometry.R2, geometry.R3)),
        (platform_points(), (geometry.Rm1, geometry.Rm2, geometry.Rm3)),
    ):
        values = np.array([point.subs(geometry.substitutions()) for point in points], dtype=float)
        np.testing.assert_allclose(np.linalg.norm(values, axis=(1, 2)), radii)
        # Limb 1 along -x, limb 2 on the +y side, limb 3 on the -y side.
        assert values[0, 0] < 0 < values[1, 1]
        assert values[2, 1] < 0


@pytest.mark.parametrize(
    ("robot", "configuration", "valid"),
    [("6ups", 1, "3ups_rpu, 5p"), ("3ups_rpu", 3, "1, 2, 4, 8")],
)
def test_unknown_choices_list_the_valid_ones(robot, configuration, valid):
    with pytest.raises(OptionError, match=valid):
        read_geometry(TABLE, robot, configuration)


def test_missing_and_unknown_entries_are_named(tmp_path):
    path = tmp_path / "table.yaml"
    path.write_text("robot: {configurations: {1: {R1: 0.4, R9: 0.4}}}")
    with pytest.raises(RobotFileError, match=r"missing \['R2'.*unknown \['R9'\]"):
        read_geometry(path, "robot", 1)
    with pytest.raises(MissingFileError, match="absent"):
        read_geometry(tmp_path / "absent.yaml", "robot", 1)
