"""Bags of every kind, written by rosbags and mcap, come back as they were; faults are named."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rosbags.highlevel import AnyReader

from ros_cases import (
    KINDS,
    MCAP,
    PLAIN,
    ROS1,
    ROS2,
    SQLITE,
    STAMPED,
    START_NS,
    cdr_bytes,
    even_stamps,
    one_topic,
    payloads,
    read,
    samples,
    write_bag1,
    write_bag2,
    write_kind,
    write_mcap,
)

# -- what libraries write is read


@pytest.mark.parametrize("kind", KINDS)
def test_samples_stamps_and_frame_of_every_kind(tmp_path, kind):
    wrench = samples()
    path = write_kind(kind, tmp_path, wrench, even_stamps())
    content = read(path)
    (recording,) = content.recordings
    assert recording.wrench.tobytes() == wrench.tobytes()
    assert recording.rate_hz == 500
    assert recording.start_time == START_NS / 10**9
    assert recording.name == path.name
    assert recording.meta["frame"] == "ft_link"
    assert recording.meta["topic"] == "/ft"
    assert recording.meta["message_type"] == "geometry_msgs/WrenchStamped"
    assert recording.meta.get("node") == ("/driver" if kind.startswith("bag1") else None)
    assert (content.rows, content.notes) == ([], [])


@pytest.mark.parametrize("kind", ["bag1 LZ4", "bag2 sqlite None v9", "bag2 mcap STORAGE v9"])
def test_agrees_with_rosbags_message_by_message(tmp_path, kind):
    rng = np.random.default_rng(3)
    stamps = (START_NS + np.cumsum(rng.integers(1, 9_000_000, 50))).tolist()
    path = write_kind(kind, tmp_path, samples(50), stamps)
    rows, times = [], []
    with AnyReader([path], default_typestore=ROS2) as reader:
        for connection, _, raw in reader.messages():
            value = reader.deserialize(raw, connection.msgtype)
            force, torque, stamp = value.wrench.force, value.wrench.torque, value.header.stamp
            rows.append((force.x, force.y, force.z, torque.x, torque.y, torque.z))
            times.append(stamp.sec * 10**9 + stamp.nanosec)
    (recording,) = read(path).recordings
    assert recording.wrench.tolist() == [list(row) for row in rows]
    assert recording.rate_hz is None
    assert recording.time_s.tolist() == [(time - times[0]) / 1e9 for time in times]  # each rounded once


def test_plain_wrench_is_stamped_by_its_log_time(tmp_path):
    topics = {"/ft": (PLAIN, payloads(ROS2, samples()), even_stamps())}
    for path in (write_bag2(tmp_path / "x", topics), write_mcap(tmp_path / "x.mcap", topics)):
        content = read(path)
        assert content.recordings[0].rate_hz == 500
        assert content.recordings[0].start_time == START_NS / 10**9
        assert "frame" not in content.recordings[0].meta
        assert "log times are taken" in content.notes[0]
    topics = {"/ft": (PLAIN, payloads(ROS1, samples()), even_stamps())}
    assert read(write_bag1(tmp_path / "x.bag", topics)).recordings[0].wrench.tobytes() == samples().tobytes()


def test_gaps_stay_and_start_on_a_clock_of_its_own(tmp_path):
    stamps = [0, 2_000_000, 4_000_000, 900_000_000, 902_000_000]
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(5), [5 * 10**9 + s for s in stamps]))
    content = read(path)
    (recording,) = content.recordings
    assert recording.time_s.tolist() == [s / 1e9 for s in stamps]
    assert recording.start_time is None
    assert content.rows == [{"name": "x.mcap", "first_stamp_s": 5.0}]


def test_a_bag_of_several_files_is_one_recording(tmp_path):
    wrench, stamps = samples(30), even_stamps(30)
    folder = tmp_path / "push"
    for i, part in enumerate((slice(0, 12), slice(12, 25), slice(25, 30))):
        write_bag2(tmp_path / f"part_{i}", one_topic(ROS2, wrench[part], stamps[part]), MCAP)
    folder.mkdir()
    names = []
    for i in range(3):
        names.append(f"push_{i}.mcap")
        (tmp_path / f"part_{i}" / f"part_{i}.mcap").rename(folder / names[-1])
    listed = "".join(f"\n  - {name}" for name in names)
    head = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap"
    (folder / "metadata.yaml").write_text(f"{head}\n  relative_file_paths:{listed}\n")
    (recording,) = read(folder).recordings
    assert recording.wrench.tobytes() == wrench.tobytes()
    assert recording.rate_hz == 500


def test_old_bags_name_their_folder_and_long_metadata_is_cut_to_what_counts(tmp_path):
    path = write_bag2(tmp_path / "old", one_topic(ROS2, samples(), even_stamps()), version=8)
    metadata = path / "metadata.yaml"
    text = metadata.read_text()
    head, _, tail = text.partition("old.db3")
    topics = "".join(
        f"\n    - topic_metadata:\n        name: /t{i}\n        relative_file_paths: [../../no]"
        for i in range(9000)
    )
    metadata.write_text(f"{head}old/old.db3{tail}\n  topics_with_message_count:{topics}\n")
    assert read(path).recordings[0].wrench.tobytes() == samples().tobytes()


def test_messages_are_ordered_by_log_time_and_errors_count_them_as_they_lie(tmp_path):
    wrench, stamps = samples(6), even_stamps(6)
    shuffled = [2, 0, 1, 5, 3, 4]
    raw = payloads(ROS2, wrench, stamps)
    topics = {"/ft": (STAMPED, [raw[i] for i in shuffled], [stamps[i] for i in shuffled])}
    path = write_mcap(tmp_path / "x.mcap", topics)
    assert read(path).recordings[0].wrench.tobytes() == wrench.tobytes()
    again = payloads(ROS2, wrench, [*stamps[:4], stamps[3], stamps[5]])  # sample 4 lies in place 5
    topics = {"/ft": (STAMPED, [again[i] for i in shuffled], [stamps[i] for i in shuffled])}
    path = write_mcap(tmp_path / "y.mcap", topics)
    with pytest.raises(RecordingFileError, match=r"message 6 of /ft: the stamp 0.006 is repeated"):
        read(path)


# -- clocks


def test_stamps_never_set_give_way_to_log_times(tmp_path):
    for name, stamps in (("zero", [0] * 20), ("frozen", [START_NS] * 20)):
        path = write_mcap(tmp_path / f"{name}.mcap", one_topic(ROS2, samples(), stamps, even_stamps()))
        content = read(path)
        assert content.recordings[0].rate_hz == 500
        assert content.notes == [
            "header.stamp never changes: log times are taken, which jitter more than the sensor's clock"
        ]


@pytest.mark.parametrize("fault", ["back", "repeated", "zero"])
def test_faulty_stamps_are_refused_or_repaired(tmp_path, fault):
    log, stamps = even_stamps(), even_stamps()
    stamps[7] = {"back": stamps[4] + 1, "repeated": stamps[6], "zero": 0}[fault]
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(), stamps, log))
    with pytest.raises(RecordingFileError) as caught:
        read(path)
    assert caught.value.place == "message 8 of /ft"
    assert "on_time_error='repair'" in str(caught.value)
    content = read(path, on_time_error="repair")
    (row,) = content.rows
    assert (row.get("moved"), row.get("merged")) == ((0, 1) if fault == "repeated" else (1, 0))
    assert content.recordings[0].flags.any()


def test_stated_rate_must_fit(tmp_path):
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(), even_stamps()))
    assert read(path, rate_hz=500.0).recordings[0].rate_hz == 500
    with pytest.raises(RecordingFileError, match="400 Hz does not fit"):
        read(path, rate_hz=400.0)


# -- topics


def two_topics(store):
    left = (STAMPED, payloads(store, samples(seed=1), even_stamps()), even_stamps())
    right = (STAMPED, payloads(store, samples(seed=2), even_stamps()), even_stamps())
    return {"/left/ft": left, "/right/ft": right}


def test_several_topics_are_listed_and_one_is_chosen(tmp_path):
    for path in (
        write_bag1(tmp_path / "x.bag", two_topics(ROS1)),
        write_bag2(tmp_path / "x", two_topics(ROS2), SQLITE),
        write_mcap(tmp_path / "x.mcap", two_topics(ROS2)),
    ):
        with pytest.raises(RecordingFileError) as caught:
            read(path)
        assert "/left/ft (geometry_msgs/WrenchStamped, 20 messages, 500 Hz)" in str(caught.value)
        assert "/right/ft" in str(caught.value)
        assert "topic=" in str(caught.value)
        for name in ("/right/ft", "right/ft"):
            (recording,) = read(path, topic=name).recordings
            assert recording.wrench.tobytes() == samples(seed=2).tobytes()
        with pytest.raises(RecordingFileError, match=r"no messages on topic '/up'; it has /left/ft"):
            read(path, topic="/up")


def test_no_wrench_says_what_there_is(tmp_path):
    vector = ROS2.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0)
    topics = {"/v": ("geometry_msgs/msg/Vector3", [cdr_bytes(vector)] * 3, even_stamps(3))}
    for path in (write_bag2(tmp_path / "x", topics), write_mcap(tmp_path / "x.mcap", topics)):
        with pytest.raises(RecordingFileError) as caught:
            read(path)
        assert "with one as a field; it has /v (geometry_msgs/Vector3, 3 messages, 500 Hz)" in str(
            caught.value
        )
        with pytest.raises(RecordingFileError, match="no wrenches on topic '/v'"):
            read(path, topic="/v")
    for path in (
        write_bag2(tmp_path / "e", {}),
        write_mcap(tmp_path / "e.mcap", {}),
        write_bag1(tmp_path / "e.bag", {}),
    ):
        with pytest.raises(RecordingFileError, match="no messages at all"):
            read(path)


def test_a_topic_without_messages_does_not_count(tmp_path):
    topics = {"/silent": (STAMPED, [], []), **one_topic(ROS2, samples(), even_stamps())}
    assert read(write_mcap(tmp_path / "x.mcap", topics)).recordings[0].meta["topic"] == "/ft"


# -- within load


def test_a_folder_of_bags_of_all_kinds(tmp_path):
    (tmp_path / "rice").mkdir()
    (tmp_path / "peas").mkdir()
    write_kind("bag1 None", tmp_path / "rice", samples(seed=1), even_stamps())
    write_kind("bag2 sqlite None v9", tmp_path / "peas", samples(seed=2), even_stamps())
    write_kind("mcap ZSTD", tmp_path / "peas", samples(seed=3), even_stamps())
    data = load(tmp_path, topic="/ft")
    assert data.names == ("peas/x.mcap", "peas/x", "rice/x.bag")
    assert data.y.tolist() == ["peas", "peas", "rice"]
    assert data.X.shape == (3, 20, 6)
    assert data.history[-1].parameters["topic"] == "/ft"


def test_what_the_index_says_comes_first(tmp_path):
    write_kind("mcap ZSTD", tmp_path, samples(), even_stamps())
    (tmp_path / "index.csv").write_text("file,label,start_time,name\nx.mcap,oats,12.5,first push\n")
    (recording,) = load(tmp_path)
    assert (recording.label, recording.start_time, recording.name) == ("oats", 12.5, "first push")


@pytest.mark.parametrize(
    ("kind", "module", "library"),
    [
        ("mcap NONE", "mcap.records", "mcap"),
        ("mcap ZSTD", "zstandard", "zstandard"),
        ("mcap LZ4", "lz4.frame", "lz4"),
        ("bag1 LZ4", "lz4.frame", "lz4"),
        ("bag2 sqlite None v9", "ruamel.yaml", r"ruamel\.yaml"),
        ("bag2 sqlite FILE v9", "zstandard", "zstandard"),
        ("bag2 sqlite MESSAGE v9", "zstandard", "zstandard"),
    ],
)
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, kind, module, library):
    path = write_kind(kind, tmp_path, samples(), even_stamps())
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ImportError, match=rf"^{library} is needed .*pip install 'granular-id\[ros\]'"):
        read(path)
