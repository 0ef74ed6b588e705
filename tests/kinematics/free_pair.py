"""Two bodies that fly freely, and the motions that a joint between frames of theirs allows."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.robot import Body, Robot
from loopid.robot.closures import LoopClosure

ROD = 0.4
KINDS = ("3d", "6d", "hinge", "universal", "prismatic", "cylindrical", "2d", "distance")


def unit(vector):
    return tuple((np.array(vector) / np.linalg.norm(vector)).tolist())


def random_rotation(generator):
    return pin.Quaternion(*unit(generator.normal(size=4))).toRotationMatrix()


def free_pair(kind, axes=((0, 0, 1), (0, 0, 1)), fixed=False):
    """A closure of oblique frames on two free bodies, or of the ground and the second one."""
    generator, model = np.random.default_rng(7), pin.Model()
    bodies = [model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), n) for n in "ab"]
    ids = []
    for name, joint in (("at_a", 0 if fixed else bodies[0]), ("at_b", bodies[1])):
        place = pin.SE3(random_rotation(generator), generator.uniform(-0.3, 0.3, size=3))
        ids.append(model.addFrame(pin.Frame(name, joint, 0, place, pin.FrameType.OP_FRAME)))
    numbers = (ROD,) if kind == "distance" else ()
    if kind == "cable":
        rope = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "rope")
        numbers = 0.0, "rope", (model.joints[rope].idx_q, model.joints[rope].idx_v)
    closure = LoopClosure(kind, "at_a", "at_b", tuple(ids), tuple(map(unit, axes)), *numbers)
    links = tuple(Body(model.names[k], k) for k in bodies)
    return Robot("pair", Path(), model, (closure,), (), links, pin.neutral(model))


def at_random(mechanism, generator):
    """Any configuration (1, nq)."""
    return at_poses(mechanism, *(random_pose(generator) for _ in range(2)))


def at_relative(mechanism, relative, generator):
    """A configuration (1, nq) with a given pose of the second frame as the first one sees it."""
    first, second = (mechanism.model.frames[k] for k in mechanism.closures[0].frame_ids)
    base = random_pose(generator)
    held = base if first.parentJoint else pin.SE3.Identity()
    return at_poses(mechanism, base, held * first.placement * relative * second.placement.inverse())


def at_poses(mechanism, first, second):
    q = pin.neutral(mechanism.model)
    q[14:] = ROD  # of a cable
    q[:7], q[7:14] = pin.SE3ToXYZQUAT(first), pin.SE3ToXYZQUAT(second)
    return q[None]


def random_pose(generator):
    return pin.SE3(random_rotation(generator), generator.uniform(-0.5, 0.5, size=3))


def allowed(kind, axes, generator):
    """A relative pose that the joint allows, by the joint's own coordinates."""
    a, b = np.array(unit(axes[0])), np.array(unit(axes[1]))
    turn, other = generator.uniform(-3, 3, size=2)
    along = generator.uniform(-0.5, 0.5) * a
    still, anyhow, none = np.eye(3), random_rotation(generator), np.zeros(3)
    about = pin.exp3(turn * a) @ onto(b, a)
    square = onto(b, unit(np.cross(a, [0.3, -0.2, 0.9])))
    rotation, translation = {
        "3d": (anyhow, none),
        "6d": (still, none),
        "hinge": (about, none),
        "universal": (pin.exp3(turn * a) @ square @ pin.exp3(other * b), none),
        "prismatic": (still, along),
        "cylindrical": (about, along),
        "2d": (anyhow, along),
        "distance": (anyhow, ROD * random_rotation(generator)[0]),
        "cable": (anyhow, ROD * random_rotation(generator)[0]),
    }[kind]
    return pin.SE3(rotation, translation)


def violation(kind, axes, relative):
    """By how much (rad or m) a relative pose is none that the joint allows."""
    a, b = np.array(unit(axes[0])), relative.rotation @ unit(axes[1])
    apart, turned = relative.translation, np.linalg.norm(relative.rotation - np.eye(3))
    beside, pointing = np.linalg.norm(np.cross(a, apart)), np.linalg.norm(a - b)
    at_one_point = np.linalg.norm(apart)
    return {
        "3d": at_one_point,
        "6d": at_one_point + turned,
        "hinge": at_one_point + pointing,
        "universal": at_one_point + abs(a @ b),
        "prismatic": beside + turned,
        "cylindrical": beside + pointing,
        "2d": beside,
        "distance": abs(at_one_point - ROD),
    }[kind]


def relative_pose(mechanism, q):
    """The second frame of the closure as the first one sees it, at a configuration (nq,)."""
    data = mechanism.model.createData()
    pin.framesForwardKinematics(mechanism.model, data, q)
    first, second = (data.oMf[k] for k in mechanism.closures[0].frame_ids)
    return first.actInv(second)


def onto(start, end):
    """A rotation that takes one unit vector to another."""
    return pin.Quaternion.FromTwoVectors(np.array(start), np.array(end)).toRotationMatrix()
