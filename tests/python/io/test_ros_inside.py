"""Wrenches inside messages of makers' types: read as rosbags reads them, listed where there are several, refused."""

from __future__ import annotations

import sys
from operator import attrgetter

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ros_cases import (
    MCAP,
    ROS1,
    ROS2,
    SQLITE,
    even_stamps,
    message,
    one_topic,
    read,
    samples,
    write_mcap,
)

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
        headed = make["maker_msgs/msg/Headed"](True, stamped.header, np.arange(3, dtype=np.uint8), bare)
        alone = make["maker_msgs/msg/Bare"](3, bare, np.ones(2))
        vector, nine = make["geometry_msgs/msg/Vector3"](7.0, 8.0, 9.0), np.ones(9)
        quaternion = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        imu = make["sensor_msgs/msg/Imu"](header, quaternion, nine, vector, nine, vector, nine)
        yield {
            "Reading": make["maker_msgs/msg/Reading"](header, 5, imu, stamped, False, words(i), 21.5),
            "Headed": headed,
            "Bare": alone,
            "Nested": make["maker_msgs/msg/Nested"]("".join(words(i)), headed),
            "Two": make["maker_msgs/msg/Two"](stamped, alone),
            "Listed": make["maker_msgs/msg/Listed"]([stamped], [bare, bare]),
        }[name]


def write(folder, kind, name, **about):
    version, type_name = KINDS[kind], f"maker_msgs/msg/{name}"
    store = STORES[version]
    if kind == "bag":
        writer, path = Writer1(folder / "x.bag"), folder / "x.bag"
    else:
        writer = Writer2(folder / "x", version=9, storage_plugin=SQLITE if kind == "db3" else MCAP)
        path = folder / "x"
    to_bytes = store.serialize_ros1 if version == 1 else store.serialize_cdr
    with writer:
        connection = writer.add_connection("/ft", type_name, typestore=store)
        for value, log_ns in zip(values(version, name, **about), even_stamps(), strict=True):
            writer.write(connection, log_ns, to_bytes(value, type_name))
    return path


CASES = {
    "Reading": ("wrench", {}, True),
    "Reading, of any length": ("wrench", {"words": lambda i: ["ab"] * (i % 4)}, True),
    "Headed": ("load", {}, True),
    "Bare": ("load", {}, False),
    "Nested": ("tool.load", {}, True),
    "Nested, of any length": ("tool.load", {"words": lambda i: ["ab"] * (i % 3)}, True),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("case", CASES)
def test_the_wrench_is_that_of_rosbags(tmp_path, kind, case):
    field, about, stamped = CASES[case]
    path = write(tmp_path, kind, case.partition(",")[0], **about)
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


@pytest.mark.parametrize("kind", KINDS)
def test_of_several_one_is_chosen(tmp_path, kind):
    path = write(tmp_path, kind, "Two")
    for topic in (None, "/ft", "/ft.middle"):
        with pytest.raises(RecordingFileError, match=r"/ft\.left, /ft\.right\.load; choose by topic="):
            read(path, topic=topic)
    assert read(path, topic="/ft.left").recordings[0].meta["frame"] == "link"
    assert "frame" not in read(path, topic="ft.right.load").recordings[0].meta
    with pytest.raises(RecordingFileError, match="no messages on topic '/other'"):
        read(path, topic="/other")


def test_wrenches_in_lists_are_none_that_could_be_taken(tmp_path):
    with pytest.raises(RecordingFileError, match=r"nor with one as a field; it has /ft \(maker_msgs/Listed"):
        read(write(tmp_path, "mcap", "Listed"))


def reading_topic(name="Reading", **about):
    store = STORES[2]
    raw = [bytes(store.serialize_cdr(v, v.__msgtype__)) for v in values(2, name, **about)]
    return {"/maker": (f"maker_msgs/msg/{name}", raw, even_stamps())}


def definition(name="Reading"):
    return STORES[2].generate_msgdef(f"maker_msgs/msg/{name}", ros_version=2)[0]


def test_a_plain_topic_comes_first_and_the_other_is_named(tmp_path):
    plain = one_topic(ROS2, samples(seed=5), even_stamps())
    store = STORES[2]
    writer = Writer2(tmp_path / "b", version=9, storage_plugin=MCAP)
    with writer:
        for topic, (type_name, messages, log_ns) in (plain | reading_topic()).items():
            connection = writer.add_connection(topic, type_name, typestore=store)
            for data, time in zip(messages, log_ns, strict=True):
                writer.write(connection, time, data)
    content = read(tmp_path / "b")
    assert content.recordings[0].wrench.tobytes() == samples(seed=5).tobytes()
    assert "/maker (maker_msgs/Reading, 20 messages, 500 Hz)" in content.notes[0]
    for topic in ("/maker", "/maker.wrench"):
        assert read(tmp_path / "b", topic=topic).recordings[0].wrench.tobytes() == samples().tobytes()
    with pytest.raises(RecordingFileError, match=r"no messages on topic '/ft\.wrench'"):
        read(tmp_path / "b", topic="/ft.wrench")


RULE = "=" * 80
CIRCLE = f"maker_msgs/A a\n{RULE}\nMSG: maker_msgs/A\nmaker_msgs/A a\n{RULE}\nMSG: geometry_msgs/Wrench\nfloat64 x\n"
TREE = "".join(
    f"{RULE}\nMSG: maker_msgs/T{i}\nmaker_msgs/T{i + 1} a\nmaker_msgs/T{i + 1} b\n" for i in range(20)
)
TREE += f"{RULE}\nMSG: maker_msgs/T20\nuint8 x\n"


@pytest.mark.parametrize(
    ("change", "text", "problem"),
    [
        (lambda raw: raw[:-1], None, "message 1 of /maker: has .* less than its type makes it"),
        (lambda raw: raw[:3], None, "has 3 bytes|less than its type"),
        (lambda raw: raw + bytes(4), None, "4 bytes more than its type makes it"),
        (lambda raw: b"\0\7" + raw[2:], None, "begins with 00 07"),
        (lambda raw: raw[:12] + b"\xff\xff\xff\x7f" + raw[16:], None, "less than its type"),
        (lambda raw: raw, "geometry_msgs/Wrench w;\n", "its definition cannot be parsed"),
        (
            lambda raw: raw,
            "geometry_msgs/Wrench wrench\nmaker_msgs/No no\n",
            "maker_msgs/msg/No of field no is not",
        ),
        (
            lambda raw: raw,
            f"{HEADED}{RULE}\nMSG: geometry_msgs/Wrench\nfloat64 x\n",
            "Wrench is defined as 'x'",
        ),
        (
            lambda raw: raw,
            CIRCLE.replace("float64 x", "Vector3 force\nVector3 torque"),
            "nested more than 32 deep",
        ),
        (lambda raw: raw, f"geometry_msgs/Wrench w\nmaker_msgs/T0 t\n{TREE}", "more than 5000 fields"),
        (
            lambda raw: raw,
            f"maker_msgs/E[4294967295] a\ngeometry_msgs/Wrench w\n{RULE}\nMSG: maker_msgs/E\n",
            "less than its type",
        ),
    ],
)
def test_what_is_damaged_or_hostile(tmp_path, change, text, problem):
    (type_name, raw, log_ns) = reading_topic()["/maker"]
    topics = {"/maker": (type_name, [change(data) for data in raw], log_ns)}
    path = write_mcap(tmp_path / "x.mcap", topics, definitions=text or definition())
    with pytest.raises(RecordingFileError, match=problem):
        read(path)


def test_a_bag_without_definitions_says_what_adds_them(tmp_path):
    path = write_mcap(tmp_path / "x.mcap", reading_topic(), definitions="")
    with pytest.raises(RecordingFileError, match="ros2 bag convert"):
        read(path)


def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch):
    path = write(tmp_path, "bag", "Reading")
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(ImportError, match=r"^rosbags is needed .*'granular-id\[ros\]'"):
        read(path)


@pytest.mark.data
def test_real_bags_of_a_makers_driver(data_dir):
    data = load(data_dir / "sand_press")
    assert len(data) == 19
    assert set(data.labels) == {"press", "press_smooth", "press_grouser", "rest"}
    pressed = data[data.names.index("press_1.bag")]
    assert pressed.n_samples == 2684
    assert np.diff(pressed.time_s).mean() == pytest.approx(0.01, rel=1e-3)
    assert np.abs(pressed.wrench).max() < 200
