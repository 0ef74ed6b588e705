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
    """Texts of URDF and YAML of a robot of hinges and slides, with other link frames."""
    generator, model = np.random.default_rng(seed), robot.model
    data = model.createData()
    turns = [pin.SE3.Identity()]
    axes = [np.zeros(3)]
    for k in range(1, model.njoints):
        joint, calc = model.joints[k], model.joints[k].createData()
        joint.calc(calc, pin.neutral(model))
        S = np.asarray(calc.S).reshape(6)
        axis = S[3:] if np.abs(S[3:]).any() else S[:3]
        along = generator.uniform(-0.1, 0.1) if np.abs(S[3:]).any() else 0.0
        turn = pin.exp3(generator.uniform(-2, 2, 3))
        turns.append(pin.SE3(turn, along * axis))
        axes.append(turn.T @ axis)

    def number(values):
        return " ".join(repr(round(float(value), digits) + 0.0) for value in values)

    def origin(place):
        return {
            "xyz": number(place.translation),
            "rpy": number(pin.rpy.matrixToRpy(place.rotation)),
        }

    links, parts = ["ground", *(f"link{k}" for k in range(1, model.njoints))], []
    for k in range(1, model.njoints):
        kind = (
            "revolute"
            if "R" in model.joints[k].shortname().removeprefix("JointModel")
            else "prismatic"
        )
        place = turns[model.parents[k]].inverse() * model.jointPlacements[k] * turns[k]
        fields = {
            "name": model.names[k],
            "kind": kind,
            "parent": links[model.parents[k]],
            "child": links[k],
        }
        parts += [body(links[k]), JOINT.format(**fields, axis=number(axes[k]), **origin(place))]
    pin.framesForwardKinematics(model, data, robot.reference)
    closures = []
    for n, closure in enumerate(robot.closures):
        described = {"type": closure.kind, "frames": []}
        relative = None
        for side, frame_id in zip("ab", closure.frame_ids, strict=True):
            frame = model.frames[frame_id]
            turn = pin.SE3(pin.exp3(generator.uniform(-2, 2, 3)), np.zeros(3))
            if closure.kind in ("6d", "prismatic"):
                turn = (
                    pin.SE3(relative or turn.rotation, np.zeros(3))
                    if relative is None
                    else relative
                )
                relative = turn
            name = f"end{n}{side}"
            place = turns[frame.parentJoint].inverse() * frame.placement * turn
            mount = {
                "name": f"{name}_mount",
                "kind": "fixed",
                "parent": links[frame.parentJoint],
                "child": name,
            }
            text = JOINT.format(**mount, axis="1 0 0", **origin(place))
            parts += [f'<link name="{name}"/>', text]
            described["frames"].append(name)
            axis = np.array(closure.axes["ab".index(side)])
            described.setdefault("axes", []).append(
                [round(float(x), digits) for x in turn.rotation.T @ axis]
            )
        if closure.kind in ("3d", "6d", "distance"):
            del described["axes"]
        if closure.length:
            described["length"] = round(closure.length, digits)
        closures.append(described)
    reference = {name: float(robot.reference[robot.joint(name).idx_q]) for name in robot.joints}
    yaml = {
        "urdf": "robot.urdf",
        "closures": closures,
        "name_mot": list(robot.actuated),
        "reference": reference,
    }
    return urdf(*parts), json.dumps(yaml)
