"""Regions of centres of mass from the collision geometry of a URDF."""

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from closure_robots import joint, urdf
from loopid import load_mechanism
from loopid.errors import ModelWarning, OptionError, RobotFileError
from loopid.loading import collision_regions

INERTIAL = """<inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>"""
BOX = '<box size="0.2 0.4 0.6"/>'


def collision(shape, xyz="0 0 0", rpy="0 0 0"):
    return f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{shape}</geometry></collision>'


def link(name, *collisions):
    return f'<link name="{name}">{INERTIAL}{"".join(collisions)}</link>\n'


@pytest.fixture
def regions_of(tmp_path):
    """Regions of a robot with one arm, and with more links where they are given."""

    def regions(*collisions, more=""):
        path = tmp_path / "robot.urdf"
        path.write_text(urdf(link("arm", *collisions), joint("hinge", "ground", "arm"), more))
        return collision_regions(load_mechanism(path))

    return regions


def inside(region, points):
    return np.array([point in region for point in points])


def points_around(seed=0, count=400):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3))


def test_a_turned_box_is_exact(regions_of):
    xyz, rpy = np.array([0.1, -0.2, 0.3]), np.array([0.3, -0.7, 1.1])
    text = {"xyz": " ".join(map(str, xyz)), "rpy": " ".join(map(str, rpy))}
    region = regions_of(collision(BOX, **text))["arm"]
    own = (points_around() - xyz) @ pin.rpy.rpyToMatrix(*rpy)
    expected = (np.abs(own) <= np.array([0.1, 0.2, 0.3])).all(axis=1)
    assert 3 < expected.sum() < 390
    np.testing.assert_array_equal(inside(region, points_around()), expected)


@pytest.mark.parametrize(
    ("shape", "holds", "slack"),
    [
        (
            '<cylinder radius="0.5" length="1.2"/>',
            lambda p, s: (np.hypot(p[:, 0], p[:, 1]) <= 0.5 * s) & (np.abs(p[:, 2]) <= 0.6 * s),
            1.0,
        ),
        ('<sphere radius="0.7"/>', lambda p, s: np.linalg.norm(p, axis=1) <= 0.7 * s, 1.1),
        (
            '<capsule radius="0.4" length="0.6"/>',
            lambda p, s: (
                np.linalg.norm(p - np.clip(p, [0, 0, -0.3], [0, 0, 0.3]), axis=1) <= 0.4 * s
            ),
            1.25,
        ),
    ],
)
def test_round_shapes_are_met_within_some_percent(regions_of, shape, holds, slack):
    region, points = regions_of(collision(shape))["arm"], points_around(count=2000)
    found = inside(region, points)
    assert found[holds(points, 0.85)].all()
    assert not found[~holds(points, slack)].any()


def test_links_fixed_to_a_body_belong_to_it(regions_of):
    more = link("tool", collision(BOX)) + joint(
        "mount", "arm", "tool", (1, 0, 0), kind="fixed", limits=(0, 0)
    )
    region = regions_of(collision(BOX), more=more)["arm"]
    np.testing.assert_allclose(region.centre, [0.5, 0, 0], atol=1e-12)
    np.testing.assert_allclose(region.half_widths, [0.6, 0.2, 0.3])
    assert np.array([0.5, 0, 0]) in region


def test_meshes_are_read_with_their_scale(regions_of, tmp_path):
    trimesh.creation.box((2.0, 4.0, 6.0)).export(tmp_path / "part.stl")
    region = regions_of(collision('<mesh filename="part.stl" scale="0.1 0.1 0.1"/>'))["arm"]
    np.testing.assert_allclose(region.half_widths, [0.1, 0.2, 0.3], rtol=1e-6)
    package = tmp_path / "meshes"
    package.mkdir()
    (tmp_path / "part.stl").rename(package / "part.stl")
    shape = f'<mesh filename="package://{tmp_path.name}/meshes/part.stl"/>'
    np.testing.assert_allclose(regions_of(collision(shape))["arm"].half_widths, [1, 2, 3])


@pytest.mark.parametrize("name", ["gone.stl", "package://robot/gone.stl", "broken.stl"])
def test_bodies_with_unreadable_meshes_are_left_out_with_a_warning(regions_of, tmp_path, name):
    (tmp_path / "broken.stl").write_text("no mesh")
    more = link("hand", collision(BOX)) + joint("wrist", "arm", "hand")
    with pytest.warns(ModelWarning, match=r"no region for link arm: .*mesh"):
        found = regions_of(collision(BOX), collision(f'<mesh filename="{name}"/>'), more=more)
    assert list(found) == ["hand"]


def test_bodies_without_geometry_have_no_region(regions_of):
    assert regions_of() == {}


@pytest.mark.parametrize(
    ("shape", "match"),
    [
        ("<cone/>", "none of the geometries box, cylinder"),
        ('<box size="1 0 1"/>', "size must be positive: 1 0 1"),
        ('<box size="1 1"/>', "size must be three finite numbers"),
        ('<sphere radius="big"/>', "radius must be a finite number"),
        ('<sphere radius="-1"/>', "radius must be positive"),
        ("<mesh/>", "has no filename"),
    ],
)
def test_broken_geometry_is_refused(regions_of, shape, match):
    with pytest.raises(RobotFileError, match=rf"robot\.urdf: .*{match}"):
        regions_of(collision(shape))


def test_tied_links_have_what_all_of_them_have(tmp_path):
    texts = [link("a", collision(BOX)), link("b", collision(BOX, xyz="0.1 0 0"))]
    joints = [joint("first", "ground", "a"), joint("second", "a", "b")]
    (tmp_path / "robot.urdf").write_text(urdf(*texts, *joints))
    (tmp_path / "robot.yaml").write_text("urdf: robot.urdf\nidentical: {both: [a, b]}\n")
    (name, region), *others = collision_regions(
        load_mechanism(tmp_path / "robot.yaml", tied=True)
    ).items()
    assert (name, others) == ("both", [])
    np.testing.assert_allclose(region.centre, [0.05, 0, 0], atol=1e-12)
    np.testing.assert_allclose(region.half_widths, [0.05, 0.2, 0.3])


def test_real_robots_keep_their_centres_of_mass(robot_data):
    robot = load_mechanism(robot_data / "panda_description" / "urdf" / "panda.urdf")
    regions = collision_regions(robot)
    values = robot.standard_parameters("gravity").reshape(-1, 4)
    for body, (mass, *first) in zip(robot.links, values, strict=True):
        if "finger" not in body:
            assert np.array(first) / mass in regions[body]


def test_only_urdfs_have_it(tmp_path):
    (tmp_path / "robot.xml").write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size="0.1"/></body></worldbody>'
        '<actuator><motor joint="j"/></actuator></mujoco>'
    )
    with pytest.raises(OptionError, match="from a URDF only"):
        collision_regions(load_mechanism(tmp_path / "robot.xml"))
