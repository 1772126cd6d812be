"""Parquet archives: whole data sets there and back, with plain pyarrow as the other side in both directions."""

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings, strategies as st

from archive_cases import index_in, rewrite, samples_in
from dataset_strategies import assert_same_bits, datasets, small
from effort import cases
from granular_id.io import load, save
from granular_id.io.parquet.archive import Archive
from granular_id.io.parquet.writing import _repeats, append, save_parquet
from granular_id.recording import Dataset, Recording
from remedies import lines_of, refusal, run

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]


def table(path):
    """Read with plain pyarrow, knowing nothing of this package."""
    return pq.ParquetFile(path).read()


@settings(max_examples=cases(8))
@given(dataset=datasets(), cut=st.integers(1, 3))
def test_what_was_appended_is_loaded_to_the_last_bit(tmp_path_factory, dataset, cut):
    # equal ones would be added once
    named = [replace(r, name=f"{i} {r.name}") for i, r in enumerate(dataset)]
    folder = tmp_path_factory.mktemp("archive")
    for part in (named[:cut], named[cut:]):
        if part:
            append(folder, Dataset(part, dataset.history))
    read = load(folder)
    assert_same_bits(read, Dataset(named))
    assert read.history[:-1] == dataset.history


def test_plain_pyarrow_reads_what_is_saved(tmp_path):
    folder = save(small(), tmp_path / "archive", "parquet")
    part = samples_in(folder)
    index = table(index_in(folder)).to_pydict()
    regular, stamped = small()
    uneven = b"".join(part.tobytes() for part in (stamped.wrench, stamped.time_s, stamped.flags))
    parts = (regular.wrench.tobytes(), uneven)
    assert index.pop("digest") == [hashlib.sha256(part).hexdigest()[:32] for part in parts]
    assert len(set(index.pop("id"))) == 2
    assert index == {
        "name": ["one", "two"],
        "label": ["oat flakes", None],
        "session": ["mon", None],
        "start_time": [1.7e9, None],
        "rate_hz": [500.0, None],
        "n_samples": [2, 3],
        "trigger_index": [None, 1],
        "file": [f"samples/{part.name}"] * 2,
        "row_group": [0, 0],
        "meta": ['{"tool": {"d_mm": 17}}', None],
    }
    samples = table(part)
    assert samples.column_names == [*AXES, "time_s", "flags"]
    assert [str(kind) for kind in samples.schema.types] == ["double"] * 7 + ["uint8"]
    wrench = np.concatenate([r.wrench for r in small()])
    assert all(samples[axis].to_numpy().tobytes() == wrench[:, j].tobytes() for j, axis in enumerate(AXES))
    assert np.array_equal(samples["time_s"].to_numpy(), [np.nan, np.nan, 0, 0.25, 0.375], equal_nan=True)
    assert samples["flags"].to_pylist() == [0, 0, 0, 1, 2]
    footer = pq.read_metadata(index_in(folder)).metadata
    mark = {
        "format": "recordings",
        "version": 1,
        "axes": AXES,
        "columns": AXES,
        "units": ["N"] * 3 + ["N m"] * 3,
    }
    assert mark.items() <= json.loads(footer[b"granular_id"]).items()
    assert json.loads(footer[b"history"]) == [small().history[0].to_dict()]


def test_what_plain_pyarrow_writes_in_the_format_is_loaded(tmp_path):
    folder = save(small(), tmp_path / "archive", "parquet")
    rewrite(
        index_in(folder), lambda t: t.append_column("operator", pa.array(["x", "y"])), compression="snappy"
    )
    rewrite(samples_in(folder), compression="gzip", use_dictionary=False)
    assert load(folder) == small()


def test_axes_called_like_other_columns_keep_their_names(tmp_path):
    axes = ("flags", "time_s", "x.y", "x")
    data = Dataset([Recording(np.arange(8.0).reshape(2, 4), rate_hz=10, axes=axes, flags=[1, 2], name="a")])
    assert load(save(data, tmp_path / "archive", "parquet")) == data


def test_values_that_repeat_become_a_dictionary(tmp_path):
    rng = np.random.default_rng(1)
    wrench = rng.standard_normal((3000, 6))
    wrench[:, :2] = np.round(wrench[:, :2] * 16) / 16
    folder = save(Dataset([Recording(wrench, rate_hz=500, name="a")]), tmp_path / "archive", "parquet")
    group = pq.read_metadata(samples_in(folder)).row_group(0)
    encodings = [set(group.column(j).encodings) for j in range(6)]
    assert all("RLE_DICTIONARY" in some for some in encodings[:2])
    assert all("BYTE_STREAM_SPLIT" in some for some in encodings[2:])
    assert {group.column(j).compression for j in range(6)} == {"ZSTD"}
    assert _repeats(np.zeros(4))
    assert not _repeats(np.arange(4.0))


def test_many_recordings_go_into_several_files(tmp_path):
    data = Dataset([Recording(np.full((1, 6), i // 2), rate_hz=500, name=str(i // 2)) for i in range(150)])
    archive = Archive(save_parquet(data, tmp_path / "archive", recordings_per_group=1))
    assert (len(archive.keys), len(list((archive.folder / "samples").iterdir()))) == (3, 3)
    assert load(archive.folder) == data
    assert archive.n_recordings == 150, "those that are equal, too"
    assert archive.read(archive.row_groups[140])[0].wrench[0, 0] == 70


def test_long_recordings_do_not_share_a_row_group(tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.io.parquet.writing._MAX_GROUP_SAMPLES", 10)
    data = Dataset([Recording(np.full((n, 6), n), rate_hz=500, name=str(n)) for n in (4, 5, 20, 3, 7, 1)])
    archive = Archive(save_parquet(data, tmp_path / "archive"))
    assert [part.n_samples for part in archive.row_groups] == [9, 20, 10, 1]
    assert load(archive.folder) == data


def test_recordings_of_one_length_are_one_block(tmp_path):
    meta = {"notes": "x" * 100_000}
    data = Dataset([Recording(np.full((4, 6), i), rate_hz=500, meta=meta, name=str(i)) for i in range(20)])
    read = load(save_parquet(data, tmp_path / "archive", recordings_per_group=2))
    assert read == data
    assert np.shares_memory(read.X, read[0].wrench)
    assert not read.X.flags.writeable
    assert read[0].meta["notes"] is read[19].meta["notes"]


RNG = np.random.default_rng(20)
PUSHES = [
    Recording(RNG.standard_normal((4 + i, 6)), rate_hz=500, label="rice", name=f"push {i}") for i in range(5)
]


def saved(folder, recordings=PUSHES):
    return Archive(save_parquet(Dataset(recordings), folder, recordings_per_group=2))


def test_samples_of_a_row_group_larger_than_a_batch(tmp_path, monkeypatch):
    monkeypatch.setattr("granular_id.io.parquet.archive._BATCH_ROWS", 4)
    archive = saved(tmp_path / "a")
    assert archive.read(archive.row_groups[1]).recordings == tuple(PUSHES[2:4])


def test_threads_share_an_archive(tmp_path):
    archive = saved(tmp_path / "a", PUSHES * 20)
    wanted = [archive.read(group) for group in archive.row_groups]
    with ThreadPoolExecutor(4) as threads:
        found = [*threads.map(lambda _: [archive.read(group) for group in archive.row_groups], range(4))]
    assert found == [wanted] * 4


@pytest.mark.parametrize("form", ["a reading a row", "a list a row"])
def test_tables_of_other_forms_have_a_line(tmp_path, form):
    wrench = np.round(np.random.default_rng(3).normal(size=(40, 6)), 4)
    table = pd.DataFrame(wrench, columns=["fx", "fy", "fz", "tx", "ty", "tz"]).assign(
        time=np.arange(40) / 500
    )
    if form == "a reading a row":
        table = table.melt("time", var_name="kind")
    else:
        table = pd.DataFrame({"time": table["time"], "observation.wrench": list(wrench)})
    table.to_parquet(tmp_path / "a.parquet")
    np.testing.assert_allclose(run(*lines_of(refusal(tmp_path / "a.parquet"))).X[0], wrench)
