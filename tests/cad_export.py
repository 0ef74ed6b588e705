"""Robots as a CAD program exports them: link frames anywhere, numbers of a few digits."""

import json

import numpy as np
import pinocchio as pin

from closure_robots import body, urdf

JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
  <limit lower="-7" upper="7" effort="1" velocity="1"/></joint>
"""


def cad_export(robot, digits=6, seed=0):
    """Texts of URDF and YAML of a robot of hinges and slides with points, pins or welds."""
    generator, model = np.random.default_rng(seed), robot.model

    def text(values):
        return " ".join(repr(round(float(value), digits) + 0.0) for value in values)

    def element(name, kind, parent, child, place, axis=(1, 0, 0)):
        rpy = pin.rpy.matrixToRpy(place.rotation)
        return JOINT.format(
            name=name, kind=kind, parent=parent, child=child,
            xyz=text(place.translation), rpy=text(rpy), axis=text(axis),
        )  # fmt: skip

    def turned():
        return pin.SE3(pin.exp3(generator.uniform(-2, 2, 3)), np.zeros(3))

    links, parts = ["ground", *(f"link{k}" for k in range(1, model.njoints))], []
    frames = [pin.SE3.Identity()]  # of the new links in the old ones
    for k in range(1, model.njoints):
        joint, parent = model.joints[k], model.parents[k]
        data = joint.createData()
        joint.calc(data, pin.neutral(model))
        twist = np.asarray(data.S).reshape(6)
        turns = bool(np.abs(twist[3:]).any())
        axis = twist[3:] if turns else twist[:3]
        shift = pin.SE3(np.eye(3), generator.uniform(-0.1, 0.1) * turns * axis)
        frames.append(shift * turned())
        place = frames[parent].inverse() * model.jointPlacements[k] * frames[k]
        kind, axis = "revolute" if turns else "prismatic", frames[k].rotation.T @ axis
        name = model.names[k]
        parts += [body(links[k]), element(name, kind, links[parent], links[k], place, axis)]
    closures = []
    for n, closure in enumerate(robot.closures):
        described, turn = {"type": closure.kind, "frames": [], "axes": []}, turned()
        for side, frame_id, along in zip("ab", closure.frame_ids, closure.axes, strict=True):
            frame, name = model.frames[frame_id], f"end{n}{side}"
            turn = turn if closure.kind in ("6d", "prismatic") else turned()
            place = frames[frame.parentJoint].inverse() * frame.placement * turn
            parent = links[frame.parentJoint]
            parts += [f'<link name="{name}"/>']
            parts += [element(f"{name}_mount", "fixed", parent, name, place)]
            described["frames"].append(name)
            described["axes"].append([float(x) for x in text(turn.rotation.T @ along).split()])
        if closure.kind in ("3d", "6d"):
            del described["axes"]
        closures.append(described)
    values = {name: float(robot.reference[robot.joint(name).idx_q]) for name in robot.joints}
    yaml = {"closures": closures, "name_mot": list(robot.actuated), "reference": values}
    return urdf(*parts), json.dumps({"urdf": "robot.urdf"} | yaml)
