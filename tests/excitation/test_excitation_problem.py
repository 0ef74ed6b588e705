import os
import pickle

import numpy as np
import pytest

from closure_robots import body, joint, urdf
from loopid import JointTerms, MotionLimits, find_force_model, load_mechanism
from loopid.errors import ModelWarning
from loopid.excitation import CRITERIA
from loopid.excitation.limits import (
    Bounds,
    Collisions,
)
from loopid.excitation.problem import (
    Coordinates,
    Problem,
    evaluate,
)
from loopid.excitation.shapes import FourierShape
from loopid.kinematics import measured_coordinates


def problem(mechanism, model, terms=None, platform=False, collisions=None):
    force_model = find_force_model(mechanism, model, terms)
    n = len(force_model.parameters)
    limits = MotionLimits(accelerations={"all": 5.0})
    return Problem(
        force_model=force_model,
        coordinates=Coordinates(force_model, mechanism.platform.names if platform else None),
        shape=FourierShape(8.0, 3),
        bounds=Bounds(
            mechanism, limits, 0.02, model == "gravity", collisions, mechanism.reference[None]
        ),
        criterion=CRITERIA["D"],
        noise=np.linspace(1.0, 2.0, len(mechanism.actuated)),
        basis=np.eye(n),
        prior=np.zeros((n, n)),
        samples=800,
    )


def point(given, size):
    names = "platform" if given.coordinates.on_platform else given.coordinates.names
    mechanism = given.force_model.mechanism
    home = measured_coordinates(mechanism, names).read(mechanism.reference[None])[0]
    shape = given.shape
    around = size * shape.draw(np.random.default_rng(3), len(home)) * given.coordinates.units
    return given.of_variables(np.outer(shape.still(), home) + around)


def test_a_problem_can_be_sent_to_another_process():
    given = problem(load_mechanism("five_bar"), "full")
    sent = pickle.loads(pickle.dumps(given))
    np.testing.assert_array_equal(sent.bounds.upper, given.bounds.upper)


@pytest.mark.parametrize(
    ("name", "model", "kinds", "platform", "size"),
    [
        ("five_bar", "full", ("Fc", "Fv"), False, 0.3),
        ("five_bar", "gravity", (), False, 0.3),
        ("3ups_rpu", "gravity", (), True, 0.05),
        ("3ups_rpu", "full", (), False, 0.02),
    ],
)
def test_slopes_are_those_of_finite_differences(name, model, kinds, platform, size):
    mechanism = load_mechanism(name)
    terms = JointTerms(mechanism.actuated, kinds) if kinds else None
    given = problem(mechanism, model, terms, platform)
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
    robot = load_mechanism(file)
    q = np.array([[0.3, 0.0], [0.3, 2.8], [1.0, 3.0]])
    found = Collisions(robot, q)
    assert found.pairs == 1
    np.testing.assert_allclose(found.least(q), np.abs(1 + np.exp(1j * q[:, 1])) - 0.3, atol=1e-6)
    # A mesh that is no file is not waited for.
    os.mkfifo(tmp_path / "fore.stl")
    mesh = f'<mesh filename="file://{tmp_path}/fore.stl"/>'
    file.write_text(file.read_text().replace("<sphere radius='0.1'/>", mesh))
    with pytest.warns(ModelWarning, match=r"there is no mesh .*fore\.stl"):
        assert Collisions(robot, q).pairs == 0
