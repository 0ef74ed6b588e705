"""New inertias of a robot file's links from the parameters of its bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loopid.arrays import FloatArray, finite
from loopid.consistency import pseudo_inertia
from loopid.errors import DataError, RobotFileError
from loopid.export.inertias import require_feasible
from loopid.export.sharing import shared, shared_at_rest
from loopid.loading import link_frames
from loopid.parameters import KINDS, MODELS, ParameterSet
from loopid.robot import Body, Mechanism, tie_matrix

# Relative difference between a body as its links in the file make it and as it was loaded.
AGREEMENT = 1e-9


@dataclass(frozen=True)
class BodyLinks:
    """The links with inertia that a joint carries.

    Attributes
    ----------
    body : Body
    names : tuple of str
    placements : tuple of FloatArray
        (4, 4) each, of the link in the frame of the joint.
    inertias : tuple of FloatArray
        (4, 4) each, seen from the joint.
    """

    body: Body
    names: tuple[str, ...]
    placements: tuple[FloatArray, ...]
    inertias: tuple[FloatArray, ...]

    @property
    def carrier(self) -> int:
        """The link that changes first: the one that names the body, else the heaviest."""
        if self.body.link in self.names:
            return self.names.index(self.body.link)
        return int(np.argmax([P[3, 3] for P in self.inertias]))

    def updated(self, parameters: FloatArray) -> dict[str, FloatArray]:
        """New inertias (4, 4), each seen from its link, of the links that change.

        Raises
        ------
        FeasibilityError
        """
        at_rest = len(parameters) == len(MODELS["gravity"])
        share = shared_at_rest if at_rest else shared
        ten = np.append(parameters, np.zeros(len(KINDS) - len(parameters)))
        found = share(self.inertias, self.carrier, pseudo_inertia(ten))
        changed = {}
        for name, T, before, after in zip(
            self.names, self.placements, self.inertias, found, strict=True
        ):
            if after is not before:
                require_feasible(name, after, limits=at_rest)
                back = np.linalg.inv(T)
                changed[name] = back @ after @ back.T
        return changed


def updated_links(
    mechanism: Mechanism,
    links: Mapping[str, FloatArray],
    standard_parameters: FloatArray,
    parameters: ParameterSet | None = None,
) -> dict[str, FloatArray]:
    """New inertias (4, 4), each seen from its link, of the links that change.

    Parameters
    ----------
    links : mapping
        Inertias (4, 4) of all links with inertia as the robot file has them.
    standard_parameters : FloatArray
        (n,) of ``mechanism.parameters("full")`` or ``("gravity")``; the latter keep inertias
        about the links' centres of mass.
    parameters : ParameterSet, optional
        Their names (n,), where they are in another order or terms of joints are among them.

    Raises
    ------
    DataError
        When they are neither.
    FeasibilityError
        Naming a link that would be none, and its mass or principal moment.
    """
    rows = _body_parameters(mechanism, standard_parameters, parameters)
    found: dict[str, FloatArray] = {}
    for body, row in zip(mechanism.bodies, rows, strict=True):
        found |= _links_of(mechanism, body, links).updated(row)
    return found


def _body_parameters(
    mechanism: Mechanism, standard_parameters: FloatArray, parameters: ParameterSet | None
) -> FloatArray:
    """Parameters (bodies, 4 or 10), those of tied links repeated."""
    values = finite(standard_parameters, "standard parameters")
    own = {model: mechanism.parameters(model).labels for model in reversed(MODELS)}
    if parameters is not None:
        values = _selected(values, parameters, own)
    for model, labels in own.items():
        if values.shape == (len(labels),):
            T = tie_matrix(mechanism.links, mechanism.ties, len(MODELS[model]))
            return np.asarray((T @ values).reshape(-1, len(MODELS[model])))
    counts = " or ".join(f"({len(labels)},)" for labels in own.values())
    raise DataError(
        f"standard parameters must have shape {counts}, not {values.shape}: give their names where "
        "terms of joints are among them"
    )


def _selected(
    values: FloatArray, parameters: ParameterSet, own: Mapping[str, tuple[str, ...]]
) -> FloatArray:
    """Those of the bodies by name, in the full model if there are all ten of each."""
    if values.shape != (len(parameters),):
        raise DataError(
            f"standard parameters must have shape ({len(parameters)},) as their names, not "
            f"{values.shape}"
        )
    places = {label: k for k, label in enumerate(parameters.labels)}
    for labels in own.values():
        if places.keys() >= set(labels):
            return values[[places[label] for label in labels]]
    missing = next(label for label in own["gravity"] if label not in places)
    raise DataError(f"standard parameters lack {missing}")


def _links_of(mechanism: Mechanism, body: Body, links: Mapping[str, FloatArray]) -> BodyLinks:
    frames = link_frames(mechanism.model)
    carried = {name: mechanism.model.frames[frames[name]] for name in links if name in frames}
    names = [name for name, frame in carried.items() if frame.parentJoint == body.joint_id]
    placements = [np.array(carried[name].placement.homogeneous) for name in names]
    inertias = [T @ links[name] @ T.T for name, T in zip(names, placements, strict=True)]
    _check_sum(mechanism, body, inertias)
    return BodyLinks(body, tuple(names), tuple(placements), tuple(inertias))


def _check_sum(mechanism: Mechanism, body: Body, inertias: list[FloatArray]) -> None:
    """Make sure that the file is still what the mechanism was loaded from."""
    loaded = pseudo_inertia(mechanism.model.inertias[body.joint_id].toDynamicParameters())
    difference = np.abs(np.sum(inertias, axis=0) - loaded) if inertias else np.inf
    if np.max(difference) > AGREEMENT * np.abs(loaded).max():
        raise RobotFileError(
            f"{mechanism.path}: link {body.link} is not what it was when the robot was loaded: "
            "load it again"
        )
