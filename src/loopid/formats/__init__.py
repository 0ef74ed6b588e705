"""Formats of other programs, each in a file of its own that is imported when a file has it.

A new one is a file and a line: below for those of loopid, in a program of one's own by
``ROBOT_FORMATS.register(".ending", reader)``.
"""

from loopid.loading.formats import ROBOT_FORMATS, URDF_DIALECTS

for ending in (".xml", ".mjcf"):
    ROBOT_FORMATS.register(ending, "loopid.formats.mjcf:read_mjcf")

for sign, reader in {
    "link[starts-with(@name, 'closing_')]": "onshape:read_closing_frames",
    "loop | coupling | joint[@independent] | loop_constraint | joint_constraint": (
        "urdf_plus:read_urdf_plus"
    ),
    "constraint": "urdf_constraint:read_constraints",
    "loop_joint": "isaac_sim:read_loop_joints",
    "gazebo": "gazebo:read_gazebo",
    "//*[contains(name(), 'ball_constraint') or contains(name(), 'linear_')]": "drake:read_drake",
}.items():
    URDF_DIALECTS.register(sign, f"loopid.formats.{reader}")
