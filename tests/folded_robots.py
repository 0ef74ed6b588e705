"""Robots drawn folded: closed at their zero pose, where assembly modes meet."""

from closure_robots import body, frame, joint, tie

SHORT, LONG = 0.2, 0.5
UPWARDS = (1.5707963267948966, 0, 0)  # the axes of planar robots lie flat, so that gravity acts


def parallelogram(name, parent, at=(0, 0, 0), cranks=(SHORT, SHORT), coupler=LONG, root=()):
    """Two cranks and a coupler that all lie along x at zero; the motor is the first crank's.

    The second crank is hinged to the parent, the coupler to the first one: both loops are the same
    whichever of the hinges is the closure.
    """
    x, y, z = at
    parts = [
        *(body(f"{name}_{part}", (0.07, 0.01, 0.0)) for part in ("crank", "coupler", "rocker")),
        joint(f"{name}_crank_joint", parent, f"{name}_crank", at),
        joint(f"{name}_coupler_joint", f"{name}_crank", f"{name}_coupler", (cranks[0], 0, 0)),
        joint(f"{name}_rocker_joint", parent, f"{name}_rocker", (x + LONG, y, z)),
        frame(f"{name}_coupler_tip", f"{name}_coupler", (coupler, 0, 0)),
        frame(f"{name}_rocker_tip", f"{name}_rocker", (cranks[1], 0, 0)),
    ]
    return parts, tie("3d", (f"{name}_coupler_tip", f"{name}_rocker_tip"))


def folded_four_bar(**bars):
    """A parallelogram on an upright plate."""
    parts, closure = parallelogram("bar", "plate", **bars)
    plate = frame("plate", "ground", rpy=UPWARDS)
    return [plate, *parts], {"closures": [closure], "name_mot": ["bar_crank_joint"]}


def folded_row():
    """The same in a row: crank, coupler and rocker one after the other, the last one turned."""
    parts = [
        frame("plate", "ground", rpy=UPWARDS),
        *(body(name, (0.07, 0.01, 0.0)) for name in ("crank", "coupler", "rocker")),
        joint("crank_joint", "plate", "crank"),
        joint("coupler_joint", "crank", "coupler", (SHORT, 0, 0)),
        joint("rocker_joint", "coupler", "rocker", (LONG, 0, 0), rpy=(0, 0, 3.141592653589793)),
        frame("end", "rocker", (SHORT, 0, 0)),
        frame("pivot", "plate", (LONG, 0, 0)),
    ]
    return parts, {"closures": [tie("3d", ("end", "pivot"))], "name_mot": ["crank_joint"]}


def folded_leg():
    """A leg of two motors: a hip, and a knee that a folded parallelogram drives from the hip."""
    parts = [
        frame("plate", "ground", rpy=UPWARDS),
        *(body(name, (0.07, 0.01, 0.0)) for name in ("thigh", "shank", "crank", "rod")),
        joint("hip", "plate", "thigh"),
        joint("knee", "thigh", "shank", (LONG, 0, 0)),
        joint("motor", "plate", "crank"),
        joint("rod_joint", "crank", "rod", (SHORT, 0, 0)),
        frame("rod_tip", "rod", (LONG, 0, 0)),
        frame("heel", "shank", (SHORT, 0, 0)),
    ]
    closure = tie("3d", ("rod_tip", "heel"))
    return parts, {"closures": [closure], "name_mot": ["hip", "motor"]}


def folded_branches():
    """Two parallelograms that branch off the coupler of a third one, each with a motor."""
    parts, ties = [frame("plate", "ground", rpy=UPWARDS)], []
    for name, parent in (("first", "plate"), ("left", "first_coupler"), ("right", "first_coupler")):
        more, closure = parallelogram(name, parent, at=(0, 0.1 if name == "left" else 0, 0))
        parts += more
        ties.append(closure)
    motors = [f"{name}_crank_joint" for name in ("first", "left", "right")]
    return parts, {"closures": ties, "name_mot": motors}


FOLDED_MJCF = """<mujoco model="folded"><worldbody>
  <body name="crank"><joint name="crank_joint" axis="0 1 0"/>
    <inertial pos="0.07 0 0.01" mass="1" diaginertia="0.02 0.03 0.025"/>
    <body name="coupler" pos="0.2 0 0"><joint name="coupler_joint" axis="0 1 0"/>
      <inertial pos="0.2 0 0.02" mass="2" diaginertia="0.02 0.03 0.025"/>
    </body></body>
  <body name="rocker" pos="0.5 0 0"><joint name="rocker_joint" axis="0 1 0"/>
    <inertial pos="0.05 0 0.02" mass="1" diaginertia="0.02 0.03 0.025"/></body>
</worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="0.5 0 0"/></equality>
<actuator><motor joint="crank_joint"/></actuator></mujoco>
"""


def parallelogram_chain(count, angle=0.6):
    """An arm of many parallelograms, each on the coupler of the one before, on a turning base."""
    parts = [frame("plate", "ground", rpy=UPWARDS), body("arm"), joint("turn", "plate", "arm")]
    ties, motors, reference, parent = [], ["turn"], {}, "arm"
    for k in range(count):
        more, closure = parallelogram(f"p{k}", parent)
        parts += more
        ties.append(closure)
        motors.append(f"p{k}_crank_joint")
        for sign, name in ((1, "crank"), (-1, "coupler"), (1, "rocker")):
            reference[f"p{k}_{name}_joint"] = sign * angle
        parent = f"p{k}_coupler"
    return parts, {"closures": ties, "name_mot": motors, "reference": reference}
