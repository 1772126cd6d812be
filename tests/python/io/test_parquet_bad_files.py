"""Archives that are cut off, damaged, or whose index lies: refused by name."""

import json
from pathlib import Path

import numpy as np
import pytest

from archive_cases import index_in, poison, rewrite, samples_in, with_column
from granular_id.io import RecordingFileError, load
from granular_id.io.parquet.writing import save_parquet
from granular_id.recording import Dataset, Recording

pa = pytest.importorskip("pyarrow")


@pytest.fixture
def archive(tmp_path):
    rng = np.random.default_rng(3)
    recordings = [
        Recording(rng.standard_normal((5, 6)), rate_hz=500, label="rice", name=f"push {i}", meta={"i": i})
        for i in range(4)
    ]
    return save_parquet(Dataset(recordings), tmp_path / "archive", recordings_per_group=2)


def refused(path, message=None):
    with pytest.raises(RecordingFileError, match=message) as caught:
        load(path)
    return caught.value


@pytest.mark.parametrize("which", [index_in, samples_in])
def test_file_cut_off_or_something_else_is_named(archive, which):
    file = which(archive)
    data = file.read_bytes()
    cut = [data[: len(data) * quarter // 4] for quarter in range(4)]
    for changed in (*cut, b"fx,fy\n1,2\n" * 9, bytes(range(256)), b"PAR1" + bytes(99) + b"PAR1"):
        file.write_bytes(changed)
        assert Path(refused(archive).path).name == file.name


def test_flipped_bit_in_the_samples_is_found_by_its_checksum(archive):
    poison(samples_in(archive), 1)
    error = refused(archive, "cannot be decoded: .*(crc|CRC)")
    assert error.place == "row group 1"
    assert f"{samples_in(archive).name}, row group 1" in str(error)


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("n_samples", [5, 5, 5, 6], "row group 1: holds 10 samples; .* recordings have 11"),
        ("n_samples", [5, None, 5, 5], "n_samples: row 1 holds None; wanted at least 1"),
        ("n_samples", [1 << 60, 5, 5, 5], None),
        ("row_group", [0, 0, 2, 2], "row_group: row 2 holds 2; wanted row groups one after the other"),
        ("row_group", [1, 1, 2, 2], "row_group: row 0 holds 1; wanted row group"),
        ("row_group", [0, 0, 0, 0], "row group 0: holds 10 samples; .* recordings have 20"),
        ("rate_hz", [500.0, None, 500, 500], "recording 'push 1': time_s"),
        ("start_time", [np.inf, 0.0, 0.0, 0.0], "recording 'push 0': start_time"),
        ("meta", ["{}", "[]", "{}", "{}"], "reading metadata failed with TypeError"),
        ("label", [1, 2, 3, 4], None),
    ],
)
def test_index_that_lies_is_refused(archive, column, values, message):
    rewrite(index_in(archive), with_column(column, pa.array(values)))
    refused(archive, message)


def test_archive_without_a_column_rows_or_a_part_is_refused(archive):
    samples_in(archive).rename(archive / "samples" / "other")
    refused(archive, "cannot be read: No such file")
    rewrite(index_in(archive), lambda table: table.slice(0, 0))
    refused(archive, "lists no recordings")
    rewrite(index_in(archive), lambda table: table.drop_columns(["rate_hz"]))
    refused(archive, "column 'rate_hz' is missing")


@pytest.mark.parametrize(
    ("mark", "message"),
    [
        (None, "no entry 'granular_id' that names axes"),
        ("{", "no entry 'granular_id' that names axes"),
        ({"columns": ["b"]}, r"the columns is \['b'\]; wanted \['a'\]"),
        ({"format": "samples"}, "the format is 'samples'; wanted 'recordings'"),
        ({"version": 2}, "the version is 2; wanted 1"),
        ({"units": ["lbf"]}, r"the units is \['lbf'\]; wanted \[''\]"),
        ({"written": "now"}, "reading its columns failed with"),
        ({}, "holds other axes"),
    ],
)
def test_mark_in_the_footer_that_is_wrong_is_refused(archive, mark, message):
    if isinstance(mark, dict):
        good = {
            "format": "recordings",
            "version": 1,
            "axes": ["a"],
            "columns": ["a"],
            "units": [""],
            "written": 1.0,
        }
        mark = json.dumps({**good, "part": 0, **mark})
    rewrite(index_in(archive), labels={} if mark is None else {"granular_id": mark})
    refused(archive, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop_columns(["tz"]), "row group 0: cannot be decoded: .*tz"),
        (with_column("fx", pa.array([1.0] * 17 + [None] * 3)), "fx, row group 1: sample 7 is nan"),
        (with_column("fx", pa.array([[1.0]] * 20)), "row group 0: cannot be decoded"),
    ],
)
def test_samples_with_wrong_columns_are_refused(archive, change, message):
    rewrite(samples_in(archive), change, row_group_size=10)
    refused(archive, message)
