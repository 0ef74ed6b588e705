"""The knee robots' generator: files, closed-form kinematics and the paper's link frames."""

import subprocess
import sys

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings, strategies as st
from lxml import etree

import loopid
from loopid import random_configurations
from loopid.kinematics import SamplingOptions, assemble, constraint_residual

CONFIGURATIONS = [("3ups_rpu", 1), ("3ups_rpu", 2), ("3ups_rpu", 4), ("3ups_rpu", 8), ("5p", 1)]
INERTIA = ("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
LEGS = (1, 2, 3)

metres = st.floats(0.3, 0.5)
# Base points twisted against the platform's, as a leg that points at the centre holds no yaw.
geometries = st.fixed_dictionaries(
    {f"R{leg}": metres for leg in LEGS}
    | {f"Rm{leg}": st.floats(0.15, 0.35) for leg in LEGS}
    | {f"beta_F{side}": st.floats(50, 90) for side in "DI"}
    | {f"beta_M{side}": st.floats(5, 30) for side in "DI"}
    | {"ds": st.floats(0.1, 0.2)}
)
# A wide workspace: x_m, z_m in m, theta and psi in rad.
poses = st.tuples(
    st.floats(-0.2, 0.2), st.floats(0.6, 0.8), st.floats(-0.4, 0.4), st.floats(-0.5, 0.5)
)


def generate(urdf_folder, *arguments):
    command = [sys.executable, str(urdf_folder / "generate.py"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def table(generator):
    return generator.read_table()


def test_the_committed_files_are_the_generators(urdf_folder, tmp_path):
    assert generate(urdf_folder, "--out", tmp_path).returncode == 0
    written = {file.name: file.read_text() for file in tmp_path.iterdir()}
    assert set(written) == {"3ups_rpu.urdf", "3ups_rpu.yaml", "5p.urdf", "5p.yaml"}
    for name, text in written.items():
        assert text == (urdf_folder / name).read_text(), f"{name} is not what generate.py writes"


def test_the_table_has_the_published_configurations(table):
    assert [(robot, c) for robot in table for c in table[robot]["configurations"]] == CONFIGURATIONS


@pytest.mark.parametrize(("robot", "configuration"), CONFIGURATIONS)
def test_every_configuration_closes_at_its_home(robot, configuration, table, write_robot):
    geometry = table[robot]["configurations"][configuration]
    mechanism = loopid.load(write_robot(geometry, table[robot]))
    assert np.abs(constraint_residual(mechanism, mechanism.reference)).max() < 1e-15
    q = random_configurations(mechanism, 3, options=SamplingOptions(singularity_threshold=0.001))
    assert np.abs(constraint_residual(mechanism, q)).max() < 1e-13


@settings(max_examples=4)
@given(geometry=geometries, pose=poses)
def test_closed_form_inverse_kinematics_is_assembly(generator, table, write_robot, geometry, pose):
    mechanism = loopid.load(write_robot(geometry, table["3ups_rpu"]))
    joints = generator.reference_configuration(geometry, list(pose))
    expected = [joints[name] for name in mechanism.joints]
    found = assemble(mechanism, np.array(pose), "platform")[0]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_every_body_has_a_primitive_visual(mechanism):
    links = {link.get("name"): link for link in etree.parse(urdf_of(mechanism)).iterfind("link")}
    assert not [mesh for link in links.values() for mesh in link.iter("mesh")]
    for body in mechanism.bodies:
        shapes = links[body.link].iterfind("visual/geometry/*")
        assert {shape.tag for shape in shapes} & {"box", "cylinder", "sphere"}, body.link


def urdf_of(mechanism):
    return str(mechanism.path.with_suffix(".urdf"))


def test_cad_inertials_are_the_tables(mechanism, table):
    rows = table[mechanism.name]["inertials"]
    assert set(rows) == {body.link for body in mechanism.bodies}
    for body in mechanism.bodies:
        mass, centre, about_centre = rows[body.link]
        inertia = mechanism.model.inertias[body.joint_id]
        assert inertia.mass == mass
        np.testing.assert_allclose(inertia.lever, centre, atol=1e-15)
        entries = {name: "xyz".index(name[1]) * 3 + "xyz".index(name[2]) for name in INERTIA}
        found = inertia.inertia.ravel()[list(entries.values())]
        np.testing.assert_allclose(found, about_centre, atol=1e-15, err_msg=body.link)


def test_the_tables_inertials_are_the_published_ones(shared, table):
    tables = (shared / "3ups_rpu.md").read_text().split("```")[1:4:2]
    for name, text in zip(("3ups_rpu", "5p"), tables, strict=True):
        published = dict(line.split(maxsplit=1) for line in text.strip().splitlines())
        for link, (mass, centre, inertia) in table[name]["inertials"].items():
            limb, _, part = link.removeprefix("leg").partition("_")
            body = {"cylinder": f"{limb}1", "stem": f"{limb}2"}.get(part, "m")
            # Legs that are alike share a row, i1 or i2.
            row = published.get(body) or published[f"i{body[1]}"]
            assert [float(number) for number in row.split()] == [mass, *centre, *inertia], link


def placements(mechanism, q):
    """Placement of every link's frame at a configuration."""
    data = mechanism.model.createData()
    pin.framesForwardKinematics(mechanism.model, data, q)
    names = [frame.name for frame in mechanism.model.frames]
    return dict(zip(names, data.oMf, strict=True))


@pytest.fixture(scope="module")
def closed(mechanism, table):
    """The robot's geometry, with joint values and link frames at random closed poses."""
    geometry = table[mechanism.name]["configurations"][1]
    configurations = random_configurations(mechanism, 5, seed=9)
    return geometry, [
        (dict(zip(mechanism.joints, q, strict=True)), placements(mechanism, q))
        for q in configurations
    ]


def assert_axes(placement, x, y, z, origin):
    np.testing.assert_allclose(placement.rotation, np.transpose([x, y, z]), atol=1e-14)
    np.testing.assert_allclose(placement.translation, origin, atol=1e-14)


@pytest.mark.parametrize("leg", LEGS)
def test_frames_of_limbs_1_to_3_are_the_papers(closed, generator, leg):
    geometry, configurations = closed
    for joints, frames in configurations:
        c1, s1, c2, s2 = (
            turn(joints[f"leg{leg}_universal_{k}"]) for k in (1, 2) for turn in (np.cos, np.sin)
        )
        axes = (c1 * c2, s2, s1 * c2), (-s1, 0, c1), (c1 * s2, -c2, s1 * s2)
        base = generator.base_points(geometry)[leg]
        assert_axes(frames[f"leg{leg}_cylinder"], *axes, base)
        tip = frames["platform"].act(np.array(generator.platform_points(geometry)[leg]))
        assert_axes(frames[f"leg{leg}_stem"], *axes, tip)


def test_frames_of_limb_4_and_the_platform_are_the_papers(closed):
    geometry, configurations = closed
    for joints, frames in configurations:
        c, s = np.cos(joints["leg4_revolute"]), np.sin(joints["leg4_revolute"])
        x, y, z = np.array([(c, 0, s), (0, 1, 0), (-s, 0, c)])
        foot = np.array([geometry["ds"], 0, 0])
        assert_axes(frames["leg4_cylinder"], x, y, z, foot)
        p = foot + joints["leg4_stroke"] * z
        assert_axes(frames["leg4_stem"], -x, -z, -y, p)
        theta, psi = joints["platform_pitch"] - joints["leg4_revolute"], joints["platform_yaw"]
        rotation = pin.rpy.rotate("y", theta) @ pin.rpy.rotate("z", psi)
        assert_axes(frames["platform"], *rotation.T, p)


def test_one_configuration_is_written_where_it_is_wanted(urdf_folder, tmp_path):
    folder = tmp_path / "new" / "folder"
    done = generate(urdf_folder, "--robot", "3ups_rpu", "--configuration", 8, "--out", folder)
    assert (done.returncode, done.stderr) == (0, "")
    stem = "3ups_rpu_configuration8"
    assert {file.name for file in folder.iterdir()} == {f"{stem}.urdf", f"{stem}.yaml"}
    assert loopid.load(folder / f"{stem}.yaml").name == stem


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--robot", "5p", "--configuration", 2), "5p has configurations [1], not 2"),
        (("--robot", "6ups"), "6ups"),
        (("--configuration", "first"), "first"),
    ],
)
def test_unknown_choices_exit_with_code_2(urdf_folder, tmp_path, arguments, problem):
    done = generate(urdf_folder, *arguments, "--out", tmp_path)
    assert done.returncode == 2
    assert problem in done.stderr
    assert not list(tmp_path.iterdir())
