"""Small robots for every kind of closure: URDF text, and YAML beside it."""

import json
import re
from itertools import pairwise

import numpy as np
import pinocchio as pin

X, Y, Z = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
ROWS = {
    "3d": 3,
    "6d": 6,
    "hinge": 5,
    "universal": 4,
    "prismatic": 5,
    "cylindrical": 4,
    "2d": 2,
    "distance": 1,
    "cable": 1,
}
ROD = 0.5  # m, length of rods
SKEW = "0.4 -0.9 0.3"  # turn of the frame that planar linkages lie in, so that gravity is anywhere
BODY = """<link name="{name}"><inertial>
  <origin xyz="{centre}" rpy="0 0 0"/><mass value="{mass}"/>
  <inertia ixx="0.02" ixy="0.001" ixz="0.002" iyy="0.03" iyz="-0.001" izz="0.025"/>
</inertial></link>
"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>
"""
LIMIT = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'


def numbers(values):
    return values if isinstance(values, str) else " ".join(repr(float(value)) for value in values)


def body(name, centre=(0.1, 0.02, -0.03), mass=1.0):
    return BODY.format(name=name, centre=numbers(centre), mass=mass)


def unit(axis):
    return (np.array(axis) / np.linalg.norm(axis)).tolist()


def joint(
    name, parent, child, xyz=(0, 0, 0), axis=Z, kind="revolute", rpy=(0, 0, 0), limits=(-3, 3)
):
    limit = "" if kind in ("fixed", "continuous") else LIMIT.format(*limits)
    texts = (numbers(values) for values in (xyz, unit(axis), rpy))
    fields = dict(zip(("xyz", "axis", "rpy"), texts, strict=True))
    return JOINT.format(name=name, kind=kind, parent=parent, child=child, limit=limit, **fields)


def frame(name, parent, xyz=(0, 0, 0), rpy=(0, 0, 0)):
    """A link without mass, to tie a closure to."""
    mount = joint(f"{name}_mount", parent, name, xyz, kind="fixed", rpy=rpy)
    return f'<link name="{name}"/>\n{mount}'


def urdf(*parts):
    return f'<robot name="small"><link name="ground"/>\n{"".join(parts)}</robot>\n'


def files(parts, description):
    """Texts of a robot's URDF and of its YAML, of which JSON is a part."""
    return urdf(*parts), json.dumps({"urdf": "robot.urdf", **description})


def in_millimetres(parts, description):
    """The same robot with all its lengths in mm; its inertias stay as they are."""
    sliding = re.findall('joint name="(.*?)" type="prismatic"', "".join(parts))
    units = dict.fromkeys(sliding, 1000.0)
    reference = {name: units.get(name, 1) * q for name, q in description["reference"].items()}
    closures = [_closure_in_millimetres(closure, units) for closure in description["closures"]]
    changed = {"reference": reference, "closures": closures}
    return [_part_in_millimetres(part) for part in parts], description | changed


def _part_in_millimetres(part):
    lengths = r'(origin xyz)="(.*?)"'
    if 'type="prismatic"' in part:
        lengths = r'(origin xyz|lower|upper)="(.*?)"'

    def scaled(match):
        values = [1000 * float(value) for value in match[2].split()]
        return f'{match[1]}="{numbers(values)}"'

    return re.sub(lengths, scaled, part)


def _closure_in_millimetres(closure, units):
    if "joints" in closure:
        joints = {name: c / units.get(name, 1) for name, c in closure["joints"].items()}
        return closure | {"joints": joints}
    return closure | {"length": 1000 * closure["length"]} if "length" in closure else closure


def tie(kind, frames, **more):
    return {"type": kind, "frames": list(frames), **more}


def chain(count, seed=0, sliding=()):
    """Bodies and joints in a row, from the ground, of random oblique geometry."""
    generator = np.random.default_rng(seed)
    links = ["ground", *(f"link{k}" for k in range(1, count + 1))]
    parts = []
    for k, (parent, child) in enumerate(pairwise(links), start=1):
        xyz, rpy, axis = generator.uniform(-1, 1, size=(3, 3)) * [[0.3], [1.5], [1.0]]
        kind = "prismatic" if k in sliding else "revolute"
        parts += [body(child, 0.3 * rpy), joint(f"joint{k}", parent, child, xyz, axis, kind, rpy)]
    return parts


def loop(kind, seed=0, axes=None):
    """A row of bodies whose end is tied to the ground, with one degree of freedom.

    A cable takes none: two motors move the end.

    Its closure is at rest by construction: the frame on the ground is put where the end is.
    """
    count = ROWS[kind] + 1
    sliding = (2,) if count > 3 else ()
    end = frame("end", f"link{count}", (0.2, -0.1, 0.15), (0.3, 0.5, -0.4))
    parts = [*chain(count, seed, sliding), end]
    model = pin.buildModelFromXML(urdf(*parts))
    angles = np.random.default_rng(seed + 1).uniform(-0.6, 0.6, size=model.nq)
    data = model.createData()
    pin.framesForwardKinematics(model, data, angles)
    place = data.oMf[model.getFrameId("end")]
    apart = [0, 0.6 * ROD, 0.8 * ROD] if kind in ("distance", "cable") else [0, 0, 0]
    parts.append(
        frame("pivot", "ground", place.act(np.array(apart)), pin.rpy.matrixToRpy(place.rotation))
    )
    more = {"axes": [unit(axis) for axis in axes]} if axes else {}
    if kind == "distance":
        more["length"] = ROD
    reference = dict(zip(list(model.names)[1:], angles.tolist(), strict=True))
    if kind == "cable":
        cables = {"rope": ["end", "pivot"]}
        return parts, {"cables": cables, "name_mot": ["rope", "joint1"], "reference": reference}
    return parts, {
        "closures": [tie(kind, ("end", "pivot"), **more)],
        "name_mot": ["joint1"],
        "reference": reference,
    }
