"""Generated C: what Python says, at all poses and for all kinds of joints, from motors alone."""

import ctypes
import importlib.util
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import loopid
from bank_robots import few_of
from closure_robots import ROWS, body, chain, files, frame, joint, loop, urdf
from compiled_c import CompiledRobot
from loopid import Dynamics, JointTerms, Robot, bundled_robots, random_configurations
from loopid.base_parameters import find_base
from loopid.control import Signals, WrenchObserver
from loopid.errors import AccuracyWarning, DataError, MissingExtraError, OptionError
from loopid.export import c_source
from loopid.export.c_code import motor_positions
from loopid.identification import ForceModel
from loopid.kinematics import assemble, closed_motion
from loopid.kinematics.assembly import try_assemble
from loopid.kinematics.closing import nearby_configurations
from loopid.motion import JointMotion
from loopid.observation import Observation
from loopid.regressors import gravity_regressor, motion_regressor
from loopid.regressors.motion_regressors import motion_parameters
from loopid.robot import Body

pytestmark = [
    pytest.mark.skipif(
        importlib.util.find_spec("casadi") is None, reason="needs pip install 'loopid[codegen]'"
    ),
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler called cc"),
    pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning"),
]
AGREEMENT = 1e-10
STARTED = 1.2, 1.9  # positions of the motors of the five-bar
GEAR = {
    "closures": [{"type": "coupling", "joints": {"joint1": 1, "joint3": -2.5}, "offset": 0.1}],
    "name_mot": ["joint1", "joint2"],
    "reference": {},
}
CAM = GEAR | {
    "closures": [
        {
            "type": "coupling",
            "joints": {"joint3": 1},
            "of": {"joint1": 1, "joint2": -0.5},
            "polynomial": [0.1, 0.4, 0.3, -0.1, 0.05],
        }
    ]
}
STRICT = ("-O0", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
# Names that would leave a comment or a text of C, each to define a function of its own.
HOSTILE = (
    "a*/ int injected(void) {return 1;} /*",
    "a*\\\n/ int injected(void) {return 1;} /\\\n*",
    "a*??/\n/ int injected(void) {return 1;} /*",
    'a"; int injected(void) {return 1;} /*',
    "a\nint injected(void) {return 1;}\n",
    "a\r\n#error\r\n",
    "a\u2028%:error\x1b[31m\x9b31m ??/",
    "a\\",
)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Compile the code of a force model, once."""
    made = {}

    def compile_it(model):
        if id(model) not in made:
            folder = tmp_path_factory.mktemp("c")
            made[id(model)] = model, CompiledRobot(model, c_source(model), folder, STRICT)
        return made[id(model)][1]

    return compile_it


def joint_terms(mechanism, kinds, rates=(0.0, 0.0)):
    joints = [name for name in mechanism.actuated if mechanism.joint(name).nv == 1]
    return JointTerms(tuple(joints), kinds, *rates) if kinds else None


@cache
def force_model(robot, model, kinds=("Ia", "Fc", "Fv", "Fo"), **options):
    """A force model as users have it."""
    mechanism = loopid.load(robot, **options)
    return loopid.force_model(mechanism, model, joint_terms(mechanism, kinds), search="qr")


def all_columns(robot, model, kinds=("Ia", "Fc", "Fv", "Fo"), rates=(0.0, 0.0), **options):
    """All standard parameters as if they were base parameters: nothing is left out."""
    mechanism = robot if isinstance(robot, Robot) else loopid.load(robot, **options)
    terms = joint_terms(mechanism, kinds, rates)
    names = motion_parameters(mechanism, model, terms)
    base = find_base(Observation.from_matrix(np.eye(len(names)), names, length=1.0), "qr")
    assert np.array_equal(base.base, np.arange(len(names)))
    return ForceModel(mechanism, model, terms, base)


def around_reference(model):
    """Motion through closed poses around the reference, which are fast to find."""
    mechanism = model.robot
    q = nearby_configurations(mechanism, mechanism.reference)
    rates = np.random.default_rng(6).standard_normal((2, len(q), len(mechanism.independent)))
    return closed_motion(mechanism, q, *rates)


def moved(model, count=20):
    """Random motion through closed poses."""
    mechanism = model.robot
    q = random_configurations(mechanism, count, seed=5)
    rates = np.random.default_rng(6).standard_normal((2, count, len(mechanism.independent)))
    return closed_motion(mechanism, q, *rates)


def assert_agrees(model, robot, motion=None):
    """All functions, at closed poses."""
    motion = moved(model) if motion is None else motion
    W = motion_regressor(model.robot, motion, model.model, joint_terms=model.joint_terms)
    expected = model.base.regressor(W)
    K, status = robot.regressors(motion)
    assert not status.any()
    scale = np.abs(expected).max(axis=(0, 1))
    scale = np.maximum(scale, 1e-3 * scale.max())  # columns without an effect are there too
    assert (np.abs(K - expected) / scale).max() < AGREEMENT
    assert robot.state.residual < 1e-9
    np.testing.assert_allclose(robot.state.q, motion.configurations[-1], atol=1e-9)
    # The rest at the last pose.
    chosen = model.robot.velocity_indices(model.robot.independent)
    du, ddu = (x[-1, chosen].copy() for x in (motion.velocities, motion.accelerations))
    phi = np.random.default_rng(7).standard_normal(K.shape[2])
    size, still = np.abs(K[-1]) @ np.abs(phi), np.zeros(len(chosen))
    force, at_rest = np.zeros(len(chosen)), robot.regressor(still, still) @ phi
    assert robot.call("forces", du, ddu, phi, force) == 0
    assert (np.abs(force - K[-1] @ phi) / size).max() < AGREEMENT
    assert robot.call("gravity", phi, force) == 0
    assert (np.abs(force - at_rest) / size).max() < AGREEMENT
    assert robot.call("observe", du, still, phi, 10.0, 1e-3, force) == 0
    bias = robot.regressor(du, still) @ phi
    mass = np.stack([robot.regressor(still, unit) @ phi - at_rest for unit in np.eye(len(chosen))])
    assert (np.abs(robot.state.bias - bias) / size).max() < AGREEMENT
    assert (
        np.abs(np.reshape(robot.state.mass, mass.shape) - mass).max(axis=0) / size
    ).max() < AGREEMENT


@pytest.mark.parametrize(
    ("robot", "model"),
    [
        pytest.param("3ups_rpu", "gravity", marks=pytest.mark.validate),
        ("five_bar", "full"),
        pytest.param("6ups", "full", marks=pytest.mark.validate),
        pytest.param("delta", "gravity", marks=pytest.mark.validate),
    ],
)
def test_robots_with_loops(compiled, robot, model):
    found = all_columns(robot, model)
    assert_agrees(found, compiled(found), around_reference(found))


@pytest.mark.parametrize("model", few_of(["gravity", "full"], "full"))
def test_a_tree(compiled, robot_data, model):
    path = robot_data / "ur_description" / "urdf" / "ur10_robot.urdf"
    found = force_model(path, model)
    assert_agrees(found, compiled(found))


@pytest.mark.parametrize("rates", few_of([((0.3, 0.0),), ((0.2, 0.4),)], ((0.2, 0.4),)))
def test_friction_at_low_rates(compiled, rates):
    found = all_columns("five_bar", "gravity", ("Fc", "Fv"), rates)
    assert_agrees(found, compiled(found), around_reference(found))


def test_all_kinds_of_joint_terms(compiled):
    found = all_columns(
        "five_bar", "gravity", ("Ia", "Fc+", "Fc-", "Fc~0.3", "Fs~0.5", "Ks3", "Ks@1.2", "Kg@-9")
    )
    assert_agrees(found, compiled(found), around_reference(found))


def test_friction_curves_and_load(compiled):
    """One law in C and in Python; with the loads of the values that C is given."""
    kinds = "Ia", "Fc", "Fv", "Fk0~0.25", "Fk~0.5", "Fa~0.5", "Fa1~1"
    found = all_columns("five_bar", "full", kinds)
    assert_agrees(found, compiled(found), around_reference(found))
    found = all_columns("five_bar", "full", (*kinds, "Ft"))
    phi = np.random.default_rng(3).standard_normal(len(found.parameters))
    found, robot = found.with_loads(phi), compiled(found.with_loads(phi))
    motion, size = around_reference(found), len(found.robot.independent)
    K, _ = robot.regressors(motion)
    rows = found.robot.velocity_indices(found.robot.independent)
    rates = motion.velocities[:, rows], motion.accelerations[:, rows]
    here = JointMotion(np.arange(float(len(K))), motion.configurations, *rates, np.ones(len(K)))
    expected = found.regressor(here)
    np.testing.assert_allclose(K, expected, atol=1e-9 * np.abs(expected).max())
    force = np.zeros(size)
    assert robot.call("forces", rates[0][-1].copy(), rates[1][-1].copy(), phi, force) == 0
    np.testing.assert_allclose(force, expected[-1] @ phi, rtol=1e-9)
    # Through zero it is smooth.
    slow, still = 1e-6 * np.ones(size), np.zeros(size)
    assert robot.call("forces", slow, still, phi, force) == 0
    before = force.copy()
    assert robot.call("forces", still, still, phi, force) == 0
    np.testing.assert_allclose(before, force, atol=0.05 * np.abs(phi).max())


def test_tied_links(compiled):
    found = all_columns("3rrr", "full", tied=True)
    assert_agrees(found, compiled(found), around_reference(found))


KINDS = few_of([*ROWS, "coupling", "cam"], "6d", "distance", "cable", "cam")


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_closure(compiled, tmp_path, kind):
    couplings = {"coupling": (chain(3), GEAR), "cam": (chain(3), CAM)}
    parts, description = couplings.get(kind) or loop(kind)
    for name, text in zip(("robot.urdf", "robot.yaml"), files(parts, description), strict=True):
        (tmp_path / name).write_text(text)
    # Closures are the same in both models.
    found = all_columns(tmp_path / "robot.yaml", "gravity", ("Fv",))
    assert_agrees(found, compiled(found), around_reference(found))


def test_loops_of_joints_with_several_coordinates(compiled, tmp_path):
    """Positions that are no angles: a circle's, a quaternion's, a pose's."""
    parts = (
        body("crank"),
        joint("motor", "ground", "crank", axis=(0.1, 0.2, 1), kind="continuous"),
        body("rod"),
        joint("ball", "crank", "rod", (0.2, 0, 0)),
        frame("end", "rod", (0.6, 0, 0)),
        body("slide"),
        joint("slider", "ground", "slide", (0.5, 0.1, 0), (1, 0, 0), "prismatic"),
        body("plate"),
        joint("drift", "ground", "plate", kind="floating"),
        body("puck"),
        joint("table", "ground", "puck", (0, 0, 0.1), kind="planar"),
        frame("edge", "puck", (0.2, 0, 0)),
        frame("post", "ground", (0.3, 0.1, 0.1)),
    )
    closures = [
        {"type": "3d", "frames": ["end", "slide"]},
        {"type": "hinge", "frames": ["plate", "slide"]},
        {"type": "distance", "frames": ["edge", "post"], "length": 0.25},
    ]
    changes = {"joint_name": ["ball"], "joint_type": ["SPHERICAL"], "name_mot": ["motor"]}
    texts = files(parts, {"closures": closures, **changes})
    for name, text in zip(("robot.urdf", "robot.yaml"), texts, strict=True):
        (tmp_path / name).write_text(text)
    found = all_columns(tmp_path / "robot.yaml", "full", ())
    assert len(found.robot.independent) > 3
    assert_agrees(found, compiled(found), around_reference(found))


def test_every_joint_of_robot_files(compiled, tmp_path):
    parts = (
        body("base"),
        body("slide"),
        joint("slider", "base", "slide", (0.1, 0, 0), (1, 2, 2), "prismatic"),
        body("wheel"),
        joint("spin", "slide", "wheel", (0, 0.1, 0), (0, 1, 0), "continuous", (0.1, 0.2, 0.3)),
        body("bob"),
        joint("oblique", "wheel", "bob", (0, 0, 0.1), (1, -1, 0.5), "continuous"),
        body("ball"),
        joint("socket", "bob", "ball", (0.1, 0.2, 0.3), rpy=(0.5, 0, 0.2)),
        body("cart"),
        joint("table", "ground", "cart", (0, 0, 0.4), kind="planar", rpy=(0.1, 0.2, 0)),
        body("tip"),
        joint("hinge", "cart", "tip", (0.2, 0, 0), (0, -1, 0)),
    )
    root = joint("drift", "ground", "base", kind="floating", rpy=(0.2, 0.1, 0))
    (tmp_path / "robot.urdf").write_text(urdf(root, *parts))
    (tmp_path / "robot.yaml").write_text(
        "joint_name: [socket]\njoint_type: [SPHERICAL]\n"
        "name_mot: [drift, slider, spin, oblique, socket, table, hinge]\n"
    )
    found = all_columns(tmp_path / "robot.yaml", "full", ())
    kinds = {found.robot.joint(name).shortname() for name in found.robot.joints}
    assert {"JointModelFreeFlyer", "JointModelPlanar", "JointModelSpherical"} < kinds
    assert found.robot.model.nq > found.robot.model.nv
    assert_agrees(found, compiled(found))


def hand_made(*kinds):
    """A chain of joints that no file has."""
    pin.seed(0)
    model, parent, bodies = pin.Model(), 0, []
    for k, kind in enumerate(kinds):
        parent = model.addJoint(parent, kind, pin.SE3.Random(), f"joint{k}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        bodies.append(Body(f"link{k}", parent))
    names = tuple(f"joint{k}" for k in range(len(kinds)))
    return Robot("hand made", Path("none"), model, (), names, tuple(bodies), pin.neutral(model))


@pytest.mark.parametrize("count", [pytest.param(1, marks=pytest.mark.validate), 2])
def test_screws(compiled, count):
    rng = np.random.default_rng(0)
    axis = np.linalg.qr(rng.standard_normal((3, 3)))[0][2]
    joints = pin.JointModelHZ(0.3), pin.JointModelHelicalUnaligned(axis, 0.2)
    mechanism = hand_made(*joints[:count])
    q, v, a = rng.uniform(-1, 1, (3, 40, count))
    found = all_columns(mechanism, "full", ())
    assert_agrees(found, compiled(found), closed_motion(mechanism, q, v, a))


@pytest.mark.parametrize("kind", ["SphericalZYX", "Composite", "Translation"])
def test_a_joint_without_symbols_is_refused(kind):
    joint = getattr(pin, f"JointModel{kind}")()
    if kind == "Composite":
        joint.addJoint(pin.JointModelRX(), pin.SE3.Random())
    with pytest.raises(OptionError, match=f"joint0 is a {kind}, which has no symbolic form"):
        c_source(all_columns(hand_made(joint), "full", ()))


def test_singular_poses_are_told(compiled):
    found = force_model("parallelogram", "full", ())
    mechanism, robot = found.robot, compiled(found)
    # All bars in a line: the motor loses control of the coupler.
    line = mechanism.reference[:2].sum()
    still = np.zeros((1, 3))
    for apart, expected in ((0.0, 2), (1e-5, 1), (0.3, 0)):
        q = np.array([line + apart, -apart, line + apart])
        assert robot.place(q, q[:1].copy()) == expected
        if expected == 1:
            with pytest.warns(AccuracyWarning):
                motion = closed_motion(mechanism, q[None], [[0.0]], [[0.0]])
            W = motion_regressor(mechanism, motion, "full")
            K = robot.regressor(still[0, :1], still[0, :1])
            np.testing.assert_allclose(K, found.base.regressor(W)[0], rtol=1e-6, atol=1e-6)


def test_what_is_not_finite_is_told(compiled):
    found = force_model("five_bar", "full")
    robot, (u, du, ddu) = compiled(found), np.array([STARTED, [1.0, 2.0], [3.0, 4.0]])
    assert robot.call("start", u) == 0
    before, out = bytes(robot.state), np.zeros(2)
    assert robot.call("assemble", np.array([np.nan, u[1]])) == 2
    assert robot.call("follow", np.array([np.inf, u[1]])) == 2
    assert robot.call("forces", du, ddu, np.nan * found.prior, out) == 3
    assert robot.call("gravity", np.nan * found.prior, out) == 3
    assert robot.call("observe", np.nan * du, ddu, found.prior, 1.0, 1e-3, out) == 3
    assert np.isnan(robot.regressor(du, np.inf * ddu)).any()
    assert bytes(robot.state) == before
    assert robot.call("forces", du, ddu, found.prior, out) == 0
    assert robot.call("start", u * np.nan) == 2


def test_values():
    found = force_model("five_bar", "full")
    values = found.prior + np.arange(len(found.prior)) / 7
    source = c_source(found, values=values).source
    kept = re.search(r"five_bar_values\[[^]]*\] = \{(.*?)\};", source, re.DOTALL)[1]
    np.testing.assert_array_equal([float(each) for each in kept.split(",")], values)


# From motor signals.


def drive(mechanism, count, step, seed=0):
    """Motors (count, dof) on a random walk inside the limits, and all joints there (count, nq)."""
    generator, u = (
        np.random.default_rng(seed),
        motor_positions(mechanism, mechanism.reference[None]),
    )
    indices = mechanism.velocity_indices(mechanism.independent)
    walk = generator.choice([-1.0, 1.0], (count // 20, len(indices))).repeat(20, axis=0)
    u = u + step * np.cumsum(walk, axis=0) * mechanism.coordinate_scales[indices]
    found = try_assemble(mechanism, u, trajectory=True)
    assert found.assembled.all()
    return u, found.configurations


@pytest.mark.parametrize("robot", few_of(bundled_robots(), "five_bar"))
def test_a_control_loop(compiled, robot):
    """All joints and forces, sample by sample."""
    found = force_model(robot, "full")
    mechanism, call = found.robot, compiled(found)
    u, q = drive(mechanism, 200, 1e-4)
    assert call.call("start", u[0].copy()) == 0
    forces, reached = np.zeros(u.shape), np.zeros(q.shape)
    for k in range(len(u)):
        assert call.call("assemble", u[k]) == 0
        assert call.call("gravity", found.prior, forces[k]) == 0
        reached[k] = call.state.q
    np.testing.assert_allclose(reached, q, atol=1e-9)
    expected = gravity_regressor(mechanism, q) @ mechanism.standard_parameters("gravity")
    np.testing.assert_allclose(forces, expected, atol=1e-9 * np.abs(expected).max())


@pytest.fixture
def gripper(tmp_path, urdf_folder):
    """A five-bar of 1 cm: its loops close to a nanometre before its angles are exact."""
    text = (urdf_folder / "five_bar.urdf").read_text()
    small = re.sub(
        r'(?<=origin )xyz="(\S+) (\S+) (\S+)"',
        lambda match: 'xyz="{:.9g} {:.9g} {:.9g}"'.format(
            *(0.02 * float(x) for x in match.groups())
        ),
        text,
    )
    (tmp_path / "five_bar.urdf").write_text(small)
    return shutil.copy(urdf_folder / "five_bar.yaml", tmp_path)


@pytest.mark.parametrize("robot", few_of(["five_bar", "3ups_rpu", "6ups", "gripper"], "gripper"))
def test_motions_close_or_are_refused(tmp_path, robot, request):
    """Short ways close; longer ones end where Python's assembly does, or are refused."""
    robot = request.getfixturevalue(robot) if robot == "gripper" else robot
    found = force_model(robot, "gravity", ())
    mechanism, code = found.robot, c_source(found)
    q = random_configurations(mechanism, 200, seed=2)
    u, generator = motor_positions(mechanism, q), np.random.default_rng(3)
    refused = 0
    for steps in (1, 3):
        flags = (*STRICT, f"-D{code.name.upper()}_NEWTON_STEPS={steps}")
        call = CompiledRobot(found, code, tmp_path / str(steps), flags)
        for way in (1e-6, 1e-3, 1e-1):
            target = u + way * generator.uniform(-1, 1, u.shape)
            reached, status = call.moved(q, u, target)
            good = status < 2
            for k in np.flatnonzero(good):  # a robot that stands there is closed, too
                call.place(q[k], u[k])
                assert max(call.call("assemble", target[k]) for _ in range(3)) < 2
            np.testing.assert_allclose(reached[~good], q[~good], atol=1e-12)
            whole = try_assemble(mechanism, target[good], start=q[good])
            np.testing.assert_allclose(whole.configurations, reached[good], atol=1e-6)
            assert good.all() or way > 1e-6
            refused += int((~good).sum())
    assert refused


def test_lost_samples(compiled):
    found = force_model("five_bar", "full")
    robot = compiled(found)
    u, q = drive(found.robot, 200, 1e-4)
    robot.call("start", u[0].copy())
    for k in range(1, len(u)):
        if k in (20, 21, 60):  # nothing comes
            continue
        if k in (40, 80):  # nonsense comes
            before = bytes(robot.state)
            assert robot.call("assemble", u[k] + (0.3 if k == 40 else np.nan)) == 2
            assert bytes(robot.state) == before
            continue
        assert robot.call("assemble", u[k].copy()) == 0
        np.testing.assert_allclose(robot.state.q, q[k], atol=1e-9)
    # Too many are lost for one part.
    far, there = drive(found.robot, 20, 2e-2, seed=1)
    assert robot.call("assemble", far[-1].copy()) == 2
    assert robot.call("follow", far[-1].copy()) == 0
    np.testing.assert_allclose(robot.state.q, there[-1], atol=1e-9)


def test_starts_from_the_reference(compiled):
    """On its branch, or nowhere."""
    found = force_model("five_bar", "full")
    mechanism, robot = found.robot, compiled(found)
    u = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 2))
    whole, status = try_assemble(mechanism, u), np.zeros(len(u))
    for k in range(len(u)):
        status[k] = robot.call("start", u[k])
        if status[k] < 2:
            np.testing.assert_allclose(robot.state.q, whole.configurations[k], atol=1e-6)
    assert 20 < (status < 2).sum() < 195
    assert (whole.assembled == (status < 2)).mean() > 0.98  # the rest is next to a singularity


def test_angles_on_a_circle_go_the_short_way(compiled, tmp_path):
    """A crank of any number of turns; a rod whose spin stays."""
    parts = (
        body("crank"),
        joint("motor", "ground", "crank", axis=(0.1, 0.2, 1), kind="continuous"),
        body("rod"),
        joint("ball", "crank", "rod", (0.2, 0, 0)),
        frame("end", "rod", (0.6, 0, 0)),
        body("slide"),
        joint("slider", "ground", "slide", (0.5, 0.1, 0), (1, 0, 0), "prismatic"),
    )
    changes = {"joint_name": ["ball"], "joint_type": ["SPHERICAL"], "name_mot": ["motor"]}
    texts = files(parts, {"closures": [{"type": "3d", "frames": ["end", "slide"]}], **changes})
    for name, text in zip(("robot.urdf", "robot.yaml"), texts, strict=True):
        (tmp_path / name).write_text(text)
    found = all_columns(tmp_path / "robot.yaml", "gravity", ())
    mechanism, robot = found.robot, compiled(found)
    assert mechanism.unmeasured
    u = np.zeros((700, len(mechanism.independent)))
    u[:, 0] = motor_positions(mechanism, mechanism.reference[None])[0, 0] + 0.02 * np.arange(700)
    q = assemble(mechanism, u[:, :1], trajectory=True)
    assert robot.call("start", u[0].copy()) == 0
    for k in range(len(u)):
        turned = u[k] - 2 * np.pi * (k % 3) * np.eye(len(u[0]))[0]  # as encoders may count
        assert robot.call("assemble", turned) == 0
        assert robot.state.u[0] == turned[0]
    np.testing.assert_allclose(robot.state.residual, 0, atol=1e-12)
    # Without its spin about itself, which depends on the steps, the rod is where Python has it.
    slider = mechanism.joint("slider").idx_q
    np.testing.assert_allclose(robot.state.q[slider], q[-1, slider], atol=1e-9)


@pytest.mark.parametrize(
    ("robot_name", "kind"),
    few_of(
        [("3ups_rpu", "full"), ("delta", "gravity"), ("five_bar", "gravity")],
        ("five_bar", "gravity"),
    ),
)
def test_the_observer_is_that_of_python(robot_name, kind, compiled):
    """With friction and rotors, also where the bodies of the model stand still."""
    found = force_model(robot_name, kind, ("Ia", "Fc", "Fv"))
    robot, phi, frame = compiled(found), found.prior + 0.1, found.robot.model.frames[-1].name
    own = Dynamics(found, phi)
    beside = WrenchObserver(own, 1e-3, gain=40.0, noise=1.0, frame=frame)
    home = motor_positions(found.robot, own.configuration[None])[0]
    time, pace = 1e-3 * np.arange(50)[:, None], np.linspace(5, 9, len(home))
    u, du = home + 0.01 * np.sin(pace * time), 0.01 * pace * np.cos(pace * time)
    tau, seen = np.random.default_rng(0).normal(0, 20, u.shape), np.zeros(len(home))
    assert robot.call("start", u[0].copy()) == 0
    for each in zip(u, du, tau, strict=True):
        here, rate, force = (part.copy() for part in each)
        assert robot.call("assemble", here) == 0
        assert robot.call("observe", rate, force, phi, 40.0, 1e-3, seen) == 0
        residual = beside.update(Signals(*each)).residual
        np.testing.assert_allclose(seen, residual, atol=1e-9 * max(1.0, np.abs(residual).max()))


def test_the_observer(compiled, load_once):
    """De Luca's formula, with C^T du from kinetic energy, gives the filtered external forces."""
    mechanism = load_once("five_bar")
    found = loopid.force_model(
        mechanism, "full", JointTerms(mechanism.actuated, ("Ia",)), search="qr"
    )
    robot, phi, dt, bandwidth = compiled(found), found.prior + 0.1, 1e-3, 40.0
    time = dt * np.arange(400)[:, None]
    pace, phase = np.array([[5.0, 7.0]]), np.array([[0.2, 1.0]])
    u = STARTED + 0.3 * np.sin(pace * time + phase) - 0.3 * np.sin(phase)
    du, ddu = 0.3 * pace * np.cos(pace * time + phase), -0.3 * pace**2 * np.sin(pace * time + phase)
    pushed = np.where(time > 0.2, [[3.0, -2.0]], 0.0)
    q = assemble(mechanism, u, trajectory=True)

    def forces(q, du, ddu):
        return found.base.regressor(found.standard_regressor(q, du, ddu)) @ phi

    def mass(q):
        still, units = 0 * du, [np.broadcast_to(e, du.shape) for e in np.eye(2)]
        return np.stack([forces(q, still, e) - forces(q, still, still) for e in units], axis=2)

    def energy(q):
        return 0.5 * np.einsum("ni,nij,nj->n", du, mass(q), du)

    gravity, h = forces(q, 0 * du, 0 * du), 1e-5
    ends = [
        [assemble(mechanism, u + s * h * e, start=q[0], trajectory=True) for s in (1, -1)]
        for e in np.eye(2)
    ]
    slopes = np.stack([(energy(a) - energy(b)) / (2 * h) for a, b in ends], axis=1)
    tau = forces(q, du, ddu) - pushed
    rate, p = tau + slopes - gravity, np.einsum("nij,nj->ni", mass(q), du)
    expected, given, total = np.zeros(u.shape), 0.5 * (tau[1:] + tau[:-1]), np.zeros(2)
    seen = np.zeros(u.shape)
    assert robot.call("start", u[0].copy()) == 0
    for k in range(len(u)):
        assert robot.call("assemble", u[k].copy()) == 0
        now = given[k - 1] if k else tau[0]
        assert robot.call("observe", du[k].copy(), now.copy(), phi, bandwidth, dt, seen[k]) == 0
        if k:
            total += 0.5 * dt * (rate[k] + rate[k - 1])
            expected[k] = bandwidth * (p[k] - p[0] - total) / (1 + bandwidth * dt)
            total += dt * expected[k]
    np.testing.assert_allclose(seen, expected, atol=1e-3)
    filtered = pushed * -np.expm1(-bandwidth * np.maximum(time - 0.2, 0))
    np.testing.assert_allclose(seen, filtered, atol=0.1)
    np.testing.assert_allclose(seen[-1], pushed[-1], atol=2e-3)


def test_the_control_loop_of_the_header(tmp_path):
    """It compiles as it stands, and holds the robot where it is."""
    found = force_model("five_bar", "full", ())
    code = c_source(found, values=found.prior)
    example = code.header[code.header.index('#include "five_bar.h"') :]
    example = example[: example.index("Before the loop")]
    main = f"""
int main(void) {{
  static struct five_bar_state state;
  const double u[] = {{{STARTED[0]}, {STARTED[1]}}}, still[] = {{0, 0}};
  double force[2] = {{0, 0}}, rest[2], external[2];
  if (five_bar_start(&state, u)) return 1;
  if (control(&state, u, still, u, still, still, five_bar_values, force, external)) return 1;
  five_bar_gravity(&state, five_bar_values, rest);
  return force[0] != rest[0] || force[1] != rest[1];
}}
"""
    code.save(tmp_path)
    (tmp_path / "main.c").write_text(example + main)
    strict = [flag for flag in STRICT if flag != "-pedantic"]
    subprocess.run(
        ["cc", *strict, "-pedantic", "main.c", "five_bar.c", "-lm", "-o", "main"],
        cwd=tmp_path,
        check=True,
    )
    subprocess.run([str(tmp_path / "main")], check=True)


def test_nothing_but_mathematics_is_called(compiled):
    """No memory is allocated, and nothing read or written elsewhere."""
    robot = compiled(force_model("five_bar", "full"))
    library = Path(robot.library._name)
    if shutil.which("nm") is None:
        pytest.skip("needs nm")
    command = ["nm", "-D", "--undefined-only", str(library)]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    called = {line.partition("@")[0] for line in lines} - {"U", "w"}
    local = {
        "sin",
        "cos",
        "sincos",
        "sqrt",
        "atan2",
        "tanh",
        "copysign",
        "memcpy",
        "memset",
        "fmin",
        "fmax",
    }
    assert {name for name in called if not name.startswith("_")} <= local


def test_the_function_of_casadi():
    import casadi

    found = force_model("five_bar", "full")
    mechanism = found.robot
    code, motion = c_source(found), moved(found, 5)
    call = casadi.Function.deserialize(code.casadi)
    chosen = mechanism.velocity_indices(mechanism.independent)
    for k, q in enumerate(motion.configurations):
        du, ddu = motion.velocities[k, chosen], motion.accelerations[k, chosen]
        out = {
            name: value.full() for name, value in call(q=q, du=du, ddu=ddu, phi=found.prior).items()
        }
        K = found.base.regressor(found.standard_regressor(q[None], du[None], ddu[None]))[0]
        np.testing.assert_allclose(out["residual"], 0, atol=1e-9)
        np.testing.assert_allclose(out["dq"][:, 0], motion.velocities[k], atol=1e-10)
        np.testing.assert_allclose(out["force"][:, 0], K @ found.prior, atol=1e-10)
        np.testing.assert_allclose(
            out["mass"] @ ddu + out["bias"][:, 0], K @ found.prior, atol=1e-10
        )


def test_names_are_texts_and_nothing_else(tmp_path):
    """Readers refuse such names; other programs may make mechanisms, too."""
    model, bodies, parent = pin.Model(), [], 0
    for name in HOSTILE:
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3.Random(), name)
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        bodies.append(Body(name, parent))
    mechanism = Robot(
        HOSTILE[1], Path("none"), model, (), HOSTILE, tuple(bodies), pin.neutral(model)
    )
    found = all_columns(mechanism, "gravity", ("Fv",))
    code = c_source(found)
    assert code.name.isidentifier()
    assert (code.header + code.source).isascii()
    for flags in (STRICT, ("-Wall", "-Wextra", "-Werror")):  # with trigraphs, and without
        compiled = CompiledRobot(found, code, tmp_path / str(len(flags)), flags)
        library = compiled.library
        assert not hasattr(library, "injected")
        texts = ctypes.c_char_p * len(HOSTILE)
        names = texts.in_dll(library, f"{code.name}_motor_names")
        assert [name.decode() for name in names] == list(HOSTILE)
        assert compiled.call("start", np.zeros(model.nv)) == 0


def test_long_texts_are_cut(tmp_path):
    found = force_model("five_bar", "gravity", ())
    long = replace(found, robot=replace(found.robot, name="ö" * 5000))
    code = c_source(long)
    compiled = CompiledRobot(long, code, tmp_path, STRICT)
    text = ctypes.c_char.in_dll(compiled.library, f"{code.name}_robot")
    assert ctypes.string_at(ctypes.addressof(text)).endswith(b"...")
    named = replace(found, robot=replace(found.robot, name="x" * 5000))
    assert len(c_source(named).name) < 100  # of files


def test_two_robots_and_cpp_in_one_program(tmp_path):
    names = ("five_bar", "four_bar")
    for robot in names:
        c_source(force_model(robot, "gravity", ())).save(tmp_path)
    lines = [f'#include "{robot}.h"\n#include "{robot}.h"' for robot in names]
    calls = " + ".join(f"{robot.upper()}_DOF" for robot in names)
    (tmp_path / "main.cpp").write_text("\n".join([*lines, f"int main() {{ return {calls} - 3; }}"]))
    sources = [str(tmp_path / f"{robot}.c") for robot in names]
    subprocess.run(["cc", *STRICT, "-c", *sources], cwd=tmp_path, check=True)
    objects = [f"{robot}.o" for robot in names]
    if shutil.which("c++") is None:
        pytest.skip("needs a C++ compiler called c++")
    subprocess.run(["c++", "main.cpp", *objects, "-o", "main"], cwd=tmp_path, check=True)
    subprocess.run([str(tmp_path / "main")], check=True)


def test_the_same_model_gives_the_same_code():
    found = force_model("five_bar", "full")
    assert c_source(found) == c_source(found)


def test_refusals(monkeypatch):
    found = force_model("five_bar", "gravity", ())
    for name in ("1bar", "five bar", "", "é", "a__b", "a_"):
        with pytest.raises(OptionError, match="begin with a letter, then letters and digits"):
            c_source(found, name=name)
    with pytest.raises(DataError, match=r"shape \(\d+,\), not \(2,\)"):
        c_source(found, values=np.zeros(2))
    with pytest.raises(DataError, match="finite"):
        c_source(found, values=found.prior * np.nan)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(MissingExtraError, match=r"loopid\[codegen\]"):
        c_source(found)


def test_the_header_says_below_which_rate_signs_are_smooth(load_once):
    import casadi

    robot = load_once("four_bar")
    model = loopid.force_model(robot, "gravity", "Fc")
    code = c_source(model)
    (rate,) = re.findall(r"motors, s is (\S+) rad/s", code.header)
    values = np.where([each.kind == "Fc" for each in model.parameters], 2.0, 0.0)
    du = np.array([0.7 * float(rate)])
    found = casadi.Function.deserialize(code.casadi)(
        q=robot.reference, du=du, ddu=[0.0], phi=values
    )
    pose = Dynamics(robot).pose(motor_positions(robot, robot.reference[None])[0])
    smooth = Dynamics(model, values, smoothing=float(rate)).inverse(pose, du, 0 * du)
    np.testing.assert_allclose(found["force"].full()[:, 0], smooth, rtol=1e-12)
    assert 0.5 < smooth[0] / 2.0 < 0.7
