"""Bags of every kind, written by rosbags and mcap, come back as they were: samples, clock, topic."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.recording import Setup

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from remedies import lines_of, refusal, run
from ros_cases import (
    KINDS,
    MCAP,
    PLAIN,
    ROS1,
    ROS2,
    SQLITE,
    STAMPED,
    START_NS,
    even_stamps,
    message,
    one_topic,
    payloads,
    samples,
    to_bytes,
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
    data = load(path)
    (recording,) = data
    assert recording.wrench.tobytes() == wrench.tobytes()
    assert (recording.rate_hz, recording.start_time) == (500, START_NS / 10**9)
    assert recording.name == path.name
    message_type = "geometry_msgs/WrenchStamped"
    assert recording.meta == {"topic": "/ft", "message_type": message_type, "frame": "ft_link"}
    assert (data.history[-1].rows, data.history[-1].notes) == ((), ())


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
    assert load(first)[0].wrench.tobytes() == wrench.tobytes()


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
        (mcap, "mcap recover"),
        (bag, "ros2 bag reindex"),
        (bag / "x.db3", "reindex"),
        (bag1, "try `rosbag reindex`"),
        (bag2, "try `ros2 bag reindex`, or `mcap recover`"),
    ):
        with pytest.raises(RecordingFileError, match=f"was not closed.*{way_out}"):
            load(path)


def test_wrench_without_header_has_log_times(tmp_path):
    ros1 = {"/ft": (PLAIN, payloads(ROS1, samples()), even_stamps())}
    topics = {"/silent": (STAMPED, [], []), "/ft": (PLAIN, payloads(ROS2, samples()), even_stamps())}
    for path in (
        write_bag1(tmp_path / "x.bag", ros1),
        write_bag2(tmp_path / "x", topics),
        write_mcap(tmp_path / "x.mcap", topics),
    ):
        data = load(path)
        assert data[0].wrench.tobytes() == samples().tobytes()
        assert (data.rate_hz, data[0].start_time) == (500, START_NS / 10**9)
        assert "frame" not in data[0].meta
        assert "log times are taken" in data.history[-1].notes[0]


def test_gaps_stay_and_start_on_a_clock_of_its_own(tmp_path):
    stamps = [0, 2_000_000, 4_000_000, 900_000_000, 902_000_001]
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(5), [5 * 10**9 + s for s in stamps]))
    data = load(path)
    assert data[0].time_s.tolist() == [s / 1e9 for s in stamps]  # each rounded once
    assert data[0].start_time is None
    assert data.history[-1].rows == ({"name": "x.mcap", "first_stamp_s": 5.0},)


@pytest.mark.parametrize("stamps", [[0] * 20, [START_NS] * 20])
def test_stamps_never_set_give_way_to_log_times(tmp_path, stamps):
    data = load(write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(), stamps, even_stamps())))
    assert data.rate_hz == 500
    assert "header.stamp never changes: log times are taken" in data.history[-1].notes[0]


def test_messages_are_in_the_order_of_their_log_times(tmp_path):
    wrench, stamps = samples(6), even_stamps(6)
    shuffled = [2, 0, 1, 5, 3, 4]
    raw = payloads(ROS2, wrench, stamps)
    topics = {"/ft": (STAMPED, [raw[i] for i in shuffled], [stamps[i] for i in shuffled])}
    for path in (write_mcap(tmp_path / "x.mcap", topics), write_bag2(tmp_path / "x", topics)):
        assert load(path)[0].wrench.tobytes() == wrench.tobytes()


@pytest.mark.parametrize(
    ("like", "later_ns", "way_out"), [(4, 1, "on_time_error='repair'"), (6, 0, "packets")]
)
def test_faulty_stamps_are_refused_by_message(tmp_path, like, later_ns, way_out):
    stamps = even_stamps()
    stamps[7] = stamps[like] + later_ns
    path = write_mcap(tmp_path / "x.mcap", one_topic(ROS2, samples(), stamps, even_stamps()))
    with pytest.raises(RecordingFileError, match=way_out) as caught:
        load(path)
    assert caught.value.place == "message 8 of /ft"
    if later_ns:
        assert load(path, on_time_error="repair").history[-1].rows[0]["moved"] == 1


def test_several_topics_are_listed_and_one_is_chosen(tmp_path):
    for path, store, write in (
        (tmp_path / "x.bag", ROS1, write_bag1),
        (tmp_path / "x.mcap", ROS2, write_mcap),
    ):
        left = one_topic(store, samples(seed=1), even_stamps(), name="/left/ft")
        write(path, left | one_topic(store, samples(seed=2), even_stamps(), name="/right/ft"))
        with pytest.raises(RecordingFileError, match="pass topic=") as caught:
            load(path)
        for name in ("/left/ft", "/right/ft"):
            assert f"'{name}' (20 messages)" in str(caught.value)
        for name in ("/right/ft", "right/ft"):
            (recording,) = load(path, topic=name)
            assert recording.wrench.tobytes() == samples(seed=2).tobytes()
            assert recording.meta["read_as"] == f"topic={name}"
        with pytest.raises(RecordingFileError, match=r"no wrenches on topic '/up'; it has '/left/ft'"):
            load(path, topic="/up")


def test_the_only_topic_is_compared_with_the_chosen_one(tmp_path):
    kinds = {"/ft": samples(seed=1), "/ft_filtered": samples(seed=2)}
    every = {name: one_topic(ROS2, wrench, even_stamps(), name=name)[name] for name, wrench in kinds.items()}
    both = write_mcap(tmp_path / "both.mcap", every)
    alone = write_mcap(tmp_path / "alone.mcap", {"/ft_filtered": every["/ft_filtered"]})
    later = Setup.of(load(alone)[0].meta)
    (difference,) = Setup.of(load(both, topic="/ft")[0].meta).differences(later)
    assert str(difference) == "read_as 'topic=/ft_filtered', in training 'topic=/ft'"
    assert Setup.of(load(both, topic="ft_filtered")[0].meta).differences(later) == []


def test_no_wrench_says_what_there_is(tmp_path):
    vector = to_bytes(ROS2.types["geometry_msgs/msg/Vector3"](1.0, 2.0, 3.0), ROS2)
    topics = {"/v": ("geometry_msgs/msg/Vector3", [vector] * 3, even_stamps(3))}
    path, empty = write_mcap(tmp_path / "x.mcap", topics), write_bag1(tmp_path / "e.bag", {})
    for bag, problem in (
        (path, r"it has /v \(geometry_msgs/msg/Vector3, 3 messages\)"),
        (empty, "no messages at all"),
    ):
        with pytest.raises(RecordingFileError, match=problem):
            load(bag)


@pytest.mark.parametrize(
    ("kind", "value", "column", "name"),
    [("bag1 None", np.nan, 1, "fy"), ("mcap ZSTD", -np.inf, 5, "tz")],
)
def test_forces_that_are_not_finite(tmp_path, kind, value, column, name):
    wrench = samples()
    wrench[16, column] = value
    path = write_kind(kind, tmp_path, wrench, even_stamps())
    with pytest.raises(RecordingFileError, match=f"column {name}.*message 17 of /ft") as caught:
        load(path)
    (recording,) = run(*lines_of(caught.value.problem))
    assert recording.wrench.tobytes() == np.delete(wrench, 16, axis=0).tobytes()


@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ros1", "ros2"])
def test_a_frame_that_changes(tmp_path, store):
    write = write_bag1 if store is ROS1 else write_mcap
    raw = payloads(store, samples(), even_stamps())
    raw[9] = to_bytes(message(store, samples()[9], even_stamps()[9], "x"), store)
    path = write(tmp_path / ("x.bag" if store is ROS1 else "x.mcap"), {"/ft": (STAMPED, raw, even_stamps())})
    with pytest.raises(RecordingFileError, match="frame_id changes from 'ft_link' to 'x'") as caught:
        load(path)
    assert caught.value.place == "message 10 of /ft"


TYPES = {
    "maker_msgs/msg/Reading": "geometry_msgs/WrenchStamped wrench\nfloat32 temperature\nstring status",
    "maker_msgs/msg/Bare": "std_msgs/Header header\ngeometry_msgs/Wrench load",
    "maker_msgs/msg/Deep": "maker_msgs/Bare inner\nint32[3] counts",
    "maker_msgs/msg/Two": "geometry_msgs/WrenchStamped left\nmaker_msgs/Bare right",
    "maker_msgs/msg/Listed": "geometry_msgs/Wrench[] loads",
    "maker_msgs/msg/Plain": "\n".join(f"float64 {name}" for name in ("fx", "fy", "fz", "mx", "my", "mz")),
}
FIELDS = {"Reading": "wrench", "Bare": "load", "Deep": "inner.load"}


def topic_of(name, ros=2):
    """Return the type store and the topic of twenty messages of a maker's type."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    for leaf, text in TYPES.items():
        store.register(get_types_from_msg(text, leaf))
    kind = {leaf.rpartition("/")[2]: store.types[leaf] for leaf in TYPES}
    serialize = store.serialize_ros1 if ros == 1 else store.serialize_cdr

    def raw(row, stamp):
        stamped = message(ROS1 if ros == 1 else ROS2, row, stamp)
        bare = kind["Bare"](header=stamped.header, load=stamped.wrench)
        value = {
            "Reading": lambda: kind["Reading"](wrench=stamped, temperature=20.0, status="ok"),
            "Bare": lambda: bare,
            "Deep": lambda: kind["Deep"](inner=bare, counts=np.zeros(3, np.int32)),
            "Two": lambda: kind["Two"](left=stamped, right=bare),
            "Listed": lambda: kind["Listed"](loads=[stamped.wrench]),
            "Plain": lambda: kind["Plain"](*map(float, row)),
        }[name]()
        return bytes(serialize(value, value.__msgtype__))

    stamps = even_stamps()
    messages = [raw(row, stamp) for row, stamp in zip(samples(), stamps, strict=True)]
    return store, (f"maker_msgs/msg/{name}", messages, stamps)


def write(folder, kind, name):
    store, topic = topic_of(name, 1 if kind == "bag" else 2)
    if kind == "bag":
        return write_bag1(folder / "x.bag", {"/ft": topic}, store=store)
    if kind == "mcap":
        return write_mcap(folder / "x.mcap", {"/ft": topic}, store=store)
    return write_bag2(folder / "x", {"/ft": topic}, SQLITE, store=store)


@pytest.mark.parametrize("kind", ["bag", "mcap", "folder"])
@pytest.mark.parametrize("name", FIELDS)
def test_wrenches_within_messages_are_read(tmp_path, kind, name):
    path = write(tmp_path, kind, name)
    data = load(path)
    assert data[0].wrench.tolist() == samples().tolist()
    assert data.rate_hz == 500
    assert (data[0].meta["frame"], data[0].meta["topic"]) == ("ft_link", f"/ft.{FIELDS[name]}")
    assert FIELDS[name] in data.history[-1].notes[0]


def test_six_numbers_without_a_wrench_have_a_line(tmp_path):
    (recording,) = run(*lines_of(refusal(write(tmp_path, "folder", "Plain"))))
    assert recording.wrench.tolist() == samples().tolist()
    assert recording.rate_hz == 500


def test_one_of_several_fields_is_chosen(tmp_path):
    path = write(tmp_path, "mcap", "Two")
    for topic in (None, "/ft"):
        with pytest.raises(RecordingFileError, match=r"'/ft\.left' .*'/ft\.right\.load' .*pass topic="):
            load(path, topic=topic)
    assert load(path, topic="/ft.left")[0].wrench.tolist() == samples().tolist()
    assert load(path, topic="ft.right.load")[0].meta["frame"] == "ft_link"
    (tmp_path / "lists").mkdir()
    with pytest.raises(RecordingFileError, match=r"one as a field; it has /ft \(maker_msgs/msg/Listed"):
        load(write(tmp_path / "lists", "mcap", "Listed"))


def test_a_plain_topic_comes_first_and_the_other_is_named(tmp_path):
    store, topic = topic_of("Reading")
    topics = one_topic(ROS2, samples(seed=5), even_stamps()) | {"/maker": topic}
    path = write_mcap(tmp_path / "x.mcap", topics, store=store)
    data = load(path)
    assert data[0].wrench.tobytes() == samples(seed=5).tobytes()
    assert "'/maker.wrench' (20 messages)" in data.history[-1].notes[0]
    for topic in ("/maker", "/maker.wrench"):
        assert load(path, topic=topic)[0].wrench.tobytes() == samples().tobytes()


@pytest.mark.data
def test_real_bags_of_a_makers_driver(data_dir):
    data = load(data_dir / "sand_press")
    assert len(data) == 19
    assert set(data.labels) == {"press", "press_smooth", "press_grouser", "rest"}
    pressed = data[data.names.index("press_1.bag")]
    assert pressed.n_samples == 2684
    assert np.diff(pressed.time_s).mean() == pytest.approx(0.01, rel=1e-3)
    assert np.abs(pressed.wrench).max() < 200


FORMS = {
    "names": lambda row: dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), row, strict=True)),
    "one list": lambda row: {"id": "s1", "wrench": row},
    "a list beside joints": lambda row: {"q": [0] * 6, "tau": [1] * 6, "tool_wrench": row, "id": 7, "fx": 0},
    "two lists": lambda row: {"ft": {"force": row[:3], "torque": row[3:]}},
}


@pytest.mark.parametrize("form", FORMS)
def test_messages_in_json_have_a_line_for_all_files(tmp_path, form):
    for i, name in enumerate(("rice_1", "rice_2", "peas_1")):
        with (tmp_path / f"{name}.mcap").open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema("Wrench", "jsonschema", b"{}")
            channel = writer.register_channel("/ft", "json", schema)
            for k in range(50):
                row = FORMS[form]([i, 2, 3, 4, 5, k])
                writer.add_message(channel, k * 2_000_000, json.dumps(row).encode(), k * 2_000_000)
            writer.finish()
    data = run(lines_of(refusal(tmp_path))[0])
    assert data.y.tolist() == ["peas", "rice", "rice"]
    assert data.X[:, 0].tolist() == [[i, 2, 3, 4, 5, 0] for i in (2, 0, 1)]
    assert data.rate_hz == 500


def test_messages_in_json_that_state_units_are_not_taken_for_newtons(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/ft", "json", writer.register_schema("W", "jsonschema", b"{}"))
        for k in range(9):
            row = FORMS["names"]([1, 2, 3, 4, 5, k]) | {"torque_unit": "Nmm"}
            writer.add_message(channel, k * 2_000_000, json.dumps(row).encode(), k * 2_000_000)
        writer.finish()
    (line,) = lines_of(refusal(tmp_path / "a.mcap"))
    with pytest.raises(ValueError, match="'torque_unit' states units"):
        run(line)


def test_bags_of_joints_have_no_line(tmp_path):
    state, header = (
        ROS2.types["sensor_msgs/msg/JointState"],
        message(ROS2, samples()[0], even_stamps()[0]).header,
    )
    messages = [to_bytes(state(header, [*"abcdef"], row, row, row), ROS2) for row in samples()]
    problem = refusal(
        write_bag2(tmp_path / "x", {"/joints": ("sensor_msgs/msg/JointState", messages, even_stamps())})
    )
    assert "in Python" not in problem


@pytest.mark.parametrize("name", ["sensor_msgs/msg/Imu", "std_msgs/msg/Float64MultiArray"])
def test_bags_of_other_sensors_have_a_line_for_all(tmp_path, name):
    types, stamps = ROS2.types, even_stamps()
    vector, header = types["geometry_msgs/msg/Vector3"], message(ROS2, samples()[0], stamps[0]).header

    def of(row):
        if "Imu" not in name:
            layout = types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            return types[name](layout=layout, data=np.array(row))
        turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
        nine, (w, a) = np.zeros(9), (vector(*map(float, part)) for part in (row[:3], row[3:]))
        return types[name](header, turn, nine, w, nine, a, nine)

    for push in ("rice/push_1", "peas/push_1"):
        (tmp_path / push).parent.mkdir()
        messages = [to_bytes(of(row), ROS2) for row in samples()]
        write_bag2(tmp_path / push, {"/data": (name, messages, stamps)})
    data = run(lines_of(refusal(tmp_path))[0])
    assert data.y.tolist() == ["peas", "rice"]
    np.testing.assert_array_equal(data.X, [samples()] * 2)
    assert data.axes[0] == ("angular_velocity.x" if "Imu" in name else "fx")
