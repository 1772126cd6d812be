"""Data sets in one NPZ file, plain numpy being the other side; hostile columns are refused."""

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from dataset_strategies import assert_same_bits, small
from granular_id.io import RecordingFileError, load, save
from granular_id.io.flat import flatten, unflatten
from granular_id.recording import AXES, Dataset, Recording

VALUES = {
    "version": 1,
    "axes": list(AXES),
    "wrench": np.concatenate([recording.wrench for recording in small()]),
    "n_samples": [2, 3],
    "rate_hz": [500.0, np.nan],
    "start_time": [1.7e9, np.nan],
    "trigger_index": [-1, 1],
    "label": ["oat flakes", ""],
    "session": ["mon", ""],
    "name": ["one", "two"],
    "meta": '{"tool": {"d_mm": 17}}\n{}',
    "history": json.dumps([step.to_dict() for step in small().history]),
    "time_s": [np.nan] * 2 + [0, 0.25, 0.375],
    "flags": [0] * 3 + [1, 2],
}
"""What the layout makes of it."""


def plain(path):
    """What numpy alone finds in a file."""
    with np.load(path, allow_pickle=False) as file:
        found = dict(file)
    mark, _, version = str(found.pop("format")).rpartition(" ")
    texts = {name: found[name].tobytes().decode() for name in ("meta", "history")}
    return found | texts | {"format": mark, "version": int(version)}


def written(folder, **change):
    """Write the layout by numpy alone, packed as other programs may; None leaves something out."""
    values = {name: value for name, value in (VALUES | change).items() if value is not None}
    version, path = values.pop("version"), folder / "x.npz"
    for name in ("meta", "history"):
        if isinstance(values.get(name), str):
            values[name] = np.frombuffer(values[name].encode(), np.uint8)
    np.savez_compressed(path, format=f"granular_id recordings {version}", **values)
    return path


def test_npz_plain_numpy_reads_and_writes_it(tmp_path):
    found = plain(save(small(), tmp_path / "set.npz"))
    assert found.pop("format") == "granular_id recordings"
    assert found.keys() == VALUES.keys()
    for name, value in VALUES.items():
        np.testing.assert_array_equal(found[name], value, err_msg=name)
    read = load(written(tmp_path))
    assert_same_bits(read, small())
    assert read.history[:-1] == small().history


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"version": 2}, "granular_id recordings 2.*reads 'granular_id recordings 1'"),
        ({"wrench": None}, "wrench: is missing"),
        ({"label": None}, "label: is missing"),
        ({"label": [1, 2]}, "label: .*wanted texts"),
        ({"label": np.array([b"a", b"b"])}, "label: .*wanted texts"),
        ({"label": np.array([0x7FFFFFFF, 0], "<u4").view("<U1")}, "label|x.npz"),
        ({"meta": np.array([255], np.uint8)}, "meta: .*wanted the bytes of a text in UTF-8"),
        ({"meta": np.zeros(2)}, "meta: .*wanted the bytes"),
        ({"meta": "{}"}, "meta has 1 values; wanted 2"),
    ],
)
def test_files_that_contradict_themselves_are_refused(tmp_path, change, message):
    path = written(tmp_path, **change)
    with pytest.raises(RecordingFileError, match=message) as caught:
        load(path)
    assert caught.value.path == str(path)


def test_samples_are_held_once(tmp_path):
    block = np.zeros((50, 1600, 6))
    path = save(Dataset([Recording(wrench, rate_hz=500) for wrench in block]), tmp_path / "set.npz")
    load(path)
    tracemalloc.start()
    load(path).X  # noqa: B018  (X is made at its first use)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1.5 * block.nbytes


PATH = Path("set.npz")


@pytest.mark.parametrize("n", [1, 3])
def test_flat_views_of_bytes_are_not_copied(n):
    raw = np.frombuffer(np.random.default_rng(1).standard_normal((n, 4, 6)).tobytes(), np.uint8).copy()
    raw.flags.writeable = False
    block = raw.view(np.float64).reshape(n, 4, 6)
    data = Dataset([Recording(wrench, rate_hz=500, name=str(i)) for i, wrench in enumerate(block)])
    assert data[0].wrench.base is raw  # else the test proves nothing
    flat = flatten(data)
    assert np.array_equal(flat["wrench"], block.reshape(-1, 6))
    read = Dataset(unflatten(flat, PATH).recordings)
    assert np.array_equal(read.X, block)
    assert np.shares_memory(read.X, flat["wrench"])


def test_real_numbers_of_other_types_are_converted():
    flat = flatten(small())
    other = {
        "wrench": flat["wrench"].astype(">f4"),
        "n_samples": flat["n_samples"].astype(np.uint8),
        "rate_hz": np.array([500, 500], np.int16),
        "time_s": None,
        "flags": np.ones(5, np.int32),
    }
    read = unflatten(flat | other, PATH).recordings
    assert (read[0].wrench.dtype, read[0].wrench[0, 1]) == (np.float64, 1)
    assert read[1].flags.dtype == np.uint8


def _with(name, index, value):
    def change(flat):
        changed = flat[name].copy()
        changed[index] = value
        return {name: changed}

    return change


NAN, INF = float("nan"), float("inf")
DEEP = "[" * 10_000 + "]" * 10_000

HOSTILE = {
    r"recording 1 \('two'\): wrench\[1, 2\] \(fz\) is nan": _with("wrench", (3, 2), NAN),
    "column wrench .* <U1": {"wrench": np.full((5, 6), "1")},
    "column wrench .* shape": {"wrench": np.zeros(30)},
    "axes has 1 names": {"axes": ("fx",)},
    r"n_samples, .* begins \[6, -1\]": {"n_samples": np.array([6, -1])},
    r"n_samples, .* adds up to 9223372036854775809": {"n_samples": np.array([2**63 - 1, 2])},
    "n_samples, .* adds up to 0": {"n_samples": np.array([], np.int64)},
    "n_samples, of dtype float64": {"n_samples": np.array([3.0, 2.0])},
    r"recording 0 \('one'\): rate_hz must be positive": _with("rate_hz", 0, -5.0),
    "neither": _with("rate_hz", 0, NAN),
    "rate_hz has 1 values": {"rate_hz": np.array([500.0])},
    "got both": _with("time_s", 1, 0.5),
    "time_s has 4 values": {"time_s": np.zeros(4)},
    "start_time must be finite": _with("start_time", 1, -INF),
    "trigger_index=3 is outside": _with("trigger_index", 1, 3),
    "flags holds -1": {"flags": np.array([0, 0, 0, 0, -1])},
    "control character": _with("label", 1, "ri\x00ce"),
    "session has 1 values": {"session": ["a"]},
    "meta is not JSON": {"meta": "{}\n{"},
    "meta is a JSON list": {"meta": "[1]\n{}"},
    "history: history is not JSON: maximum recursion": {"history": DEEP},
    "history: a step has the keys": {"history": '[{"a": 1}]'},
}
"""By what is wrong with it."""


@pytest.mark.parametrize("problem", HOSTILE)
def test_hostile_columns_are_refused_by_the_name_of_the_column(problem):
    change = HOSTILE[problem]
    flat = flatten(small())
    wrong = flat | (change(flat) if callable(change) else change)
    with pytest.raises(RecordingFileError, match=rf"^set\.npz.*{problem}"):
        unflatten(wrong, PATH)
    assert len(unflatten(flat, PATH).recordings) == 2
