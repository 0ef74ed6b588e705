"""Generated C: the same regressor as Python's, at all poses and for all kinds of joints."""

import ctypes
import importlib.util
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from closure_robots import ROWS, body, chain, files, frame, joint, loop, urdf
from compiled_c import NUMBERS, CompiledRegressor
from loopid import JointTerms, Mechanism, find_force_model, load_mechanism, random_configurations
from loopid.base_parameters import BaseParameters
from loopid.errors import AccuracyWarning, DataError, MissingExtraError, OptionError
from loopid.export import export_regressor, regressor_code
from loopid.identification import ForceModel
from loopid.kinematics import closed_motion, constraint_residual, nearby_configurations
from loopid.regressors import motion_parameters, motion_regressor
from loopid.robot import Body

pytestmark = [
    pytest.mark.skipif(
        importlib.util.find_spec("casadi") is None, reason="needs pip install 'loopid[codegen]'"
    ),
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler called cc"),
    pytest.mark.filterwarnings("ignore::loopid.errors.ModelWarning"),
]
AGREEMENT = 1e-10
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

    def compile_it(model, flags=STRICT, **options):
        folder = tmp_path_factory.mktemp("c")
        return CompiledRegressor(model, regressor_code(model, **options), folder, flags)

    return compile_it


def joint_terms(mechanism, kinds, rates=(0.0, 0.0)):
    joints = [name for name in mechanism.actuated if mechanism.joint(name).nv == 1]
    return JointTerms(tuple(joints), kinds, *rates) if kinds else None


@cache
def force_model(robot, model, kinds=("Ia", "Fc", "Fv", "Fo"), **options):
    """A force model as users have it."""
    mechanism = load_mechanism(robot, **options)
    return find_force_model(mechanism, model, joint_terms(mechanism, kinds), search="qr")


def all_columns(robot, model, kinds=("Ia", "Fc", "Fv", "Fo"), rates=(0.0, 0.0), **options):
    """All standard parameters as if they were base parameters: nothing is left out."""
    mechanism = robot if isinstance(robot, Mechanism) else load_mechanism(robot, **options)
    terms = joint_terms(mechanism, kinds, rates)
    names = motion_parameters(mechanism, model, terms)
    p = len(names)
    whole, nothing = np.arange(p), np.arange(0)
    base = BaseParameters(names, None, whole, nothing, np.zeros((p, 0)), None)
    return ForceModel(mechanism, model, terms, base)


def around_reference(model):
    """Motion through closed poses around the reference, which are fast to find."""
    mechanism = model.mechanism
    q = nearby_configurations(mechanism, mechanism.reference)
    rates = np.random.default_rng(6).standard_normal((2, len(q), len(mechanism.independent)))
    return closed_motion(mechanism, q, *rates)


def moved(model, count=20):
    """Random motion through closed poses."""
    mechanism = model.mechanism
    q = random_configurations(mechanism, count, seed=5)
    rates = np.random.default_rng(6).standard_normal((2, count, len(mechanism.independent)))
    return closed_motion(mechanism, q, *rates)


def residuals(regressor, q):
    """Largest closure residuals (N,) in m at configurations (N, nq)."""
    call = regressor.function("closure_residual", ctypes.c_double, 1)
    return np.array([call(row.ctypes.data_as(NUMBERS)) for row in np.ascontiguousarray(q)])


def assert_agrees(model, regressor, motion=None):
    motion = moved(model) if motion is None else motion
    W = motion_regressor(model.mechanism, motion, model.model, joint_terms=model.joint_terms)
    expected = model.base.regressor(W)
    state = motion.configurations, motion.velocities, motion.accelerations
    K, status = regressor(*state)
    assert not status.any()
    scale = np.abs(expected).max(axis=(0, 1))
    scale = np.maximum(scale, 1e-3 * scale.max())  # columns without an effect are there too
    assert (np.abs(K - expected) / scale).max() < AGREEMENT
    assert residuals(regressor, motion.configurations).max() < 1e-9


@pytest.mark.parametrize(
    ("robot", "model"),
    [
        ("3ups_rpu", "gravity"),
        ("five_bar", "full"),
        pytest.param("6ups", "full", marks=pytest.mark.validate),
        pytest.param("delta", "gravity", marks=pytest.mark.validate),
    ],
)
def test_robots_with_loops(compiled, robot, model):
    found = all_columns(robot, model)
    assert_agrees(found, compiled(found), around_reference(found))


@pytest.mark.parametrize("model", ["gravity", "full"])
def test_a_tree(compiled, robot_data, model):
    path = robot_data / "ur_description" / "urdf" / "ur10_robot.urdf"
    found = force_model(path, model)
    assert_agrees(found, compiled(found))


@pytest.mark.parametrize("rates", [(0.3, 0.0), (0.2, 0.4)])
def test_friction_at_low_rates(compiled, rates):
    found = all_columns("five_bar", "gravity", ("Fc", "Fv"), rates)
    assert_agrees(found, compiled(found), around_reference(found))


def test_all_kinds_of_joint_terms(compiled):
    found = all_columns(
        "five_bar", "gravity", ("Ia", "Fc+", "Fc-", "Fc~0.3", "Fs~0.5", "Ks3", "Ks@1.2")
    )
    assert_agrees(found, compiled(found), around_reference(found))


def test_tied_links(compiled):
    found = all_columns("3rrr", "full", tied=True)
    assert_agrees(found, compiled(found), around_reference(found))


@pytest.mark.parametrize("kind", [*ROWS, "coupling", "cam"])
def test_every_kind_of_closure(compiled, tmp_path, kind):
    couplings = {"coupling": (chain(3), GEAR), "cam": (chain(3), CAM)}
    parts, description = couplings.get(kind) or loop(kind)
    for name, text in zip(("robot.urdf", "robot.yaml"), files(parts, description), strict=True):
        (tmp_path / name).write_text(text)
    # Closures are the same in both models.
    found = all_columns(tmp_path / "robot.yaml", "gravity", ("Fv",))
    call = compiled(found)
    assert_agrees(found, call, around_reference(found))
    # Open closures are measured in the same units.
    mechanism = found.mechanism
    q = mechanism.reference + np.random.default_rng(0).uniform(-0.2, 0.2, (5, mechanism.model.nq))
    gaps = np.abs(constraint_residual(mechanism, q) * mechanism.row_scales).max(axis=1)
    np.testing.assert_allclose(residuals(call, q), gaps, rtol=1e-9)


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
    assert len(found.mechanism.independent) > 3
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
    kinds = {found.mechanism.joint(name).shortname() for name in found.mechanism.joints}
    assert {"JointModelFreeFlyer", "JointModelPlanar", "JointModelSpherical"} < kinds
    assert found.mechanism.model.nq > found.mechanism.model.nv
    assert_agrees(found, compiled(found))


def test_joints_that_are_several(compiled):
    """Composite joints, three angles, screws: made by hand, as no file has them."""
    pin.seed(0)
    model, rng = pin.Model(), np.random.default_rng(0)
    pair = pin.JointModelComposite()
    pair.addJoint(pin.JointModelRX(), pin.SE3.Random())
    pair.addJoint(pin.JointModelPZ(), pin.SE3.Random())
    pair.addJoint(pin.JointModelRUBY(), pin.SE3.Random())
    pair.addJoint(pin.JointModelSphericalZYX(), pin.SE3.Random())
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    kinds = (
        pair,
        pin.JointModelSphericalZYX(),
        pin.JointModelTranslation(),
        pin.JointModelUniversal(axes[0], axes[1]),
        pin.JointModelHZ(0.3),
        pin.JointModelHelicalUnaligned(axes[2], 0.2),
    )
    parent, bodies = 0, []
    for k, kind in enumerate(kinds):
        parent = model.addJoint(parent, kind, pin.SE3.Random(), f"joint{k}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        bodies.append(Body(f"link{k}", parent))
    names = tuple(f"joint{k}" for k in range(len(kinds)))
    mechanism = Mechanism(
        "hand made", Path("none"), model, (), names, tuple(bodies), pin.neutral(model)
    )
    q = np.array(
        [pin.integrate(model, pin.neutral(model), v) for v in rng.uniform(-1, 1, (40, model.nv))]
    )
    motion = closed_motion(mechanism, q, *rng.standard_normal((2, 40, model.nv)))
    found = all_columns(mechanism, "full", ())
    assert_agrees(found, compiled(found), motion)


def test_singular_poses_are_told(compiled):
    found = force_model("parallelogram", "full", ())
    mechanism, call = found.mechanism, compiled(found)
    # All bars in a line: the motor loses control of the coupler.
    line = mechanism.reference[:2].sum()
    still = np.zeros((1, 3))
    for apart, expected in ((0.0, 2), (1e-12, 2), (1e-5, 1), (0.3, 0)):
        q = np.array([[line + apart, -apart, line + apart]])
        assert residuals(call, q)[0] < 1e-9
        K, status = call(q, still, still)
        assert status[0] == expected
        assert np.isnan(K).all() == (expected == 2)
        if expected == 1:
            with pytest.warns(AccuracyWarning):
                motion = closed_motion(mechanism, q, [[0.0]], [[0.0]])
            W = motion_regressor(mechanism, motion, "full")
            np.testing.assert_allclose(K, found.base.regressor(W), rtol=1e-6, atol=1e-6)


def test_what_is_not_finite_is_told(compiled):
    found = force_model("five_bar", "full", ())
    call, motion = compiled(found), moved(found, 1)
    good = motion.configurations[0], motion.velocities[0], motion.accelerations[0]
    for k in range(3):
        state = [part.copy() for part in good]
        state[k][1] = np.nan
        K = np.zeros((2, len(found.parameters)))
        status = call.function("regressor", ctypes.c_int, 4)(
            *(part.ctypes.data_as(NUMBERS) for part in (*state, K))
        )
        assert status == 3
        assert np.isnan(K).all()
        if k == 0:
            residual = call.function("closure_residual", ctypes.c_double, 1)
            assert np.isnan(residual(state[0].ctypes.data_as(NUMBERS)))


def test_forces_and_values(compiled):
    found = force_model("five_bar", "full")
    values = found.prior + np.arange(len(found.prior)) / 7
    call, motion = compiled(found, values=values), moved(found)
    kept = (ctypes.c_double * len(values)).in_dll(call.library, "five_bar_values")
    np.testing.assert_array_equal(np.array(kept), values)
    states = (motion.configurations[0], motion.velocities[0], motion.accelerations[0])
    numbers = [np.ascontiguousarray(part) for part in (*states, values, np.zeros(2))]
    forces = call.function("forces", ctypes.c_int, 5)
    assert forces(*(part.ctypes.data_as(NUMBERS) for part in numbers)) == 0
    K, _ = call(*(part[None] for part in states))
    np.testing.assert_allclose(numbers[-1], K[0] @ values, rtol=1e-12)


@pytest.mark.parametrize(
    "flags", [STRICT, (*STRICT, "-trigraphs"), ("-Wall", "-Wextra", "-Werror")]
)
def test_names_are_texts_and_nothing_else(tmp_path, flags):
    """Readers refuse such names; other programs may make mechanisms, too."""
    model, bodies, parent = pin.Model(), [], 0
    for name in HOSTILE:
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3.Random(), name)
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        bodies.append(Body(name, parent))
    mechanism = Mechanism(
        HOSTILE[1], Path("none"), model, (), HOSTILE, tuple(bodies), pin.neutral(model)
    )
    found = all_columns(mechanism, "full", ("Fv",))
    code = regressor_code(found)
    assert code.name.isidentifier()
    assert (code.header + code.source).isascii()
    compiled = CompiledRegressor(found, code, tmp_path, flags)
    library = compiled.library
    assert not hasattr(library, "injected")
    texts = ctypes.c_char_p * len(HOSTILE)
    rows = texts.in_dll(library, f"{code.name}_row_names")
    assert [row.decode() for row in rows] == list(HOSTILE)
    motion = np.zeros((1, model.nv))
    assert not compiled(pin.neutral(model)[None], motion, motion)[1].any()


def test_long_texts_are_cut(tmp_path):
    found = force_model("five_bar", "gravity", ())
    long = replace(found, mechanism=replace(found.mechanism, name="ö" * 5000))
    code = regressor_code(long)
    compiled = CompiledRegressor(long, code, tmp_path, STRICT)
    text = ctypes.c_char.in_dll(compiled.library, f"{code.name}_robot")
    assert ctypes.string_at(ctypes.addressof(text)).endswith(b"...")
    named = replace(found, mechanism=replace(found.mechanism, name="x" * 5000))
    assert len(regressor_code(named).name) < 100  # of files


def test_two_robots_and_cpp_in_one_program(tmp_path):
    names = ("five_bar", "four_bar")
    for robot in names:
        export_regressor(force_model(robot, "gravity", ()), tmp_path)
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
    assert regressor_code(found) == regressor_code(found)


def test_refusals(monkeypatch):
    found = force_model("five_bar", "gravity", ())
    for name in ("1bar", "five bar", "", "é", "a__b", "a_"):
        with pytest.raises(OptionError, match="letters and digits"):
            regressor_code(found, name=name)
    with pytest.raises(DataError, match=r"shape \(\d+,\), not \(2,\)"):
        regressor_code(found, values=np.zeros(2))
    with pytest.raises(DataError, match="finite"):
        regressor_code(found, values=found.prior * np.nan)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(MissingExtraError, match=r"loopid\[codegen\]"):
        regressor_code(found)
