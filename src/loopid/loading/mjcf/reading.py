"""From an MJCF file to the open tree and what the file says beside it."""

from __future__ import annotations

from pathlib import Path

from loopid.loading.description import Description
from loopid.loading.mjcf.compiling import compile_mjcf
from loopid.loading.mjcf.equalities import read_closures
from loopid.loading.mjcf.motors import read_motors
from loopid.loading.mjcf.names import model_name, read_names
from loopid.loading.mjcf.notes import read_notes
from loopid.loading.mjcf.reference import read_reference
from loopid.loading.mjcf.scene import Scene
from loopid.loading.mjcf.tree import build_model, inertial_links
from loopid.loading.source import TreeSource


def read_tree(path: Path) -> TreeSource:
    """Read an MJCF file; MuJoCo is there.

    Raises
    ------
    MissingFileError, RobotFileError
        Naming the file and MuJoCo's reason or the element that is not supported.
    """
    compiled, warnings = compile_mjcf(path)
    scene = Scene(path, compiled, read_names(compiled))
    name = model_name(compiled) or path.stem
    model, child_links = build_model(scene, name)
    closures = read_closures(scene, model)
    motors = read_motors(scene, closures)
    description = Description(
        closures=closures,
        name_mot=motors.joints,
        reference=read_reference(scene),
    )
    return TreeSource(
        name=name,
        file=path,
        model=model,
        inertial_links=inertial_links(scene),
        child_links=child_links,
        description=description,
        notes=(
            *read_notes(scene, motors),
            *(f"MuJoCo warns: {text}" for text in dict.fromkeys(warnings)),
        ),
    )
