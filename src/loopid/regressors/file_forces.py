"""What a robot file gives beyond rigid bodies, with its size at random states."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from loopid.arguments import FloatArray
from loopid.errors import AccuracyWarning, AssemblyError, SingularityError
from loopid.kinematics.poses import torque_regressors
from loopid.kinematics.projection import ClosedMotion, closed_motion
from loopid.kinematics.sampling import random_configurations, random_motions
from loopid.records import record
from loopid.regressors.joint_laws import joint_term
from loopid.regressors.joint_terms import OF_FILE, JointTerms
from loopid.regressors.motion_regressors import motion_regressor
from loopid.robot.robot import LeftOut, Robot, link_frames

SAMPLES = 60  # random states that forces of the robot file are compared in
NOTHING = 1e-12  # of the largest rigid-body force: round-off


@record
class FileForce:
    """A force that the robot file gives and that rigid bodies do not have."""

    what: str
    joint: str = ""  # of a joint term; empty for what no model has
    kind: str = ""
    value: float = np.nan  # coefficient of the joint term, in ``unit``; NaN for what no model has
    unit: str = ""
    # Rms over random states, relative to the rigid-body forces of the motor, or free coordinate,
    # that senses it most; infinite where these are zero, NaN where it is not known
    size: float = np.nan


def file_forces(robot: Robot) -> tuple[FileForce, ...]:
    """All that the robot file gives beyond rigid bodies, with its size.

    Examples
    --------
    >>> import loopid
    >>> from loopid.regressors.file_forces import file_forces
    >>> file_forces(loopid.load("five_bar"))
    ()
    """
    terms = JointTerms.of(robot, OF_FILE)
    if terms is None and not robot.left_out:
        return ()
    try:
        q = random_configurations(robot, SAMPLES)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AccuracyWarning)  # the draws keep a margin
            motion = closed_motion(robot, q, *random_motions(robot, SAMPLES))
    except (AssemblyError, SingularityError):
        motion = None
    return tuple(_sized(robot, terms, motion))


def _sized(
    robot: Robot, terms: JointTerms | None, motion: ClosedMotion | None
) -> Iterator[FileForce]:
    rigid = None
    if motion is not None:
        rigid = _rms(motion_regressor(robot, motion) @ robot.standard_parameters())

    def size(force: FloatArray | None) -> float:
        if rigid is None or force is None:
            return float("nan")
        found = _rms(force)
        known = rigid > NOTHING * rigid.max(initial=0.0)
        acting = found > NOTHING * max(found.max(initial=0.0), rigid.max(initial=0.0))
        if (acting & ~known).any():
            return float("inf")
        return float((found[known] / rigid[known]).max(initial=0.0))

    if terms is not None:
        names, values = terms.parameters(robot), terms.values(robot)
        columns = None if motion is None else terms.columns(robot, motion) * np.nan_to_num(values)
        for j, (name, value) in enumerate(zip(names, values, strict=True)):
            law, own = joint_term(name.kind), terms.of_joints[name.link]
            # A spring counts from where it is slack.
            parts = [j, *(names.labels.index(f"{name.link}.{kind}") for kind in law.beside)]
            force = None if columns is None else columns[..., parts].sum(axis=2)
            parted = any(name.kind in joint_term(kind).beside for kind in own)
            if not (np.isnan(value) or parted):
                what = f"{law.name} of {name.link}"
                yield FileForce(what, name.link, name.kind, float(value), name.unit, size(force))
    for left in robot.left_out:
        yield FileForce(left.what, size=size(_force(robot, motion, left)))


def _rms(force: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt((force**2).mean(axis=0)))


def _force(robot: Robot, motion: ClosedMotion | None, left: LeftOut) -> FloatArray | None:
    """Force (N, dof) of what is left out; None where it is not known."""
    if motion is None or not left.weights:
        return None
    untied, pi = replace(robot, tied=False), np.zeros((len(robot.bodies), 4))
    carriers = [body.joint_id for body in robot.bodies]
    for link, (mass, *centre) in left.weights.items():
        frame = robot.model.frames[link_frames(robot.model)[link]]
        if frame.parentJoint in carriers:
            point = frame.placement.act(np.array(centre))
            pi[carriers.index(frame.parentJoint)] += mass * np.array([1.0, *point])
    K = torque_regressors(untied, motion.configurations, model="gravity", G=motion.projection.G)
    return np.asarray(-(K @ pi.ravel()))
