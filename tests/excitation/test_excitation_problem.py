import coal
import numpy as np
import pinocchio as pin
import pytest

import loopid
from closure_robots import body, joint, urdf
from loopid import JointTerms, MotionLimits
from loopid.errors import ModelWarning
from loopid.excitation import DesignOptions
from loopid.excitation.collisions import Collisions, convex_hull
from loopid.excitation.criteria import CRITERIA
from loopid.excitation.limits import Bounds
from loopid.excitation.problem import Problem, evaluate
from loopid.excitation.shapes import FourierShape
from loopid.kinematics import measured_coordinates


def problem(mechanism, model, terms=None):
    force_model = loopid.force_model(mechanism, model, terms)
    n = len(force_model.parameters)
    limits = MotionLimits(accelerations={"all": 5.0}, singularity_threshold=0.02)
    return Problem(
        force_model=force_model,
        shape=FourierShape(8.0, 3),
        bounds=Bounds(mechanism, limits, mechanism.reference[None], model == "gravity"),
        criterion=CRITERIA["D"],
        noise=np.linspace(1.0, 2.0, len(mechanism.actuated)),
        basis=np.eye(n),
        prior=np.zeros((n, n)),
        options=DesignOptions(),
    )


def point(given, size):
    mechanism = given.force_model.robot
    home = measured_coordinates(mechanism).read(mechanism.reference[None])[0]
    shape = given.shape
    around = size * shape.draw(np.random.default_rng(3), len(home)) * given.units
    return given.of_variables(np.outer(shape.still(), home) + around)


@pytest.mark.parametrize(
    ("name", "model", "kinds", "size"),
    [
        ("five_bar", "full", ("Fc", "Fv"), 0.3),
        ("five_bar", "gravity", (), 0.3),
        pytest.param("3ups_rpu", "gravity", (), 0.02, marks=pytest.mark.validate),
        ("3ups_rpu", "full", (), 0.02),
    ],
)
def test_slopes_are_those_of_finite_differences(name, model, kinds, size):
    mechanism = loopid.load(name)
    terms = JointTerms(mechanism.actuated, kinds) if kinds else None
    given = problem(mechanism, model, terms)
    y, near = point(given, size), mechanism.reference[None]
    at = evaluate(given, y, near)
    direction = np.random.default_rng(4).normal(size=len(y))
    ahead, back = (evaluate(given, y + sign * 1e-5 * direction, at.q, False) for sign in (1, -1))
    assert (ahead.f - back.f) / 2e-5 == pytest.approx(at.df @ direction, rel=2e-3)
    numbers = ((ahead.g - back.g) / 2e-5).ravel()
    slopes = at.dg @ direction
    assert np.abs(slopes - numbers).max() < 2e-3 * np.abs(numbers).max()


def test_out_of_reach_is_no_value(five_bar):
    given = problem(five_bar, "gravity")
    far = given.of_variables(np.outer(given.shape.still(), [0.0, np.pi]))
    assert evaluate(given, far, five_bar.reference[None]) is None


def test_collisions_are_distances_between_links(tmp_path):
    ball = "<collision>{}<geometry><sphere radius='{}'/></geometry></collision></link>"
    shapes = {"ground": ball.format("", 0.2), "fore": ball.format("<origin xyz='1 0 0'/>", 0.1)}
    arm = urdf(
        body("upper"), body("fore"),
        joint("shoulder", "ground", "upper"), joint("elbow", "upper", "fore", (1, 0, 0)),
    ).replace('<link name="ground"/>', f'<link name="ground">{shapes["ground"]}')  # fmt: skip
    head, tail = arm.split('<link name="fore">')
    file = tmp_path / "arm.urdf"
    file.write_text(f'{head}<link name="fore">{tail.replace("</link>", shapes["fore"], 1)}')
    robot = loopid.load(file)
    q = np.array([[0.3, 0.0], [0.3, 2.8], [1.0, 3.0]])
    found = Collisions(robot, q)
    assert found.pairs == (("ground", "fore"),)
    np.testing.assert_allclose(found.least(q), np.abs(1 + np.exp(1j * q[:, 1])) - 0.3, atol=1e-6)
    # What cannot be read is told.
    whole = file.read_text()
    for shape in ("<foo/>", "<sphere radius='nan'/>", "<sphere radius='-0.1'/>"):
        file.write_text(whole.replace("<sphere radius='0.1'/>", shape))
        with pytest.warns(ModelWarning, match="geometry of fore cannot be .* left out"):
            assert not Collisions(robot, q).pairs
    file.write_text(whole)
    # Without a mesh, no link touches another.
    mesh = f'<mesh filename="file://{tmp_path}/fore.stl"/>'
    file.write_text(file.read_text().replace("<sphere radius='0.1'/>", mesh))
    with pytest.warns(ModelWarning, match=r"fore\.stl"):
        assert not Collisions(robot, q).pairs


@pytest.mark.parametrize(
    "name",
    [
        "ur_description/urdf/ur5_robot",
        pytest.param("ur_description/urdf/ur10_robot", marks=pytest.mark.validate),
        pytest.param("xarm_description/urdf/xarm7", marks=pytest.mark.validate),
    ],
)
def test_hulls_hold_the_meshes_of_arms_and_no_more(robot_data, name):
    """A point is as far from a hull as from a plane before it at least, from a vertex at most."""
    file = robot_data / f"{name}.urdf"
    robot, point = loopid.load(file), coal.Sphere(1e-3)
    folders = [str(folder) for folder in file.parents]
    meshes = pin.buildGeomFromUrdf(
        robot.model, str(file), pin.GeometryType.COLLISION, package_dirs=folders
    )
    directions = np.random.default_rng(0).normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hulls = Collisions(robot, robot.reference[None]).geometry.geometryObjects
    for hull, mesh in zip(hulls, meshes.geometryObjects, strict=True):
        if not isinstance(piece := mesh.geometry, coal.BVHModelBase):
            continue
        vertices = np.array([piece.vertex(k) for k in range(piece.num_vertices)])
        for away in 2.0 * directions:
            at = coal.Transform3s()
            at.setTranslation(away)
            found = coal.distance(
                *(hull.geometry, coal.Transform3s(), point, at),
                *(coal.DistanceRequest(), coal.DistanceResult()),
            )
            least = 2.0 - (vertices @ away).max() / 2.0 - 1e-3
            most = np.linalg.norm(vertices - away, axis=1).min() - 1e-3
            assert least - 1e-5 < found < most + 1e-5


@pytest.mark.parametrize(("height", "count"), [(1, 60), (0, 60), (0, 4)])
def test_hulls_are_those_of_meshes_with_points_inside(height, count):
    """Of a cube, of a flat square, and of one that has its corners only."""
    corners = [[x, y, z] for z in (-1, 1) for x in (-1, 1) for y in (-1, 1)]
    points = np.concatenate([corners, np.random.default_rng(0).uniform(-1, 1, (52, 3))])[:count]
    points *= [1, 1, height]
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(count - 2, count)
    for k in range(count - 2):
        mesh.addTriangle(*points[k : k + 3])
    mesh.endModel()
    hull, ball = convex_hull(mesh), coal.Sphere(0.1)
    for place in ([2, 0, 0], [0, -3, 0.5], [2, 2, 2]):
        at = coal.Transform3s()
        at.setTranslation(np.array(place, dtype=float))
        found = coal.distance(
            hull, coal.Transform3s(), ball, at, coal.DistanceRequest(), coal.DistanceResult()
        )
        outside = np.maximum(np.abs(place) - [1, 1, height], 0)
        assert found == pytest.approx(np.linalg.norm(outside) - 0.1, abs=1e-6)
