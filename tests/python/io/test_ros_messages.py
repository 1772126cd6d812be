"""Wrench messages as bytes: decoded as the libraries do, and refused with their number where they are at fault."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from effort import cases
from granular_id.io import RecordingFileError

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from granular_id.io.ros.wrench import decode_wrenches, encode_wrenches
from ros_cases import (
    ROS1,
    ROS2,
    STAMPED,
    cdr_bytes,
    even_stamps,
    message,
    one_topic,
    payloads,
    read,
    ros1_bytes,
    samples,
    write_bag1,
    write_kind,
    write_mcap,
)


def raising(index, problem):
    raise ValueError(f"{index}: {problem}")


@settings(max_examples=cases(25))
@given(
    frame=st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12),
    values=st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=6, max_size=6), min_size=1
    ),
    start=st.integers(0, 2**31 - 2),
    little_endian=st.booleans(),
)
def test_decoding_is_that_of_rosbags(frame, values, start, little_endian):
    stamps = [start * 10**9 + i * 999_999_937 for i in range(len(values)) if start + i < 2**31]
    for to_bytes, store, encoding in (
        (lambda value: cdr_bytes(value, little_endian=little_endian), ROS2, "cdr"),
        (ros1_bytes, ROS1, "ros1"),
    ):
        raw = [
            to_bytes(message(store, row, stamp, frame)) for row, stamp in zip(values, stamps, strict=False)
        ]
        lengths = np.array([len(data) for data in raw])
        found = decode_wrenches(b"".join(raw), lengths, encoding, "geometry_msgs/WrenchStamped", raising)
        assert found.wrench.tobytes() == np.array(values[: len(raw)], dtype=np.float64).tobytes()
        assert found.stamps_ns.tolist() == stamps
        assert found.frame_id == frame
    little = [cdr_bytes(message(ROS2, row, stamp, frame)) for row, stamp in zip(values, stamps, strict=False)]
    assert encode_wrenches(found.wrench, found.stamps_ns, frame) == little


@pytest.mark.parametrize("kind", ["bag1 None", "bag2 sqlite None v9", "mcap ZSTD"])
@pytest.mark.parametrize(("value", "column", "name"), [(math.nan, 1, "force.y"), (-math.inf, 5, "torque.z")])
def test_forces_that_are_not_finite(tmp_path, kind, value, column, name):
    wrench = samples()
    wrench[16, column] = value
    with pytest.raises(RecordingFileError) as caught:
        read(write_kind(kind, tmp_path, wrench, even_stamps()))
    assert caught.value.place == "message 17 of /ft"
    assert f"{name} is {value}" in str(caught.value)


@pytest.mark.parametrize("other", ["tool0", "ft_lin2", "x", ""])
@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ros1", "ros2"])
def test_a_frame_that_changes(tmp_path, store, other):
    stamps = even_stamps()
    raw = payloads(store, samples(), stamps)
    raw[9] = payloads(store, samples()[9:10], stamps[9:10], other)[0]
    topics = {"/ft": (STAMPED, raw, stamps)}
    path = (
        write_bag1(tmp_path / "x.bag", topics) if store is ROS1 else write_mcap(tmp_path / "x.mcap", topics)
    )
    with pytest.raises(RecordingFileError) as caught:
        read(path)
    assert caught.value.place == "message 10 of /ft"
    assert f"frame_id changes from 'ft_link' to {other!r}" in str(caught.value)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda raw: raw[:-1], "bytes; its type makes it"),
        (lambda raw: b"", "begins with nothing; wanted plain CDR"),
        (lambda raw: b"\x00\x07" + raw[2:], "begins with 00 07 00 00; wanted plain CDR"),
        (lambda raw: raw[:12] + b"\xff\xff\xff\x7f" + raw[16:], "claims a frame_id of 2147483647 bytes"),
        (lambda raw: raw[:8] + b"\xff\xff\xff\xff" + raw[12:], "4294967295 nanosec; wanted less than 1e9"),
        (lambda raw: raw[:16] + b"\xff\xfe" + raw[18:], "frame_id is not UTF-8"),
    ],
)
def test_damaged_messages(tmp_path, change, problem):
    raw = [change(data) for data in payloads(ROS2, samples(), even_stamps())]
    path = write_mcap(tmp_path / "x.mcap", {"/ft": (STAMPED, raw, even_stamps())})
    with pytest.raises(RecordingFileError, match=problem) as caught:
        read(path)
    assert caught.value.place == "message 1 of /ft"


def test_byte_order_may_not_change_within_a_topic(tmp_path):
    raw = payloads(ROS2, samples(), even_stamps())
    raw[3] = cdr_bytes(message(ROS2, samples()[3], even_stamps()[3]), little_endian=False)
    path = write_mcap(tmp_path / "x.mcap", {"/ft": (STAMPED, raw, even_stamps())})
    with pytest.raises(RecordingFileError, match="byte order changes") as caught:
        read(path)
    assert caught.value.place == "message 4 of /ft"


def test_a_type_of_the_same_name_but_other_fields(tmp_path):
    text = "std_msgs/Header header\ngeometry_msgs/Wrench wrench\nfloat32 temperature # of the sensor\n"
    topics = one_topic(ROS2, samples(), even_stamps())
    with pytest.raises(
        RecordingFileError, match=r"defined as 'Header header; Wrench wrench; float32 temperature'"
    ):
        read(write_mcap(tmp_path / "x.mcap", topics, definitions=text))
    text = (
        "# comment\nHeader   header\n\nint8 LEFT=1\nWrench wrench # N\n"
        + "=" * 80
        + "\nMSG: geometry_msgs/Wrench\nVector3 torque\nVector3 force\n"
    )
    with pytest.raises(RecordingFileError, match="Wrench is defined as 'Vector3 torque; Vector3 force'"):
        read(write_mcap(tmp_path / "y.mcap", topics, definitions=text))
