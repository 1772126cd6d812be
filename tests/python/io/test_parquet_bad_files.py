"""Archives that are cut off, damaged, or written to do harm: refused by name, within bounds of time and memory."""

import json
import os
import shutil
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from effort import cases
from granular_id.io import RecordingFileError, load, save
from granular_id.io.parquet.footer import Chunk
from granular_id.io.parquet.pages import unpacked_bytes
from granular_id.io.parquet.save import save_parquet
from granular_id.io.parquet.thrift import CutOffError, read_struct
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


def refused(path, message):
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
@pytest.mark.parametrize("tenth", range(10))
def test_cut_off(archive, name, tenth):
    file = archive / name
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * tenth // 10])
    error = refused(archive, "is empty|cut off|does not begin with PAR1")
    assert Path(error.path).name == Path(name).name


@pytest.mark.parametrize("name", [INDEX, PART])
def test_text_and_binary_in_place_of_parquet(archive, name):
    for data in (b"fx,fy\n1,2\n" * 9, bytes(range(256)), b"PAR1" + bytes(99) + b"PAR1", b"PAR1" * 3):
        (archive / name).write_bytes(data)
        refused(archive, "does not begin with PAR1|damaged footer|footer has")


def test_a_flipped_bit_in_the_samples_is_found_by_its_checksum(archive):
    data = bytearray((archive / PART).read_bytes())
    column = pq.read_metadata(archive / PART).row_group(1).column(2)
    data[column.data_page_offset + column.total_compressed_size - 5] ^= 4
    (archive / PART).write_bytes(data)
    error = refused(archive, "cannot be decoded: .*(crc|CRC)")
    assert error.place == "row group 1"
    assert "part-00000.parquet, row group 1" in str(error)


@pytest.mark.parametrize(
    "file",
    [
        "../outside.parquet",
        "/etc/passwd",
        "samples/../../x.parquet",
        "recordings.parquet",
        "samples/part-0.parquet",
        "",
    ],
)
def test_the_index_names_no_file_but_parts_of_the_archive(archive, file):
    rewrite(archive / INDEX, with_column("file", pa.array([file] * 4)))
    error = refused(archive, "wanted one like samples/part-00000.parquet")
    assert error.column == "file"


def test_links_out_of_the_archive_are_not_followed(archive, tmp_path):
    outside = tmp_path / "outside.parquet"
    shutil.move(archive / PART, outside)
    (archive / PART).symlink_to(outside)
    refused(archive, "link that leaves the folder")
    (archive / PART).unlink()
    shutil.move(archive / "samples", tmp_path / "elsewhere")
    shutil.move(outside, tmp_path / "elsewhere" / "part-00000.parquet")
    (archive / "samples").symlink_to(tmp_path / "elsewhere")
    refused(archive, "link that leaves the folder")


def test_a_file_of_samples_is_missing_or_no_file(archive):
    (archive / PART).unlink()
    refused(archive, "cannot be read: No such file")
    os.mkfifo(archive / PART)
    refused(archive, "not a regular file")


LIES = {
    "n_samples": (
        [5, 5, 5, 6],
        "row group 1: holds 10 samples; by recordings.parquet its recordings have 11",
    ),
    "n_samples, none": ([0, 5, 5, 5], "row 0 is said to have 0 samples"),
    "n_samples, negative": ([-5, 15, 5, 5], "row 0 is said to have -5 samples"),
    "n_samples, too many": ([1 << 60, 5, 5, 5], "row 0 is said to have"),
    "n_samples, a bomb": ([1 << 35, 5, 5, 5], "would expand from"),
    "row_group": ([0, 0, 2, 2], "row 2 is said to lie in row group 2"),
    "row_group, back": ([1, 1, 0, 0], "row 0 is said to lie in row group 1"),
    "row_group, missing": ([0, 0, 0, 0], "holds 2 row groups; recordings.parquet lists 1"),
    "id": ([0, 1, 1, 3], "row 2 has the id 1; wanted 0, 1, 2"),
}


@pytest.mark.parametrize(
    ("column", "values", "message"), [(c, v, m) for c, (v, m) in LIES.items()], ids=list(LIES)
)
def test_an_index_that_lies(archive, column, values, message):
    rewrite(archive / INDEX, with_column(column.partition(",")[0], pa.array(values, pa.int64())))
    refused(archive, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop_columns(["rate_hz"]), "column 'rate_hz' is missing"),
        (with_column("rate_hz", pa.array(["500"] * 4)), "rate_hz: holds string; wanted double"),
        (with_column("label", pa.array([1, 2, 3, 4])), "label: holds int64; wanted string"),
        (with_column("label", pa.array([b"\xff"] * 4)), "label: holds binary; wanted string"),
        (with_column("n_samples", pa.array([5, None, 5, 5])), "n_samples: holds empty cells"),
        (with_column("rate_hz", pa.array([500.0, -1, 500, 500])), r"rate_hz\[1\] .*is -1.0"),
        (with_column("rate_hz", pa.array([500.0, None, 500, 500])), "no stamps"),
        (with_column("start_time", pa.array([np.inf] * 4)), "start_time.* is inf"),
        (with_column("trigger_index", pa.array([9, 0, 0, 0])), r"trigger_index\[0\] .*is 9"),
        (with_column("meta", pa.array(["{"] * 4)), r"meta\[0\] is not JSON"),
        (with_column("meta", pa.array(["[" * 100_000] * 4)), "nested too deeply"),
        (with_column("meta", pa.array(["[1]"] * 4)), "a JSON list; wanted"),
        (with_column("label", pa.array(["a\nb"] * 4)), "control character"),
        (lambda t: t.slice(0, 0), "lists no recordings"),
        (lambda t: t.append_column("label", t["label"]), "'label' occurs twice"),
    ],
)
def test_an_index_with_wrong_columns(archive, change, message):
    rewrite(archive / INDEX, change)
    refused(archive, message)


@pytest.mark.parametrize(
    ("mark", "message"),
    [
        (None, "no entry 'granular_id'"),
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON|does not say"),
        ({"format": "samples"}, "does not say that these are recordings"),
        ({"format": "recordings", "version": 2}, "is of version 2; this granular_id reads version 1"),
        (
            {"format": "recordings", "version": 1, "axes": ["fx"], "columns": []},
            "wanted two lists of different names",
        ),
        ({"format": "recordings", "version": 1, "axes": ["fx"], "columns": ["fx"]}, "holds other axes"),
    ],
)
def test_marks_in_the_footer(archive, mark, message):
    text = mark if isinstance(mark, str) else json.dumps(mark)
    rewrite(archive / INDEX, labels={} if mark is None else {"granular_id": text})
    refused(archive, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.drop_columns(["tz"]), "column 'tz' is missing"),
        (with_column("fx", pa.array(["1"] * 20)), "fx: holds string; wanted double"),
        (with_column("fx", pa.array([1.0] * 20, pa.float32())), "fx: holds float; wanted double"),
        (with_column("fx", pa.array([None] + [1.0] * 19)), "column fx, row group 0: holds empty cells"),
        (
            with_column("fx", pa.array([1.0] * 17 + [np.nan] * 3)),
            r"wrench\[17, 0\] .*push 3.*, sample 2.* is nan",
        ),
        (with_column("fx", pa.array([[1.0]] * 20)), "fx: holds list"),
    ],
)
def test_samples_with_wrong_columns(archive, change, message):
    rewrite(archive / PART, change, row_group_size=10)
    refused(archive, message)


def test_a_bomb_is_refused_before_it_is_unpacked(archive):
    zeros = pa.array(np.zeros(2_000_000))
    names = pq.ParquetFile(archive / PART).schema_arrow.names
    labels = {
        k: v for k, v in pq.read_metadata(archive / PART).metadata.items() if k.startswith(b"granular_id")
    }
    bomb = pa.table(dict.fromkeys(names, zeros)).replace_schema_metadata(labels)
    pq.write_table(bomb, archive / PART, row_group_size=1_000_000, compression="zstd")
    rewrite(archive / INDEX, with_column("n_samples", pa.array([500_000] * 4)))
    assert (archive / PART).stat().st_size < 100_000
    del zeros, bomb
    tracemalloc.start()
    before = pa.total_allocated_bytes()
    refused(archive, "would expand from .* more than 64 times")
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()
    assert pa.total_allocated_bytes() - before < 5_000_000


def test_a_page_that_claims_gigabytes_is_refused_before_it_is_unpacked(archive):
    """The header of a page says 2 GB while the footer says little: only a walk over the pages sees it."""
    path = archive / PART
    record = pq.read_metadata(path).row_group(0).column(0)
    data = bytearray(path.read_bytes())
    start = record.data_page_offset
    fields, size = read_struct(bytes(data[start : start + 200]))
    old = bytes(data[start : start + size])
    huge = _zigzag((1 << 31) - 1)
    claimed = old[:3] + huge + old[3 + len(_zigzag(fields[2])) :]
    assert read_struct(claimed)[0][2] == (1 << 31) - 1
    grown = len(claimed) - len(old)
    spliced = bytes(data[:start]) + claimed + bytes(data[start + size :])
    chunk = Chunk("fx", start, start + record.total_compressed_size + grown, record.num_values)
    assert unpacked_bytes(lambda at, n: spliced[at : at + n], chunk) > 2_000_000_000


def _zigzag(value):
    value <<= 1
    found = bytearray()
    while True:
        found.append((value & 127) | (128 if value > 127 else 0))
        value >>= 7
        if not value:
            return bytes(found)


def test_too_large_a_file(archive):
    with pytest.raises(RecordingFileError, match="more than max_file_bytes=100"):
        load(archive, max_file_bytes=100)


def test_structs_of_thrift_are_bounded():
    for data in (b"", b"\x15", b"\x15\x80", b"\x18\x05ab", b"\x19\xfc\xff\xff\xff\xff\x0f"):
        with pytest.raises(CutOffError):
            read_struct(data)
    for data, message in (
        (b"\x1c" * 40, "nested too deeply"),
        (b"\x19\x19" + b"\x19" * 40, "nested too deeply"),
        (b"\x1d\x00", "unknown type 13"),
        (b"\x15" + b"\x80" * 12, "more than 64 bits"),
        (b"\x19\xf3\x80\x89\x7a" + bytes(2_000_000), "more than 1000000 values"),
        (b"\x15\x00" * 1_000_001, "more than 1000000 values"),  # where it has no end either
    ):
        with pytest.raises(ValueError, match=message):
            read_struct(data)


def test_campaign():
    """Mutations in a process of their own, so that a crash of a library is a failure and not the end of the tests."""
    n_cases = cases(40)
    script = Path(__file__).with_name("parquet_mutations.py")
    result = subprocess.run(
        [sys.executable, str(script), "20240327", str(n_cases)], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr[-2000:]
    counts = json.loads(result.stdout)
    print(f"Parquet: {n_cases} damaged archives, 0 crashes, {counts}")
    assert sum(counts[kind] for kind in ("as written", "other content", "refused")) == n_cases
    assert counts["memory_mb"] < 256


def test_other_folders_are_not_taken_for_archives(tmp_path):
    (tmp_path / "recordings.parquet").mkdir()
    refused(tmp_path, "holds no")


def test_save_refuses_before_it_writes(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such folder"):
        save(Dataset([Recording(np.ones((2, 6)), rate_hz=5)]), tmp_path / "none" / "archive", "parquet")
