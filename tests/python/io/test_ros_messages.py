"""Messages: plain wrenches, and wrenches inside makers' types, read as rosbags reads them; faults are numbered."""

from __future__ import annotations

import math
from operator import attrgetter

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from effort import cases
from granular_id.io import RecordingFileError, load

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from granular_id.io.ros.messages import MessageType, message_type
from granular_id.recording import AXES
from ros_cases import (
    MCAP,
    ROS1,
    ROS2,
    SQLITE,
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
    write_bag2,
    write_kind,
    write_mcap,
)


def write_one(folder, store, raw):
    topics = {"/ft": (STAMPED, raw, even_stamps())}
    return write_bag1(folder / "x.bag", topics) if store is ROS1 else write_mcap(folder / "x.mcap", topics)


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
def test_plain_messages_of_any_content(frame, values, start, little_endian):
    stamps = [start * 10**9 + i * 999_999_937 for i in range(len(values)) if start + i < 2**31]
    for to_bytes, store, encoding in (
        (lambda value: cdr_bytes(value, little_endian=little_endian), ROS2, "cdr"),
        (ros1_bytes, ROS1, "ros1"),
    ):
        raw = [
            to_bytes(message(store, row, stamp, frame)) for row, stamp in zip(values, stamps, strict=False)
        ]
        found = message_type("geometry_msgs/WrenchStamped", "", encoding).decode(raw, "", raising)
        assert found.wrench.tobytes() == np.array(values[: len(raw)], dtype=np.float64).tobytes()
        assert found.stamps_ns.tolist() == stamps
        assert found.frame_id == frame


@pytest.mark.parametrize(
    ("kind", "value", "column", "name"),
    [("bag1 None", math.nan, 1, "force.y"), ("mcap ZSTD", -math.inf, 5, "torque.z")],
)
def test_forces_that_are_not_finite(tmp_path, kind, value, column, name):
    wrench = samples()
    wrench[16, column] = value
    with pytest.raises(RecordingFileError, match=f"{name} is {value}") as caught:
        read(write_kind(kind, tmp_path, wrench, even_stamps()))
    assert caught.value.place == "message 17 of /ft"


@pytest.mark.parametrize("store", [ROS1, ROS2], ids=["ros1", "ros2"])
def test_a_frame_that_changes(tmp_path, store):
    stamps = even_stamps()
    for other in ("ft_lin2", "x", ""):  # of the same length, and of others
        raw = payloads(store, samples(), stamps)
        raw[9] = payloads(store, samples()[9:10], stamps[9:10], other)[0]
        path = write_one(tmp_path, store, raw)
        with pytest.raises(
            RecordingFileError, match=f"frame_id changes from 'ft_link' to {other!r}"
        ) as caught:
            read(path)
        assert caught.value.place == "message 10 of /ft"
        path.unlink()


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda raw: raw[:-1], "does not fit its type"),
        (lambda raw: raw + bytes(8), "does not fit its type"),
        (lambda raw: b"", "begins with nothing; wanted plain CDR"),
        (lambda raw: b"\x00\x07" + raw[2:], "begins with 00 07 00 00; wanted plain CDR"),
        (lambda raw: raw[:12] + b"\xff\xff\xff\x7f" + raw[16:], "does not fit its type"),
        (lambda raw: raw[:8] + b"\xff\xff\xff\xff" + raw[12:], "4294967295 nanosec; wanted less than 1e9"),
        (lambda raw: raw[:16] + b"\xff\xfe" + raw[18:], "does not fit its type.*utf-8"),
    ],
)
@pytest.mark.parametrize("number", [1, 4])
def test_damaged_messages(tmp_path, change, problem, number):
    raw = payloads(ROS2, samples(), even_stamps())
    raw[number - 1] = change(raw[number - 1])
    with pytest.raises(RecordingFileError, match=problem) as caught:
        read(write_one(tmp_path, ROS2, raw))
    assert caught.value.place == f"message {number} of /ft"


RULE = "=" * 80


def read_by(folder, definition, topics):
    return read(write_mcap(folder / "x.mcap", topics, definitions=definition)).recordings[0].wrench


def test_a_plain_type_with_other_fields_is_read_by_its_definition(tmp_path):
    text = f"std_msgs/Header header\ngeometry_msgs/Wrench wrench\n{RULE}\nMSG: geometry_msgs/Wrench\n"
    text += "geometry_msgs/Vector3 torque\ngeometry_msgs/Vector3 force\n"
    text += f"{RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
    text += f"{RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    found = read_by(tmp_path, text, one_topic(ROS2, samples(), even_stamps()))
    np.testing.assert_array_equal(found, np.roll(samples(), 3, axis=1))


@pytest.mark.parametrize("number", ["float32", "int64"])
def test_numbers_of_another_kind_are_read_by_their_definition(tmp_path, number):
    text = f"geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n{RULE}\nMSG: geometry_msgs/Vector3\n"
    text += f"{number} x\n{number} y\n{number} z\n"
    rows = np.arange(120.0).reshape(20, 6)
    raw = [b"\x00\x01\x00\x00" + row.astype(number).tobytes() for row in rows]
    found = read_by(tmp_path, text, {"/ft": ("geometry_msgs/msg/Wrench", raw, even_stamps())})
    np.testing.assert_array_equal(found, rows)


def test_a_comment_in_other_letters_than_utf_8_spoils_nothing(tmp_path):
    text = ROS2.generate_msgdef(STAMPED, ros_version=2)[0].encode() + "# not \N{DEGREE SIGN}C\n".encode(
        "latin-1"
    )
    found = read_by(tmp_path, text, one_topic(ROS2, samples(), even_stamps()))
    np.testing.assert_array_equal(found, samples())


# -- makers' types

READING = """Header header
uint32 statusword
sensor_msgs/Imu imu
geometry_msgs/WrenchStamped wrench
bool saturated
string[] notes
float32 temperature
"""
HEADED = "bool on\nstd_msgs/Header header\nuint8[3] odd\ngeometry_msgs/Wrench load\n"
BARE = "uint8 odd\ngeometry_msgs/Wrench load\nfloat64[] more\n"
NESTED = "string name\nmaker_msgs/Headed tool\n"
TWO = "geometry_msgs/WrenchStamped left\nmaker_msgs/Bare right\n"
LISTED = "geometry_msgs/WrenchStamped[] all\ngeometry_msgs/Wrench[2] pair\n"
TYPES = {"Reading": READING, "Headed": HEADED, "Bare": BARE, "Nested": NESTED, "Two": TWO, "Listed": LISTED}


def store_of(name):
    store = get_typestore(name)
    types = {}
    for kind, text in TYPES.items():
        types.update(get_types_from_msg(text, f"maker_msgs/msg/{kind}"))
    store.register(types)
    return store


STORES = {1: store_of(Stores.ROS1_NOETIC), 2: store_of(Stores.ROS2_JAZZY)}
KINDS = {"bag": 1, "db3": 2, "mcap": 2}


def values(version, name, n=20, words=lambda i: []):
    """Make messages of a type of `TYPES`; the wrench of sample i is in each of its places."""
    store, plain, stamps = STORES[version], (ROS1, ROS2)[version - 1], even_stamps(n)
    make = store.types
    for i, row in enumerate(samples(n)):
        stamped, bare = message(plain, row, stamps[i], "link"), message(plain, row)
        header = message(plain, row, stamps[i] + 500, "outer").header
        headed = make["maker_msgs/msg/Headed"](i % 2, stamped.header, np.arange(i, i + 3).astype("u1"), bare)
        alone = make["maker_msgs/msg/Bare"](i, bare, np.ones(2) * i)
        vector, nine = make["geometry_msgs/msg/Vector3"](i / 7, 8.0, 9.0), np.arange(9) * float(i)
        quaternion = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        imu = make["sensor_msgs/msg/Imu"](header, quaternion, nine, vector, nine, vector, nine)
        yield {
            "Reading": make["maker_msgs/msg/Reading"](header, 300 * i, imu, stamped, i % 2, words(i), i / 3),
            "Headed": headed,
            "Bare": alone,
            "Nested": make["maker_msgs/msg/Nested"]("".join(words(i)), headed),
            "Two": make["maker_msgs/msg/Two"](stamped, alone),
            "Listed": make["maker_msgs/msg/Listed"]([stamped], [bare, bare]),
        }[name]


def write(folder, kind, name, **about):
    version, type_name = KINDS[kind], f"maker_msgs/msg/{name}"
    store = STORES[version]
    to_bytes = store.serialize_ros1 if version == 1 else store.serialize_cdr
    raw = [bytes(to_bytes(value, type_name)) for value in values(version, name, **about)]
    topics = {"/ft": (type_name, raw, even_stamps())}
    if kind == "bag":
        return write_bag1(folder / "x.bag", topics, store=store)
    return write_bag2(folder / "x", topics, SQLITE if kind == "db3" else MCAP, store=store)


CASES = {
    "Reading": ("wrench", {}, True),
    "Reading, of any length": ("wrench", {"words": lambda i: ["ab"] * (i % 4)}, True),
    "Headed": ("load", {}, True),
    "Bare": ("load", {}, False),
    "Nested": ("tool.load", {}, True),
    "Nested, of other words": ("tool.load", {"words": lambda i: ["abc"[i % 3]]}, True),
}


BY_KIND = [
    *((case, kind) for case in CASES for kind in ("bag", "mcap")),
    ("Reading", "db3"),
]


@pytest.mark.parametrize(("case", "kind"), BY_KIND)
def test_the_wrench_is_that_of_rosbags(tmp_path, monkeypatch, kind, case):
    field, about, stamped = CASES[case]
    path = write(tmp_path, kind, case.partition(",")[0], **about)
    if not about:  # where only numbers differ, none is read alone
        monkeypatch.delattr(MessageType, "_one_by_one")
    content = read(path)
    (recording,) = content.recordings
    with AnyReader([path]) as reader:
        found = [attrgetter(field)(reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]
    plain = [getattr(value, "wrench", value) for value in found]
    rows = [[getattr(part, axis) for part in (w.force, w.torque) for axis in "xyz"] for w in plain]
    assert recording.wrench.tolist() == rows == samples().tolist()
    assert recording.rate_hz == 500
    assert recording.meta.get("frame") == ("link" if stamped else None)
    assert recording.meta["topic"] == f"/ft.{field}"
    assert field in content.notes[0]
    assert ("log times" in content.notes[-1]) is not stamped


def test_of_several_one_is_chosen_and_those_in_lists_are_none(tmp_path):
    path = write(tmp_path, "mcap", "Two")
    for topic in (None, "/ft", "/ft.middle"):
        with pytest.raises(RecordingFileError, match=r"/ft\.left, /ft\.right\.load; choose by topic="):
            read(path, topic=topic)
    assert read(path, topic="/ft.left").recordings[0].meta["frame"] == "link"
    assert "frame" not in read(path, topic="ft.right.load").recordings[0].meta
    (tmp_path / "lists").mkdir()
    with pytest.raises(RecordingFileError, match=r"nor with one as a field; it has /ft \(maker_msgs/Listed"):
        read(write(tmp_path / "lists", "mcap", "Listed"))


IMU = ("wx", "wy", "wz", "ax", "ay", "az")


@pytest.mark.parametrize("kind", [*KINDS])
def test_an_imu_beside_the_wrench_is_read_where_it_is_asked_for(tmp_path, monkeypatch, kind):
    monkeypatch.delattr(MessageType, "_one_by_one")
    path = write(tmp_path, kind, "Reading")
    (recording,) = read(path, topic="/ft.imu").recordings
    assert recording.axes == IMU
    assert recording.wrench.tolist() == [[i / 7, 8.0, 9.0] * 2 for i in range(20)]
    assert recording.meta["topic"] == "/ft.imu"
    assert recording.meta["frame"] == "outer"
    assert read(path).recordings[0].axes == AXES


def test_an_imu_has_units_where_they_are_stated(tmp_path):
    path = write(tmp_path, "bag", "Reading")
    assert "units" not in load(path, topic="/ft.imu")[0].meta
    units = load(path, topic="/ft.imu", units="deg/s,g")[0].meta["units"]
    assert dict(units) == dict(zip(IMU, ["deg/s"] * 3 + ["g"] * 3, strict=True))


def test_a_topic_that_is_an_imu_is_read_where_it_is_asked_for(tmp_path):
    store, stamps = STORES[2], even_stamps()
    imus = [value.imu for value in values(2, "Reading")]
    raw = [bytes(store.serialize_cdr(value, value.__msgtype__)) for value in imus]
    topics = one_topic(ROS2, samples(), stamps) | {"/imu": ("sensor_msgs/msg/Imu", raw, stamps)}
    path = write_mcap(tmp_path / "x.mcap", topics, store=store)
    assert read(path, topic="/imu").recordings[0].wrench[3].tolist() == [3 / 7, 8.0, 9.0] * 2
    assert read(path).recordings[0].wrench.tolist() == samples().tolist()


def test_imus_of_no_number_are_refused_by_their_names(tmp_path):
    store = STORES[2]
    imus = [value.imu for value in values(2, "Reading")]
    imus[4].angular_velocity.y = math.nan
    raw = [bytes(store.serialize_cdr(value, value.__msgtype__)) for value in imus]
    path = write_mcap(tmp_path / "x.mcap", {"/imu": ("sensor_msgs/msg/Imu", raw, even_stamps())}, store=store)
    with pytest.raises(RecordingFileError, match=r"angular_velocity\.y is nan"):
        read(path, topic="/imu")
    with pytest.raises(RecordingFileError, match="has no messages of type"):
        read(path)


def test_a_plain_topic_comes_first_and_the_other_is_named(tmp_path):
    store, stamps = STORES[2], even_stamps()
    raw = [bytes(store.serialize_cdr(value, value.__msgtype__)) for value in values(2, "Reading")]
    topics = one_topic(ROS2, samples(seed=5), stamps) | {"/maker": ("maker_msgs/msg/Reading", raw, stamps)}
    path = write_mcap(tmp_path / "x.mcap", topics, store=store)
    content = read(path)
    assert content.recordings[0].wrench.tobytes() == samples(seed=5).tobytes()
    assert "/maker (maker_msgs/Reading, 20 messages, 500 Hz)" in content.notes[0]
    for topic in ("/maker", "/maker.wrench"):
        assert read(path, topic=topic).recordings[0].wrench.tobytes() == samples().tobytes()
    with pytest.raises(RecordingFileError, match=r"no messages on topic '/ft\.wrench'"):
        read(path, topic="/ft.wrench")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "ros2 bag convert"),
        ("geometry_msgs/Wrench w;\n", "cannot be parsed"),
        ("geometry_msgs/Wrench wrench\nmaker_msgs/No no\n", "maker_msgs/msg/No"),
    ],
)
def test_definitions_that_are_missing_or_no_definitions(tmp_path, text, problem):
    raw = [bytes(STORES[2].serialize_cdr(value, value.__msgtype__)) for value in values(2, "Bare")]
    topics = {"/maker": ("maker_msgs/msg/Bare", raw, even_stamps())}
    with pytest.raises(RecordingFileError, match=problem):
        read(write_mcap(tmp_path / "x.mcap", topics, definitions=text))


@pytest.mark.data
def test_real_bags_of_a_makers_driver(data_dir):
    data = load(data_dir / "sand_press")
    assert len(data) == 19
    assert set(data.labels) == {"press", "press_smooth", "press_grouser", "rest"}
    pressed = data[data.names.index("press_1.bag")]
    assert pressed.n_samples == 2684
    assert np.diff(pressed.time_s).mean() == pytest.approx(0.01, rel=1e-3)
    assert np.abs(pressed.wrench).max() < 200


@pytest.mark.data
def test_the_imu_of_real_bags(data_dir):
    data = load(data_dir / "sand_press", topic="/rokubimini_cosmo/forcetorque_readings.imu", units="deg/s,g")
    up = np.array([recording.wrench[:100, 3:].mean(axis=0) for recording in data])
    assert (abs(np.linalg.norm(up, axis=1) - 1) < 0.04).all()
    assert (up[:, 2] < -0.96).all()
