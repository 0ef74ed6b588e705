"""New inertials of links from standard parameters of bodies.

Links on fixed joints move as one body, whose parameters are the sum of theirs: forces tell the sum
only. The link that the joint carries takes the whole change where it can; otherwise all links
share the new body, so that each stays physically consistent.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from loopid.arguments import FloatArray, finite
from loopid.errors import DataError, RobotFileError
from loopid.inertia import body_defect, central_moments, centre, from_moments, pseudo_inertia
from loopid.parameters import KINDS, MODELS, ParameterSet
from loopid.robot.mechanism import Body, Mechanism, link_frames

# Relative difference between a body as its links in the file make it and as it was loaded.
AGREEMENT = 1e-9
# Relative difference up to which the parameters of a body are as they were.
SAME = 1e-13


def updated_inertials(
    mechanism: Mechanism,
    old: Mapping[str, FloatArray],
    standard_parameters: FloatArray,
    parameters: ParameterSet | None = None,
) -> dict[str, FloatArray]:
    """New pseudo-inertias (4, 4), each seen from its link, of the links that change.

    ``old`` are those of all links that have one, as the robot file has them; the other arguments
    are those of ``updated_robot_file``.
    """
    rows = _body_parameters(mechanism, standard_parameters, parameters)
    changed: dict[str, FloatArray] = {}
    for body, row in zip(mechanism.bodies, rows, strict=True):
        placements = _placements(mechanism, body, old)
        links = [T @ old[name] @ T.T for name, T in placements.items()]
        _require_unchanged(mechanism, body, links)
        names = list(placements)
        heaviest = int(np.argmax([P[3, 3] for P in links]))
        carrier = names.index(body.link) if body.link in names else heaviest
        at_rest = len(row) < len(KINDS)
        whole = pseudo_inertia(np.pad(row, (0, len(KINDS) - len(row))))
        found = (shared_at_rest if at_rest else shared)(links, carrier, whole)
        for (name, T), before, after in zip(placements.items(), links, found, strict=True):
            if after is before:
                continue
            if reason := body_defect(after, flat_allowed=at_rest):
                message = f"link {name} cannot have these parameters: {reason}"
                raise DataError(message, link=name)
            back = np.linalg.inv(T)
            changed[name] = back @ after @ back.T
    return changed


def _placements(mechanism: Mechanism, body: Body, links: Iterable[str]) -> dict[str, FloatArray]:
    """Where those of the links that belong to a body are on it, (4, 4) each."""
    frames, model = link_frames(mechanism.model), mechanism.model
    own = {name: model.frames[frames[name]] for name in links if name in frames}
    return {
        name: np.array(frame.placement.homogeneous)
        for name, frame in own.items()
        if frame.parentJoint == body.joint_id
    }


def _require_unchanged(mechanism: Mechanism, body: Body, links: Sequence[FloatArray]) -> None:
    """Refuse a file whose links (4, 4) are not the body that was loaded."""
    inertia = mechanism.model.inertias[body.joint_id]
    loaded = pseudo_inertia(inertia.toDynamicParameters())
    difference = np.abs(np.sum(links, axis=0) - loaded) if links else np.inf
    if np.max(difference) > AGREEMENT * np.abs(loaded).max():
        raise RobotFileError(
            f"{mechanism.path}: link {body.link} is not what it was when the robot was loaded: "
            "load it again",
            file=str(mechanism.path),
            link=body.link,
        )


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
                f"{values.shape}",
                shape=values.shape,
                valid=(len(parameters),),
            )
        places = {label: k for k, label in enumerate(parameters.labels)}
        known = [labels for labels in own.values() if places.keys() >= set(labels)]
        if not known:
            missing = next(label for label in own["gravity"] if label not in places)
            raise DataError(f"standard parameters lack {missing}", missing=missing)
        values = values[[places[label] for label in known[0]]]  # the full model where it is there
    for model, labels in own.items():
        if values.shape == (len(labels),):
            T = mechanism.tie_matrix(len(MODELS[model]))
            return np.asarray((T @ values).reshape(-1, len(MODELS[model])))
    counts = " or ".join(f"({len(labels)},)" for labels in own.values())
    raise DataError(
        f"standard parameters must have shape {counts}, not {values.shape}: give their names where "
        "joint terms are among them",
        shape=values.shape,
        valid=tuple((len(labels),) for labels in own.values()),
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
