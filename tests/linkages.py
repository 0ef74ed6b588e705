"""Textbook linkages, planar ones on an oblique plate so that gravity acts in all directions."""

import numpy as np
import pinocchio as pin

from closure_robots import ROD, ROWS, X, Z, body, frame, joint, loop, tie

PLATE = frame("plate", "ground", rpy=(0.4, -0.9, 0.3))
TURN = (0.7, 0.2, -0.5)  # of the frames that closures tie, to make their axes oblique
CRANK = ("crank_joint",)
BARS = {"crank": 0.2, "coupler": 0.45, "rocker": 0.4, "ground": 0.5}


def turned(axis):
    """An axis as a frame that is turned by TURN sees it."""
    return (pin.rpy.rpyToMatrix(*TURN).T @ np.array(axis, dtype=float)).tolist()


AXES_ALIKE = ("hinge", "prismatic", "cylindrical", "2d")
AXES = {"hinge": (Z, Z), "cylindrical": (Z, Z), "2d": (Z, Z), "universal": (Z, X)}


def four_bar(kind, bars=BARS, **more):
    """Crank, coupler and rocker in a row; the rocker's ground pivot is the closure.

    A weld needs a hinge before it; a rod is the coupler itself.
    """
    lengths = list(bars.values())
    if kind == "distance":
        return _rod_four_bar(lengths)
    parts = [
        PLATE,
        *(body(name) for name in ("crank", "coupler", "rocker")),
        joint("crank_joint", "plate", "crank"),
        joint("coupler_joint", "crank", "coupler", (lengths[0], 0, 0)),
        joint("rocker_joint", "coupler", "rocker", (lengths[1], 0, 0), limits=(-4, 4)),
        frame("pivot", "plate", (lengths[3], 0, 0), TURN),
    ]
    tip = (lengths[2], 0, 0)
    if kind == "6d":
        hinged = [frame("tip", "rocker", tip), body("knuckle")]
        hinged += [joint("end_joint", "tip", "knuckle"), frame("end", "knuckle", rpy=TURN)]
        parts += hinged
    else:
        parts.append(frame("end", "rocker", tip, TURN))
    axes = {"axes": [turned(axis) for axis in AXES[kind]]} if kind in AXES else {}
    reference = {"crank_joint": 1.0, "coupler_joint": -0.46, "rocker_joint": -2.1}
    if kind == "6d":
        reference["end_joint"] = 1.56
    closure = tie(kind, ("end", "pivot"), **axes)
    return parts, described([closure], CRANK, reference, **more)


def _rod_four_bar(lengths):
    parts = [
        PLATE,
        *(body(name) for name in ("crank", "rocker")),
        joint("crank_joint", "plate", "crank"),
        joint("rocker_joint", "plate", "rocker", (lengths[3], 0, 0)),
        frame("crank_tip", "crank", (lengths[0], 0, 0)),
        frame("rocker_tip", "rocker", (lengths[2], 0, 0)),
    ]
    closure = tie("distance", ("crank_tip", "rocker_tip"), length=lengths[1])
    return parts, described([closure], CRANK, {"crank_joint": 1.0, "rocker_joint": 1.5})


def slider_crank(kind):
    """A block hinged to the coupler, tied to an oblique rail on the plate."""
    parts = [
        PLATE,
        *(body(name) for name in ("crank", "coupler", "block")),
        joint("crank_joint", "plate", "crank"),
        joint("coupler_joint", "crank", "coupler", (0.2, 0, 0)),
        joint("block_joint", "coupler", "block", (0.5, 0, 0)),
        frame("shoe", "block", rpy=TURN),
        frame("rail", "plate", (0, 0.05, 0), TURN),
    ]
    closure = tie(kind, ("rail", "shoe"), axes=[turned(X)] * 2)
    reference = {"crank_joint": 1.0, "coupler_joint": -1.24, "block_joint": 0.24}
    return parts, described([closure], CRANK, reference)


def bennett():
    """Four skew hinges, one of them a closure, that can move as lengths fit to twists."""
    short, twist, other = 0.3, np.radians(30), np.radians(50)
    long = short * np.sin(other) / np.sin(twist)
    parts, place = [], (0, 0)
    for k, after in enumerate([(short, twist), (long, other), (short, twist)], start=1):
        parent = f"link{k - 1}" if k > 1 else "ground"
        at = {"xyz": (place[0], 0, 0), "rpy": (place[1], 0, 0)}
        parts += [body(f"link{k}"), joint(f"joint{k}", parent, f"link{k}", **at)]
        place = after
    parts += [
        frame("end", "link3", (short, 0, 0), (twist, 0, 0)),
        frame("pivot", "ground", (-long, 0, 0), (-other, 0, 0)),
    ]
    return parts, described([tie("hinge", ("end", "pivot"))], ["joint1"], {"joint1": 0.8})


def rssr(rod):
    """Two skew cranks and a rod between ball joints: ``rod`` is the type of its first one.

    ``SPHERICAL`` leaves its spin free, ``UJOINT_YZ`` does not; with ``None`` the rod has no mass
    and is a closure itself.
    """
    parts = [
        *(body(name) for name in ("crank", "rocker")),
        joint("crank_joint", "ground", "crank"),
        joint("rocker_joint", "ground", "rocker", (0.5, 0.1, 0.2), (0.3, 1, 0.2)),
        frame("crank_tip", "crank", (0.15, 0, 0.05)),
        frame("rocker_tip", "rocker", (0.1, 0.05, 0.35)),
    ]
    if rod is None:
        closure = tie("distance", ("crank_tip", "rocker_tip"), length=ROD)
        return parts, described([closure], CRANK, {})
    parts += [body("rod"), joint("ball", "crank_tip", "rod"), frame("rod_end", "rod", (ROD, 0, 0))]
    more = {"joint_name": ["ball"], "joint_type": [rod]}
    closure = tie("3d", ("rod_end", "rocker_tip"))
    cross = {"rocker_joint": -0.98, "ball_Y": -1.09, "ball_Z": 0.31} if rod == "UJOINT_YZ" else {}
    return parts, described([closure], CRANK, {"crank_joint": 0.3} | cross, **more)


def five_bar(motors=("left_joint", "right_joint"), geared=False):
    """Two cranks and two couplers, pinned where these meet; geared, it has one freedom."""
    parts = [PLATE]
    for side, x in (("left", 0.0), ("right", 0.3)):
        parts += [
            *(body(f"{side}{bar}") for bar in ("", "_coupler")),
            joint(f"{side}_joint", "plate", side, (x, 0, 0)),
            joint(f"{side}_elbow", side, f"{side}_coupler", (0.2, 0, 0)),
            frame(f"{side}_tip", f"{side}_coupler", (0.35, 0, 0)),
        ]
    closures = [tie("3d", ("left_tip", "right_tip"))]
    if geared:
        closures.append(
            {"type": "coupling", "joints": {"left_joint": 2.0, "right_joint": 1.0}, "offset": 5.0}
        )
    elbows = {"left_elbow": -1.24, "right_elbow": 1.32}
    reference = {"left_joint": 2.0, "right_joint": 1.0}
    reference |= {name: angle for name, angle in elbows.items() if name not in motors}
    return parts, described(closures, motors, reference)


def rack_and_pinion():
    """A turn that pushes: a coupling of rad and m."""
    parts = [
        *(body(name) for name in ("pinion", "rack", "arm")),
        joint("pinion_joint", "ground", "pinion", axis=(1, 1, 0)),
        joint("rack_joint", "ground", "rack", (0, 0.3, 0), (0, 1, 1), "prismatic"),
        joint("arm_joint", "rack", "arm", (0.4, 0, 0), (1, 0, 0)),
    ]
    gear = {"type": "coupling", "joints": {"pinion_joint": -0.05, "rack_joint": 1}, "offset": 0.1}
    return parts, described([gear], ("pinion_joint", "arm_joint"), {})


def cam():
    """The same with a curve of fourth order, and a second slide that follows two joints at once."""
    parts, description = rack_and_pinion()
    curve = {
        "type": "coupling",
        "joints": {"rack_joint": 1},
        "of": {"pinion_joint": 1, "arm_joint": -0.5},
        "polynomial": [0.1, 0.05, 0.03, -0.01, 0.004],
    }
    return parts, description | {"closures": [curve]}


def differential():
    """Two motors whose sum and difference turn the two hinges of a wrist."""
    parts = [
        *(body(name) for name in ("left", "right", "fork", "hand")),
        joint("left_joint", "ground", "left", axis=(0, 1, 0)),
        joint("right_joint", "ground", "right", axis=(0, 1, 0)),
        joint("pitch", "ground", "fork", (0.2, 0, 0), (0, 1, 0)),
        joint("roll", "fork", "hand", (0.1, 0, 0), (1, 0, 0)),
    ]
    couplings = [
        {"joints": {"left_joint": 1, "pitch": -1, "roll": -1}},
        {"joints": {"right_joint": 1, "pitch": -1, "roll": 1}},
    ]
    return parts, described([], ("left_joint", "right_joint"), {}, couplings=couplings)


def described(closures, motors, reference, **more):
    return {"closures": closures, "name_mot": list(motors), "reference": reference, **more}


SKEW = (0.6, -0.5, 0.7)
PLANAR = [kind for kind in ROWS if kind not in ("prismatic", "cable")]
LINKAGES = {
    **{f"{kind} loop": loop(kind, seed=4) for kind in ROWS},
    **{f"{kind} loop, skew": loop(kind, seed=5, axes=[SKEW, SKEW]) for kind in AXES_ALIKE},
    "universal loop, skew": loop("universal", seed=5, axes=[SKEW, (0.5, 0.6, 0)]),
    **{f"{kind} four-bar": four_bar(kind) for kind in PLANAR},
    **{f"{kind} slider-crank": slider_crank(kind) for kind in ("prismatic", "cylindrical")},
    "bennett": bennett(),
    "rod rssr": rssr(None),
    "ball rssr": rssr("SPHERICAL"),
    "cross rssr": rssr("UJOINT_YZ"),
    "five-bar": five_bar(),
    "geared five-bar": five_bar(("left_joint",), geared=True),
    "redundant five-bar": five_bar(("left_joint", "right_joint", "left_elbow")),
    "rack and pinion": rack_and_pinion(),
    "cam": cam(),
    "differential": differential(),
}
# Those that dynamics tell apart: balls that spin, redundant motors, couplings.
MOVED = (
    *("cable loop", "ball rssr", "cross rssr", "redundant five-bar", "rack and pinion", "cam"),
    "differential",
)
# One with each kind of equations and joints, for laws of all linkages in an ordinary run.
ORDINARY = ("6d loop", "distance loop", "prismatic slider-crank", "bennett", *MOVED)
