"""``load_mechanism``: from robot files to a validated, closed ``Mechanism``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pinocchio as pin

from loopid.errors import MissingFileError, MobilityError, OptionError
from loopid.loading.bundled import find_robot_file
from loopid.loading.closing import close_reference
from loopid.loading.closures import find_closures, find_couplings, find_platform
from loopid.loading.description import Description, merged, read_description
from loopid.loading.findings import warn_of_findings
from loopid.loading.groups import find_groups
from loopid.loading.mjcf import read_mjcf
from loopid.loading.parts import find_bodies, find_motors, locked_values
from loopid.loading.reference import written_reference
from loopid.loading.source import TreeSource
from loopid.loading.tree import build_tree
from loopid.loading.urdf import read_urdf_source
from loopid.mechanism import Mechanism

DESCRIPTIONS = (".yaml", ".yml")
MJCF = (".xml", ".mjcf")


def load_mechanism(
    path: str | Path,
    lock: Sequence[str] = (),
    *,
    floating_base: bool = False,
    free_mimics: bool = False,
    tied: bool = False,
) -> Mechanism:
    """Load a robot and check that it is one.

    Parameters
    ----------
    path : str or Path
        A YAML with the loop closures (its URDF or MJCF beside it), a URDF or URDF+, an MJCF, or the
        name of a bundled robot such as ``"3ups_rpu"``.
    lock : sequence of str
        Joints, or turns of spherical joints such as ``"ball.wz"``, to lock at their reference, in
        addition to those the YAML fixes.
    floating_base : bool
        Whether the root of a URDF moves freely.
    free_mimics : bool
        Whether joints of a URDF that mimic others have motors of their own all the same.
    tied : bool
        Whether links that the file declares ``identical`` share their parameters.

    Returns
    -------
    Mechanism
        Closed at its reference to 1e-10 m, or as far as the rounded numbers of its file allow.

    Raises
    ------
    MissingFileError, RobotFileError, MobilityError, OptionError
        Naming the file and the offender.

    Warns
    -----
    MobilityWarning, SingularityWarning, ClosureWarning, InertiaWarning, ModelWarning
        Of what is loaded nevertheless.
    """
    file = find_robot_file(path)
    given = read_description(file) if file.suffix in DESCRIPTIONS else Description()
    source = _read_tree(file, given, floating_base, free_mimics)
    description = merged(source.description, given)
    tree = build_tree(file, source, description, lock)
    locked = {*description.fixed, *lock}
    mechanism = _mechanism(tree, description, source.model, locked, tied, file)
    try:
        _require_motors(mechanism)
        # Where no motors are known, none can be kept where it is.
        kept = given.reference if description.name_mot is not None else ()
        mechanism = close_reference(mechanism, given=kept)
    except MobilityError as error:
        raise MobilityError(f"{file}: {error}") from error
    warn_of_findings(mechanism, tree, motors_given=description.name_mot is not None)
    return mechanism


def _require_motors(mechanism: Mechanism) -> None:
    if not mechanism.actuated:
        raise MobilityError(
            "no joint has a motor, so no force would be known: choose 'name_mot' among "
            f"{', '.join(mechanism.joints)}"
        )


def _read_tree(
    file: Path, given: Description, floating_base: bool, free_mimics: bool
) -> TreeSource:
    tree = file if file.suffix not in DESCRIPTIONS else _tree_beside(file, given)
    floating = floating_base or given.floating_base
    if tree.suffix not in MJCF:
        return read_urdf_source(tree, floating, free_mimics)
    if floating:
        raise OptionError(f"{tree}: an MJCF says itself whether its base floats: add a freejoint")
    return read_mjcf(tree)


def _tree_beside(file: Path, description: Description) -> Path:
    named = description.urdf or description.mjcf
    if named is not None:
        candidates = [file.parent / named]
    else:
        candidates = [file.with_suffix(suffix) for suffix in (".urdf", *MJCF)]
    for tree in candidates:
        if tree.is_file():
            return tree
    kind = "MJCF" if description.mjcf is not None else "URDF"
    missing = " ".join(str(candidates[0]).split())
    raise MissingFileError(f"{file}: its {kind} {missing} is missing")


def _mechanism(
    tree: TreeSource,
    description: Description,
    whole: pin.Model,
    locked: set[str],
    tied: bool,
    file: Path,
) -> Mechanism:
    """The mechanism at the reference as it is written; ``whole`` still has the locked joints."""
    model, reference = tree.model, description.reference
    bodies = find_bodies(tree)
    if tied and not description.identical:
        raise OptionError(f"{file} declares no identical links: nothing to tie")
    return Mechanism(
        name=tree.name,
        path=file,
        model=model,
        closures=find_closures(file, model, description),
        couplings=find_couplings(
            file, model, description, locked_values(file, whole, reference, locked)
        ),
        actuated=find_motors(file, model, description, locked),
        bodies=bodies,
        reference=written_reference(
            file, model, {name: v for name, v in reference.items() if name not in locked}
        ),
        platform=find_platform(file, model, description.platform),
        identical=find_groups(file, tree, description.identical, bodies),
        tied=tied,
    )
