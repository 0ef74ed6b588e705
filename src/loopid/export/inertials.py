"""New inertias of a robot file's links from the parameters of its bodies.

Links on fixed joints move as one body, whose parameters are the sum of theirs: forces tell the sum
only. The link that the joint carries takes the whole change where it can; otherwise all links
share the new body, so that each stays physically consistent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from loopid.arrays import BoolArray, FloatArray, finite
from loopid.errors import DataError, FeasibilityError, RobotFileError
from loopid.parameters import KINDS, MODELS, ParameterSet
from loopid.pseudo_inertia import (
    body_defect,
    central_moments,
    centre,
    from_moments,
    inertia_tensor,
    pseudo_inertia,
)
from loopid.robot import Mechanism, link_frames

# Relative difference between a body as its links in the file make it and as it was loaded.
AGREEMENT = 1e-9
# Relative difference up to which the parameters of a body are as they were.
SAME = 1e-13
# Numbers whose change moves no more than this part of the second moments about the link's origin
# stay as they are written.
KEPT = 1e-14
# Relative difference between an inertia as it was meant and as the new file is read.
FAITHFUL = 1e-11


@dataclass(frozen=True)
class Inertial:
    """An ``<inertial>``: a tensor about the centre along axes that are turned from the link's."""

    mass: float
    centre: FloatArray  # (3,)
    axes: FloatArray  # (3, 3)
    tensor: FloatArray  # (3, 3)

    @property
    def P(self) -> FloatArray:  # noqa: N802
        """Pseudo-inertia (4, 4), seen from the link."""
        inertia = pin.Inertia(self.mass, self.centre, self.axes @ self.tensor @ self.axes.T)
        return np.array(pin.PseudoInertia.FromInertia(inertia).toMatrix())

    def replaced(self, P: FloatArray) -> Inertial:
        """The numbers of another pseudo-inertia along the same axes."""
        tensor = self.axes.T @ inertia_tensor(central_moments(P)) @ self.axes
        return Inertial(float(P[3, 3]), centre(P), self.axes, tensor)

    def changes_to(self, new: Inertial) -> tuple[bool, bool, BoolArray]:
        """Whether mass, centre, and which entries of the tensor (3, 3), change beyond round-off."""
        spread = float(np.trace(new.P[:3, :3]))
        mass = abs(new.mass - self.mass) > KEPT * abs(self.mass)
        moved = np.abs(new.centre - self.centre).max() > KEPT * np.sqrt(spread / new.mass)
        tensor = np.abs(new.tensor - self.tensor) > KEPT * spread
        return bool(mass), bool(moved), np.asarray(tensor)


def updated_inertials(
    mechanism: Mechanism,
    old: Mapping[str, Inertial],
    standard_parameters: FloatArray,
    parameters: ParameterSet | None = None,
) -> dict[str, FloatArray]:
    """New pseudo-inertias (4, 4), each seen from its link, of the links that change.

    ``old`` are the inertials of all links that have one, as the robot file has them; the other
    arguments are those of ``updated_robot_file``.
    """
    frames, model = link_frames(mechanism.model), mechanism.model
    rows = _body_parameters(mechanism, standard_parameters, parameters)
    changed: dict[str, FloatArray] = {}
    for body, row in zip(mechanism.bodies, rows, strict=True):
        placements = {
            name: np.array(model.frames[frames[name]].placement.homogeneous)
            for name in old
            if name in frames and model.frames[frames[name]].parentJoint == body.joint_id
        }
        links = [T @ old[name].P @ T.T for name, T in placements.items()]
        loaded = pseudo_inertia(model.inertias[body.joint_id].toDynamicParameters())
        difference = np.abs(np.sum(links, axis=0) - loaded) if links else np.inf
        if np.max(difference) > AGREEMENT * np.abs(loaded).max():
            raise RobotFileError(
                f"{mechanism.path}: link {body.link} is not what it was when the robot was loaded: "
                "load it again"
            )
        names = list(placements)
        heaviest = int(np.argmax([P[3, 3] for P in links]))
        carrier = names.index(body.link) if body.link in names else heaviest
        at_rest = len(row) < len(KINDS)
        whole = pseudo_inertia(np.pad(row, (0, len(KINDS) - len(row))))
        found = (shared_at_rest if at_rest else shared)(links, carrier, whole)
        for (name, T), before, after in zip(placements.items(), links, found, strict=True):
            if after is not before:
                reason = body_defect(after, flat_allowed=at_rest)
                if reason:
                    raise FeasibilityError(f"link {name} cannot have these parameters: {reason}")
                back = np.linalg.inv(T)
                changed[name] = back @ after @ back.T
    return changed


def require_faithful(
    tree: Path,
    old: Mapping[str, Inertial],
    new: Mapping[str, FloatArray],
    read: Mapping[str, Inertial],
) -> None:
    """Refuse new content of a robot file that is not read as it was meant."""
    for name, P in ({name: inertial.P for name, inertial in old.items()} | dict(new)).items():
        if name not in read or np.abs(read[name].P - P).max() > FAITHFUL * np.abs(P).max():
            raise RobotFileError(f"{tree}: the inertial of {name} cannot be changed in place")


def _body_parameters(
    mechanism: Mechanism, standard_parameters: FloatArray, parameters: ParameterSet | None
) -> FloatArray:
    """Parameters (bodies, 4 or 10), those of tied links repeated."""
    values = finite(standard_parameters, "standard parameters")
    own = {model: mechanism.parameters(model).labels for model in reversed(MODELS)}
    if parameters is not None:
        if values.shape != (len(parameters),):
            raise DataError(
                f"standard parameters must have shape ({len(parameters)},) as their names, not "
                f"{values.shape}"
            )
        places = {label: k for k, label in enumerate(parameters.labels)}
        known = [labels for labels in own.values() if places.keys() >= set(labels)]
        if not known:
            missing = next(label for label in own["gravity"] if label not in places)
            raise DataError(f"standard parameters lack {missing}")
        values = values[[places[label] for label in known[0]]]  # the full model where it is there
    for model, labels in own.items():
        if values.shape == (len(labels),):
            T = mechanism.tie_matrix(len(MODELS[model]))
            return np.asarray((T @ values).reshape(-1, len(MODELS[model])))
    counts = " or ".join(f"({len(labels)},)" for labels in own.values())
    raise DataError(
        f"standard parameters must have shape {counts}, not {values.shape}: give their names where "
        "joint terms are among them"
    )


def shared(links: Sequence[FloatArray], carrier: int, whole: FloatArray) -> list[FloatArray]:
    """Pseudo-inertias (4, 4) of the links of a body that add up to a new one of the body.

    The carrier takes the whole change; where that leaves it inconsistent, each link gets its part
    of the mass and the shape of the whole. Links that do not change are the very same arrays.
    """
    before = np.sum(links, axis=0)
    if np.abs(_relative_change(before, whole)).max() <= SAME:
        return list(links)
    found = list(links)
    found[carrier] = links[carrier] + (whole - before)
    if len(links) > 1 and body_defect(found[carrier]) and before[3, 3] > 0:
        parts = [P[3, 3] / before[3, 3] * whole for P in links]
        parts[carrier] += whole - np.sum(parts, axis=0)  # round-off
        if not any(map(body_defect, parts)):
            return parts
    return found


def shared_at_rest(
    links: Sequence[FloatArray], carrier: int, whole: FloatArray
) -> list[FloatArray]:
    """The same where only mass and first moments (the last row of ``whole``) are known.

    Inertias about the links' own centres of mass stay.
    """
    before = np.sum(links, axis=0)
    if np.abs(_relative_change(before, whole)[3]).max() <= SAME:
        return list(links)
    mass, *moment = (links[carrier] + whole - before)[3, [3, 0, 1, 2]]
    if mass > 0 or len(links) == 1:
        found = list(links)
        middle = np.array(moment) / mass if mass else np.zeros(3)
        found[carrier] = from_moments(mass, middle, central_moments(links[carrier]))
        return found
    ratio, shift = whole[3, 3] / before[3, 3], centre(whole) - centre(before)
    return [
        from_moments(ratio * P[3, 3], centre(P) + shift, central_moments(P)) if P[3, 3] else P
        for P in links
    ]


def _relative_change(P: FloatArray, other: FloatArray) -> FloatArray:
    """The difference of two pseudo-inertias with units taken out by the size of the first."""
    size = np.sqrt(np.maximum(np.diag(P), np.trace(P[:3, :3]) / 3 * np.array([1, 1, 1, 0])))
    size[size == 0] = 1.0
    return np.asarray((P - other) / np.outer(size, size))
