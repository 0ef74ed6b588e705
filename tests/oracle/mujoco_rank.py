"""How many base parameters a robot has, by MuJoCo alone: an oracle for loopid's ranks.

MuJoCo's inverse dynamics is linear in the inertial parameters of a body. Its columns, for one unit
parameter after the other, are projected to the motions that MuJoCo's own constraint Jacobian
allows. Only the closed poses are loopid's, and MuJoCo checks that they are closed.
"""

from itertools import pairwise

import mujoco
import numpy as np
import pinocchio as pin

STEP = 1e-4  # s, of the central difference that gives the rate of the Jacobian
OPEN = 1e-7  # m or rad, beside what the rounding of a file leaves
UNITS = {"full": 10, "gravity": 4}


def text(values):
    return " ".join(repr(float(value)) for value in np.ravel(values))


def place(placement):
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    return f'pos="{text(placement.translation)}" quat="{text((w, x, y, z))}"'


def to_mjcf(robot):
    """Text of an MJCF of a loaded robot; of couplings as of tendons, of hinges as of two points."""
    model = robot.model
    children = [
        [j for j in range(1, model.njoints) if model.parents[j] == k] for k in range(model.njoints)
    ]
    sites = {k: [] for k in range(model.njoints)}
    equalities, tendons = [], []
    for n, closure in enumerate(robot.closures):
        points = {"hinge": 2}.get(closure.kind, 1)
        for side, frame_id in enumerate(closure.frame_ids):
            frame, axis = model.frames[frame_id], np.array(closure.axes[side])
            for p in range(points):
                there = frame.placement * pin.SE3(np.eye(3), 0.1 * p * axis)
                name = f"end{n}_{side}_{p}"
                sites[frame.parentJoint].append(f'<site name="{name}" {place(there)}/>')
        tag = {"3d": "connect", "hinge": "connect", "6d": "weld"}[closure.kind]
        for p in range(points):
            equalities.append(f'<{tag} site1="end{n}_0_{p}" site2="end{n}_1_{p}"/>')
    for n, coupling in enumerate(robot.couplings):
        sums = {"y": coupling.coefficients} | ({"x": coupling.argument} if coupling.powers else {})
        for name, factors in sums.items():
            parts = "".join(
                f'<joint joint="{joint}" coef="{factor!r}"/>'
                for joint, factor in zip(coupling.joints, factors, strict=True)
                if factor
            )
            tendons.append(f'<fixed name="{name}{n}">{parts}</fixed>')
        curve = text([coupling.offset, 0.0, *coupling.powers, 0.0, 0.0, 0.0][:5])
        second = f'tendon2="x{n}"' if coupling.powers else ""
        equalities.append(f'<tendon tendon1="y{n}" {second} polycoef="{curve}"/>')

    def body(k):
        joint, kind = model.joints[k], model.joints[k].shortname().removeprefix("JointModel")
        name, data = model.names[k], model.joints[k].createData()
        joint.calc(data, pin.neutral(model))
        if joint.nv == 1:
            twist = np.asarray(data.S).reshape(6)
            hinge = bool(twist[3:].any())
            axis = text(twist[3:] if hinge else twist[:3])
            tag = f'<joint name="{name}" type="{"hinge" if hinge else "slide"}" axis="{axis}"/>'
        else:
            several = {"Spherical": "ball", "FreeFlyer": "free"}[kind]
            tag = f'<joint name="{name}" type="{several}"/>'
        inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        inner = "".join([tag, inertial, *sites[k], *(body(child) for child in children[k])])
        return f'<body name="body{k}" {place(model.jointPlacements[k])}>{inner}</body>'

    world = "".join(sites[0]) + "".join(body(k) for k in children[0])
    return (
        f'<mujoco><compiler angle="radian"/><option gravity="{text(model.gravity.linear)}"/>'
        f"<worldbody>{world}</worldbody><tendon>{''.join(tendons)}</tendon>"
        f"<equality>{''.join(equalities)}</equality></mujoco>"
    )


def positions(robot, compiled, q):
    """MuJoCo's configuration: quaternions with w first, angles for points on a circle."""
    found = np.zeros(compiled.nq)
    lengths = [compiled.tendon(k).name for k in range(compiled.ntendon)]
    for name in robot.joints:
        joint = robot.joint(name)
        if name.partition("_")[0] in lengths:  # of a tendon, or of a part of one
            continue
        free = joint.shortname() == "JointModelFreeFlyer"  # need not have a name in MuJoCo
        kinds = compiled.jnt_type.tolist()
        number = kinds.index(mujoco.mjtJoint.mjJNT_FREE) if free else compiled.joint(name).id
        start = int(compiled.jnt_qposadr[number])
        own = q[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nv == 1:
            found[start] = np.arctan2(own[1], own[0]) if joint.nq == 2 else own[0]
        else:
            shift = joint.nq - 4
            found[start : start + joint.nq] = [*own[:shift], own[-1], *own[shift:-1]]
    return found


def rates(robot, compiled, q):
    """The map T (nv of MuJoCo, nv) of velocities, and what turning axes add to accelerations."""
    T, kinds = np.zeros((compiled.nv, robot.model.nv)), compiled.jnt_type.tolist()
    for name in robot.joints:
        joint = robot.joint(name)
        if name not in [compiled.joint(k).name for k in range(compiled.njnt)] and joint.nv == 1:
            continue  # a length of a tendon
        free = joint.shortname() == "JointModelFreeFlyer"
        number = kinds.index(mujoco.mjtJoint.mjJNT_FREE) if free else compiled.joint(name).id
        first, own = int(compiled.jnt_dofadr[number]), slice(joint.idx_v, joint.idx_v + joint.nv)
        T[first : first + joint.nv, own] = np.eye(joint.nv)
        if free:  # MuJoCo's linear velocity is along the axes of the world
            turn = pin.Quaternion(q[joint.idx_q + 3 : joint.idx_q + 7]).toRotationMatrix()
            T[first : first + 3, own.start : own.start + 3] = turn

    def turned(v):
        """Accelerations (nv,) at velocities, by axes that turn with a floating base."""
        found = np.zeros(robot.model.nv)
        for name in robot.floating:
            k = robot.joint(name).idx_v
            found[k : k + 3] = np.cross(v[k + 3 : k + 6], v[k : k + 3])
        return found

    return T, turned


class Oracle:
    """A robot in MuJoCo; ``bodies`` are those that carry parameters."""

    def __init__(self, robot, compiled, bodies):
        self.robot, self.model, self.bodies = robot, compiled, bodies
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model.body_sameframe[:] = 0  # as inertial frames will move
        self.data = mujoco.MjData(compiled)

    @classmethod
    def of(cls, robot):
        """Of a robot from an MJCF its own file, of another one its tree and closures."""
        if robot.path.suffix == ".xml":
            compiled = mujoco.MjModel.from_xml_path(str(robot.path))
            return cls(robot, compiled, [compiled.body(link).id for link in robot.links])
        compiled = mujoco.MjModel.from_xml_string(to_mjcf(robot))
        return cls(robot, compiled, [compiled.body(f"body{b.joint_id}").id for b in robot.bodies])

    def jacobian(self, position):
        """Rows (k, nv) of the equalities, which have to hold."""
        self.data.qpos[:] = position
        self.data.qvel[:] = 0
        mujoco.mj_fwdPosition(self.model, self.data)
        equal = self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        left = OPEN + 10 * (self.robot.rounding or 0.0)
        assert np.abs(self.data.efc_pos[equal]).max(initial=0.0) < left
        return self.data.efc_J.reshape(-1, self.model.nv)[equal].copy()

    def motion(self, position, generator):
        """Motions (nv, dof) that are possible, and one velocity and acceleration of them."""
        J = self.jacobian(position)
        _, values, right = (
            np.linalg.svd(J) if len(J) else (None, np.zeros(0), np.eye(self.model.nv))
        )
        rank = int((values > 1e-6 * values.max(initial=0.0)).sum())
        N = right[rank:].T
        v = N @ generator.uniform(-3, 3, N.shape[1])
        a = N @ generator.uniform(-9, 9, N.shape[1])
        if rank:
            rows = []
            for step in (-STEP, STEP):
                near = position.copy()
                mujoco.mj_integratePos(self.model, near, v, step)
                self.data.qpos[:] = near
                mujoco.mj_fwdPosition(self.model, self.data)
                equal = self.data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
                rows.append(self.data.efc_J.reshape(-1, self.model.nv)[equal] @ v)
            drift = (rows[1] - rows[0]) / (2 * STEP)
            a -= np.linalg.pinv(J, rcond=1e-6) @ drift
        return N, v, a

    def forces(self, position, v, a):
        """Forces (nv,) of the smooth inverse dynamics."""
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = position, v, a
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)
        found = np.zeros(self.model.nv)
        mujoco.mj_rne(self.model, self.data, 1, found)
        return found

    def columns(self, position, v, a, count):
        """Forces (nv, bodies count) by unit parameters: mass, three moments, six of inertia."""
        model, found = self.model, []
        names = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
        for name in names:
            getattr(model, name)[:] = 0
        model.body_iquat[:, 0] = 1
        for body in self.bodies:
            model.body_mass[body] = 1
            mass = self.forces(position, v, a)
            inertia = []
            model.body_mass[body] = 0
            turns = [np.eye(3)] * 3 + [pin.exp3(np.pi / 4 * axis) for axis in np.eye(3)]
            for k, turn in enumerate(turns if count > 4 else ()):
                # Off the diagonal, 1 and -1 about axes that are turned by an eighth.
                diagonal = np.eye(3)[k] if k < 3 else np.roll([0.0, 1.0, -1.0], k - 3)
                x, y, z, w = pin.Quaternion(turn).coeffs()
                model.body_iquat[body], model.body_inertia[body] = (w, x, y, z), diagonal
                inertia.append(self.forces(position, v, a))
            model.body_iquat[body], model.body_inertia[body] = (1, 0, 0, 0), 0
            moments = []
            model.body_mass[body] = 1
            for k in range(3):
                forces = []
                for sign in (1, -1):  # even parts are mass and inertia
                    model.body_ipos[body] = sign * np.eye(3)[k]
                    forces.append(self.forces(position, v, a))
                moments.append((forces[0] - forces[1]) / 2)
            model.body_ipos[body], model.body_mass[body] = 0, 0
            found += [mass, *moments, *inertia]
        return np.array(found).T

    def rank(self, configurations, kind="full", seed=0):
        """Rank, and the gap of singular values behind it."""
        generator, rows = np.random.default_rng(seed), []
        inertial = [
            getattr(self.model, n).copy()
            for n in ("body_mass", "body_ipos", "body_iquat", "body_inertia")
        ]
        for q in configurations:
            for name, values in zip(
                ("body_mass", "body_ipos", "body_iquat", "body_inertia"), inertial, strict=True
            ):
                getattr(self.model, name)[:] = values
            position = positions(self.robot, self.model, q)
            N, v, a = self.motion(position, generator)
            if kind == "gravity":
                v, a = np.zeros((2, self.model.nv))
            rows.append(N.T @ self.columns(position, v, a, UNITS[kind]))
        W = np.concatenate(rows)
        norms = np.linalg.norm(W, axis=0)
        W = W[:, norms > 1e-7 * norms.max()]  # central differences leave 1e-8
        values = np.linalg.svd(W / np.linalg.norm(W, axis=0), compute_uv=False)
        values = np.append(values / values[0], 1e-16)
        gaps = [one / max(other, 1e-16) for one, other in pairwise(values)]
        # Central differences leave 1e-8; what is below does not count.
        rank = (
            int(
                np.argmax(
                    [gap if one > 1e-6 else 0.0 for gap, one in zip(gaps, values, strict=False)]
                )
            )
            + 1
        )
        return rank, gaps[rank - 1]
