"""``load_mechanism``: from robot files to a validated, closed ``Mechanism``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pinocchio as pin

from loopid.arguments import checked
from loopid.errors import MobilityError, OptionError
from loopid.loading.closing import close_reference
from loopid.loading.closures import find_closures, find_couplings, find_platform
from loopid.loading.description import Description, merged
from loopid.loading.findings import warn_of_findings
from loopid.loading.groups import find_groups
from loopid.loading.mjcf import read_mjcf
from loopid.loading.parts import find_bodies, find_motors, locked_values
from loopid.loading.reference import written_reference
from loopid.loading.source import TreeSource
from loopid.loading.tree import build_tree
from loopid.loading.tree_file import RobotFiles, find_files
from loopid.loading.urdf import read_urdf_source
from loopid.robot import Mechanism


@checked
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
    files = find_files(path)
    file, given = files.named, files.given
    source = _read_tree(files, floating_base, free_mimics)
    description = merged(source.description, given)
    tree = build_tree(file, source, description, lock)
    locked = {*description.fixed, *lock}
    mechanism = _mechanism(tree, description, source.model, locked, tied, file)
    try:
        _require_motors(mechanism)
        # Where no motors are known, none can be kept where it is.
        kept = given.reference if description.name_mot is not None else ()
        closed = close_reference(mechanism, given=kept)
    except MobilityError as error:
        raise MobilityError(f"{file}: {error}") from error
    warn_of_findings(*closed, tree, motors_given=description.name_mot is not None)
    options = {
        "lock": tuple(lock),
        "floating_base": floating_base,
        "free_mimics": free_mimics,
        "tied": tied,
    }
    return replace(closed.mechanism, options=options)


def _require_motors(mechanism: Mechanism) -> None:
    if not mechanism.actuated:
        raise MobilityError(
            "no joint has a motor, so no force would be known: choose 'name_mot' among "
            f"{', '.join(mechanism.joints)}"
        )


def _read_tree(files: RobotFiles, floating_base: bool, free_mimics: bool) -> TreeSource:
    floating = floating_base or files.given.floating_base
    if not files.is_mjcf:
        return read_urdf_source(files.tree, floating, free_mimics)
    if floating:
        raise OptionError(
            f"{files.tree}: an MJCF says itself whether its base floats: add a freejoint"
        )
    return read_mjcf(files.tree)


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
