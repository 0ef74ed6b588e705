"""One simulated run in every format that is read by an extra library."""

import gzip
from functools import cache

import h5py
import numpy as np
import polars
from simulated_logs import table

STATE = "sensor_msgs/msg/JointState"
TOPIC = "/joint_states"


@cache
def types_of(ros):
    """The types of messages of "ros1" or "ros2"."""
    from rosbags.typesys import Stores, get_typestore  # slow to import

    return get_typestore({"ros1": Stores.ROS1_NOETIC, "ros2": Stores.ROS2_HUMBLE}[ros])


def joint_state(ros, stamp, names, position=(), velocity=(), effort=()):
    """A message, with the stamp in ns."""
    types = types_of(ros).types
    time = types["builtin_interfaces/msg/Time"](*divmod(int(stamp), 10**9))
    sequence = (0,) if ros == "ros1" else ()
    header = types["std_msgs/msg/Header"](*sequence, time, "base")
    values = [np.array(column, dtype=np.float64) for column in (position, velocity, effort)]
    return types[STATE](header, list(names), *values)


def states(ros, joints, stamps, position, force):
    """A message a row with all joints, as (received, topic, message)."""
    for stamp, q, f in zip(stamps, position, force, strict=True):
        yield int(stamp), TOPIC, joint_state(ros, stamp, joints, q, np.ones_like(q), f)


def write_ros1(path, messages, packed=None, chunk=4096):
    """A bag of (received, topic, message)."""
    from rosbags.rosbag1 import Writer  # slow to import

    store, connections = types_of("ros1"), {}
    writer = Writer(path)
    writer.chunk_threshold = chunk
    if packed is not None:
        writer.set_compression(Writer.CompressionFormat[packed])
    with writer:
        for received, topic, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], received, store.serialize_ros1(message, kind))
    return path


def write_ros2(folder, messages, storage="mcap", packed=None):
    """A bag of (received, topic, message); ``packed`` is "file", "message" or "storage"."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store, connections = types_of("ros2"), {}
    plugin = {"db3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[storage]
    writer = Writer(folder, version=9, storage_plugin=plugin)
    if packed is not None:
        writer.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
    with writer:
        for received, topic, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], received, store.serialize_cdr(message, kind))
    return folder


def write_parquet(path, columns, **options):
    polars.DataFrame(columns).write_parquet(path, **options)
    return path


def write_hdf5(path, columns, group="/"):
    with h5py.File(path, "w") as file:
        for name, column in columns.items():
            file.require_group(group)[name] = column
    return path


def columns_of(time, position, force, joints):
    """Arrays by the names of their columns."""
    named = zip(("position", "force"), (position, force), strict=True)
    columns = {
        f"{joint}.{kind}": values[:, k] for kind, values in named for k, joint in enumerate(joints)
    }
    return {"time": time} | columns


def write_any(kind, folder, joints, time, position, force):
    """The run in a format; gives its path."""
    stamps = np.round(np.asarray(time) * 1e9).astype(np.int64)
    columns = columns_of(time, position, force, joints)
    if kind == "csv.gz":
        path = folder / "run.csv.gz"
        path.write_bytes(gzip.compress(table(time, position, force, joints).encode()))
        return path
    if kind == "npz":
        np.savez(folder / "run.npz", **columns)
        return folder / "run.npz"
    if kind == "parquet":
        return write_parquet(folder / "run.parquet", columns)
    if kind == "hdf5":
        return write_hdf5(folder / "run.h5", columns)
    if kind == "ros1":
        return write_ros1(folder / "run.bag", states("ros1", joints, stamps, position, force))
    messages = states("ros2", joints, stamps, position, force)
    bag = write_ros2(folder / "run", messages, kind.split()[0])
    return bag / "run.mcap" if kind == "mcap file" else bag
