"""The picture of README: bundled robots and what their motors let be known.

``python docs/images/overview.py`` draws it anew.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin

import loopid

ROBOTS = {"five_bar": "five-bar", "3ups_rpu": "3UPS+RPU", "delta": "delta", "6ups": "6-UPS"}
TREE, CLOSURE, MOTOR = "#33546e", "#c8553d", "#e9a23b"


def bars(robot):
    """Segments (n, 2, 3) between the joints and closure frames of each link, in the base frame."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, robot.reference)
    closure_frames = [frame for closure in robot.closures for frame in closure.frame_ids]
    for joint in range(model.njoints):
        here = data.oMi[joint].translation
        ends = [
            data.oMi[k].translation for k in range(1, model.njoints) if model.parents[k] == joint
        ]
        ends += [
            data.oMf[k].translation for k in closure_frames if model.frames[k].parentJoint == joint
        ]
        yield from ((here, end) for end in ends if joint)
        if not joint:  # the base: a plate through all that stands on it
            yield from ((one, other) for one, other in zip(ends, ends[1:] + ends[:1], strict=True))


def draw(axes, name, title):
    """Draw a robot at its reference, with its counts of parameters above it."""
    robot = loopid.load_mechanism(name)
    full = loopid.find_base_parameters(loopid.structural_observation(robot, "full"))
    gravity = loopid.find_base_parameters(loopid.structural_observation(robot, "gravity"))
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.reference)
    points = np.array([end for bar in bars(robot) for end in bar])
    for one, other in bars(robot):
        axes.plot(*zip(one, other, strict=True), color=TREE, lw=2.2, solid_capstyle="round")
    for closure in robot.closures:
        place = data.oMf[closure.frame_ids[0]].translation
        axes.scatter(*place, edgecolor=CLOSURE, facecolor="white", s=45, lw=1.8, zorder=6)
    for joint in robot.actuated:
        index = robot.model.getJointId(joint)
        ends = data.oMi[index].translation, data.oMi[robot.model.parents[index]].translation
        slides = robot.model.joints[index].shortname().startswith("JointModelP")
        place = np.mean(ends, axis=0) if slides else ends[0]
        axes.scatter(*place, color=MOTOR, s=30, marker="s", zorder=5)
    centre, size = (points.max(0) + points.min(0)) / 2, np.ptp(points, axis=0).max() / 2
    axes.set(**{f"{x}lim": (c - size, c + size) for x, c in zip("xyz", centre, strict=True)})
    axes.set_box_aspect((1, 1, 1), zoom=1.12)
    axes.view_init(*((0, -90) if name == "five_bar" else (18, -62)))
    axes.set_axis_off()
    axes.set_title(
        f"{title}\n{len(full)} base parameters of {len(full.parameters)}\n"
        f"gravity: {len(gravity)} of {len(gravity.parameters)}",
        fontsize=9,
        color="#222222",
    )


def main():
    """Draw the picture."""
    figure = plt.figure(figsize=(9.2, 3.0))
    for place, (name, title) in enumerate(ROBOTS.items(), 1):
        draw(figure.add_subplot(1, len(ROBOTS), place, projection="3d"), name, title)
    marks = [
        plt.Line2D([], [], color=TREE, lw=2.2, label="links"),
        plt.Line2D([], [], color=MOTOR, marker="s", ls="", label="motors"),
        plt.Line2D([], [], color=CLOSURE, marker="o", mfc="white", ls="", label="loop closures"),
    ]
    figure.legend(handles=marks, loc="lower center", ncols=3, frameon=False, fontsize=9)
    figure.subplots_adjust(left=0, right=1, top=0.84, bottom=0.06, wspace=0)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=150)


if __name__ == "__main__":
    main()
