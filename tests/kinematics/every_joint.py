"""Random trees of all kinds of joints that Pinocchio has, with a frame on every body."""

from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.robot import Robot

JOINTS = 12


def random_tree(seed, base=0.0):
    """A mechanism without closures; its root may be far from the fixed origin, in m."""
    generator, model = np.random.default_rng(seed), pin.Model()
    kinds, joints = joint_kinds(generator), [0]
    for k in range(JOINTS):
        parent = joints[generator.integers(len(joints))]
        place = random_placement(generator)
        place.translation += base if parent == 0 else 0.0
        kind = kinds[generator.integers(len(kinds))]
        joints.append(model.addJoint(parent, kind, place, f"joint{k}"))
        model.appendBodyToJoint(joints[-1], pin.Inertia.Random(), pin.SE3.Identity())
    frames = [
        model.addFrame(pin.Frame(f"f{k}", k, 0, random_placement(generator), pin.OP_FRAME))
        for k in joints
    ]
    return Robot("tree", Path(), model, (), (), (), pin.neutral(model)), frames


def joint_kinds(generator):
    axis = generator.normal(size=3)
    axis /= np.linalg.norm(axis)
    composite = pin.JointModelComposite()
    composite.addJoint(pin.JointModelRX(), random_placement(generator))
    composite.addJoint(pin.JointModelPY(), random_placement(generator))
    return [
        *(
            getattr(pin, f"JointModel{kind}{letter}")()
            for kind in ("R", "RUB", "P")
            for letter in "XYZ"
        ),
        pin.JointModelRevoluteUnaligned(*axis),
        pin.JointModelPrismaticUnaligned(*axis),
        pin.JointModelHelicalUnaligned(*axis, 0.3),
        pin.JointModelUniversal(1, 0, 0, 0, 1, 0),
        pin.JointModelSpherical(),
        pin.JointModelSphericalZYX(),
        pin.JointModelFreeFlyer(),
        pin.JointModelPlanar(),
        pin.JointModelTranslation(),
        composite,
    ]


def random_placement(generator):
    turn = pin.Quaternion(generator.normal(size=4)).normalized()
    return pin.SE3(turn.toRotationMatrix(), generator.uniform(-1, 1, size=3))


def random_states(mechanism, count, generator):
    """Configurations (N, nq) and velocities (N, nv)."""
    steps = generator.normal(size=(count, mechanism.model.nv))
    q = [pin.integrate(mechanism.model, mechanism.reference, step) for step in steps]
    return np.array(q), generator.normal(size=steps.shape)
