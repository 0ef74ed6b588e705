"""Which formats a robot's tree may be in.

Readers and editors are imported when a file needs them; this file imports none, so that tools can
register theirs at no cost.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from loopid.registry import Registry

if TYPE_CHECKING:
    from loopid.loading.inertials import InertialFile

    # An editor of the inertials of a file.
    InertialEditor = Callable[[Path], InertialFile]

# By the ending of the tree's file.
INERTIAL_FILES: Registry[InertialEditor] = Registry("ending of a robot file to be edited")
