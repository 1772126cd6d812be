"""Archives that are cut off, damaged, or whose index lies: refused by name."""

import json
from pathlib import Path

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from granular_id.io.parquet.writing import save_parquet
from granular_id.recording import Dataset, Recording

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

PART = "samples/part-00000.parquet"
INDEX = "recordings.parquet"


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


def rewrite(path, change=lambda table: table, labels=None, **options):
    """Write a file anew by plain pyarrow, its table or its labels changed."""
    table = pq.ParquetFile(path).read()
    old = {k: v for k, v in pq.read_metadata(path).metadata.items() if k.startswith(b"granular_id")}
    table = change(table).replace_schema_metadata(old if labels is None else labels)
    pq.write_table(table, path, **options)


def with_column(name, values):
    return lambda table: table.set_column(table.column_names.index(name), name, values)


@pytest.mark.parametrize("name", [INDEX, PART])
def test_what_is_cut_off_or_something_else(archive, name):
    file = archive / name
    data = file.read_bytes()
    cut = [data[: len(data) * quarter // 4] for quarter in range(4)]
    for changed in (*cut, b"fx,fy\n1,2\n" * 9, bytes(range(256)), b"PAR1" + bytes(99) + b"PAR1"):
        file.write_bytes(changed)
        assert Path(refused(archive).path).name == Path(name).name


def test_a_flipped_bit_in_the_samples_is_found_by_its_checksum(archive):
    data = bytearray((archive / PART).read_bytes())
    column = pq.read_metadata(archive / PART).row_group(1).column(2)
    data[column.data_page_offset + column.total_compressed_size - 5] ^= 4
    (archive / PART).write_bytes(data)
    error = refused(archive, "cannot be decoded: .*(crc|CRC)")
    assert error.place == "row group 1"
    assert "part-00000.parquet, row group 1" in str(error)


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("n_samples", [5, 5, 5, 6], "row group 1: holds 10 samples; .* recordings have 11"),
        ("n_samples", [5, None, 5, 5], "n_samples: row 1 holds None; wanted at least 1"),
        ("n_samples", [1 << 60, 5, 5, 5], None),
        ("row_group", [0, 0, 2, 2], "row 2 is said to lie in row group 2"),
        ("row_group", [0, 0, 0, 0], "holds 2 row groups; recordings.parquet lists 1"),
        ("id", [0, 1, 1, 3], "id: row 2 holds 1; wanted 0, 1, 2"),
        ("file", [PART, "../a.parquet"] * 2, "row 1 holds '../a.parquet'; wanted samples"),
        ("rate_hz", [500.0, None, 500, 500], "no stamps"),
        ("label", [1, 2, 3, 4], None),
        ("digest", ["a", "b", None, "d"], "digest: row 2 holds None; wanted 32 hexadecimal digits"),
    ],
)
def test_an_index_that_lies(archive, column, values, message):
    rewrite(archive / INDEX, with_column(column, pa.array(values)))
    refused(archive, message)


def test_an_archive_without_a_column_rows_or_a_part(archive):
    (archive / PART).rename(archive / "samples" / "other")
    refused(archive, "cannot be read: No such file")
    rewrite(archive / INDEX, lambda table: table.slice(0, 0))
    refused(archive, "lists no recordings")
    rewrite(archive / INDEX, lambda table: table.drop_columns(["rate_hz"]))
    refused(archive, "column 'rate_hz' is missing")


@pytest.mark.parametrize(
    ("mark", "message"),
    [
        (None, "no entry 'granular_id' that names axes"),
        ("{", "no entry 'granular_id' that names axes"),
        ({"axes": ["fx"], "columns": []}, "no entry 'granular_id' that names axes"),
        ({"axes": ["a", "a"], "columns": ["a", "b"]}, "no entry 'granular_id' that names axes"),
        ({"format": "samples"}, "the format is 'samples'; wanted 'recordings'"),
        ({"version": 2}, "the version is 2; wanted 1"),
        ({"units": ["lbf"]}, r"the units is \['lbf'\]; wanted \[''\]"),
        ({}, "holds other axes"),
    ],
)
def test_marks_in_the_footer(archive, mark, message):
    if isinstance(mark, dict):
        mark = json.dumps(
            {"format": "recordings", "version": 1, "axes": ["a"], "columns": ["a"], "units": [""]} | mark
        )
    rewrite(archive / INDEX, labels={} if mark is None else {"granular_id": mark})
    refused(archive, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop_columns(["tz"]), "row group 0: cannot be decoded: .*tz"),
        (with_column("fx", pa.array([1.0] * 17 + [None] * 3)), r"\[17, 0\] .*push 3.*, sample 2.* is nan"),
        (with_column("fx", pa.array([[1.0]] * 20)), "row group 0: cannot be decoded"),
    ],
)
def test_samples_with_wrong_columns(archive, change, message):
    rewrite(archive / PART, change, row_group_size=10)
    refused(archive, message)


def test_other_folders_are_not_taken_for_archives(tmp_path):
    (tmp_path / "recordings.parquet").mkdir()
    refused(tmp_path, "holds no")
