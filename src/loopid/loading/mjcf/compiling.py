"""MuJoCo's compiled model of an MJCF file, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np
from lxml import etree

from loopid.errors import MissingFileError, RobotFileError

# MuJoCo lets 'nan' and 'inf' through.
FINITE = ("body_pos", "body_quat", "body_ipos", "body_iquat", "body_mass", "body_inertia",
          "jnt_pos", "jnt_axis", "qpos0", "site_pos", "site_quat", "eq_data", "wrap_prm",
          "key_qpos")  # fmt: skip


def compile_mjcf(path: Path) -> tuple[mujoco.MjModel, list[str]]:
    """Compiled model of an MJCF file, and what MuJoCo warns of.

    Raises
    ------
    MissingFileError, RobotFileError
        One sentence with the file and MuJoCo's reason.
    """
    if not path.is_file():
        raise MissingFileError(f"{path} is missing")
    _require_mujoco_root(path)
    with _heard_warnings() as warnings:
        try:
            compiled = mujoco.MjModel.from_xml_path(str(path))
        except (ValueError, RuntimeError, mujoco.FatalError, mujoco.UnexpectedError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise RobotFileError(f"{path}: MuJoCo refuses it: {reason}") from error
    _require_finite(path, compiled)
    return compiled, warnings


@contextmanager
def _heard_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings, which it would print and append to a file where it runs."""
    heard: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield heard
    finally:
        mujoco.set_mju_user_warning(before)


def _require_mujoco_root(path: Path) -> None:
    """MuJoCo compiles URDFs too, but drops what it does not know in them."""
    try:
        with path.open("rb") as stream:
            root = next(etree.iterparse(stream, events=("start",)))[1].tag
    except (etree.XMLSyntaxError, OSError):
        return  # for MuJoCo to explain
    if root != "mujoco":
        raise RobotFileError(f"{path} is not MJCF: its root is <{root!s}>, not <mujoco>")


def _require_finite(path: Path, compiled: mujoco.MjModel) -> None:
    finite = {name: bool(np.isfinite(getattr(compiled, name)).all()) for name in FINITE}
    finite["gravity"] = bool(np.isfinite(compiled.opt.gravity).all())
    # Limits may be infinite.
    finite["jnt_range"] = not np.isnan(compiled.jnt_range).any()
    broken = [name for name, fine in finite.items() if not fine]
    if broken:
        raise RobotFileError(f"{path}: {broken[0]} of MuJoCo's model is not finite")
    for name in ("body_quat", "body_iquat", "site_quat"):
        # What is too long or short for MuJoCo to normalise is zero then.
        if not np.linalg.norm(getattr(compiled, name), axis=1).all():
            raise RobotFileError(f"{path}: {name} of MuJoCo's model has a quaternion of length 0")
