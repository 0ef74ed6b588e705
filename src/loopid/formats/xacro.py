"""xacro: a URDF or SDF written with macros, which the package ``xacro`` writes out.

Importing this needs xacro.
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Mapping
from contextlib import redirect_stderr
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from loopid.errors import OptionError, RobotFileError, naming, optional
from loopid.formats.sdf import read_sdf
from loopid.loading.tree import TreeSource
from loopid.loading.urdf import read_urdf
from loopid.loading.xml_elements import Element, parsed_xml

with optional("xacro", "xacro"):
    import xacro

READERS = {"robot": read_urdf, "sdf": read_sdf}
UNDEFINED_ARGUMENT = re.compile(r"Undefined substitution argument (\S+)")
ROS_INDEX = "ament_index_python"


def read_xacro(
    path: Path,
    floating_base: bool = False,
    free_mimics: bool = False,
    xacro: Mapping[str, str] | None = None,
) -> TreeSource:
    """Read the URDF or SDF that a file of macros gives with some arguments."""
    with naming(path):
        root, said = _written_out(path, xacro or {})
        if root.tag not in READERS:
            raise RobotFileError(f"its root is <{root.tag!s}>, not <robot> or <sdf>")
    source: TreeSource = READERS[str(root.tag)](path, floating_base, free_mimics, root)
    return replace(source, notes=(*source.notes, *said))


def _written_out(path: Path, arguments: Mapping[str, str]) -> tuple[Element, list[str]]:
    """The file without macros, and what xacro warns of."""
    given, heard, packages = _Arguments(arguments), io.StringIO(), _packages(path)
    sys.modules.update(packages)  # xacro takes no argument for it
    try:
        with redirect_stderr(heard):
            content = xacro.process_file(str(path), mappings=given).toxml("utf-8")
    except Exception as error:  # of any expression in the file
        raise RobotFileError(_reason(error)) from error
    finally:
        for name in packages:
            del sys.modules[name]
    for name in arguments:
        if name not in given.used:
            raise OptionError.unknown("argument of its macros", name, sorted(given.used))
    # Where in the file it is stands on lines of their own behind each warning.
    warnings = (" ".join(text.split()) for text in heard.getvalue().split("warning: "))
    said = [f"xacro warns: {text}" for text in dict.fromkeys(warnings) if text]
    return parsed_xml(content), said


def _reason(error: BaseException) -> str:
    """What xacro refuses, once, and what helps where that is known."""
    wrapped = error  # xacro's errors hold others, and print each with what it holds
    while isinstance(inner := getattr(wrapped, "exc", None), BaseException):
        wrapped = inner
    for cause in (wrapped, wrapped.__cause__, wrapped.__context__):
        if isinstance(cause, RobotFileError):
            return str(cause)
    reason = " ".join(str(error).split()) or type(error).__name__
    if argument := UNDEFINED_ARGUMENT.search(reason):
        name = argument[1]
        return (
            f"the argument {name!r} has no value: give one as xacro={{{name!r}: ...}}, or by the "
            "key 'xacro' of a YAML beside the file"
        )
    return f"xacro refuses it: {reason:.300}"


class _Arguments(dict[str, Any]):
    """Arguments that know which of them were used."""

    def __init__(self, arguments: Mapping[str, str]) -> None:
        super().__init__(arguments)
        self.used: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.used.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> Any:
        self.used.add(name)
        return super().__getitem__(name)


def _packages(path: Path) -> dict[str, ModuleType]:
    """ROS's index of packages, which xacro asks for ``$(find NAME)``; without ROS a look around."""
    if find_spec(ROS_INDEX) is not None:
        return {}

    def folder_of(name: str) -> str:
        for folder in path.absolute().parents:
            for place in (folder, folder / name):
                if place.name == name and place.is_dir():
                    return str(place)
        raise RobotFileError(
            f"package {name!r} is neither installed nor around the file: put its folder {name} "
            f"beside the file or above it"
        )

    index, packages = ModuleType(ROS_INDEX), ModuleType(f"{ROS_INDEX}.packages")
    packages.__dict__["get_package_share_directory"] = folder_of
    return {ROS_INDEX: index, f"{ROS_INDEX}.packages": packages}
