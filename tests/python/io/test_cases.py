"""Files in the shape of real ones that were misread, or refused without a way out that works: a test of each kind.

Each kind has small files made here; those of the shared data (``GRANULAR_ID_DATA``) are read, too.
"""

import json

import numpy as np
import pandas as pd
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.recording import AXES
from remedies import lines_of, run

RNG = np.random.default_rng(7)
W = np.round(RNG.normal(size=(120, 6)), 5)
STAMPS = pd.Timestamp("2025-03-04 21:46:21.9") + pd.to_timedelta(np.arange(120) * 2, unit="ms")
DAY = pd.Timedelta("1D")
BEFORE_MIDNIGHT = pd.Timestamp("2025-03-04 23:59:59.9") - STAMPS[0]
NAMES = ["Force_x", "Force_y", "Force_z", "Torque_x", "Torque_y", "Torque_z"]


@pytest.fixture
def case(data_dir):
    """Where the shared files of a case are; skipped where there are none."""

    def folder(name):
        path = data_dir / "cases" / name
        if not path.exists():
            pytest.skip(f"{path} is not there")
        return path

    return folder


def frame(**columns):
    return pd.DataFrame({**columns, **dict(zip(NAMES, W.T, strict=True))})


def refused(path, problem, **options):
    with pytest.raises(RecordingFileError, match=problem) as caught:
        load(path, **options)
    return caught.value.problem


CP1252 = {"encoding": "cp1252"}
SIX = "ax,ay,az,wx,wy,wz"
BOTH = {"label": "folder", "session": "parent"}
SHARED = {
    "02_text_timestamps": ({}, None, (6, 400, 500, 6, 0)),
    "07_log_with_pauses": ({}, None, (2, 1200, None, 2, 0)),
    "12_dropouts": ({}, None, (4, 396, None, 2, 0)),
    "01_session_above_label/by_day": (BOTH, "label='folder', session='parent'", (12, 150, 250, 2, 2)),
    "01_session_above_label/by_person": (BOTH, "label='folder', session='parent'", (12, 150, 250, 2, 2)),
    "03_ati_demo_export": ({"csv": {"skiprows": 7}, "rate_hz": 500}, "{'skiprows': 7}", (2, 300, 500, 2, 0)),
    "05_rows_in_packets": ({"axes": SIX, "rate_hz": 100}, "for other axes pass axes=", (2, 600, 100, 2, 0)),
    "06_other_array_or_topic/train": (
        {"array": "ee_wrench"},
        "pass array='ee_wrench' ",
        (36, 300, 500, 3, 0),
    ),
    "11_encodings/utf16.csv": ({}, None, (1, 200, 500, 0, 0)),
    "11_encodings/excel_sep_line.csv": ({}, None, (1, 200, 500, 0, 0)),
    "11_encodings/windows_1252.csv": ({"axes": SIX, "csv": CP1252}, str(CP1252), (1, 200, 500, 0, 0)),
}
"""Options, what the refusal without them names, and recordings, samples, rate, labels and sessions."""


@pytest.mark.data
@pytest.mark.parametrize("path", SHARED)
def test_shared_files_are_read_as_the_refusal_says(case, path):
    options, problem, figures = SHARED[path]
    if problem is not None:
        refused(case(path), problem)
    data = load(case(path), **options)
    sessions = set(data.sessions) - {None}
    found = (len(data), max(r.n_samples for r in data), data[0].rate_hz, len(data.labels), len(sessions))
    assert found == figures


@pytest.mark.parametrize(
    "texts",
    [
        [f"{stamp:%Y-%m-%d %H:%M:%S.%f}" for stamp in STAMPS],
        [str(stamp).removesuffix(".000000") for stamp in STAMPS],  # full seconds without a fraction
        [f"{stamp:%H:%M:%S.%f}" for stamp in STAMPS],
        [f"{stamp:%Y-%m-%dT%H:%M:%S.%f}Z" for stamp in STAMPS],
        [f"{stamp:%d %b %Y %H:%M:%S.%f}" for stamp in STAMPS],
        [f"{stamp:%d.%m.%Y %H:%M:%S},{stamp.microsecond // 1000:03d}" for stamp in STAMPS],
        [f"{stamp:%H:%M:%S},{stamp.microsecond // 1000:03d}" for stamp in STAMPS],
        [f"{stamp:%m/%d/%Y %I:%M:%S.%f %p}" for stamp in STAMPS],
        [f"{stamp:%H:%M:%S}:{stamp.microsecond // 1000:03d}" for stamp in STAMPS],
        [f"{stamp:%M:%S.%f}" for stamp in STAMPS],
        [f"{stamp + BEFORE_MIDNIGHT:%M:%S.%f}" for stamp in STAMPS],
        [str(stamp - STAMPS[0]) for stamp in STAMPS],  # 0 days 00:00:00.002000
        [f"{stamp + BEFORE_MIDNIGHT:%H:%M:%S.%f}" for stamp in STAMPS],
        [f"{stamp + BEFORE_MIDNIGHT:%d.%m.%Y %H:%M:%S.%f}" for stamp in STAMPS],  # 4th of March, not April
        [f"{stamp + 8 * DAY + BEFORE_MIDNIGHT:%d/%m/%Y %H:%M:%S.%f}" for stamp in STAMPS],  # 12th, 13th
    ],
)
def test_text_timestamps_are_a_clock(tmp_path, texts):
    frame(Timestamp=texts).to_csv(tmp_path / "a.csv", index=False)
    frame().set_index(pd.Index(texts)).to_csv(tmp_path / "of_pandas.csv")
    for name in ("a.csv", "of_pandas.csv"):
        recording = load(tmp_path / name)[0]
        assert (recording.rate_hz, recording.n_samples) == (500, 120)
        assert recording.wrench.tobytes() == W.tobytes()


@pytest.mark.parametrize(
    ("above", "read"),
    [
        ("Force Unit: N; Torque Unit: Nmm", {}),
        ("Units: N, Nmm", {"units": ["N", "Nmm"]}),
        ("'Units (force/torque)' = N/Nmm", {"units": ["N", "Nmm"]}),
    ],
)
def test_units_above_the_names_are_obeyed_or_refused(tmp_path, above, read):
    text = (frame(time=np.arange(120) / 500) * [1, 1, 1, 1, 1000, 1000, 1000]).to_csv(index=False)
    (tmp_path / "a.csv").write_text(f"Rig 3\n{above}\n{text}")
    if read:
        refused(tmp_path / "a.csv", "states units .*units=", csv={"skiprows": 2})
    np.testing.assert_allclose(load(tmp_path / "a.csv", csv={"skiprows": 2}, **read)[0].wrench, W, atol=1e-9)


@pytest.mark.parametrize("above", ["Unit under test: 5", "Units: see names"])
def test_lines_about_other_units_are_passed_over(tmp_path, above):
    (tmp_path / "a.csv").write_text(f"{above}\n{frame(time=np.arange(120) / 500).to_csv(index=False)}")
    assert load(tmp_path / "a.csv", csv={"skiprows": 1})[0].wrench.tobytes() == W.tobytes()


def in_packets(size, rate_hz):
    return 1.7e9 + (np.arange(120) // size) * size / rate_hz


@pytest.mark.parametrize(
    ("stamps", "rate_hz", "problem"),
    [
        (["soon"] * 120, 500, "state the rate, and the clock is ignored: pass rate_hz=RATE"),
        ([*np.arange(119) / 500, ""], 500, "state the rate, and the clock is ignored: pass rate_hz=RATE"),
        *((in_packets(*one), one[1], "packets, and are not averaged.*RATE") for one in ((2, 200), (3, 100))),
    ],
)
def test_a_clock_that_is_none_needs_a_stated_rate(tmp_path, stamps, rate_hz, problem):
    frame(time=stamps).to_csv(tmp_path / "a.csv", index=False)
    refused(tmp_path / "a.csv", problem)
    refused(tmp_path / "a.csv", problem, on_time_error="repair")
    data = load(tmp_path / "a.csv", rate_hz=rate_hz)
    assert data[0].wrench.tobytes() == W.tobytes()
    assert (data.rate_hz, data[0].start_time) == (rate_hz, 1.7e9 if "packets" in problem else None)
    assert "the clock was ignored" in data.history[-1].rows[0]["remark"]


def test_pauses_stay_in_the_stamps_and_no_rate_closes_them(tmp_path):
    stamps = np.arange(120) / 500 + 90.5 * (np.arange(120) // 40)
    frame(time=stamps).to_csv(tmp_path / "a.csv", index=False)
    recording = load(tmp_path / "a.csv")[0]
    np.testing.assert_allclose(recording.time_s, stamps)
    refused(tmp_path / "a.csv", r"a pause of 90.5 s, .*\.split\(gap_s=1\)", rate_hz=500)
    data = load(tmp_path / "a.csv")
    assert data.history[-1].notes[0] == (
        "1 recording has pauses of up to 90.5 s: .split(gap_s=1) makes a recording of each stretch (--split-gap-s 1)"
    )
    parts = data.split(gap_s=1)
    assert (len(parts), parts.rate_hz, parts[2].n_samples) == (3, 500, 40)


def test_packets_with_stamps_of_their_own_want_the_rate(tmp_path):
    sample = np.arange(120)
    frame(time=sample // 4 * 4 / 500 + sample % 4 * 2e-5).to_csv(tmp_path / "a.csv", index=False)
    refused(tmp_path / "a.csv", "came in packets.*rate_hz=RATE")
    (recording,) = load(tmp_path / "a.csv", rate_hz=500)
    assert (recording.rate_hz, recording.n_samples) == (500, 120)
    frame(time=sample // 4 * 4 / 500 + sample % 4 * 2e-5 + 3 * (sample >= 60)).to_csv(
        tmp_path / "b.csv", index=False
    )
    refused(tmp_path / "b.csv", "came in packets.*rate_hz=RATE")
    parts = load(tmp_path / "b.csv", rate_hz=500).split(gap_s=1)
    assert [(part.rate_hz, part.n_samples) for part in parts] == [(500, 60)] * 2


@pytest.mark.parametrize("packet", [2, 5])
def test_packets_between_pauses_are_split_at_a_stated_rate(tmp_path, packet):
    sample = np.arange(120)
    stamps = sample // packet * packet / 500 + 3 * (sample >= 60)
    frame(time=stamps).to_csv(tmp_path / "a.csv", index=False)
    refused(tmp_path / "a.csv", "one stamp.*rate_hz=RATE")
    whole = load(tmp_path / "a.csv", rate_hz=500)
    parts = whole.split(gap_s=1)
    assert whole[0].rate_hz is None
    assert [(part.rate_hz, part.n_samples) for part in parts] == [(500, 60), (500, 60)]


def test_counted_samples_have_pauses(tmp_path):
    counts = np.arange(120) + 900 * (np.arange(120) >= 40)
    frame(sample=counts).to_csv(tmp_path / "a.csv", index=False)
    parts = load(tmp_path / "a.csv", time="sample", time_unit="sample", rate_hz=500).split(gap_s=1)
    assert [(part.rate_hz, part.n_samples) for part in parts] == [(500, 40), (500, 80)]


@pytest.mark.parametrize("form", ["vectors", "axes"])
@pytest.mark.parametrize(
    ("topic", "rate_hz", "inside"),
    [("/wrench", 500, ["wrench"]), ("/robot1/ft_sensor/raw", 250, []), ("/state", 100, ["sensors", "ft"])],
)
def test_mcap_of_json_names_the_lines_that_read_it(tmp_path, topic, rate_hz, inside, form):
    pytest.importorskip("rosbags")
    writers = pytest.importorskip("mcap.writer")
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = writers.Writer(file)
        writer.start()
        schema = writer.register_schema("geometry_msgs/WrenchStamped", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel(topic, "json", schema)
        for i, row in enumerate(W.tolist()):
            value = {
                part: dict(zip("xyz", row[k : k + 3], strict=True))
                for part, k in (("force", 0), ("torque", 3))
            }
            if form == "axes":
                value = dict(zip(AXES, row, strict=True))
            for key in reversed(inside):
                value = {"header": {"seq": i}, key: value}
            at = 1_700_000_000_000_000_000 + round(i * 1e9 / rate_hz)
            writer.add_message(channel, at, json.dumps(value).encode(), at)
        writer.finish()
    data = run(*lines_of(refused(tmp_path / "a.mcap", "messages in JSON")))
    assert (data.rate_hz, data[0].axes) == (rate_hz, AXES)
    assert data[0].wrench.tobytes() == W.tobytes()


def test_mcap_of_other_messages_says_what_they_are(tmp_path):
    writers = pytest.importorskip("mcap.writer")
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = writers.Writer(file)
        writer.start()
        schema = writer.register_schema("maker.Wrench", "protobuf", b"?")
        for topic, encoding, data in (("/ft", "protobuf", b"\1"), ("/log", "json", b'{"force": 3}')):
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, 5, data, 5)
        writer.finish()
    refused(tmp_path / "a.mcap", r"no wrenches of ROS 2 but /ft \(protobuf\), /log \(json\): .*from_frames")


@pytest.mark.parametrize("lost", [[50, 51], [3, 4, 60, 61, 62], [0, 119]])
def test_empty_rows_and_missing_rows_are_alike(tmp_path, lost):
    whole = frame(time=np.arange(120) / 500)
    empty = whole.copy()
    empty.loc[lost, NAMES] = np.nan
    empty.to_csv(tmp_path / "empty.csv", index=False)
    whole.drop(index=lost).to_csv(tmp_path / "missing.csv", index=False)
    one, other = (load(tmp_path / name) for name in ("empty.csv", "missing.csv"))
    assert np.array_equal(one[0].wrench, other[0].wrench)
    assert np.array_equal(one[0].times(), other[0].times())
    assert one.history[-1].totals["left_out_samples"] == len(lost)
    inner = sum(0 < i < 119 for i in lost)
    filled = one.resample(500)[0]
    assert (filled.flags is None or int((filled.flags > 0).sum())) == (inner or True)
