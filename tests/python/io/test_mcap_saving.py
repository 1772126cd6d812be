"""MCAP written here: read back bit for bit, and by the libraries of the ROS world with right types and stamps."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from dataset_strategies import assert_same_bits, recordings
from effort import cases
from granular_id.io import load, save
from granular_id.io.ros.mcap_save import save_mcap
from granular_id.recording import Dataset, Recording, StepReport

pytest.importorskip("mcap")
pytest.importorskip("rosbags")

from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from ros_cases import ROS2, STAMPED, irregular, push


def decoded(path):
    """Return what the mcap library makes of the messages, checking every checksum."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return list(reader.iter_decoded_messages())


# -- bits


@settings(max_examples=cases(15))
@given(st.lists(recordings(), min_size=1, max_size=3), st.booleans())
def test_round_trip(tmp_path_factory, items, changed):
    history = [StepReport("made", {"seed": 1}, rows=[{"name": "a", "gap": 0.1}])] if changed else []
    data = Dataset(items, history)
    name = "one.mcap" if len(items) == 1 else "several"
    back = load(save_mcap(data, tmp_path_factory.mktemp("mcap") / name))
    assert_same_bits(back, data)
    assert [step.to_dict() for step in back.history[:-1]] == [step.to_dict() for step in data.history]


def test_save_picks_it_by_ending_or_name(tmp_path):
    one, two = Dataset([push(5)]), Dataset([push(5), irregular(5)])
    assert load(save(one, tmp_path / "one.mcap")) == one
    assert load(save(two, tmp_path / "two", "mcap")) == two
    assert sorted(p.name for p in (tmp_path / "two").rglob("*")) == [
        "index.csv",
        "rice",
        "rice_1.mcap",
        "rice_2.mcap",
    ]


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


def test_rosbags_reads_types_values_and_stamps(tmp_path):
    recording = push(meta={"frame": "ft_sensor"})
    path = save_mcap(Dataset([recording]), tmp_path / "x.mcap")
    with AnyReader([path]) as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/wrench", STAMPED)
        assert reader.typestore.hash_rihs01(STAMPED) == ROS2.hash_rihs01(STAMPED)  # every field of every type
        rows, times = [], []
        for _, time, raw in reader.messages():
            value = reader.deserialize(raw, STAMPED)
            force, torque = value.wrench.force, value.wrench.torque
            rows.append([force.x, force.y, force.z, torque.x, torque.y, torque.z])
            times.append(time)
            assert value.header.frame_id == "ft_sensor"
            assert value.header.stamp.sec * 10**9 + value.header.stamp.nanosec == time
    assert rows == recording.wrench.tolist()
    assert times == [1_700_000_000_250_000_000 + i * 2_000_000 for i in range(1600)]


def test_messages_are_those_that_rosbags_would_write(tmp_path):
    path = save_mcap(Dataset([push(3, meta={"frame": "ft"})]), tmp_path / "x.mcap")
    with path.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages():
            value = ROS2.deserialize_cdr(message.data, STAMPED)
            assert bytes(ROS2.serialize_cdr(value, STAMPED)) == message.data


def test_what_foxglove_and_plotjuggler_ask_for(tmp_path):
    """Both seek by the summary: channels, schemas, chunk indexes and counts per channel must stand in it."""
    path = save_mcap(Dataset([push()]), tmp_path / "x.mcap")
    with path.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        names = [record.name for record in reader.iter_metadata()]
        file.seek(0)
        assert len(list(StreamReader(file, validate_crcs=True).records)) > 1600  # all checksums fit
    assert [channel.topic for channel in summary.channels.values()] == ["/wrench"]
    assert [schema.name for schema in summary.schemas.values()] == [STAMPED]
    assert summary.statistics.message_count == 1600
    assert summary.statistics.channel_message_counts == {1: 1600}
    assert [chunk.compression for chunk in summary.chunk_indexes] == ["zstd"]
    assert list(summary.chunk_indexes[0].message_index_offsets) == [1]
    assert (summary.chunk_indexes[0].message_start_time, summary.chunk_indexes[0].message_end_time) == (
        1_700_000_000_250_000_000,
        1_700_000_003_448_000_000,
    )
    assert names == ["granular_id"]


def test_unknown_or_impossible_start_counts_from_the_first_sample(tmp_path):
    for i, start in enumerate((None, -1.0, 3e9, 1e300)):
        recording = push(5, start_time=start)
        path = save_mcap(Dataset([recording]), tmp_path / f"{i}.mcap")
        assert [m.message.log_time for m in decoded(path)] == [0, 2_000_000, 4_000_000, 6_000_000, 8_000_000]
        assert load(path)[0] == recording


@pytest.mark.parametrize(
    "frame", ["ft", "\u00b5 sensor", "", "\ud800", "a\0b", "x" * 1023, "x" * 1024, 7, None]
)
def test_frames_that_can_be_written_and_others(tmp_path, frame):
    recording = push(3, meta={"frame": frame})
    path = save_mcap(Dataset([recording]), tmp_path / "x.mcap")
    written = {message.decoded_message.header.frame_id for message in decoded(path)}
    can_be = isinstance(frame, str) and frame.isprintable() and len(frame) < 1024
    assert written == {frame if can_be else ""}
    assert load(path)[0] == recording


# -- what cannot be written


def test_refusals(tmp_path):
    one_axis = Recording(np.zeros((3, 1)), rate_hz=62.5, axes=("force",), name="gm10")
    with pytest.raises(ValueError, match="'gm10' has the axes force; MCAP holds fx fy fz tx ty tz only"):
        save_mcap(Dataset([one_axis]), tmp_path / "a.mcap")
    with pytest.raises(ValueError, match=r"an \.mcap file holds one recording, and there are 2"):
        save_mcap(Dataset([push(2), push(2)]), tmp_path / "a.mcap")
    forever = Recording(np.zeros((2, 6)), time_s=[0, 1e10], name="long")
    with pytest.raises(ValueError, match=r"recording 'long': the recording lasts 1e\+10 s"):
        save_mcap(Dataset([forever]), tmp_path / "a.mcap")
    with pytest.raises(TypeError, match="dataset must be a Dataset"):
        save_mcap([push(2)], tmp_path / "a.mcap")
    with pytest.raises(FileNotFoundError):
        save_mcap(Dataset([push(2)]), tmp_path / "no" / "a.mcap")
    (tmp_path / "b.mcap").write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        save_mcap(Dataset([push(2)]), tmp_path / "b.mcap")
    assert (tmp_path / "b.mcap").read_bytes() == b"precious"
    assert [p.name for p in tmp_path.iterdir()] == ["b.mcap"]


def test_progress_and_the_files_of_a_folder(tmp_path):
    calls = []
    data = Dataset([push(2, label=label) for label in ("a/b", None, "..")])
    folder = save_mcap(data, tmp_path / "set", progress=lambda *call: calls.append(call))
    assert load(folder) == data
    assert [call[:2] for call in calls] == [(1, 3), (2, 3), (3, 3)]
    assert all((folder / call[2]).is_file() for call in calls)
    calls.clear()
    save_mcap(data[:1], tmp_path / "one.mcap", progress=lambda *call: calls.append(call))
    assert calls == [(1, 1, "one.mcap")]


def test_metadata_is_text_that_other_tools_can_show(tmp_path):
    recording = push(3, session="monday", trigger_index=1, meta={"tool": {"width_mm": 17}, "half": "\ud800"})
    path = save_mcap(Dataset([recording]), tmp_path / "x.mcap")
    with path.open("rb") as file:
        (record,) = make_reader(file).iter_metadata()
    assert json.loads(record.metadata["meta"]) == recording.meta
    del record.metadata["meta"]
    assert record.metadata == {
        "version": "1", "n_samples": "3", "name": "rice_1", "label": "rice", "session": "monday",
        "axes": "fx fy fz tx ty tz", "rate_hz": "500.0", "start_time": "1700000000.25", "trigger_index": "1",
        "history": "[]",
    }  # fmt: skip
