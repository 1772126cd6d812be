"""CSV files and indexes that cannot be used: each gives one error with its place, and the rest still loads."""

import pickle
from pathlib import Path

import pytest

from granular_id.io import RecordingFileError, load

HEADER = b"time,fx,fy,fz,tx,ty,tz\n"
ROW1 = b"0.00,1.5,2,3,4,5,6\n"
ROW2 = b"0.01,1,2,3,4,5,6\n"
ROW3 = b"0.02,1,2,3,4,5,6\n"
BARE = b",1,2,3,4,5,6\n"
EXTRA = b"note,fx,fy,fz,tx,ty,tz\n"
GOOD = HEADER + ROW1 + ROW2 + ROW3

# name: bytes, and the line and column that the error names
BAD = {
    "empty": (b"", None, None),
    "bom only": (b"\xef\xbb\xbf", 1, "1"),
    "header only": (HEADER, 2, None),
    "no header": (ROW1 + ROW2, 1, "1"),
    "cut in the header": (GOOD[:9], 1, "3"),
    "cut after a cell": (HEADER + ROW1 + ROW2[:6], 3, None),
    "cut in an exponent": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6e", 3, "tz"),
    "zip": (b"PK\x03\x04\x14\0\0\0\x08\0" + bytes(range(256)) * 3, 1, None),
    "nul bytes after a good start": (HEADER + ROW1 + bytes(100), 3, None),
    "latin-1 header": ("zeit\xe4,fx\n".encode("latin-1"), 1, None),
    "utf-16": (GOOD.decode().encode("utf-16"), 1, None),
    "unicode minus": (HEADER + "0,\u22121,2,3,4,5,6\n".encode(), 2, "fx"),
    "semicolons and decimal commas": (b"fx;fy;fz;tx;ty;tz\n1;2,5;3;4;5;6\n", 2, "fy"),
    "two lines of comments": (b"# lab\n# fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n", 2, None),
    "time without a name": (b",fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, 1, "1"),
    "an index that jumps": (b"Unnamed: 0,fx,fy,fz,tx,ty,tz\n0" + BARE + b"2" + BARE, 1, "1"),
    "short line with other columns": (EXTRA + b"0" + BARE[:-3] + b"\n", 2, None),
    "quote that is not closed": (EXTRA + b'"a' + BARE + b"b" + BARE, 2, None),
    "quoted line end": (EXTRA + b'"a\nb"' + BARE + b"c" + BARE, 3, None),
    "numbers of samples": (b"id,fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, None, "id"),
    "two labels": (b"label," + HEADER + b"a," + ROW1 + b"b," + ROW2, None, "label"),
    "recording without a name": (EXTRA.replace(b"note", b"trial") + b"a" + BARE + BARE, 3, "trial"),
    "a comment first": (b"# lab\n" + GOOD, 1, "1"),
    "bare carriage returns": (GOOD.replace(b"\n", b"\r"), 1, None),
    "carriage return in a line": (HEADER + b"0.00,1,2,3,4,5,6\r7\n", 2, "tz"),
    "missing column": (b"time,fx,fy,fz,tx,ty\n0,1,2,3,4,5\n", 1, None),
    "doubled column": (b"time,fx,fy,fz,tx,ty,tz,FX\n", 1, "8"),
    "a mask": (b"valid," + HEADER + b"1," + ROW1 + b"0," + ROW2, None, "valid"),
    "two rates": (b"fs,fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, None, "fs"),
    "time or torque": (b"T,fx,fy,fz,tx,ty,tz\n", 1, "1"),
    "too few cells": (HEADER + ROW1 + b"0.01,1,2,3,4,5\n", 3, None),
    "trailing commas": (HEADER + ROW1.replace(b"\n", b",\n"), 2, None),
    "empty cell": (HEADER + ROW1 + b"0.01,1,,3,4,5,6\n", 3, "fy"),
    "empty line": (HEADER + ROW1 + b"\n" + ROW2, 3, None),
    "line of blanks": (HEADER + ROW1 + b" \n" + ROW2, 3, "time"),
    "nan": (HEADER + ROW1 + b"0.01,nan,2,3,4,5,6\n", 3, "fx"),
    "inf": (HEADER + b"0.00,1,2,3,4,5,-inf\n", 2, "tz"),
    "too large": (HEADER + b"0.00,1,1e999,3,4,5,6\n", 2, "fy"),
    "underscores": (HEADER + b"0.00,1_000,2,3,4,5,6\n", 2, "fx"),
    "hex": (HEADER + b"0.00,0x10,2,3,4,5,6\n", 2, "fx"),
    "quoted numbers": (HEADER + b'0.00,"1",2,3,4,5,6\n', 2, "fx"),
    "time backwards": (HEADER + ROW2 + ROW1, 3, "time"),
    "repeated stamp": (HEADER + ROW1 + ROW2 + ROW2, 4, "time"),
    "milliseconds since 1970": (HEADER + b"1581072654215,1,2,3,4,5,6\n", 2, "time"),
    "endless time": (HEADER + b"-1e11,1,2,3,4,5,6\n1.79e308,1,2,3,4,5,6\n", None, "time"),
    "huge header": (b"a" * 100_000, 1, None),
    "huge line": (HEADER + ROW1 + b"1" * 100_000 + b"\n", 3, None),
    "flags out of range": (b"time,fx,fy,fz,tx,ty,tz,flags\n0,1,2,3,4,5,6,16\n", 2, "flags"),
    "bad label": (b"time,fx,fy,fz,tx,ty,tz,material\n0,1,2,3,4,5,6,r\x07\n", None, "material"),
    "html": (b"<!DOCTYPE html>\n<html><body>404</body></html>\n", 1, "1"),
}

# of index.csv
BAD_INDEX = {
    "no file column": (b"label,session\nrice,a\n", 1, None),
    "doubled column": (b"file,label,label\n", 1, "3"),
    "lists nothing": (b"file,label\n\n", 2, None),
    "empty": (b"", None, None),
    "binary": (b"file,label\na\0,b\n", 2, None),
    "not utf-8": (b"file,label\ngood.csv,rice\nx.csv,m\xfcsli\n", 3, None),
    "open quote": (b'file,label\n"good.csv,rice\n', 2, None),
    "too many cells": (b"file,label\ngood.csv,rice,more\n", 2, None),
    "missing file": (b"file,label\ngood.csv,a\nlost.csv,b\n", None, None),
    "listed twice": (b"file,label\ngood.csv,a\n./good.csv,b\n", 3, "file"),
    "up and out": (b"file\n../good.csv\n", 2, "file"),
    "up in the middle": (b"file\na/../../good.csv\n", 2, "file"),
    "absolute": (b"file\n/etc/passwd\n", 2, "file"),
    "backslashes": (b"file\n..\\good.csv\n", 2, "file"),
    "drive": (b"file\nC:good.csv\n", 2, "file"),
    "control character": (b'file\n"go\x07od.csv"\n', 2, "file"),
    "no path": (b"file,label\n,rice\n", 2, "file"),
    "no CSV file": (b"file,label\ngood.txt,rice\n", 2, "file"),
    "unprintable column": (b"file,\x01\n", 1, "2"),
    "folder": (b"file,label\nfolder.csv,rice\n", 2, "file"),
    "name too long": (b"file\n" + b"a" * 5000 + b".csv\n", None, None),
    "bad start time": (b"file,start_time\ngood.csv,yesterday\n", 2, "start_time"),
    "no zone": (b"file,start_time\ngood.csv,2026-11-21T09:30:00\n", 2, "start_time"),
    "negative rate": (b"file,rate_hz\ngood.csv,-1\n", 2, "rate_hz"),
    "rate that does not fit": (b"file,rate_hz\ngood.csv,7\n", None, "time"),
    "fractional trigger": (b"file,trigger_index\ngood.csv,1.5\n", 2, "trigger_index"),
    "trigger outside": (b"file,trigger_index\ngood.csv,3\n", None, None),
    "bad meta": (b"file,meta\ngood.csv,{\n", 2, "meta"),
    "meta list": (b"file,meta\ngood.csv,[]\n", 2, "meta"),
    "meta with nan": (b'file,meta\ngood.csv,"{""a"": NaN}"\n', None, None),
    "deep meta": (b"file,meta\ngood.csv," + b"[" * 100_000 + b"\n", 2, "meta"),
    "bad label": (b"file,label\ngood.csv,rice \n", None, None),
}


CASES = [
    *(pytest.param("bad_1.csv", *case, id=f"csv {name}") for name, case in BAD.items()),
    *(pytest.param("index.csv", *case, id=f"index {name}") for name, case in BAD_INDEX.items()),
]


@pytest.mark.parametrize(("name", "data", "line", "column"), CASES)
def test_one_error_with_its_place(tmp_path, name, data, line, column):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / name).write_bytes(data)
    path = tmp_path if name == "index.csv" else tmp_path / name
    with pytest.raises(RecordingFileError) as caught:
        load(path)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert str(caught.value).startswith(str(path))


def test_every_cut_of_a_good_file_is_refused_or_remarked(tmp_path):
    """A file cut inside its last number cannot be told from a whole one, but it lacks its line end."""
    file = tmp_path / "a.csv"
    for end in range(len(GOOD)):
        file.write_bytes(GOOD[:end])
        try:
            data = load(file)
        except RecordingFileError:
            continue
        assert GOOD[:end].endswith(b"\n") or "cut off" in data.history[-1].rows[0]["remark"]


def test_the_rest_of_the_folder_loads_with_skip(tmp_path):
    folder = tmp_path / "rice"
    folder.mkdir()
    for i, (data, *_) in enumerate(BAD.values()):
        (folder / f"bad_{i}.csv").write_bytes(data)
    with pytest.raises(RecordingFileError, match=rf"none of {len(BAD)} recordings could be read"):
        load(tmp_path, on_error="skip")
    (folder / "good.csv").write_bytes(GOOD)
    with pytest.raises(RecordingFileError, match="bad_0"):
        load(tmp_path)
    data = load(tmp_path, on_error="skip")
    assert data.names == ("rice/good.csv",)
    report = data.history[-1]
    assert report.totals["skipped"] == len(BAD)
    assert all(row["skipped"].startswith(str(folder)) for row in report.rows if "skipped" in row)


def test_good_lines_of_an_index_load_with_skip_where_there_are_any(tmp_path):
    (tmp_path / "good.csv").write_bytes(GOOD)
    index = tmp_path / "index.csv"
    for lines, skippable in (
        (b"file\nno.txt\n", False),
        (b"file,material\n../x.csv,a\ngood.csv,rice\nlost.csv,b\n", True),
    ):
        index.write_bytes(lines)
        with pytest.raises(RecordingFileError, match=r"line 2, column file") as caught:
            load(tmp_path)
        assert caught.value.skippable is skippable
    data = load(tmp_path, on_error="skip")
    assert data.names == ("good.csv",)
    assert [row["name"] for row in data.history[-1].rows] == ["index.csv", "lost.csv"]
    assert "index.csv has no column label (found: file, material)" in data.history[-1].notes


def test_a_name_without_a_label_is_read_and_said(tmp_path):
    labels = {"_1.csv": None, "rice.csv": None, "rice_.csv": None, "rice_1.csv": "rice"}
    for name in labels:
        (tmp_path / name).write_bytes(GOOD)
    data = load(tmp_path)
    assert {r.name: r.label for r in data} == labels
    assert "3 files whose name gives no label ('_1.csv'): wanted label/*.csv" in data.history[-1].notes[0]


def test_a_file_beyond_the_size_cap_is_not_read(tmp_path):
    file = tmp_path / "a_1.csv"
    file.write_bytes(GOOD)
    with pytest.raises(RecordingFileError, match="max_file_bytes"):
        load(file, max_file_bytes=len(GOOD) - 1)
    assert len(load(file, max_file_bytes=4 * 40)) == 1
    file.write_bytes(HEADER + b"\n" * 700_000)
    with pytest.raises(RecordingFileError, match="max_file_bytes"):
        load(file)
    with file.open("r+b") as sparse:
        sparse.truncate(1 << 40)  # a terabyte that takes no room on the disk
    with pytest.raises(RecordingFileError, match="max_file_bytes"):
        load(file)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs a file that hides its size")
def test_a_file_with_more_in_it_than_it_says(tmp_path):
    (tmp_path / "a.csv").symlink_to("/proc/self/status")
    with pytest.raises(RecordingFileError, match="grows while it is read"):
        load(tmp_path / "a.csv")


def test_links_out_of_the_folder_are_not_followed_and_those_to_nowhere_are_told(tmp_path):
    outside, inside = tmp_path / "outside", tmp_path / "set"
    for folder in (outside, inside / "rice"):
        folder.mkdir(parents=True)
        (folder / "1.csv").write_bytes(GOOD)
    for name, target, problem in (
        ("rice/link.csv", outside / "1.csv", "leaves the folder"),
        ("rice/relative.csv", "../../outside/1.csv", "leaves the folder"),
        ("peas", outside, "leaves the folder"),
        ("rice/loop.csv", "loop.csv", "cannot be read"),
        ("rice/lost.csv", "missing.csv", "cannot be read"),
    ):
        (inside / name).symlink_to(target)
        with pytest.raises(RecordingFileError, match=problem) as caught:
            load(inside)
        assert caught.value.path == str(inside / name)
        assert load(inside, on_error="skip").names == ("rice/1.csv",)
        (inside / name).unlink()


def test_errors_survive_pickle_and_unprintable_names():
    error = RecordingFileError(b"a\xff.csv".decode("utf-8", "surrogateescape"), "is odd", line=3, column="fx")
    assert str(error) == "a\\udcff.csv, line 3, column fx: is odd"
    twin = pickle.loads(pickle.dumps(error))
    assert (str(twin), twin.line, twin.column) == (str(error), 3, "fx")
