"""A corpus of files that are no recordings: each gives one error with its place, and the rest still loads."""

import os
import socket
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

# name: (bytes, line, column, part of the problem)
BAD = {
    "empty": (b"", None, None, "is empty (0 bytes)"),
    "bom only": (b"\xef\xbb\xbf", 1, "1", "unknown column ''"),
    "line end only": (b"\n", 1, "1", "unknown column ''"),
    "header only": (HEADER, 2, None, "a header but no samples"),
    "header without line end": (HEADER[:-1], 2, None, "a header but no samples"),
    "header and blank lines": (HEADER + b"\r\n\n \n", 2, None, "a header but no samples"),
    "no header": (ROW1 + ROW2, 1, "1", "unknown column '0.00'"),
    "cut in the header": (GOOD[:9], 1, "3", "unknown column 'f'"),
    "cut between header cells": (GOOD[:10], 1, None, "column 'fz' is missing"),
    "cut after a cell": (HEADER + ROW1 + ROW2[:6], 3, None, "2 cells; wanted 7"),
    "cut after a comma": (HEADER + ROW1 + ROW2[:5], 3, "fx", "the cell is empty"),
    "cut before the last cell": (HEADER + ROW1 + ROW2[:-3], 3, None, "6 cells; wanted 7"),
    "cut in an exponent": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6e", 3, "tz", "'6e' is not a plain"),
    "cut after a minus": (HEADER + ROW1 + b"0.01,1,2,3,4,5,-", 3, "tz", "'-' is not a plain"),
    "zip": (b"PK\x03\x04\x14\0\0\0\x08\0" + bytes(range(256)) * 3, 1, None, "is binary"),
    "npy": (b"\x93NUMPY\x01\x00v\x00{'descr': '<f8'}", 1, None, "is binary"),
    "png": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 1, None, "byte 0x89 is not UTF-8"),
    "nul bytes after a good start": (HEADER + ROW1 + bytes(100), 3, None, "is binary"),
    "nul in a cell": (HEADER + b"0.00,1\x00,2,3,4,5,6\n", 2, None, "is binary"),
    "latin-1 header": ("zeit\xe4,fx\n".encode("latin-1"), 1, None, "byte 0xe4 is not UTF-8"),
    "utf-16": (GOOD.decode().encode("utf-16"), 1, None, "is UTF-16 text"),
    "utf-16 without mark": (GOOD.decode().encode("utf-16-le"), 1, None, "is binary"),
    "latin-1 cell": (HEADER + b"0.00,1,2,3,4,5,6\xb0\n", 2, "tz", "is not a plain"),
    "unicode minus": (HEADER + "0,\u22121,2,3,4,5,6\n".encode(), 2, "fx", "is not a plain"),
    "arabic digits": (HEADER + "0,\u0661,2,3,4,5,6\n".encode(), 2, "fx", "is not a plain"),
    "semicolons and decimal commas": (
        b"fx;fy;fz;tx;ty;tz\n1;2,5;3;4;5;6\n",
        2,
        "fy",
        "with pandas: read_csv(path, sep=';'",
    ),
    "two lines of comments": (
        b"# lab\n# fx,fy,fz,tx,ty,tz\n1,2,3,4,5,6\n",
        2,
        None,
        "read_csv(path, comment='#'",
    ),
    "time without a name": (b",fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, 1, "1", "frame.index.name = 'time'"),
    "an index that jumps": (
        b"Unnamed: 0,fx,fy,fz,tx,ty,tz\n0" + BARE + b"2" + BARE,
        1,
        "1",
        "the column has no name",
    ),
    "short line with other columns": (EXTRA + b"0" + BARE[:-3] + b"\n", 2, None, "6 cells; wanted 7"),
    "empty line with other columns": (EXTRA + b"0" + BARE + b"\n1" + BARE, 3, None, "the line is empty"),
    "quote that is not closed": (EXTRA + b'"a' + BARE + b"b" + BARE, 2, None, "is not valid CSV"),
    "quoted line end": (EXTRA + b'"a\nb"' + BARE + b"c" + BARE, 3, None, "the line is empty, or a quoted"),
    "nan with other columns": (EXTRA + b"a,1,2,nan,4,5,6\n", 2, "fz", "'nan' is not a plain"),
    "numbers of samples": (
        b"id,fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2,
        None,
        "id",
        "numbers samples, not recordings",
    ),
    "two labels": (b"label," + HEADER + b"a," + ROW1 + b"b," + ROW2, None, "label", "has 2 values"),
    "recording without a name": (EXTRA.replace(b"note", b"trial") + b"a" + BARE + BARE, 3, "trial", "empty"),
    "a comment first": (b"# lab\n" + GOOD, 1, "1", "line 1 names the columns"),
    "bare carriage returns": (GOOD.replace(b"\n", b"\r"), 1, None, "bare carriage return"),
    "carriage return in a line": (HEADER + b"0.00,1,2,3,4,5,6\r7\n", 2, "tz", "is not a plain"),
    "missing column": (b"time,fx,fy,fz,tx,ty\n0,1,2,3,4,5\n", 1, None, "column 'tz' is missing"),
    "doubled column": (b"time,fx,fy,fz,tx,ty,tz,FX\n", 1, "8", "column 'FX' occurs twice"),
    "two times": (b"time,timestamp,fx,fy,fz,tx,ty,tz\n", 1, "2", "'time' and 'timestamp' both mean time"),
    "two names of an axis": (b"time,fx,fy,fz,tx,ty,tz,Mx\n", 1, "8", "'tx' and 'Mx' both mean tx"),
    "volt": (b"time,fx [V],fy,fz,tx,ty,tz\n", 1, "2", "the unit of column 'fx [V]' is 'V'; wanted N"),
    "newton centimetre": (b"fx,fy,fz,tx_Ncm,ty,tz\n", 1, "4", "'tx_Ncm' is 'Ncm'; wanted N m"),
    "minutes in the name": (b"time_min,fx,fy,fz,tx,ty,tz\n", 1, "1", "'time_min' is 'min'; wanted s"),
    "a mask": (
        b"valid," + HEADER + b"1," + ROW1 + b"0," + ROW2,
        None,
        "valid",
        "tells which rows are samples",
    ),
    "two rates": (b"fs,fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, None, "fs", "states the rates [0.0, 0.01]"),
    "time or torque": (b"T,fx,fy,fz,tx,ty,tz\n", 1, "1", "'T' may be time, torque or temperature"),
    "too few cells": (HEADER + ROW1 + b"0.01,1,2,3,4,5\n", 3, None, "6 cells; wanted 7"),
    "too many cells": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6,7\n", 3, None, "8 cells; wanted 7"),
    "one short, one long": (HEADER + b"0,1,2,3,4,5\n0.1,1,2,3,4,5,6,7\n", 2, None, "6 cells; wanted 7"),
    "trailing commas": (HEADER + ROW1.replace(b"\n", b",\n"), 2, None, "8 cells; wanted 7"),
    "empty cell": (HEADER + ROW1 + b"0.01,1,,3,4,5,6\n", 3, "fy", "the cell is empty"),
    "blank cell": (HEADER + ROW1 + b"0.01,1, ,3,4,5,6\n", 3, "fy", "the cell is empty"),
    "empty line": (HEADER + ROW1 + b"\n" + ROW2, 3, None, "the line is empty"),
    "line of blanks": (HEADER + ROW1 + b"  \n" + ROW2, 3, "time", "the cell is empty"),
    "comment": (HEADER + ROW1 + b"# pause\n" + ROW2, 3, "time", "'# pause' is not a plain"),
    "text": (HEADER + b"0.00,1,2,three,4,5,6\n", 2, "fz", "'three' is not a plain"),
    "nan": (HEADER + ROW1 + b"0.01,nan,2,3,4,5,6\n", 3, "fx", "'nan' is not a plain"),
    "inf": (HEADER + b"0.00,1,2,3,4,5,-inf\n", 2, "tz", "'-inf' is not a plain"),
    "too large": (HEADER + b"0.00,1,1e999,3,4,5,6\n", 2, "fy", "'1e999' is too large"),
    "underscores": (HEADER + b"0.00,1_000,2,3,4,5,6\n", 2, "fx", "'1_000' is not a plain"),
    "hex": (HEADER + b"0.00,0x10,2,3,4,5,6\n", 2, "fx", "'0x10' is not a plain"),
    "hex float": (HEADER + b"0.00,0x1p3,2,3,4,5,6\n", 2, "fx", "is not a plain"),
    "fortran exponent": (HEADER + b"0.00,1d3,2,3,4,5,6\n", 2, "fx", "'1d3' is not a plain"),
    "complex": (HEADER + b"0.00,1+2j,2,3,4,5,6\n", 2, "fx", "'1+2j' is not a plain"),
    "two points": (HEADER + b"0.00,1.2.3,2,3,4,5,6\n", 2, "fx", "'1.2.3' is not a plain"),
    "two signs": (HEADER + b"0.00,--1,2,3,4,5,6\n", 2, "fx", "'--1' is not a plain"),
    "two numbers": (HEADER + b"0.00,1 2,2,3,4,5,6\n", 2, "fx", "'1 2' is not a plain"),
    "a point alone": (HEADER + b"0.00,.,2,3,4,5,6\n", 2, "fx", "'.' is not a plain"),
    "quoted numbers": (HEADER + b'0.00,"1",2,3,4,5,6\n', 2, "fx", "is not a plain"),
    "decimal commas": (HEADER + b"0,00,1,5,2,0,3,0,4,0,5,0,6,0\n", 2, None, "14 cells; wanted 7"),
    "time backwards": (
        HEADER + ROW2 + ROW1,
        3,
        "time",
        "time runs back from 0.01 to 0.0; on_time_error='repair'",
    ),
    "repeated stamp": (HEADER + ROW1 + ROW2 + ROW2, 4, "time", "the stamp 0.01 is repeated"),
    "milliseconds since 1970": (
        HEADER + b"1581072654215,1,2,3,4,5,6\n",
        2,
        "time",
        "milliseconds or nanoseconds?",
    ),
    "nanoseconds since 1970": (HEADER + b"1581072654215425827,1,2,3,4,5,6\n", 2, "time", "wanted seconds"),
    "endless time": (
        HEADER + b"-1e11,1,2,3,4,5,6\n1.79e308,1,2,3,4,5,6\n",
        None,
        "time",
        "stamps lie 1.79e+308 apart",
    ),
    "huge header": (b"a" * 100_000, 1, None, "longer than 4096 bytes"),
    "huge line": (HEADER + ROW1 + b"1" * 100_000 + b"\n", 3, None, "longer than 4096 bytes"),
    "flags out of range": (
        b"time,fx,fy,fz,tx,ty,tz,flags\n0,1,2,3,4,5,6,16\n",
        2,
        "flags",
        "16 is not a sum",
    ),
    "flags with a fraction": (b"time,fx,fy,fz,tx,ty,tz,flags\n0,1,2,3,4,5,6,0.5\n", 2, "flags", "0.5 is not"),
    "html": (b"<!DOCTYPE html>\n<html><body>404</body></html>\n", 1, "1", "unknown column '<!DOCTYPE html>'"),
}


@pytest.mark.parametrize("name", BAD)
def test_one_error_with_its_place(tmp_path, name):
    data, line, column, problem = BAD[name]
    file = tmp_path / "bad_1.csv"
    file.write_bytes(data)
    with pytest.raises(RecordingFileError) as caught:
        load(file)
    error = caught.value
    assert problem in error.problem
    assert (error.line, error.column) == (line, column)
    assert error.path == str(file)
    assert str(error).startswith(str(file))


def test_the_corpus_is_large_and_the_good_file_is_good(tmp_path):
    assert len(BAD) > 60
    (tmp_path / "good_1.csv").write_bytes(GOOD)
    assert load(tmp_path)[0].wrench[0].tolist() == [1.5, 2, 3, 4, 5, 6]


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
    listed = [row["skipped"] for row in report.rows if "skipped" in row]
    for row, (_, _, _, problem) in zip(listed, BAD.values(), strict=True):
        assert problem in row


def test_nothing_readable_is_an_error_even_with_skip(tmp_path):
    (tmp_path / "a_1.csv").write_bytes(b"")
    with pytest.raises(
        RecordingFileError, match=r"none of 1 recording could be read; the first problem: .*empty"
    ):
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
    with pytest.raises(
        RecordingFileError, match=f"has {len(GOOD)} bytes, more than max_file_bytes={len(GOOD) - 1}"
    ):
        load(file, max_file_bytes=len(GOOD) - 1)
    assert len(load(file, max_file_bytes=4 * 40)) == 1
    file.write_bytes(HEADER + b"\n" * 300_000)
    with pytest.raises(RecordingFileError, match="300001 lines, more than 209715"):
        load(file)
    with file.open("r+b") as sparse:
        sparse.truncate(1 << 40)  # a terabyte that takes no room on the disk
    with pytest.raises(RecordingFileError, match="1099511627776 bytes"):
        load(file)


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs a file that hides its size")
def test_a_file_with_more_in_it_than_it_says(tmp_path):
    (tmp_path / "a.csv").symlink_to("/proc/self/status")
    with pytest.raises(RecordingFileError, match="grows while it is read"):
        load(tmp_path / "a.csv")


def test_what_is_named_like_a_file_but_is_none(tmp_path):
    os.mkfifo(tmp_path / "pipe_1.csv")
    with pytest.raises(RecordingFileError, match="not a regular file"):
        load(tmp_path)
    (tmp_path / "pipe_1.csv").unlink()
    with socket.socket(socket.AF_UNIX) as server:
        place = os.getcwd()  # noqa: PTH109  # socket paths are short: go there
        os.chdir(tmp_path)
        try:
            server.bind("s_1.csv")
        finally:
            os.chdir(place)
        with pytest.raises(RecordingFileError, match=r"s_1.csv: is not a regular file"):
            load(tmp_path)


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
