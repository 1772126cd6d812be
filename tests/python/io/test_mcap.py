"""MCAP written here: read back bit for bit, by the libraries of the ROS world, and after others have changed it."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.io.ros.mcap import CHANGED_NOTE, save_mcap
from granular_id.recording import Dataset, Recording

pytest.importorskip("mcap")
pytest.importorskip("rosbags")

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from ros_cases import ROS2, STAMPED, irregular, push


def decoded(path):
    """Return what the mcap library makes of the messages, checking every checksum."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return list(reader.iter_decoded_messages())


# -- other readers


@pytest.mark.parametrize("recording", [push(), irregular()], ids=["uniform", "irregular"])
def test_the_mcap_library_reads_types_values_and_stamps(tmp_path, recording):
    messages = decoded(save_mcap(Dataset([recording]), tmp_path / "x.mcap"))
    assert len(messages) == recording.n_samples
    start = Fraction(recording.start_time)
    for row, time, (schema, channel, message, value) in zip(
        recording.wrench.tolist(), recording.times().tolist(), messages, strict=True
    ):
        assert (schema.name, schema.encoding) == (STAMPED, "ros2msg")
        assert (channel.topic, channel.message_encoding) == ("/wrench", "cdr")
        force, torque, stamp = value.wrench.force, value.wrench.torque, value.header.stamp
        assert [force.x, force.y, force.z, torque.x, torque.y, torque.z] == row
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        assert stamp_ns == message.log_time == message.publish_time
        assert abs(Fraction(stamp_ns, 10**9) - start - Fraction(time)) <= Fraction(1, 10**9)  # two roundings


def test_rosbags_knows_the_type_and_writes_the_same_messages(tmp_path):
    path = save_mcap(Dataset([push(3, meta={"frame": "ft_sensor"})]), tmp_path / "x.mcap")
    with AnyReader([path]) as reader:
        assert reader.typestore.hash_rihs01(STAMPED) == ROS2.hash_rihs01(STAMPED)  # every field of every type
        for _, _, raw in reader.messages():
            assert bytes(ROS2.serialize_cdr(reader.deserialize(raw, STAMPED), STAMPED)) == raw


def test_what_foxglove_and_plotjuggler_ask_for(tmp_path):
    """Both seek by the summary: channels, schemas, chunk indexes and counts per channel must stand in it."""
    recording = push(session="monday", trigger_index=1, meta={"tool": {"width_mm": 17}, "half": "\ud800"})
    path = save_mcap(Dataset([recording]), tmp_path / "x.mcap")
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        (record,) = reader.iter_metadata()
        file.seek(0)
        assert len(list(StreamReader(file, validate_crcs=True).records)) > 1600  # all checksums fit
    assert [channel.topic for channel in summary.channels.values()] == ["/wrench"]
    assert [schema.name for schema in summary.schemas.values()] == [STAMPED]
    assert summary.statistics.message_count == 1600
    assert summary.statistics.channel_message_counts == {1: 1600}
    assert [chunk.compression for chunk in summary.chunk_indexes] == ["zstd"]
    assert list(summary.chunk_indexes[0].message_index_offsets) == [1]
    assert json.loads(record.metadata.pop("meta")) == recording.meta
    assert record.metadata == {
        "version": "1", "n_samples": "1600", "name": "rice_1", "label": "rice", "session": "monday",
        "axes": "fx fy fz tx ty tz", "rate_hz": "500.0", "start_time": "1700000000.25", "trigger_index": "1",
        "history": "[]",
    }  # fmt: skip


@pytest.mark.parametrize("start", [None, -1.0, 3e9, 1e300])
def test_unknown_or_impossible_start_counts_from_the_first_sample(tmp_path, start):
    recording = push(3, start_time=start)
    path = save_mcap(Dataset([recording]), tmp_path / "x.mcap")
    assert [m.message.log_time for m in decoded(path)] == [0, 2_000_000, 4_000_000]
    assert load(path)[0] == recording


@pytest.mark.parametrize(
    ("frame", "can_be"),
    [
        ("ft", True),
        ("\u00b5 m", True),
        ("x" * 1023, True),
        ("x" * 1024, False),
        ("\ud800", False),
        ("a\0", False),
        (7, False),
    ],
)
def test_frames_that_can_be_written_and_others(tmp_path, frame, can_be):
    recording = push(3, meta={"frame": frame})
    path = save_mcap(Dataset([recording]), tmp_path / "x.mcap")
    written = {message.decoded_message.header.frame_id for message in decoded(path)}
    assert written == {frame if can_be else ""}
    assert load(path)[0] == recording


# -- what cannot be written


def test_refusals(tmp_path):
    one_axis = Recording(np.zeros((3, 1)), rate_hz=62.5, axes=("force",), name="gm10")
    forever = Recording(np.zeros((2, 6)), time_s=[0, 1e10], name="long")
    for recordings, problem in (
        ([one_axis], "'gm10' has the axes force; MCAP holds fx fy fz tx ty tz only"),
        ([push(2), push(2)], r"holds one recording, and there are 2"),
        ([forever], r"recording 'long': the recording lasts 1e\+10 s"),
    ):
        with pytest.raises(ValueError, match=problem):
            save_mcap(Dataset(recordings), tmp_path / "a.mcap")
    assert not any(tmp_path.iterdir())


# -- what others have changed since


def rewritten(path, target, keep=lambda i: True, metadata=lambda data: data, attachment=lambda data: data):
    """Copy an MCAP file with some of its messages, other metadata, and attachments first, as other tools may."""
    with path.open("rb") as file, target.open("wb") as out:
        reader, writer = make_reader(file), Writer(out)
        writer.start("ros2", "other")
        for record in reader.iter_attachments():
            writer.add_attachment(0, 0, record.name, record.media_type, attachment(record.data))
        writer.add_attachment(0, 0, "calibration.json", "application/json", b"{}")
        for i, (schema, channel, message) in enumerate(reader.iter_messages()):
            if not i:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channel_id = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            if keep(i):
                writer.add_message(channel_id, message.log_time, message.data, message.publish_time)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, metadata(dict(record.metadata)))
        writer.finish()
    return target


def test_copies_are_ours_where_the_messages_are_and_read_by_their_stamps_elsewhere(tmp_path):
    original = push(20, trigger_index=3, flags=np.arange(20) % 2)
    path = save_mcap(Dataset([original]), tmp_path / "a.mcap")
    assert load(rewritten(path, tmp_path / "b.mcap"))[0] == original
    cut = load(rewritten(path, tmp_path / "c.mcap", keep=lambda i: i >= 10))
    assert (cut[0].n_samples, cut.rate_hz, cut[0].trigger_index, cut[0].flags) == (10, 500, None, None)
    moved = rewritten(path, tmp_path / "d.mcap", metadata=lambda data: {**data, "start_time": "1700000009.0"})
    for data in (cut, load(moved)):
        assert data[0].label is None
        assert CHANGED_NOTE in data.history[-1].notes
    assert load(moved)[0].start_time == original.start_time


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"version": "2"}, r"version is '2'; wanted '1'"),
        ({"rate_hz": "fast"}, "could not convert"),
        ({"trigger_index": "99"}, "trigger_index"),
        ({"meta": "[1]"}, "a JSON list; wanted"),
        ({"history": "{}"}, "history is a JSON dict; wanted a list"),
        ({"label": " rice"}, "label"),
    ],
)
def test_own_metadata_that_we_did_not_write(tmp_path, change, problem):
    path = save_mcap(Dataset([push(5)]), tmp_path / "a.mcap")
    with pytest.raises(RecordingFileError, match=problem):
        load(rewritten(path, tmp_path / "b.mcap", metadata=lambda data: {**data, **change}))


def test_own_attachments_that_we_did_not_write(tmp_path):
    path = save_mcap(Dataset([irregular(40)]), tmp_path / "a.mcap")
    for i, data in enumerate((b"", b"\0" * 39, b"\xff" * 40 * 8, b"\0" * 40 * 8)):
        with pytest.raises(RecordingFileError, match=r"metadata granular_id|column time_s"):
            load(rewritten(path, tmp_path / f"{i}.mcap", attachment=lambda _, data=data: data))


def test_a_changed_byte_is_found_by_the_checksums(tmp_path):
    path = save_mcap(Dataset([irregular(40)]), tmp_path / "a.mcap")
    data = path.read_bytes()
    at = data.index(irregular(40).time_s.tobytes())
    path.write_bytes(data[: at + 20] + b"?" + data[at + 21 :])
    with pytest.raises(RecordingFileError, match="crc"):
        load(path)
