"""A corpus of index files that cannot be used: each gives one error with its place."""

import pytest

from granular_id.io import RecordingFileError, load

GOOD = b"time,fx,fy,fz,tx,ty,tz\n0.00,1.5,2,3,4,5,6\n0.01,1,2,3,4,5,6\n0.02,1,2,3,4,5,6\n"

# index.csv: (text, line, column, part of the problem)
BAD_INDEX = {
    "no file column": (b"label,session\nrice,a\n", 1, None, "no column 'file'"),
    "doubled column": (b"file,label,label\n", 1, "3", "column 'label' occurs twice"),
    "nameless column": (b"file,,label\n", 1, "2", "the column has no proper name"),
    "lists nothing": (b"file,label\n\n", 2, None, "lists no file"),
    "empty": (b"", None, None, "is empty"),
    "binary": (b"file,label\na\0,b\n", 2, None, "is binary"),
    "not utf-8": (b"file,label\ngood.csv,rice\nx.csv,m\xfcsli\n", 3, None, "byte 0xfc is not UTF-8"),
    "open quote": (b'file,label\n"good.csv,rice\n', 2, None, "is not valid CSV"),
    "too many cells": (b"file,label\ngood.csv,rice,more\n", 2, None, "3 cells; wanted 2"),
    "missing file": (b"file,label\ngood.csv,a\nlost.csv,b\n", None, None, "cannot be read: No such file"),
    "listed twice": (
        b"file,label\ngood.csv,a\n./good.csv,b\n",
        3,
        "file",
        "'good.csv' is already listed in line 2",
    ),
    "up and out": (b"file\n../good.csv\n", 2, "file", "is not a file within the folder"),
    "up in the middle": (b"file\na/../../good.csv\n", 2, "file", "is not a file within"),
    "absolute": (b"file\n/etc/passwd\n", 2, "file", "is not a file within"),
    "backslashes": (b"file\n..\\good.csv\n", 2, "file", "is not a file within"),
    "drive": (b"file\nC:good.csv\n", 2, "file", "is not a file within"),
    "control character": (b'file\n"go\x07od.csv"\n', 2, "file", "is not a file within"),
    "no path": (b"file,label\n,rice\n", 2, "file", "is not a file within"),
    "the folder itself": (b"file,label\n.,rice\n", 2, "file", "is not a file within"),
    "no CSV file": (b"file,label\ngood.txt,rice\n", 2, "file", "is of no known format"),
    "unprintable column": (b"file,\x01\n", 1, "2", "the column has no proper name"),
    "itself": (b"file,label\nindex.csv,rice\n", 1, "1", "unknown column 'file'"),
    "folder": (b"file,label\nfolder.csv,rice\n", 2, "file", "is of no known format"),
    "name too long": (b"file\n" + b"a" * 5000 + b".csv\n", None, None, "cannot be read"),
    "bad start time": (
        b"file,start_time\ngood.csv,yesterday\n",
        2,
        "start_time",
        "'yesterday' is no time",
    ),
    "infinite start time": (
        b"file,start_time\ngood.csv,1e999\n",
        2,
        "start_time",
        "is no time; wanted seconds",
    ),
    "no zone": (
        b"file,start_time\ngood.csv,2026-11-21T09:30:00\n",
        2,
        "start_time",
        "ISO 8601 with its zone",
    ),
    "negative rate": (b"file,rate_hz\ngood.csv,-1\n", 2, "rate_hz", "must be positive, got -1"),
    "rate that does not fit": (b"file,rate_hz\ngood.csv,7\n", None, "time", "does not fit the stamps"),
    "fractional trigger": (
        b"file,trigger_index\ngood.csv,1.5\n",
        2,
        "trigger_index",
        "is not a whole number",
    ),
    "trigger outside": (b"file,trigger_index\ngood.csv,3\n", None, None, "trigger_index=3 is outside the 3"),
    "bad meta": (b"file,meta\ngood.csv,{\n", 2, "meta", "not a JSON object"),
    "meta list": (b"file,meta\ngood.csv,[]\n", 2, "meta", "a JSON list; wanted an object"),
    "meta with nan": (b'file,meta\ngood.csv,"{""a"": NaN}"\n', None, None, "meta['a'] is nan"),
    "deep meta": (b"file,meta\ngood.csv," + b"[" * 100_000 + b"\n", 2, "meta", "not a JSON object"),
    "bad label": (b"file,label\ngood.csv,rice \n", None, None, "begins or ends with a space"),
}


@pytest.mark.parametrize("name", BAD_INDEX)
def test_one_error_for_a_bad_index(tmp_path, name):
    data, line, column, problem = BAD_INDEX[name]
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / "index.csv").write_bytes(data)
    with pytest.raises(RecordingFileError) as caught:
        load(tmp_path)
    assert problem in caught.value.problem
    assert (caught.value.line, caught.value.column) == (line, column)
    assert str(tmp_path) in caught.value.path


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
