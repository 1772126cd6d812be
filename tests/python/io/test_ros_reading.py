"""Bags of every kind, written by rosbags and mcap, come back as they were: samples, clock, topic."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from granular_id.io import RecordingFileError, load

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from ros_cases import (
    KINDS,
    MCAP,
    PLAIN,
    ROS1,
    ROS2,
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

STORED = Path(__file__).parents[2] / "data" / "ros"


@pytest.mark.parametrize("kind", KINDS)
def test_samples_stamps_and_frame_of_every_kind(tmp_path, kind):
    wrench = samples()
    path = write_kind(kind, tmp_path, wrench, even_stamps())
    before = {file: file.read_bytes() for file in sorted(tmp_path.rglob("*")) if file.is_file()}
    content = read(path)
    (recording,) = content.recordings
    assert recording.wrench.tobytes() == wrench.tobytes()
    assert (recording.rate_hz, recording.start_time) == (500, START_NS / 10**9)
    assert recording.name == path.name
    assert recording.meta["frame"] == "ft_link"
    assert recording.meta["topic"] == "/ft"
    assert recording.meta["message_type"] == "geometry_msgs/WrenchStamped"
    assert recording.meta.get("node") == ("/driver" if kind.startswith("bag1") else None)
    assert (content.rows, content.notes) == ([], [])
    assert {file: file.read_bytes() for file in sorted(tmp_path.rglob("*")) if file.is_file()} == before


@pytest.mark.parametrize("name", ["ros1.bag", "bag", "bag/bag.mcap"])
def test_bags_that_were_written_long_ago(name):
    made = runpy.run_path(str(STORED / "make_ros_bags.py"))
    wrench, stamps = made["expected"]()
    (recording,) = load(STORED / name)
    assert recording.wrench.tobytes() == wrench.tobytes()
    assert (recording.rate_hz, recording.start_time) == (500, stamps[0] / 10**9)


def test_a_bag_of_several_files_is_one_recording(tmp_path):
    wrench, stamps = samples(30), even_stamps(30)
    first, second = (
        write_bag2(tmp_path / name, one_topic(ROS2, wrench[part], stamps[part]), MCAP)
        for name, part in (("first", slice(0, 12)), ("second", slice(12, 30)))
    )
    (second / "second.mcap").rename(first / "second.mcap")
    listed = (first / "metadata.yaml").read_text()
    name = next(line for line in listed.splitlines() if "- first.mcap" in line)
    both = f"{name}\n{name.replace('first', 'second')}"
    (first / "metadata.yaml").write_text(listed.replace(name, both, 1))
    (recording,) = read(first).recordings
    assert recording.wrench.tobytes() == wrench.tobytes()
    with pytest.raises(RecordingFileError, match="bytes together"):
        read(first, max_file_bytes=max(file.stat().st_size for file in first.iterdir()))


def test_names_that_look_like_addresses(tmp_path):
    bag = write_kind("bag2 sqlite None v9", tmp_path, samples(), even_stamps())
    path = bag.rename(tmp_path / "a?mode=rwc&b#c%20d")
    assert read(path).recordings[0].n_samples == 20
    assert read((path / "x.db3").rename(path / "x y#1.db3")).recordings[0].n_samples == 20


def test_mcap_with_a_changed_byte_is_refused(tmp_path):
    path = write_kind("mcap NONE", tmp_path, samples(), even_stamps())
    data = path.read_bytes()
    at = data.index(samples().tobytes()[-8:])
    path.write_bytes(data[:at] + b"?" + data[at + 1 :])
    with pytest.raises(RecordingFileError, match="crc"):
        load(path)


def test_bags_that_were_not_closed(tmp_path):
    mcap = write_kind("mcap ZSTD", tmp_path, samples(), even_stamps())
    mcap.write_bytes(mcap.read_bytes()[:-60])
    bag = write_kind("bag2 sqlite None v9", tmp_path, samples(), even_stamps())
    (bag / "x.db3-wal").write_bytes(b"?")
    bag1 = write_bag1(tmp_path / "y.bag", one_topic(ROS1, samples(), even_stamps()))
    bag2 = write_bag2(tmp_path / "y", one_topic(ROS2, samples(), even_stamps()), MCAP)
    for file in (bag1, bag2 / "y.mcap"):
        file.write_bytes(file.read_bytes()[:-60])
    for path, way_out in (
        (mcap, r"mcap recover x\.mcap"),
        (bag, "ros2 bag reindex"),
        (bag / "x.db3", "reindex"),
        (bag1, "try `rosbag reindex`"),
        (bag2, "try `ros2 bag reindex`, or `mcap recover`"),
    ):
        with pytest.raises(RecordingFileError, match=f"was not closed.*{way_out}"):
            read(path)


# -- clocks


def test_plain_wrench_is_stamped_by_its_log_time_and_a_silent_topic_does_not_count(tmp_path):
    ros1 = {"/ft": (PLAIN, payloads(ROS1, samples()), even_stamps())}
    topics = {"/silent": (STAMPED, [], []), "/ft": (PLAIN, payloads(ROS2, samples()), even_stamps())}
    for path in (
        write_bag1(tmp_path / "x.bag", ros1),
        write_bag2(tmp_path / "x", topics),
        write_mcap(tmp_path / "x.mcap", topics),
    ):
        content = read(path)
        assert content.recordings[0].wrench.tobytes() == samples().tobytes()
        assert content.recordings[0].rate_hz == 500
        assert content.recordings[0].start_time == START_NS / 10**9
        assert "frame" not in content.recordings[0].meta
        assert "log times are taken" in content.notes[0]


def test_gaps_stay_and_start_on_a_clock_of_its_own(tmp_path):
    stamps = [0, 2_000_000, 4_000_000, 900_000_000, 902_000_001]
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(5), [5 * 10**9 + s for s in stamps]))
    content = read(path)
    (recording,) = content.recordings
    assert recording.time_s.tolist() == [s / 1e9 for s in stamps]  # each rounded once
    assert recording.start_time is None
    assert content.rows == [{"name": "x.mcap", "first_stamp_s": 5.0}]


@pytest.mark.parametrize("stamps", [[0] * 20, [START_NS] * 20])
def test_stamps_never_set_give_way_to_log_times(tmp_path, stamps):
    content = read(write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(), stamps, even_stamps())))
    assert content.recordings[0].rate_hz == 500
    assert "header.stamp never changes: log times are taken" in content.notes[0]


def test_messages_are_in_the_order_of_their_log_times(tmp_path):
    wrench, stamps = samples(6), even_stamps(6)
    shuffled = [2, 0, 1, 5, 3, 4]
    raw = payloads(ROS2, wrench, stamps)
    topics = {"/ft": (STAMPED, [raw[i] for i in shuffled], [stamps[i] for i in shuffled])}
    for path in (write_mcap(tmp_path / "x.mcap", topics), write_bag2(tmp_path / "x", topics)):
        assert read(path).recordings[0].wrench.tobytes() == wrench.tobytes()


@pytest.mark.parametrize("fault", ["back", "repeated", "zero"])
def test_faulty_stamps_are_refused_or_repaired(tmp_path, fault):
    log, stamps = even_stamps(), even_stamps()
    stamps[7] = {"back": stamps[4] + 1, "repeated": stamps[6], "zero": 0}[fault]
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(), stamps, log))
    with pytest.raises(RecordingFileError, match=r"on_time_error='repair'") as caught:
        read(path)
    assert caught.value.place == "message 8 of /ft"
    content = read(path, on_time_error="repair")
    (row,) = content.rows
    assert (row.get("moved"), row.get("merged")) == ((0, 1) if fault == "repeated" else (1, 0))
    assert content.recordings[0].flags.any()


# -- topics


def test_several_topics_are_listed_and_one_is_chosen(tmp_path):
    for path, store, write in (
        (tmp_path / "x.bag", ROS1, write_bag1),
        (tmp_path / "x.mcap", ROS2, write_mcap),
    ):
        left = one_topic(store, samples(seed=1), even_stamps(), name="/left/ft")
        write(path, left | one_topic(store, samples(seed=2), even_stamps(), name="/right/ft"))
        with pytest.raises(RecordingFileError, match="choose by topic=") as caught:
            read(path)
        for name in ("/left/ft", "/right/ft"):
            assert f"{name} (geometry_msgs/WrenchStamped, 20 messages, 500 Hz)" in str(caught.value)
        for name in ("/right/ft", "right/ft"):
            (recording,) = read(path, topic=name).recordings
            assert recording.wrench.tobytes() == samples(seed=2).tobytes()
        with pytest.raises(RecordingFileError, match=r"no messages on topic '/up'; it has /left/ft"):
            read(path, topic="/up")


def test_no_wrench_says_what_there_is(tmp_path):
    vector = cdr_bytes(ROS2.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0))
    topics = {"/v": ("geometry_msgs/msg/Vector3", [vector] * 3, even_stamps(3))}
    path, empty = write_mcap(tmp_path / "x.mcap", topics), write_bag1(tmp_path / "e.bag", {})
    for bag, topic, problem in (
        (path, None, r"it has /v \(geometry_msgs/Vector3, 3 messages, 500 Hz\)"),
        (path, "/v", "no wrenches on topic '/v'"),
        (empty, None, "no messages at all"),
    ):
        with pytest.raises(RecordingFileError, match=problem):
            read(bag, topic=topic)


@pytest.mark.parametrize(("name", "module"), [("x.mcap", "mcap.stream_reader"), ("x.bag", "rosbags.rosbag1")])
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, name, module):
    (tmp_path / name).write_bytes(b"")
    monkeypatch.setitem(sys.modules, module, None)
    library = module.partition(".")[0]
    with pytest.raises(ImportError, match=rf"^{library} is needed .*pip install 'rosbags"):
        load(tmp_path / name)
