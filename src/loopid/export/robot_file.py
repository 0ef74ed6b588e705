"""Robot files with new inertials and joint terms; all else in them stays.

Links on fixed joints move as one body. Its parameters are the sum of theirs: forces determine only
the sum. The link that the joint carries takes the whole change where it can. Otherwise all links
share the new body, so that each stays physically consistent.

Joint terms are written where the format has a place. The new file is read back. What it does not
say as the parameters do is named, whatever the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np

from loopid.arguments import FloatArray, checked, finite
from loopid.errors import DataError, FileError, ModelWarning, OptionError, RobotFileError, warn
from loopid.files import write_files
from loopid.identification.quality import MotorUse
from loopid.inertia import body_defect, central_moments, centre, from_moments, pseudo_inertia
from loopid.loading.closure import with_more
from loopid.loading.files import YAML, RobotFiles, files_of
from loopid.parameters import KINDS, MODELS, ParameterSet
from loopid.registry import editable_files
from loopid.regressors.joint_laws import RATIO, JointState, grouped, joint_term, signals
from loopid.robot.robot import Body, Robot, link_frames, shortened
from loopid.yaml_files import yaml_text

# Relative difference between a body as its links in the file make it and as it was loaded.
AGREEMENT = 1e-9
# Relative difference up to which the parameters of a body are as they were.
SAME = 1e-13
# Relative difference of a joint term, in the new file and as it was meant: degrees are round-off.
READ_BACK = 1e-12
LINE_POINTS = 200  # rates that a line is fitted at, in place of a friction curve
# Options of ``load`` that a YAML keeps, and those that only a call has.
KEPT, ASKED = ("rounding", "floating_base"), ("lock", "free_mimics")
# What is not written where the other half of its force has no place: by kind, the other halves.
HALVES = {"Ks": ("Ks2", "Ks3", "Ks@"), "Fc": ("Fc+", "Fc-")}
Terms = dict[str, dict[str, float]]  # by coordinate and kind
Known = dict[str, dict[str, Any]]  # the same, None where a file leaves a value open


@checked
def updated_robot_file(
    robot: Robot,
    standard_parameters: FloatArray,
    *,
    parameters: ParameterSet | None = None,
    use: MotorUse | None = None,
    name: str | None = None,
) -> bytes:
    """The file of the robot's tree with its inertials and joint terms updated in place.

    ``standard_parameters`` (n,) are those of ``parameters``, by default all of bodies. By a gravity
    model, inertias about the centres of mass stay. What the new file does not have as the
    parameters say is warned of, and how near its friction is to a curve (docs/exports.md); ``name``
    is what warnings call the file. A link that would not be physically consistent is refused, and a
    file that is not that of the robot.
    """
    files = files_of(robot)
    _require_editable(files.tree)
    file = editable_files[files.tree.suffix](files.tree)
    rows = body_parameters(robot, standard_parameters, parameters)
    new: dict[str, FloatArray] = {}
    links = {link: inertial.P for link, inertial in file.inertials.items()}
    for body, row in zip(robot.bodies, rows, strict=True):
        new |= _updated_links(robot, body, links, row)
    content: bytes = file.edited(new, {})
    if parameters is None:
        return content
    meant, nearest = straightened(joint_terms(parameters, standard_parameters), use)
    # Inertials come first: MuJoCo may derive damping from masses.
    wanted, there = _writable(meant), _on_coordinates(robot, file.joint_terms(content))
    if changed := {j: terms for j, terms in wanted.items() if list(_apart({j: terms}, there))}:
        content = file.edited(new, changed)
        there = _on_coordinates(robot, file.joint_terms(content))
    others = _others(robot, meant, there)
    if listed := "; ".join([*nearest, *others]):
        warn(f"joint terms of the new {name or files.tree.name}: {listed}", ModelWarning)
    return content


@checked
def export_robot_file(
    robot: Robot,
    standard_parameters: FloatArray,
    path: str | Path,
    *,
    overwrite: bool = False,
    parameters: ParameterSet | None = None,
    use: MotorUse | None = None,
) -> Path:
    """Write the robot's file with updated inertials, whole or not at all; see above.

    The name ends as the robot's own file does. Paths of meshes and of a YAML's ``urdf`` are not
    adapted. Of a robot with closures, motors or a reference given in Python a YAML beside it has
    these: then that is what is to be loaded, and given back. Options of ``load`` that the file is
    to be loaded with again, such as locked joints, are warned of.
    """
    place, files = Path(path), files_of(robot)
    tree, texts = files.tree, dict[str, bytes | str]()
    _require_editable(tree)
    if place.suffix != tree.suffix:
        what = f"ending of a copy of {tree.name}"
        raise OptionError.unknown(what, place.suffix or str(path), [tree.suffix])
    if not overwrite and place.exists() and place.samefile(tree):
        raise FileError(
            f"{path} is the robot's own file: name another, or replace it by overwrite=True",
            file=str(path),
        )
    if given := _given_in_python(robot, files, place.name):
        named = place.with_suffix(YAML[0])
        if not overwrite and named.exists() and named.read_bytes() != given.encode():
            raise FileError(
                f"{named}, which would have the closures and motors given in Python, is there "
                "already: name another file, or replace it by overwrite=True",
                file=str(named),
            )
        texts[named.name] = given
    texts[place.name] = updated_robot_file(
        robot, standard_parameters, parameters=parameters, use=use, name=place.name
    )
    # What has no place in these files; all else of ``load`` is in them.
    asked = {name: robot.options.get(name) for name in (*({} if given else KEPT), *ASKED)}
    if some := {name: value for name, value in asked.items() if value}:
        words = (f"{name}={list(x) if isinstance(x, tuple) else x}" for name, x in some.items())
        warn(
            f"{next(iter(texts))} is this robot only where it is loaded as it was, with "
            f"{', '.join(words)}",
            ModelWarning,
        )
    return place.with_name(next(iter(write_files(place.parent, texts))).name)


def _require_editable(tree: Path) -> None:
    if tree.suffix not in editable_files:
        endings = ", ".join(editable_files)
        raise RobotFileError(
            f"{tree}: bodies are not written into {tree.suffix}, but into {endings}: "
            "fit.to_pinocchio() and fit.to_c(folder) have them, too"
        )


def _given_in_python(robot: Robot, files: RobotFiles, tree: str) -> str:
    """The YAML of a robot whose file has less than ``load`` was given; empty where it has all."""
    options = robot.options
    more = [options.get(name) for name in ("closures", "motors", "reference")]
    if not any(more):
        return ""
    kept = {name: options[name] for name in KEPT if options.get(name)}
    named = {"mjcf" if files.given.mjcf else "urdf": tree, **kept}
    closures, motors, reference = more
    given = with_more(files.given, closures or (), motors, reference).model_copy(update=named)
    return yaml_text(given.model_dump(mode="json", exclude_defaults=True))


def _updated_links(
    robot: Robot, body: Body, links: Mapping[str, FloatArray], row: FloatArray
) -> dict[str, FloatArray]:
    """New pseudo-inertias (4, 4) of links of a body that change for its ``row`` (4 or 10,)."""
    model, frames = robot.model, link_frames(robot.model)
    own = {name: model.frames[frames[name]] for name in links if name in frames}
    placements = {
        name: np.array(frame.placement.homogeneous)
        for name, frame in own.items()
        if frame.parentJoint == body.joint_id
    }
    names, parts = list(placements), [T @ links[name] @ T.T for name, T in placements.items()]
    loaded = pseudo_inertia(model.inertias[body.joint_id].toDynamicParameters())
    difference = np.abs(np.sum(parts, axis=0) - loaded) if parts else np.inf
    if np.max(difference) > AGREEMENT * np.abs(loaded).max():
        raise RobotFileError(
            f"{robot.source}: link {body.link} is not what it was when the robot was loaded: "
            "load it again",
            file=robot.source,
            link=body.link,
        )
    heaviest = int(np.argmax([P[3, 3] for P in parts]))
    carrier = names.index(body.link) if body.link in names else heaviest
    at_rest = len(row) < len(KINDS)
    whole = pseudo_inertia(np.pad(row, (0, len(KINDS) - len(row))))
    found = (shared_at_rest if at_rest else shared)(parts, carrier, whole)
    changed = {}
    for name, before, after in zip(names, parts, found, strict=True):
        if after is before:
            continue
        if reason := body_defect(after, flat_allowed=at_rest):
            message = f"link {name} cannot have these parameters: {reason}"
            raise DataError(message, link=name)
        back = np.linalg.inv(placements[name])
        changed[name] = back @ after @ back.T
    return changed


def body_parameters(
    robot: Robot, standard_parameters: FloatArray, parameters: ParameterSet | None
) -> FloatArray:
    """Parameters (bodies, 10), or (bodies, 4) of a gravity model, those of tied links repeated."""
    values = finite(standard_parameters, "standard parameters")
    own = {model: robot.parameters(model) for model in ("full", "gravity")}
    named = [*own.values()] if parameters is None else [parameters]
    labels = next((each.labels for each in named if values.shape == (len(each),)), None)
    if labels is None:
        shapes = " or ".join(f"({len(each)},)" for each in named)
        raise DataError(
            f"standard parameters must have shape {shapes}, not {values.shape}: give their names "
            "where joint terms are among them"
        )
    known = dict(zip(labels, values.tolist(), strict=True))
    model = "full" if known.keys() >= {*own["full"].labels} else "gravity"
    if lacking := [label for label in own[model].labels if label not in known]:
        raise DataError(f"standard parameters lack {', '.join(lacking):.200}")
    count = len(MODELS[model])
    bodies = np.array([known[label] for label in own[model].labels])
    return np.asarray((robot.tie_matrix(count) @ bodies).reshape(-1, count))


def joint_terms(parameters: ParameterSet, values: FloatArray) -> Terms:
    """Values of the parameters that are joint terms."""
    found: Terms = {}
    for parameter, value in zip(parameters, values, strict=True):
        if parameter.kind not in KINDS:
            found.setdefault(parameter.link, {})[parameter.kind] = float(value)
    return found


def straightened(meant: Terms, use: MotorUse | None) -> tuple[Terms, list[str]]:
    """Terms with Coulomb and viscous friction in place of curves, and sentences of how near."""
    found, said = dict(meant), list[str]()
    for joint, terms in meant.items():
        slips = [kind for kind in terms if "slip" in joint_term(kind).needs]
        if any(terms[kind] for kind in slips):
            said.append(f"that friction of {joint} builds up after a reversal is left out")
        rest = {k: value for k, value in terms.items() if not grouped(k)}
        found[joint] = rest
        curved = {k: value for k, value in terms.items() if k not in slips}
        if any(grouped(kind) for kind in curved):
            line, near = _nearest_line(joint, curved, use)
            found[joint] = rest | line
            said.append(near)
    return found, said


def _nearest_line(
    joint: str, terms: Mapping[str, float], use: MotorUse | None
) -> tuple[dict[str, float], str]:
    """Coulomb and viscous friction that are nearest to a curve, and a sentence of how near.

    By least squares over rates of the log at its mean load, or of the curve's points without one.
    """
    from scipy.optimize import nnls  # slow to import

    laws = [joint_term(kind) for kind in terms if grouped(kind)]
    load, points = 0.0, [law.at for law in laws if law.at]
    least, most = (min(points), RATIO * max(points)) if points else (0.0, 1.0)
    if use is not None and joint in use.joints:
        least, most = use.of(joint)
        load = float(use.load[use.joints.index(joint)])
    # Not zero, at which friction has no direction.
    rates = np.maximum(np.linspace(least, most, LINE_POINTS), np.finfo(float).tiny)
    own = {kind: x for kind, x in terms.items() if grouped(kind) or kind in ("Fc", "Fv")}
    both = np.empty((2, LINE_POINTS))
    for way, sign in enumerate((1.0, -1.0)):
        state = JointState(None, sign * rates, None, math=np, torque=load)
        both[way] = sign * signals([*own], state, LINE_POINTS) @ [*own.values()]
    coulomb, viscous = nnls(np.stack([np.ones(LINE_POINTS), rates], axis=1), both.mean(axis=0))[0]
    off = float(np.abs(both - coulomb - viscous * rates).max())
    return {"Fc": float(coulomb), "Fv": float(viscous)}, (
        f"Fc = {coulomb:.3g} and Fv = {viscous:.3g} of {joint} are within {off:.2g} of its "
        f"friction from {least:.2g} to {most:.2g}"
    )


def _writable(meant: Terms) -> Terms:
    """What is tried to be written: no half of a force, no negative friction, inertia or stiffness.

    Simulators take numbers as they are written. With negative friction they would gain energy. A
    negative stiffness would push away from the rest of a spring.
    """
    return {
        joint: {
            kind: max(value, 0.0) if _never_negative(kind) else value
            for kind, value in terms.items()
            if not any(other.startswith(HALVES.get(kind, ())) for other in terms)
        }
        for joint, terms in meant.items()
    }


def _never_negative(kind: str) -> bool:
    return kind == "Ks" or joint_term(kind).positive


def _on_coordinates(robot: Robot, terms: Mapping[str, Mapping[str, Any]]) -> Known:
    """Terms of a file's joints on the coordinates that they are the terms of."""
    return {
        name: dict(values)
        for joint, values in terms.items()
        for name in (robot.coordinates_of([joint]) if joint in robot.joints else [joint])
    }


def _apart(meant: Terms, there: Known) -> Iterator[tuple[str, str]]:
    """Coordinates and kinds whose values differ; what is not there is zero."""
    for joint, terms in meant.items():
        for kind, value in terms.items():
            other = there.get(joint, {}).get(kind, 0.0)
            if other is None or not isclose(value, other, rel_tol=READ_BACK):
                yield joint, kind


def _others(robot: Robot, meant: Terms, there: Known) -> Iterator[str]:
    """Terms that a new file does not have as they were meant, and why."""
    files = files_of(robot)
    given = _on_coordinates(robot, files.given.joint_terms)
    read = {j: there.get(j, {}) | given.get(j, {}) for j in (*there, *given)}
    said: dict[str, list[str]] = {}
    for joint, kind in _apart(meant, read):
        label, value = f"{joint}.{kind}", meant[joint][kind]
        if kind in given.get(joint, {}):
            what = f"joint_terms of {files.named.name} overrule"
        elif value < 0 and _never_negative(kind) and read.get(joint, {}).get(kind, 0.0) == 0:
            what, label = "zero stands for the negative", f"{label} = {value:.3g}"
        else:
            what = (
                "in the fit, but not written into the file (a YAML's joint_terms takes them), are"
            )
        said.setdefault(what, []).append(label)
    for joint in robot.coordinates:
        for kind in read.get(joint, {}):
            if kind not in meant.get(joint, {}) and read[joint][kind]:
                what = "as before, and not in the fit, are"
                said.setdefault(what, []).append(f"{joint}.{kind}")
    yield from (f"{what} {shortened(labels)}" for what, labels in said.items())


def shared(links: Sequence[FloatArray], carrier: int, whole: FloatArray) -> list[FloatArray]:
    """Pseudo-inertias (4, 4) of the links of a body that add up to a new one of the body.

    The carrier takes the whole change. Where that leaves it inconsistent, each link gets its part
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
    """The same where only mass and first moments (the last row of ``whole``) are known."""
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
