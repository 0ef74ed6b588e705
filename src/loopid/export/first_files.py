"""Files to begin with: a YAML of what the tree's file leaves out, and a mapping for a log."""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from pydantic.json_schema import GenerateJsonSchema

from loopid.arguments import checked
from loopid.border import Section
from loopid.errors import FileError, LogError, LoopidError, OptionError, counted, one_line
from loopid.files import write_files
from loopid.loading.closure import Closure
from loopid.loading.description import Description
from loopid.loading.files import YAML, find_files
from loopid.loading.robot_files import load
from loopid.logs.mapping import LogMapping
from loopid.logs.reading import open_log
from loopid.motion.files import ProgramDescription
from loopid.robot.robot import Robot
from loopid.yaml_files import yaml_writer

MJCF = (".xml", ".mjcf")
COLUMN, MOTOR = "COLUMN", "MOTOR"  # in place of names that only the user knows
# Files that users write, by what they are of.
FORMS: dict[str, type[Section]] = {
    "robot": Description,
    "mapping": LogMapping,
    "motions": ProgramDescription,
}


@checked
def write_first_files(
    robot: str | Path,
    log: str | Path | None = None,
    *,
    folder: str | Path = ".",
    floating_base: bool = False,
    xacro: Mapping[str, str] | None = None,
) -> tuple[Path, Path]:
    """Write a YAML for a robot that has none, and a mapping for a log of it, to be filled in.

    Both are commented. The YAML has the closures that the tree's file shows but does not declare,
    if the loops close with them. What only the user knows stands in comments.

    Parameters
    ----------
    robot : str or Path
        A URDF, MJCF, SDF or xacro; of a YAML or a bundled robot only the mapping is written.
    log : str or Path, optional
        A log, whose columns the mapping names.
    folder : str or Path
        Where to write.
    floating_base, xacro
        As of ``load``; the YAML says them.

    Returns
    -------
    tuple of Path
        The YAML, or the robot as it was given where it has one, and the mapping.

    Raises
    ------
    FileError
        When one of the files is there already.
    LoopidError
        When the robot or the log cannot be read.

    Examples
    --------
    >>> import loopid.export, tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     _, mapping = loopid.export.write_first_files("five_bar", folder=place)
    ...     mapping.name
    'five_bar_mapping.yaml'
    """
    options = {"floating_base": floating_base, "xacro": dict(xacro or {})}
    return write_in_words(robot, log, folder, options)


def write_in_words(
    robot: str | Path,
    log: str | Path | None,
    folder: str | Path,
    options: Mapping[str, Any],
    words: Callable[[str], str] = str,
) -> tuple[Path, Path]:
    """As ``write_first_files``, with advice in the words of who asks, such as a command's."""
    files = find_files(robot)
    drawn, stem = _loaded(robot, options), files.tree.name.partition(".")[0]
    motors = drawn.actuated if drawn.motors_known else _driven(drawn, log)
    texts = {f"{stem}_mapping.yaml": _mapping_text(drawn, motors, log)}
    if files.named.suffix not in YAML:
        tree = os.path.relpath(files.tree, folder)
        texts[f"{stem}.yaml"] = _robot_text(drawn, motors, tree, options)
    for name in texts:
        if (place := Path(folder, name)).exists():
            raise FileError(f"{place} is there already: move it away, or write to another folder")
    write_files(folder, {name: words(text) for name, text in texts.items()})
    mapping, *own = (Path(folder, name) for name in texts)
    return own[0] if own else Path(robot), mapping


class _AnyForm(GenerateJsonSchema):
    """Forms that a function tells apart may fit one value both, which ``oneOf`` refuses."""

    def tagged_union_schema(self, schema: Any) -> dict[str, Any]:
        found = super().tagged_union_schema(schema)
        return {"anyOf" if key == "oneOf" else key: each for key, each in found.items()}


def file_schema(kind: str) -> dict[str, Any]:
    """JSON Schema of a kind of YAML, by which editors complete keys and mark what does not fit."""
    OptionError.require("kind of file", kind, FORMS)
    draft = {"$schema": "http://json-schema.org/draft-07/schema#"}
    schema = FORMS[kind].model_json_schema(schema_generator=_AnyForm)
    return draft | schema | {"title": f"loopid {kind} file"}


def _robot_text(
    drawn: Robot, motors: tuple[str, ...], tree: str, options: Mapping[str, Any]
) -> str:
    """The YAML of a robot whose tree is in a file."""
    pairs, whole, refused = _closed(drawn, options)
    declared = [*(each.name for each in drawn.closures), *(each.name for each in drawn.couplings)]
    closures = [{"type": "3d", "frames": list(pair)} for pair in pairs or [("LINK", "LINK")]]
    pose = whole.reference_values(whole.reference)
    degrees = counted(len(whole.independent), "degree")
    joint = whole.actuated[0]
    whose = "these have forces in the log" if motors else "keep those with motors"
    return _file(
        f"{whole.name}: what {Path(tree).name} does not say. Every key may be left out.",
        _Key("mjcf" if tree.endswith(MJCF) else "urdf", tree, sure=True),
        *(_Key(key, value, sure=True) for key, value in options.items() if value),
        "",
        "Where loops were cut open in the tree: frames that meet, as links or joints. Kinds: 3d (a",
        "ball), 6d (a weld), hinge, universal, 2d, cylindrical, prismatic, distance, cable.",
        *([f"The tree's file has these: {', '.join(declared)}."] if declared else []),
        *([f"These look like some, but: {refused}"] if refused else []),
        _Key("closures", closures, sure=bool(pairs) and not refused),
        "",
        "Joints with motors, in the order of the forces in logs.",
        *([] if drawn.motors_known else [f"The tree's file does not say: {whose}."]),
        f"{'With its closures' if whole.rows else 'Without closures'} it has {degrees} of freedom.",
        _Key("name_mot", list(motors or drawn.actuated), sure=bool(motors)),
        "",
        "The pose in which the loops were closed, in m and rad: another branch has another one.",
        _Key("reference", pose),
        "",
        "Limits in m and rad, and what is known of forces in the joints.",
        _Key("limits", {joint: [-1.0, 1.0]}),
        _Key("joint_terms", {joint: {"Ia": 0.01, "Fc": 0.5}}),
    )


def _closed(drawn: Robot, options: Mapping[str, Any]) -> tuple[list[tuple[str, str]], Robot, str]:
    """Pairs of frames that the file shows as closures, the robot with them, or why it has none."""
    pairs = [pair for loops in drawn.undeclared for pair in loops.pairs]
    try:
        return pairs, _loaded(drawn.path, options, pairs), ""
    except LoopidError as error:
        return pairs, drawn, str(error)


def _loaded(path: Any, options: Mapping[str, Any], pairs: Any = ()) -> Robot:
    """The robot with closures of pairs of frames; ``loopid check`` says what is odd about it."""
    with warnings.catch_warnings(action="ignore"):
        return load(path, closures=[Closure(*pair) for pair in pairs], **options)


def _mapping_text(robot: Robot, motors: tuple[str, ...], log: str | Path | None) -> str:
    """The mapping of a log of a robot: its columns, where they are found by name."""
    name = "A log" if log is None else Path(log).name
    found, said = ({}, []) if log is None else _found(robot, motors, Path(log))
    columns: dict[str, Any] = {"time": {"column": COLUMN, "unit": "s"}}
    joints = motors or (MOTOR,)
    columns |= {what: dict.fromkeys(joints, COLUMN) for what in ("position", "force")}
    return _file(
        f"{name} of {robot.name}: which columns are what. Every key may be left out.",
        *said,
        *([] if motors else [f"{MOTOR} is each joint that name_mot of the robot's YAML lists."]),
        *(_Key(key, found.get(key, example), key in found) for key, example in columns.items()),
        "",
        "Factors to m or rad, and to N or N m, of all or by joint, where no header has a unit.",
        _Key("position_scale", 0.001),
        _Key("force_scale", found.get("force_scale", 0.001), "force_scale" in found),
        "",
        "The rate of the rows in Hz, where no column has their times.",
        _Key("rate", 1000.0),
        "",
        "How much later the forces are than the positions, in s.",
        _Key("delay", 0.002),
    )


def _driven(robot: Robot, log: str | Path | None) -> tuple[str, ...]:
    """Joints of a robot without known motors that have forces in a log, by their names."""
    found = list[str]()
    for joint in robot.actuated if log is not None else ():
        _, finder = open_log(log or "", LogMapping())
        with suppress(LogError):
            both = [
                *finder.channels_of("position", (joint,)),
                *finder.channels_of("force", (joint,)),
            ]
            found += [joint] if any(joint in channel.column for _, channel in both) else []
    return tuple(found)


def _found(robot: Robot, motors: tuple[str, ...], path: Path) -> tuple[dict[str, Any], list[str]]:
    """What the names of a log's columns say, and sentences about them."""
    (_, finder), found, used = open_log(path, LogMapping()), dict[str, Any](), dict[str, None]()
    several = len(finder.streams) > 1
    said = [f"Columns of {name}: {', '.join(columns)}." for name, columns in finder.streams.items()]
    for quantity in ("position", "force"):
        try:
            for place, channel in finder.channels_of(quantity, motors or robot.actuated):
                name = str(place) if several else place.column
                found.setdefault(quantity, {})[channel.joint] = name
                used[place.stream] = None
                if quantity == "force" and finder.is_current(place):
                    found["force_scale"] = 1.0
        except LogError as error:
            said.append(f"Not found by name: {error}")
    if "force_scale" in found:
        said.append("Forces are currents: force_scale is the force of one of their units.")
    try:
        times = [finder.time(stream) for stream in used]
        if not several and times and times[0].rest is None:
            found["time"] = {"column": times[0].name}
    except LogError as error:
        said.append(f"Not found by name: {error}")
    return found, said


# Files with comments.


class _Key(NamedTuple):
    """A key with a value; in a comment unless it is sure."""

    name: str
    value: Any
    sure: bool = False


def _file(*parts: str | _Key) -> str:
    """A YAML of comments and keys, an entry a line."""
    yaml, lines = yaml_writer(), list[str]()
    yaml.default_flow_style = False
    yaml.indent(sequence=4, offset=2)
    for part in parts:
        if isinstance(part, str):
            lines += [f"# {one_line(part)}" if part else ""]
        else:
            text = io.StringIO()
            yaml.dump({part.name: part.value}, text)
            own = text.getvalue().splitlines()
            lines += own if part.sure else [f"# {line}" for line in own]
    return "\n".join(lines) + "\n"
