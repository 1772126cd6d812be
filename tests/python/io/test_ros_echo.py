"""CSV files that ``rostopic echo -p`` and ``ros2 topic echo --csv`` print."""

import numpy as np
import pytest

import granular_id as gid
from granular_id.io import RecordingFileError

WRENCH = np.random.default_rng(5).normal(size=(40, 6)) * [1, 1, 1, 1e-6, 1e-6, 1e-6]
STAMPS_NS = 1_700_000_000_123_456_789 + 2_000_000 * np.arange(40)
FORCES = [f"{part}.{axis}" for part in ("force", "torque") for axis in "xyz"]
HEADER = ["field.header.seq", "field.header.stamp", "field.header.frame_id"]


def ros1(logged=STAMPS_NS + 500_000, stamps=STAMPS_NS, frames="tool0", stamped=True):
    """Lines of ROS 1; without a header those of geometry_msgs/Wrench."""
    frames = [frames] * 40 if isinstance(frames, str) else frames
    wrench = "field.wrench." if stamped else "field."
    lines = [",".join(["%time", *(HEADER if stamped else []), *(wrench + name for name in FORCES)])]
    for i, row in enumerate(WRENCH.tolist()):
        about = [str(i), str(stamps[i]), frames[i]] if stamped else []
        lines.append(",".join([str(logged[i]), *about, *map(str, row)]))
    return lines


def ros2(stamps=STAMPS_NS):
    """Lines of ROS 2."""
    return [
        ",".join([*map(str, divmod(stamp, 10**9)), "tool0", *map(str, row)])
        for stamp, row in zip(stamps.tolist(), WRENCH.tolist(), strict=True)
    ]


@pytest.fixture
def load(tmp_path):
    def load(lines, end="\n", **options):
        path = tmp_path / "rice_1.csv"
        path.write_bytes((end.join(lines) + end).encode("latin-1"))
        return gid.load(path, **options)

    return load


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("lines", [ros1(), ros2()], ids=["ROS 1", "ROS 2"])
def test_samples_bit_for_bit_with_stamps_frame_and_label(load, lines, end):
    (recording,) = load(lines, end)
    assert recording.wrench.tobytes() == WRENCH.tobytes()
    assert recording.rate_hz == 500.0
    assert recording.start_time == 1_700_000_000.123456789
    assert recording.meta == {"frame": "tool0", "message_type": "geometry_msgs/WrenchStamped"}


def test_messages_without_a_header_have_log_times(load):
    data = load(ros1(stamped=False))
    assert data[0].wrench.tobytes() == WRENCH.tobytes()
    assert data[0].rate_hz == 500.0
    assert data[0].meta == {"message_type": "geometry_msgs/Wrench"}
    assert "log times are taken" in str(data.history[-1])


def test_messages_are_in_the_order_in_which_they_were_logged_also_without_a_frame(load):
    lines = [line.replace("tool0", "") for line in ros1()]
    (recording,) = load([lines[0], lines[2], lines[1], *lines[3:]])
    assert recording.wrench.tobytes() == WRENCH.tobytes()
    assert recording.meta == {"message_type": "geometry_msgs/WrenchStamped"}


def test_stamps_that_were_never_set(load):
    data = load(ros1(stamps=np.zeros(40, int)))
    assert data[0].rate_hz == 500.0
    assert "header.stamp never changes" in str(data.history[-1])
    with pytest.raises(
        RecordingFileError, match="no stamps that change and no rate is stated; pass rate_hz="
    ):
        load(ros2(np.zeros(40, int)))
    assert load(ros2(np.zeros(40, int)), rate_hz=500)[0].rate_hz == 500.0


def changed(lines, line, old, new):
    lines = list(lines)
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    return lines


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (ros1()[:1], "line 2: has a header but no samples"),
        (changed(ros1(), 1, "header.seq", "header.temperature"), r"line 1, column 2.*no field of a wrench"),
        (
            changed(ros1(), 1, "field.header.seq", "header.stamp.sec"),
            r"line 1, column 2.*no field of a wrench",
        ),
        (changed(ros1(), 1, ",field.wrench.torque.z", ""), "line 1: column 'tz' is missing"),
        (ros1(frames="tool\xff"), "line 2: byte 0xff is not UTF-8 text"),
        (changed(ros1(), 9, "tool0", "tool1"), "line 9: frame_id changes from 'tool0' to 'tool1'"),
        (
            changed(ros1(), 9, "1700000000", "1700000000000"),
            r"line 9, column %time: '17\d+' is not a whole number",
        ),
        (changed(ros1(), 9, "tool0,", "tool0,nan"), r"line 9, column field\.wrench\.force\.x"),
        (changed(ros2(), 1, "tool0,", "tool0,nan"), "line 1, column fx"),
        (changed(ros2(), 9, "1700000000", "9300000000"), "line 9, column header.stamp.sec"),
        (changed(ros2(), 9, "tool0,", ""), "line 9: 8 cells; wanted 9"),
    ],
)
def test_what_is_refused(load, lines, message):
    with pytest.raises(RecordingFileError, match=message):
        load(lines)


def test_stamps_that_run_back(load):
    lines = changed(ros2(), 9, "1700000000", "1600000000")
    with pytest.raises(RecordingFileError, match=r"line 9: time runs back"):
        load(lines)
    assert load(lines, on_time_error="repair")[0].n_samples == 40
