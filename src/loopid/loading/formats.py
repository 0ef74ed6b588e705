"""Which formats a robot's tree may be in, and which dialects of URDF are known.

Readers are imported when a file needs them; this file imports none, so that tools can register
theirs at no cost.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from loopid.registry import Registry

if TYPE_CHECKING:
    import pinocchio as pin

    from loopid.loading.tree import TreeSource
    from loopid.loading.urdf import Dialect, UrdfFile

    # A file, whether its base floats, and whether joints that mimic others move on their own.
    TreeReader = Callable[[Path, bool, bool], TreeSource]
    # A dialect mounts the frames that its closures join in the model of the tree.
    DialectReader = Callable[[UrdfFile, pin.Model], Dialect]

# By the ending of the tree's file.
ROBOT_FORMATS: Registry[TreeReader] = Registry("ending of a robot file")
ROBOT_FORMATS.register(".urdf", "loopid.loading.urdf:read_urdf")
# By the XPath of what shows that a URDF has it, from its root.
URDF_DIALECTS: Registry[DialectReader] = Registry("sign of a URDF dialect")
