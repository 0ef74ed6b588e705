"""Formats of robots and of logs beyond the core, found through registries."""

from loopid.registry import editable_files, log_formats, robot_formats, urdf_dialects

# The last one registered is first to say whether it reads a path: any folder may be one of tables.
log_formats.register("folder", "loopid.formats.text:TextFormat")
log_formats.register("csv", "loopid.formats.text:TextFormat")
log_formats.register("npz", "loopid.formats.arrays:NpzFormat")
log_formats.register("parquet", "loopid.formats.tables:ParquetFormat")
log_formats.register("hdf5", "loopid.formats.arrays:Hdf5Format")
log_formats.register("mat", "loopid.formats.arrays:MatFormat")
log_formats.register("jsonl", "loopid.formats.tables:JsonLinesFormat")
log_formats.register("excel", "loopid.formats.tables:ExcelFormat")
log_formats.register("rostopic", "loopid.formats.text:RostopicFormat")
log_formats.register("bag", "loopid.formats.bags:BagFormat")

for ending in (".xml", ".mjcf"):
    robot_formats.register(ending, "loopid.formats.mjcf:read_mjcf")
    editable_files.register(ending, "loopid.formats.mjcf_editor:MjcfEditor")

editable_files.register(".urdf", "loopid.formats.urdf_editor:UrdfEditor")
robot_formats.register(".sdf", "loopid.formats.sdf:read_sdf")
robot_formats.register(".xacro", "loopid.formats.xacro:read_xacro")

for sign, reader in {
    "link[starts-with(@name, 'closing_')]": "read_closing_frames",
    "loop | loop_joint | constraint": "read_loop_tags",
    "coupling | joint[@independent] | loop_constraint | joint_constraint": "read_urdf_plus",
    "gazebo": "read_gazebo",
    "//*[contains(name(), 'ball_constraint') or contains(name(), 'linear_')]": "read_drake",
}.items():
    urdf_dialects.register(sign, f"loopid.formats.urdf_dialects:{reader}")
