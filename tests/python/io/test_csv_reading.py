"""Reading CSV: layouts, time, sessions, and what the history says about it."""

import gzip
import math
import os
import re

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.recording import AXES, SampleFlag

HEADER = "time," + ",".join(AXES)


def write(path, times=(0.0, 0.01, 0.02), header=HEADER):
    path.parent.mkdir(parents=True, exist_ok=True)
    wrench = np.random.default_rng(0).normal(size=(len(times), 6)).tolist()
    rows = [",".join(map(repr, [float(t), *row])) for t, row in zip(times, wrench, strict=True)]
    path.write_text("\n".join([header, *rows, ""]))


def test_files_are_read_in_natural_order(tmp_path):
    for label in ("rice", "peas"):
        for k in (10, 2, 1):
            write(tmp_path / label / f"{label}_{k}.CSV")
    (tmp_path / "notes.txt").write_text("not a recording")
    (tmp_path / "rice" / ".hidden_1.csv").write_text("not one either")
    data = load(tmp_path)
    assert data.names == tuple(f"{label}/{label}_{k}.CSV" for label in ("peas", "rice") for k in (1, 2, 10))
    assert data.y.tolist() == ["peas"] * 3 + ["rice"] * 3
    assert data.history[-1].parameters["format"] == "label/*"


FOLDERS = {
    "oat_flakes_01.csv": ("oat_flakes", None, {}),
    "train/rice/a.csv": ("rice", None, {"split": "train"}),
    "Test/rice/a.csv": ("rice", None, {"split": "Test"}),
    "train/rice_1.csv": ("rice", None, {"split": "train"}),
    "label=oat%20flakes/a.csv": ("oat flakes", None, {}),
    "label=rice/session=3/speed=0.03/a.csv": ("rice", "3", {"speed": "0.03"}),
    "session=3/rice/a.csv": ("rice", "3", {}),
    "rice/speed=3/a.csv": ("rice", None, {"speed": "3"}),
    "rice/day_2/a.csv": ("rice", "day_2", {}),
    "speed=3/rice/day 1/a.csv": ("rice", "day 1", {"speed": "3"}),
    "val/material=rice/trial=2/a.csv": ("rice", None, {"split": "val", "trial": "2"}),
    "rice/test/a.csv": ("rice", None, {"split": "test"}),
}


@pytest.mark.parametrize("path", FOLDERS)
def test_names_of_folders_and_files_say_what_a_recording_is(tmp_path, path):
    write(tmp_path / path)
    data = load(tmp_path)
    assert (data[0].label, data[0].session, data[0].meta) == FOLDERS[path]
    kept = ", ".join(sorted(data[0].meta))
    assert list(data.history[-1].notes) == ([f"names of folders kept in meta: {kept}"] if kept else [])


def test_a_material_may_be_called_test_beside_others(tmp_path):
    for label in ("test", "rice"):
        write(tmp_path / label / "a.csv")
    assert load(tmp_path).labels == ("rice", "test")


def test_index(tmp_path):
    write(tmp_path / "a.csv")
    write(tmp_path / "deep" / "er" / "b.csv", [1.6e9, 1.6e9 + 0.01])
    for spare in ("spare.csv", "deep/er/spare.csv"):
        write(tmp_path / spare)
    (tmp_path / "index.csv").write_text(
        "File,LABEL,session,start_time,rate_hz,trigger_index,meta,operator\n"
        'deep/er/b.csv,"oats, rolled",s2,1.5e9,100,1,"{""depth_mm"": 76}",anna\n'
        "\n"
        "a.csv,,,,,,,\n",
    )
    data = load(tmp_path)
    b, a = data
    known = (b.label, b.session, b.start_time, b.rate_hz, b.trigger_index)
    assert known == ("oats, rolled", "s2", 1.5e9, 100, 1)
    assert b.meta == {"depth_mm": 76, "operator": "anna"}
    assert b.name == "deep/er/b.csv"
    assert (a.label, a.session, a.start_time, a.trigger_index, a.meta) == (None, None, None, None, {})
    assert data.history[-1].notes == (
        "columns of index.csv kept in meta: operator",
        "2 recordings beside index.csv (spare.csv ...) are not listed in it and were not read",
    )


def test_columns_in_any_order_and_case_with_blanks_quotes_bom_and_crlf(tmp_path):
    file = tmp_path / "a_1.csv"
    file.write_bytes(
        b'\xef\xbb\xbf"TZ", ty,TX,fz,"Fy",fx,TimeStamp\r\n 6, 5,4\t,+3.,.2e1,1E0,0\r\n6,5,4,3,2,1,0.5\r\n\r\n'
    )
    recording = load(file)[0]
    assert recording.wrench.tolist() == [[1, 2, 3, 4, 5, 6]] * 2
    assert recording.rate_hz == 2
    assert (recording.label, recording.session, recording.name) == (None, None, "a_1.csv")


@pytest.mark.parametrize(
    ("header", "note"),
    [
        ("TIMESTAMP,Fx,Fy,Fz,Tx,Ty,Tz", []),
        ("t,Fx [N],fy,fz,Mx,ty,tz", ["columns 't', 'Fx [N]', 'Mx' taken as time, fx, tx (2 files)"]),
    ],
)
def test_other_names_of_columns_are_noted(tmp_path, header, note):
    for i in range(2):
        write(tmp_path / f"a_{i}.csv", header=header)
    assert list(load(tmp_path).history[-1].notes) == note


@pytest.mark.parametrize(
    ("times", "rate_hz", "start_time", "rows"),
    [
        ([1581072654.25, 1581072654.5, 1581072655.0], None, 1581072654.25, ()),
        ([12.5, 13.0, 14.0], None, None, ({"name": "a_1.csv", "first_stamp_s": 12.5},)),
        (np.arange(800) / 500, 500, None, ()),
        (1.58e9 + np.arange(800) / 500, 500, 1.58e9, ()),
        (np.arange(800) / 500 + np.where(np.arange(800) == 70, 4e-5, 0), None, None, ()),
    ],
)
def test_even_stamps_become_a_rate_and_those_since_1970_a_start_time(
    tmp_path, times, rate_hz, start_time, rows
):
    write(tmp_path / "a_1.csv", times)
    data = load(tmp_path)
    (recording,) = data
    assert (recording.rate_hz, recording.start_time) == (rate_hz, start_time)
    assert rate_hz or recording.time_s.tolist() == [t - times[0] for t in times]
    assert data.history[-1].rows == rows
    assert data.history[-1].totals["uniform"] == (rate_hz is not None)
    assert data.history[-1].totals["irregular"] == (rate_hz is None)


def test_the_index_can_keep_even_stamps_as_they_are(tmp_path):
    write(tmp_path / "a.csv")
    (tmp_path / "index.csv").write_text("file,rate_hz\na.csv,irregular\n")
    for rate in (None, 100, 7):
        assert load(tmp_path, rate_hz=rate)[0].time_s.tolist() == [0, 0.01, 0.02]
    (tmp_path / "a.csv").write_text(",".join(AXES) + "\n1,2,3,4,5,6\n")
    with pytest.raises(RecordingFileError, match="has no time column, but is called irregular"):
        load(tmp_path, rate_hz=100)


def test_without_a_time_column_a_rate_is_needed(tmp_path):
    (tmp_path / "a_1.csv").write_text(",".join(AXES) + "\n1,2,3,4,5,6\n")
    with pytest.raises(RecordingFileError, match="no time column and no rate is stated; pass rate_hz="):
        load(tmp_path)
    assert load(tmp_path, rate_hz=500)[0].rate_hz == 500


def test_a_stated_rate_must_fit_the_stamps(tmp_path):
    write(tmp_path / "a_1.csv", times=[0, 0.002, 0.003, 0.005])  # 600 Hz, printed to the millisecond
    assert load(tmp_path, rate_hz=600)[0].rate_hz == 600
    assert load(tmp_path)[0].rate_hz is None
    with pytest.raises(RecordingFileError, match="stated rate of 100 Hz does not fit the stamps"):
        load(tmp_path, rate_hz=100)


def test_time_errors_are_repaired_only_when_told(tmp_path):
    file = tmp_path / "a_1.csv"
    body = ["0", "0.3", "0.1", "0.1", "0.5"]
    file.write_text(
        HEADER + ",flags\n" + "".join(f"{t},{i},0,0,0,0,0,{2 * (i == 3)}\n" for i, t in enumerate(body))
    )
    (tmp_path / "index.csv").write_text("file,label,trigger_index\na_1.csv,a,1\n")
    with pytest.raises(
        RecordingFileError, match=re.escape("time runs back from 0.3 to 0.1; on_time_error='repair'")
    ):
        load(tmp_path)
    data = load(tmp_path, on_time_error="repair")
    r = data[0]
    assert r.time_s.tolist() == [0, 0.1, 0.3, 0.5]
    assert r.wrench[:, 0].tolist() == [0, 2.5, 1, 4]
    repaired = SampleFlag.TIME_REPAIRED
    assert r.flags.tolist() == [0, SampleFlag.SATURATED | repaired, 0, 0]
    assert r.trigger_index == 2
    assert data.history[-1].totals["moved_samples"] == 2
    assert data.history[-1].totals["merged_samples"] == 1
    assert data.history[-1].rows == ({"name": "a_1.csv", "moved": 2, "merged": 1},)


def test_progress_is_told_of_every_file(tmp_path):
    for k in range(3):
        write(tmp_path / f"a_{k}.csv")
    (tmp_path / "a_1.csv").write_text("broken")
    calls = []
    load(tmp_path, on_error="skip", progress=lambda done, total, _: calls.append((done, total)))
    assert calls == [(1, 3), (2, 3), (3, 3)]


def test_what_is_no_recording_is_said_to_be_none(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere: no such file or folder"):
        load(tmp_path / "nowhere")
    (tmp_path / "a.xlsx").write_bytes(b"PK")
    with pytest.raises(RecordingFileError, match=r"no known format; what can be read: CSV .*folder"):
        load(tmp_path / "a.xlsx")
    with pytest.raises(RecordingFileError, match=r"holds no recordings; .*known format \(\.xlsx\); a table"):
        load(tmp_path)
    write(tmp_path / "day" / "rice" / "tool" / "morning" / "1.csv")
    with pytest.raises(RecordingFileError, match=r"'day/rice/tool/morning/1.csv' lies too deep"):
        load(tmp_path)


def test_mixed_layouts_are_refused(tmp_path):
    for new, old, problem in (
        ("peas/1.csv", "rice_1.csv", r"both here \('rice_1.csv'\) and in sub-folders"),
        ("peas/day1/1.csv", "peas/1.csv", "peas: recordings both here"),
        ("peas/day1/morning/1.csv", "peas/day1/1.csv", "morning: recordings lie too deep"),
    ):
        write(tmp_path / new)
        write(tmp_path / old)
        with pytest.raises(RecordingFileError, match=problem):
            load(tmp_path)
        (tmp_path / old).unlink()


def test_bad_settings_are_named(tmp_path):
    bad = {
        "rate_hz": 0,
        "on_error": "ignore",
        "on_time_error": "sort",
        "time_unit": "min",
        "topic": "",
        "progress": 3,
    }
    for name, value in [*bad.items(), ("rate_hz", math.nan), ("rate_hz", "1"), ("max_file_bytes", 1.5)]:
        with pytest.raises((TypeError, ValueError), match=name):
            load(tmp_path, **{name: value})


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="needs symbolic links")
def test_links_inside_the_folder_are_followed(tmp_path):
    write(tmp_path / "set" / "rice" / "1.csv")
    (tmp_path / "set" / "rice" / "2.csv").symlink_to("1.csv")
    (tmp_path / "way").symlink_to("set")
    assert load(tmp_path / "way").names == ("rice/1.csv", "rice/2.csv")
    (tmp_path / "one.csv").symlink_to("set/rice/1.csv")
    assert load(tmp_path / "one.csv")[0].n_samples == 3


def test_start_times_of_the_index_may_be_dates(tmp_path):
    (tmp_path / "a.csv").write_text("fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n")
    dates = "2020-02-07T10:50:54.25+00:00|2020-02-07T10:50:54.25Z|2020-02-07 11:50:54.250+01:00|1581072654.25"
    for text in dates.split("|"):
        (tmp_path / "index.csv").write_text(f"file,start_time,rate_hz\na.csv,{text},500\n")
        assert load(tmp_path)[0].start_time == 1581072654.25


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda data: data[:-20], "cut off"),
        (lambda data: data * 2, "several gzip streams"),
        (lambda data: data[:20] + b"\0\0" + data[22:], "cannot be decompressed|cut off"),
        (lambda _: gzip.compress(bytes(26_000_000)), "more than 25165824 bytes"),
        (lambda _: b"fx,fy", "cannot be decompressed"),
    ],
)
def test_gzip_that_is_damaged_or_a_bomb(tmp_path, change, problem):
    file = tmp_path / "a.csv.gz"
    write(tmp_path / "a.csv", times=np.arange(50) / 100)
    file.write_bytes(change(gzip.compress((tmp_path / "a.csv").read_bytes())))
    with pytest.raises(RecordingFileError, match=problem):
        load(file)
