"""CSV files and indexes that cannot be used: each gives one error with its place, and the rest still loads."""

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
    "line end only": (b"\n", 1, "1"),
    "header only": (HEADER, 2, None),
    "header without line end": (HEADER[:-1], 2, None),
    "header and blank lines": (HEADER + b"\r\n\n \n", 2, None),
    "no header": (ROW1 + ROW2, 1, "1"),
    "cut in the header": (GOOD[:9], 1, "3"),
    "cut between header cells": (GOOD[:10], 1, None),
    "cut after a cell": (HEADER + ROW1 + ROW2[:6], 3, None),
    "cut after a comma": (HEADER + ROW1 + ROW2[:5], 3, "fx"),
    "cut before the last cell": (HEADER + ROW1 + ROW2[:-3], 3, None),
    "cut in an exponent": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6e", 3, "tz"),
    "cut after a minus": (HEADER + ROW1 + b"0.01,1,2,3,4,5,-", 3, "tz"),
    "zip": (b"PK\x03\x04\x14\0\0\0\x08\0" + bytes(range(256)) * 3, 1, None),
    "npy": (b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}", 1, None),
    "png": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 1, None),
    "nul bytes after a good start": (HEADER + ROW1 + bytes(100), 3, None),
    "nul in a cell": (HEADER + b"0.00,1\x00,2,3,4,5,6\n", 2, None),
    "latin-1 header": ("zeit\xe4,fx\n".encode("latin-1"), 1, None),
    "utf-16": (GOOD.decode().encode("utf-16"), 1, None),
    "utf-16 without mark": (GOOD.decode().encode("utf-16-le"), 1, None),
    "latin-1 cell": (HEADER + b"0.00,1,2,3,4,5,6\xb0\n", 2, "tz"),
    "unicode minus": (HEADER + "0,\u22121,2,3,4,5,6\n".encode(), 2, "fx"),
    "arabic digits": (HEADER + "0,\u0661,2,3,4,5,6\n".encode(), 2, "fx"),
    "semicolons and decimal commas": (b"fx;fy;fz;tx;ty;tz\n1;2,5;3;4;5;6\n", 2, "fy"),
    "two lines of comments": (b"# lab\n# fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n", 2, None),
    "time without a name": (b",fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, 1, "1"),
    "an index that jumps": (b"Unnamed: 0,fx,fy,fz,tx,ty,tz\n0" + BARE + b"2" + BARE, 1, "1"),
    "short line with other columns": (EXTRA + b"0" + BARE[:-3] + b"\n", 2, None),
    "empty line with other columns": (EXTRA + b"0" + BARE + b"\n1" + BARE, 3, None),
    "quote that is not closed": (EXTRA + b'"a' + BARE + b"b" + BARE, 2, None),
    "quoted line end": (EXTRA + b'"a\nb"' + BARE + b"c" + BARE, 3, None),
    "nan with other columns": (EXTRA + b"a,1,2,nan,4,5,6\n", 2, "fz"),
    "numbers of samples": (b"id,fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, None, "id"),
    "two labels": (b"label," + HEADER + b"a," + ROW1 + b"b," + ROW2, None, "label"),
    "recording without a name": (EXTRA.replace(b"note", b"trial") + b"a" + BARE + BARE, 3, "trial"),
    "a comment first": (b"# lab\n" + GOOD, 1, "1"),
    "bare carriage returns": (GOOD.replace(b"\n", b"\r"), 1, None),
    "carriage return in a line": (HEADER + b"0.00,1,2,3,4,5,6\r7\n", 2, "tz"),
    "missing column": (b"time,fx,fy,fz,tx,ty\n0,1,2,3,4,5\n", 1, None),
    "doubled column": (b"time,fx,fy,fz,tx,ty,tz,FX\n", 1, "8"),
    "two times": (b"time,timestamp,fx,fy,fz,tx,ty,tz\n", 1, "2"),
    "two names of an axis": (b"time,fx,fy,fz,tx,ty,tz,Mx\n", 1, "8"),
    "volt": (b"time,fx [V],fy,fz,tx,ty,tz\n", 1, "2"),
    "newton centimetre": (b"fx,fy,fz,tx_Ncm,ty,tz\n", 1, "4"),
    "minutes in the name": (b"time_min,fx,fy,fz,tx,ty,tz\n", 1, "1"),
    "a mask": (b"valid," + HEADER + b"1," + ROW1 + b"0," + ROW2, None, "valid"),
    "two rates": (b"fs,fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, None, "fs"),
    "time or torque": (b"T,fx,fy,fz,tx,ty,tz\n", 1, "1"),
    "too few cells": (HEADER + ROW1 + b"0.01,1,2,3,4,5\n", 3, None),
    "too many cells": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6,7\n", 3, None),
    "one short, one long": (HEADER + b"0,1,2,3,4,5\n0.1,1,2,3,4,5,6,7\n", 2, None),
    "trailing commas": (HEADER + ROW1.replace(b"\n", b",\n"), 2, None),
    "empty cell": (HEADER + ROW1 + b"0.01,1,,3,4,5,6\n", 3, "fy"),
    "blank cell": (HEADER + ROW1 + b"0.01,1, ,3,4,5,6\n", 3, "fy"),
    "empty line": (HEADER + ROW1 + b"\n" + ROW2, 3, None),
    "line of blanks": (HEADER + ROW1 + b" \n" + ROW2, 3, "time"),
    "comment": (HEADER + ROW1 + b"# pause\n" + ROW2, 3, "time"),
    "text": (HEADER + b"0.00,1,2,three,4,5,6\n", 2, "fz"),
    "nan": (HEADER + ROW1 + b"0.01,nan,2,3,4,5,6\n", 3, "fx"),
    "inf": (HEADER + b"0.00,1,2,3,4,5,-inf\n", 2, "tz"),
    "too large": (HEADER + b"0.00,1,1e999,3,4,5,6\n", 2, "fy"),
    "underscores": (HEADER + b"0.00,1_000,2,3,4,5,6\n", 2, "fx"),
    "hex": (HEADER + b"0.00,0x10,2,3,4,5,6\n", 2, "fx"),
    "hex float": (HEADER + b"0.00,0x1p3,2,3,4,5,6\n", 2, "fx"),
    "fortran exponent": (HEADER + b"0.00,1d3,2,3,4,5,6\n", 2, "fx"),
    "complex": (HEADER + b"0.00,1+2j,2,3,4,5,6\n", 2, "fx"),
    "two points": (HEADER + b"0.00,1.2.3,2,3,4,5,6\n", 2, "fx"),
    "two signs": (HEADER + b"0.00,--1,2,3,4,5,6\n", 2, "fx"),
    "two numbers": (HEADER + b"0.00,1 2,2,3,4,5,6\n", 2, "fx"),
    "a point alone": (HEADER + b"0.00,.,2,3,4,5,6\n", 2, "fx"),
    "quoted numbers": (HEADER + b'0.00,"1",2,3,4,5,6\n', 2, "fx"),
    "decimal commas": (HEADER + b"0,00,1,5,2,0,3,0,4,0,5,0,6,0\n", 2, None),
    "time backwards": (HEADER + ROW2 + ROW1, 3, "time"),
    "repeated stamp": (HEADER + ROW1 + ROW2 + ROW2, 4, "time"),
    "milliseconds since 1970": (HEADER + b"1581072654215,1,2,3,4,5,6\n", 2, "time"),
    "nanoseconds since 1970": (HEADER + b"1581072654215425827,1,2,3,4,5,6\n", 2, "time"),
    "endless time": (HEADER + b"-1e11,1,2,3,4,5,6\n1.79e308,1,2,3,4,5,6\n", None, "time"),
    "huge header": (b"a" * 100_000, 1, None),
    "huge line": (HEADER + ROW1 + b"1" * 100_000 + b"\n", 3, None),
    "flags out of range": (b"time,fx,fy,fz,tx,ty,tz,flags\n0,1,2,3,4,5,6,16\n", 2, "flags"),
    "flags with a fraction": (b"time,fx,fy,fz,tx,ty,tz,flags\n0,1,2,3,4,5,6,0.5\n", 2, "flags"),
    "html": (b"<!DOCTYPE html>\n<html><body>404</body></html>\n", 1, "1"),
}

# of index.csv
BAD_INDEX = {
    "no file column": (b"label,session\nrice,a\n", 1, None),
    "doubled column": (b"file,label,label\n", 1, "3"),
    "nameless column": (b"file,,label\n", 1, "2"),
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
    "the folder itself": (b"file,label\n.,rice\n", 2, "file"),
    "no CSV file": (b"file,label\ngood.txt,rice\n", 2, "file"),
    "unprintable column": (b"file,\x01\n", 1, "2"),
    "itself": (b"file,label\nindex.csv,rice\n", 1, "1"),
    "folder": (b"file,label\nfolder.csv,rice\n", 2, "file"),
    "name too long": (b"file\n" + b"a" * 5000 + b".csv\n", None, None),
    "bad start time": (b"file,start_time\ngood.csv,yesterday\n", 2, "start_time"),
    "infinite start time": (b"file,start_time\ngood.csv,1e999\n", 2, "start_time"),
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


def refused(path, line, column):
    with pytest.raises(RecordingFileError) as caught:
        load(path)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("name", BAD)
def test_one_error_with_its_place(tmp_path, name):
    data, line, column = BAD[name]
    (tmp_path / "bad_1.csv").write_bytes(data)
    refused(tmp_path / "bad_1.csv", line, column)


@pytest.mark.parametrize("name", BAD_INDEX)
def test_one_error_for_a_bad_index(tmp_path, name):
    data, line, column = BAD_INDEX[name]
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / "index.csv").write_bytes(data)
    refused(tmp_path, line, column)


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
    for i in range(3):
        (folder / f"good_{i}.csv").write_bytes(GOOD)
    with pytest.raises(RecordingFileError, match="bad_0"):
        load(tmp_path)
    data = load(tmp_path, on_error="skip")
    assert data.names == ("rice/good_0.csv", "rice/good_1.csv", "rice/good_2.csv")
    report = data.history[-1]
    assert report.totals["skipped"] == len(BAD)
    assert all(row["skipped"].startswith(str(folder)) for row in report.rows if "skipped" in row)


def test_nothing_readable_is_an_error_even_with_skip(tmp_path):
    (tmp_path / "a_1.csv").write_bytes(b"")
    with pytest.raises(RecordingFileError, match="none of 1 recording could be read"):
        load(tmp_path, on_error="skip")


def test_a_name_without_a_label_is_read_and_said(tmp_path):
    for name in ("_1.csv", "rice.csv", "rice_.csv", "rice_1.csv"):
        (tmp_path / name).write_bytes(GOOD)
    data = load(tmp_path)
    assert {r.name: r.label for r in data} == {
        "_1.csv": None,
        "rice.csv": None,
        "rice_.csv": None,
        "rice_1.csv": "rice",
    }
    assert "3 files whose name gives no label ('_1.csv'): wanted label/*.csv" in data.history[-1].notes[0]


def test_labels_that_are_no_names(tmp_path):
    for label, problem in (("a\tb", "control character"), (" rice", "begins or ends with a space")):
        folder = tmp_path / label
        folder.mkdir()
        (folder / "1.csv").write_bytes(GOOD)
        with pytest.raises(RecordingFileError, match=problem):
            load(tmp_path)
        (folder / "1.csv").unlink()
        folder.rmdir()


def test_a_file_beyond_the_size_cap_is_not_read(tmp_path):
    file = tmp_path / "a_1.csv"
    file.write_bytes(GOOD)
    with pytest.raises(RecordingFileError, match="max_file_bytes"):
        load(file, max_file_bytes=len(GOOD) - 1)
    assert len(load(file, max_file_bytes=4 * 40)) == 1
    file.write_bytes(HEADER + b"\n" * 300_000)
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


def test_links_out_of_the_folder_are_not_followed(tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "secret_1.csv").write_bytes(GOOD)
    inside = tmp_path / "set"
    (inside / "rice").mkdir(parents=True)
    (inside / "rice" / "1.csv").write_bytes(GOOD)
    links = {
        "rice/link.csv": outside / "secret_1.csv",
        "rice/relative.csv": "../../outside/secret_1.csv",
        "peas": outside,
    }
    for name, target in links.items():
        (inside / name).symlink_to(target)
        with pytest.raises(RecordingFileError, match="leaves the folder") as caught:
            load(inside)
        assert caught.value.path == str(inside / name)
        assert load(inside, on_error="skip").names == ("rice/1.csv",)
        (inside / name).unlink()


@pytest.mark.parametrize("target", ["loop.csv", "missing.csv"])
def test_links_that_lead_nowhere(tmp_path, target):
    (tmp_path / "rice").mkdir()
    (tmp_path / "rice" / "loop.csv").symlink_to(target)
    with pytest.raises(RecordingFileError, match=r"loop.csv: cannot be read"):
        load(tmp_path)


def test_errors_survive_pickle_and_unprintable_names(tmp_path):
    import pickle

    error = RecordingFileError(b"a\xff.csv".decode("utf-8", "surrogateescape"), "is odd", line=3, column="fx")
    assert str(error) == "a\\udcff.csv, line 3, column fx: is odd"
    twin = pickle.loads(pickle.dumps(error))
    assert (str(twin), twin.line, twin.column) == (str(error), 3, "fx")


def test_good_lines_of_a_partly_bad_index_load_with_skip(tmp_path):
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / "index.csv").write_bytes(b"file,label\n../x.csv,a\ngood.csv,rice\nlost.csv,b\n")
    data = load(tmp_path, on_error="skip")
    assert data.y.tolist() == ["rice"]
    assert [row["name"] for row in data.history[-1].rows] == ["index.csv", "lost.csv"]


def test_an_index_without_labels_says_so(tmp_path):
    (tmp_path / "index.csv").write_bytes(b"file,material\ngood.csv,rice\n")
    (tmp_path / "good.csv").write_bytes(b"time,fx,fy,fz,tx,ty,tz\n0,1,2,3,4,5,6\n")
    data = load(tmp_path)
    assert "index.csv has no column label (found: file, material)" in data.history[-1].notes
    (tmp_path / "index.csv").write_bytes(b"label\nrice\n")
    with pytest.raises(RecordingFileError, match="no column 'file'") as caught:
        load(tmp_path, on_error="skip")
    assert not caught.value.skippable


def test_a_tip_to_skip_is_given_only_where_something_would_be_left(tmp_path):
    (tmp_path / "00.csv").write_bytes(b"")
    (tmp_path / "index.csv").write_bytes(b"file\nno.txt\n")
    with pytest.raises(RecordingFileError, match="no known format") as caught:
        load(tmp_path)
    assert not caught.value.skippable
    (tmp_path / "index.csv").write_bytes(b"file\nno.txt\n00.csv\n")
    with pytest.raises(RecordingFileError, match="no known format") as caught:
        load(tmp_path)
    assert caught.value.skippable
