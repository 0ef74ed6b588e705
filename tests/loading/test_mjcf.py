"""MJCF files: Pinocchio's model moves as MuJoCo's, and closures close where equalities hold."""

import importlib
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings, strategies as st
from numpy.polynomial import Polynomial

mujoco = pytest.importorskip("mujoco", reason="needs pip install 'loopid[mjcf]'")
read_mjcf = importlib.import_module("loopid.formats.mjcf").read_mjcf

FREE, BALL, SLIDE, HINGE = range(4)
SHARED = ("cassie", "robotiq_2f85")

# Anchors off the origin, oblique axes, references, joints in a chain, welded bodies, two roots.
ZOO = """<mujoco model="zoo">
<compiler angle="degree" autolimits="true"/>
<option gravity="1 -2 -9"/>
<worldbody>
  <body name="stand" pos="0.1 0 0.2" euler="10 20 30">
    <inertial pos="0 0 0.1" mass="3" diaginertia="0.1 0.1 0.1"/>
    <body name="arm" pos="0.3 0 0.1" quat="0.9 0.1 -0.3 0.2">
      <inertial pos="0.1 -0.2 0.3" mass="2" fullinertia="0.3 0.2 0.25 0.01 0.02 -0.03"/>
      <joint name="slant" axis="1 2 -1" pos="0.05 0.1 -0.2" ref="25" range="-60 50"/>
      <joint name="rail" type="slide" axis="0 1 0" pos="0.4 0 0.1" ref="0.3" range="-1 1"/>
      <joint name="turn" axis="0 0 1" pos="-0.1 0.2 0"/>
      <body name="hand" pos="0 0.5 0">
        <inertial pos="0 0 0.05" mass="0.4" diaginertia="0.01 0.02 0.015"/>
        <body name="finger" pos="0 0.1 0" euler="0 40 0">
          <inertial pos="0.02 0 0" mass="0.1" diaginertia="0.001 0.001 0.001"/>
          <joint name="knuckle" axis="0 0 -1" pos="0 0 0.03" ref="-70"/>
        </body>
      </body>
      <body name="tail" pos="-0.2 0.1 0">
        <inertial pos="0.1 0 0" mass="0.7" diaginertia="0.02 0.02 0.03"/>
        <joint name="socket" type="ball" pos="0.02 -0.03 0.04"/>
        <joint name="piston" type="slide" axis="1 1 0" ref="0.1"/>
      </body>
    </body>
  </body>
  <body name="drone" pos="1 2 3" quat="0.7 0.1 0.7 0">
    <inertial pos="0.02 0 0.01" mass="1.1" diaginertia="0.03 0.02 0.04"/>
    <freejoint name="flight"/>
    <body name="gimbal" pos="0 0 -0.1" euler="0 0 90">
      <inertial pos="0 0.01 0" mass="0.2" diaginertia="0.001 0.002 0.003"/>
      <joint name="tilt" axis="1 0 0"/>
      <site name="lens" pos="0.1 0.2 0.3" euler="30 0 0"/>
      <site name="cap" pos="-0.1 0 0.1" euler="0 50 0"/>
    </body>
  </body>
</worldbody>
<tendon>
  <fixed name="belt"><joint joint="slant" coef="2"/><joint joint="turn" coef="-0.5"/></fixed>
  <fixed name="rope"><joint joint="knuckle" coef="3"/><joint joint="turn" coef="1"/></fixed>
</tendon>
<equality>
  <connect name="pin" body1="finger" body2="tail" anchor="0.1 0.2 0.3"/>
  <connect body1="finger" anchor="0.1 0 0"/>
  <connect name="eye" site1="lens" site2="cap"/>
  <weld name="glue" body1="gimbal" body2="tail" anchor="0.3 0.2 0.1"
        relpose="0.1 0.2 0.3 0.8 0.1 0.2 -0.3" torquescale="0.7"/>
  <weld name="hold" body1="arm" body2="drone"/>
  <weld name="tack" body1="arm" torquescale="0"/>
  <weld name="stick" site1="lens" site2="cap"/>
  <joint name="gear" joint1="knuckle" joint2="slant" polycoef="0.1 -2.5 0 0 0"/>
  <joint name="brake" joint1="piston" polycoef="0.2 7 3 0 0"/>
  <tendon name="drive" tendon1="belt" tendon2="rope" polycoef="0.3 0.6 0 0 0"/>
  <tendon name="stay" tendon1="belt" polycoef="0.4 0 0 0 0"/>
</equality>
</mujoco>"""


@pytest.fixture(params=["zoo", *SHARED])
def file(request, tmp_path):
    if request.param == "zoo":
        (tmp_path / "zoo.xml").write_text(ZOO)
        return tmp_path / "zoo.xml"
    return request.getfixturevalue("shared") / "models" / "mjcf" / f"{request.param}.xml"


def bare(file):
    """MuJoCo's model, rid of every force but gravity and inertia, and its data."""
    model = mujoco.MjModel.from_xml_path(str(file))
    for forces in ("dof_damping", "dof_armature", "dof_frictionloss", "jnt_stiffness"):
        getattr(model, forces)[:] = 0
    model.body_gravcomp[:] = 0
    return model, mujoco.MjData(model)


def joints_of(model):
    """Kinds of MuJoCo's joints with slices of their positions and velocities."""
    for kind, q, v in zip(model.jnt_type, model.jnt_qposadr, model.jnt_dofadr, strict=True):
        sizes = {FREE: (7, 6), BALL: (4, 3)}.get(int(kind), (1, 1))
        yield int(kind), slice(q, q + sizes[0]), slice(v, v + sizes[1])


def random_state(model, generator):
    """Positions, velocities and accelerations, anywhere."""
    qpos = generator.uniform(-1.5, 1.5, model.nq)
    for kind, q, _ in joints_of(model):
        if kind in (FREE, BALL):
            turn = slice(q.stop - 4, q.stop)
            qpos[turn] = generator.normal(size=4)
            qpos[turn] /= np.linalg.norm(qpos[turn])
    return qpos, *generator.normal(size=(2, model.nv))


def to_pinocchio(model, qpos, qvel, qacc):
    """The same motion in Pinocchio's coordinates, and the map of its forces back to MuJoCo's.

    Pinocchio keeps w last, and the velocity of a free joint wholly in the body frame; MuJoCo keeps
    its linear part in the world frame.
    """
    q, v, a, back = qpos.copy(), qvel.copy(), qacc.copy(), np.eye(model.nv)
    for kind, at, vs in joints_of(model):
        if kind in (FREE, BALL):
            w, *xyz = qpos[at.stop - 4 : at.stop]
            q[at.stop - 4 : at.stop] = [*xyz, w]
        if kind == FREE:
            turn = pin.Quaternion(w, *xyz).toRotationMatrix()
            linear, angular = slice(vs.start, vs.start + 3), qvel[vs.start + 3 : vs.stop]
            v[linear] = turn.T @ qvel[linear]
            a[linear] = turn.T @ qacc[linear] - np.cross(angular, v[linear])
            back[linear, linear] = turn
    return q, v, a, back


def moved(source, model, data, generator):
    """Put both models into the same random state."""
    qpos, qvel, qacc = random_state(model, generator)
    data.qpos[:], data.qvel[:], data.qacc[:] = qpos, qvel, qacc
    q, v, a, back = to_pinocchio(model, qpos, qvel, qacc)
    mine = source.model.createData()
    pin.framesForwardKinematics(source.model, mine, q)
    return SimpleNamespace(q=q, v=v, a=a, back=back, data=mine)


def assert_same_forces(source, model, data, generator):
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    state = moved(source, model, data, generator)
    mujoco.mj_inverse(model, data)
    forces = pin.rnea(source.model, state.data, state.q, state.v, state.a)
    scale = np.abs(data.qfrc_inverse).max()
    np.testing.assert_allclose(state.back @ forces, data.qfrc_inverse, rtol=0, atol=1e-11 * scale)
    assert scale > 1e-3


def assert_same_places(source, model, data, generator):
    state = moved(source, model, data, generator)
    mujoco.mj_kinematics(model, data)
    bodies = [i for i, f in enumerate(source.model.frames) if f.type == pin.FrameType.BODY]
    named = {source.model.frames[i].name: state.data.oMf[i] for i in bodies}
    for body in range(model.nbody):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body)
        if name is None:
            continue
        np.testing.assert_allclose(named[name].translation, data.xpos[body], atol=1e-12)
        np.testing.assert_allclose(named[name].rotation.ravel(), data.xmat[body], atol=1e-12)


def residual(source, state, closure, torque_scale):
    """What MuJoCo calls the position of an equality, from a closure."""
    model = source.model
    if closure.type == "coupling":
        at = {joint: model.joints[model.getJointId(joint)].idx_q for joint in list(model.names)[1:]}
        y, s = (
            sum(factor * state.q[at[joint]] for joint, factor in (terms or {}).items())
            for terms in (closure.joints, closure.of)
        )
        return np.array([y - Polynomial(closure.polynomial or [closure.offset])(s)])
    one, two = (state.data.oMf[model.getFrameId(name)] for name in closure.frames)
    gap = one.translation - two.translation
    if closure.type == "3d":
        return gap
    turn = pin.Quaternion(two.rotation.T @ one.rotation)
    return np.concatenate([gap, torque_scale * turn.vec()])


def assert_same_residuals(source, model, data, generator):
    state = moved(source, model, data, generator)
    mujoco.mj_fwdPosition(model, data)
    own = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
    closures = source.description.closures
    for equality, closure in enumerate(closures):
        theirs = data.efc_pos[own & (data.efc_id == equality)]
        ours = residual(source, state, closure, model.eq_data[equality, 10])
        # A quaternion and its negative are one rotation.
        ours[3:] *= np.sign(ours[3:] @ theirs[3 : len(ours)]) if len(ours) > 3 else 1
        np.testing.assert_allclose(ours, theirs[: len(ours)], rtol=0, atol=1e-11)
        np.testing.assert_array_equal(theirs[len(ours) :], 0)
        assert np.abs(theirs).max() > 1e-6
    assert len(closures) == model.neq


def test_it_moves_as_in_mujoco(file):
    source, (model, data) = read_mjcf(file), bare(file)
    for seed in range(5):
        generator = np.random.default_rng(seed)
        assert_same_places(source, model, data, generator)
        assert_same_residuals(source, model, data, generator)
    for seed in range(5):  # last, as it switches the constraints off
        assert_same_forces(source, model, data, np.random.default_rng(seed))


def numbers(generator, count=3):
    return " ".join(map(repr, generator.normal(size=count).tolist()))


def body_text(generator, name, kinds, children=""):
    """A random body that moves by joints of the kinds."""
    joints = "<freejoint/>" if kinds == ["free"] else ""
    for kind in kinds if not joints else ():
        ref = "" if kind == "ball" else f'ref="{generator.normal()}"'
        places = f'pos="{numbers(generator)}" axis="{numbers(generator)}"'
        joints += f'<joint type="{kind}" {places} {ref}/>'
    mass, moments = generator.uniform(1, 2), generator.uniform(0.5, 0.7, 3).tolist()
    return f"""<body name="{name}" pos="{numbers(generator)}" quat="{numbers(generator, 4)}">
      <inertial pos="{numbers(generator)}" quat="{numbers(generator, 4)}" mass="{mass}"
        diaginertia="{" ".join(map(repr, moments))}"/>{joints}{children}</body>"""


def tree_text(generator, name, tree):
    kinds, children = tree
    parts = [tree_text(generator, f"{name}{i}", child) for i, child in enumerate(children)]
    return body_text(generator, name, kinds, "".join(parts))


def equality_text(generator, one, two):
    anchor, pose = numbers(generator), numbers(generator, 7)
    return f"""<equality><connect body1="{one}" body2="{two}" anchor="{anchor}"/>
      <weld body1="{one}" body2="{two}" anchor="{anchor}" relpose="{pose}"/></equality>"""


# MuJoCo refuses rotations behind a ball.
KINDS = st.builds(
    list.__add__,
    st.lists(st.sampled_from(["hinge", "slide"]), max_size=2),
    st.sampled_from([[], ["ball"]]),
)
TREES = st.recursive(
    st.tuples(KINDS, st.just([])),
    lambda tree: st.tuples(KINDS, st.lists(tree, min_size=1, max_size=3)),
    max_leaves=5,
)


@settings(max_examples=12)
@given(
    trees=st.lists(TREES, min_size=1, max_size=3),
    last=st.sampled_from(["free", "hinge", "slide", "ball"]),
    seed=st.integers(0, 2**32 - 1),
)
def test_random_trees_move_as_in_mujoco(trees, last, seed, tmp_path_factory):
    generator = np.random.default_rng(seed)
    bodies = [tree_text(generator, f"b{i}_", tree) for i, tree in enumerate(trees)]
    bodies.append(body_text(generator, "last", [last]))
    file = tmp_path_factory.getbasetemp() / "random.xml"
    file.write_text(
        f"""<mujoco><compiler angle="radian"/><worldbody>{"".join(bodies)}</worldbody>
        {equality_text(generator, "b0_", "last")}</mujoco>"""
    )
    source, (model, data) = read_mjcf(file), bare(file)
    assert_same_places(source, model, data, generator)
    assert_same_residuals(source, model, data, generator)
    assert_same_forces(source, model, data, generator)
