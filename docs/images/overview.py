"""The picture of README: from a robot and a log to values; robots with loops and their counts.

``python docs/images/overview.py`` draws it anew.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pinocchio as pin
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import loopid

LOG = Path(__file__).parents[2] / "urdf" / "logs" / "five_bar.csv"
FRONT, ABOVE = (0, -90), (18, -62)
ROBOTS = {  # with the view and the zoom of their drawing
    "3ups_rpu": ("3UPS+RPU", ABOVE, 1.15),
    "delta": ("delta", ABOVE, 1.4),
    "6ups": ("6-UPS", ABOVE, 1.5),
    "3rrr": ("3-RRR", FRONT, 1.4),
}
HALO = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"}
FRICTION = {"Fc": 0.1, "Fv": 0.05}  # of the robot that was simulated for the log
LINK, PLATE, CLOSURE, MOTOR, TEXT = "#33546e", "#9db8cc", "#c8553d", "#e9a23b", "#222222"


def points(robot):
    """Joints and closure frames on each link, by the joint that carries it; 0 is the base."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, robot.reference)
    closures = [frame for closure in robot.closures for frame in closure.frame_ids]
    for joint in range(model.njoints):
        ends = [
            data.oMi[k].translation for k in range(1, model.njoints) if model.parents[k] == joint
        ]
        ends += [data.oMf[k].translation for k in closures if model.frames[k].parentJoint == joint]
        yield (data.oMi[joint].translation if joint else None), ends


def around(ends):
    """Points in the order in which a polygon passes them."""
    ends = np.unique(np.round(ends, 6), axis=0)
    away = ends - ends.mean(axis=0)
    plane = np.linalg.svd(away)[2][:2]
    return ends[np.argsort(np.arctan2(*(away @ plane.T).T))]


def draw(axes, name, view, zoom):
    """Draw a robot at its reference: plates, bars, motors and closures."""
    robot = loopid.load(name)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.reference)
    seen = []
    for joint, ends in points(robot):
        seen += ends
        corners = around(ends if joint is None else [joint, *ends]) if len(ends) > 1 else []
        if len(corners) > 2:
            plate = Poly3DCollection([corners], facecolor=PLATE, edgecolor=LINK, alpha=0.45)
            axes.add_collection3d(plate)
        elif joint is None and len(ends) == 2:  # the ground
            axes.plot(*zip(*ends, strict=True), color=PLATE, lw=4)
        elif joint is not None:
            for end in ends:
                axes.plot(*zip(joint, end, strict=True), color=LINK, lw=2.2)
    for closure in robot.closures:
        place = data.oMf[closure.frame_ids[0]].translation
        axes.scatter(*place, edgecolor=CLOSURE, facecolor="white", s=32, lw=1.6, zorder=6)
    for joint in robot.actuated:
        index = robot.model.getJointId(joint)
        ends = data.oMi[index].translation, data.oMi[robot.model.parents[index]].translation
        slides = robot.model.joints[index].shortname().startswith("JointModelP")
        axes.scatter(*(np.mean(ends, axis=0) if slides else ends[0]), color=MOTOR, s=30, marker="s")
    low, high = np.min(seen, axis=0), np.max(seen, axis=0)
    size = np.ptp(seen, axis=0).max() / 2
    limits = {f"{x}lim": (c - size, c + size) for x, c in zip("xyz", (low + high) / 2, strict=True)}
    axes.set(**limits)
    axes.set_box_aspect((1, 1, 1), zoom=zoom)
    axes.view_init(*view)
    axes.set_axis_off()
    return robot


def counts(robot):
    """How many of all parameters are base parameters."""
    base = loopid.base_parameters.find_base(loopid.regressors.structural_observation(robot, "full"))
    return base, f"{len(base)} base parameters of {len(base.parameters)}"


def headed(axes, title, under=""):
    """Write a heading and a line below it."""
    place = axes.get_position()
    middle = (place.x0 + place.x1) / 2, place.y1
    style = {"ha": "center", "va": "bottom", "color": TEXT}
    axes.figure.text(middle[0], middle[1] + 0.045, title, fontsize=10, fontweight="bold", **style)
    axes.figure.text(middle[0], middle[1] + 0.01, under, fontsize=8.5, **style)


def combinations(axes, base):
    """Some base parameters, as they read."""
    shown = sorted(base.expressions, key=len)[-3:]
    lines = [text.replace(" + ", "\n  + ").replace(" - ", "\n  - ") for text in shown]
    lines += [f"\n… and {len(base) - len(shown)} more, proven best:"]
    lines += [f"cond(V22) = {base.search.condition_number:.4f}"]
    axes.text(0, 0.97, "\n".join(lines), va="top", fontsize=8, color=TEXT)
    axes.set_axis_off()


def main():
    """Draw the picture."""
    figure = plt.figure(figsize=(11, 5.8))
    figure.subplots_adjust(left=0.02, right=0.98, top=0.88, bottom=0.07, wspace=0.3, hspace=0.6)
    robot = draw(figure.add_subplot(2, 4, 1, projection="3d"), "five_bar", FRONT, 1.4)
    headed(figure.axes[-1], "1. Robot file", "open tree and loop closures")
    for name, (joint, ends) in zip(robot.model.names, points(robot), strict=True):
        if joint is not None:
            middle = (joint + np.mean(ends, axis=0)) / 2
            label = name.removesuffix("_joint")
            figure.axes[-1].text(*middle, label, ha="center", fontsize=7, bbox=HALO, color=TEXT)
    base, text = counts(robot)
    combinations(figure.add_subplot(2, 4, 2), base)
    headed(figure.axes[-1], "2. Base parameters", text)

    terms = loopid.JointTerms(robot.actuated, tuple(FRICTION))
    model = loopid.force_model(robot, "full", terms)
    recording = loopid.prepare(robot, loopid.read_log(LOG, robot))
    fit = loopid.identify(model, [recording]).fit
    time, joint = recording.motion.time, robot.actuated[0]
    part = time < 12
    axes = figure.add_subplot(2, 4, 3)
    predicted = fit.forces(model.regressor(recording.motion))
    axes.plot(time[part], recording.force[part, 0], ".", color=MOTOR, ms=4, label="measured")
    axes.plot(time[part], predicted[part, 0], color=LINK, lw=1.4, label="fitted")
    axes.set(xlabel="s", ylabel="N m")
    axes.legend(fontsize=7.5, frameon=False)
    headed(axes, "3. Log", f"force of {joint}")

    axes = figure.add_subplot(2, 4, 4)
    labels = [fit.parameters.labels[k] for k in model.joint_columns]
    for row, (label, column) in enumerate(zip(labels, model.joint_columns, strict=True)):
        low, high = fit.intervals()[column]
        axes.plot([low, high], [row, row], color=LINK, lw=2)
        axes.plot(fit.values[column], row, "o", color=LINK)
        axes.plot(FRICTION[label.rpartition(".")[2]], row, "|", color=CLOSURE, ms=14, mew=2)
    axes.set(yticks=range(len(labels)), xlabel="N m, N m s/rad", xlim=(0, 0.13), ylim=(3.6, -0.6))
    axes.set_yticklabels([label.replace("_crank_joint", "") for label in labels], fontsize=7.5)
    headed(axes, "4. Values", "friction: 95 % intervals, true values in red")

    for place, (name, (title, view, zoom)) in enumerate(ROBOTS.items(), 5):
        axes = figure.add_subplot(2, 4, place, projection="3d")
        other = draw(axes, name, view, zoom)
        headed(axes, title, counts(other)[1])
    marks = [
        plt.Line2D([], [], color=LINK, lw=2.2, label="links"),
        plt.Line2D([], [], color=MOTOR, marker="s", ls="", label="motors"),
        plt.Line2D([], [], color=CLOSURE, marker="o", mfc="white", ls="", label="loop closures"),
    ]
    for left in (0.235, 0.475, 0.735):
        figure.text(left, 0.93, "→", fontsize=18, color=CLOSURE, ha="center", va="center")
    figure.legend(handles=marks, loc="lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(Path(__file__).with_suffix(".png"), dpi=130)


if __name__ == "__main__":
    main()
