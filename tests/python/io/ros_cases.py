"""Bags written by the libraries of the ROS world, for the tests of reading them."""

from __future__ import annotations

import numpy as np
from mcap.writer import CompressionType, Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer as Writer2
from rosbags.typesys import Stores, get_typestore

STAMPED = "geometry_msgs/msg/WrenchStamped"
PLAIN = "geometry_msgs/msg/Wrench"
START_NS = 1_700_000_000_123_456_789
SQLITE, MCAP = StoragePlugin.SQLITE3, StoragePlugin.MCAP
ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)


def samples(n=20, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 6))


def even_stamps(n=20):
    return [START_NS + i * 2_000_000 for i in range(n)]


def message(store, row, stamp_ns=None, frame="ft_link"):
    """Return a Wrench (no stamp) or WrenchStamped object."""
    types = store.types
    force, torque = (types["geometry_msgs/msg/Vector3"](*map(float, part)) for part in (row[:3], row[3:]))
    wrench = types[PLAIN](force=force, torque=torque)
    if stamp_ns is None:
        return wrench
    stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    seq = {"seq": 7} if store is ROS1 else {}
    header = types["std_msgs/msg/Header"](**seq, stamp=stamp, frame_id=frame)
    return types[STAMPED](header=header, wrench=wrench)


def to_bytes(value, store):
    serialize = store.serialize_ros1 if store is ROS1 else store.serialize_cdr
    return bytes(serialize(value, value.__msgtype__))


def payloads(store, wrench, stamps_ns=None, frame="ft_link"):
    every = [None] * len(wrench) if stamps_ns is None else stamps_ns
    return [
        to_bytes(message(store, row, stamp, frame), store) for row, stamp in zip(wrench, every, strict=True)
    ]


def write_bag1(path, topics, compression=None, node=None, store=ROS1):
    """Write a ROS 1 bag of ``{topic: (type, payloads, log times)}``."""
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(getattr(Writer1.CompressionFormat, compression))
    with writer:
        for topic, (type_name, messages, log_ns) in topics.items():
            connection = writer.add_connection(topic, type_name, typestore=store, callerid=node)
            for data, time in zip(messages, log_ns, strict=True):
                writer.write(connection, time, data)
    return path


def write_bag2(path, topics, plugin=SQLITE, mode=None, version=9, store=ROS2):
    """Write a ROS 2 bag folder of ``{topic: (type, payloads, log times)}``."""
    writer = Writer2(path, version=version, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(getattr(CompressionMode, mode), CompressionFormat.ZSTD)
    with writer:
        for topic, (type_name, messages, log_ns) in topics.items():
            connection = writer.add_connection(topic, type_name, typestore=store)
            for data, time in zip(messages, log_ns, strict=True):
                writer.write(connection, time, data)
    return path


def write_mcap(path, topics, compression="ZSTD", *, store=ROS2, **settings):
    """Write an MCAP file of ``{topic: (type, payloads, log times)}``."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType[compression], **settings)
        writer.start(profile="ros2", library="test")
        for topic, (type_name, messages, log_ns) in topics.items():
            text = store.generate_msgdef(type_name, ros_version=2)[0]
            schema_id = writer.register_schema(type_name, "ros2msg", text.encode())
            channel = writer.register_channel(topic, "cdr", schema_id)
            for data, time in zip(messages, log_ns, strict=True):
                writer.add_message(channel, log_time=time, publish_time=time, data=data)
        writer.finish()
    return path


def one_topic(store, wrench, stamps_ns, log_ns=None, frame="ft_link", name="/ft"):
    """Return the topics of a bag that holds one WrenchStamped topic."""
    return {name: (STAMPED, payloads(store, wrench, stamps_ns, frame), log_ns or stamps_ns)}


KINDS = (
    *(f"bag1 {compression}" for compression in (None, "LZ4", "BZ2")),
    *(f"bag2 sqlite {mode} v{version}" for mode in (None, "FILE", "MESSAGE") for version in (8, 9)),
    *(f"bag2 mcap {mode} v{version}" for mode in (None, "STORAGE", "FILE") for version in (8, 9)),
    *(f"mcap {compression}" for compression in ("NONE", "LZ4", "ZSTD")),
    "mcap unchunked",
)
"""Every kind of bag that the libraries can write."""


def write_kind(kind, folder, wrench, stamps_ns, **about):
    """Write one topic as one of `KINDS`; return the path to read."""
    parts = kind.split()
    topics = one_topic(ROS1 if kind.startswith("bag1") else ROS2, wrench, stamps_ns, **about)
    if parts[0] == "bag1":
        return write_bag1(folder / "x.bag", topics, None if parts[1] == "None" else parts[1], node="/driver")
    if parts[0] == "bag2":
        plugin, mode = SQLITE if parts[1] == "sqlite" else MCAP, None if parts[2] == "None" else parts[2]
        return write_bag2(folder / "x", topics, plugin, mode, int(parts[3][1:]))
    path = folder / "x.mcap"
    if kind == "mcap unchunked":
        return write_mcap(path, topics, use_chunking=False)
    return write_mcap(path, topics, parts[1])
