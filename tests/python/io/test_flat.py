"""Flat columns: there and back without a changed bit, and everything hostile refused by name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given

from dataset_strategies import assert_same_bits, datasets
from granular_id.io import RecordingFileError
from granular_id.io.flat import FlatRecordings, flatten, unflatten
from granular_id.io.source import FileSource
from granular_id.recording import Dataset, Recording, StepReport

PATH = Path("set.npz")
SOURCE = FileSource(PATH, Path(), "set.npz")


@given(datasets())
def test_round_trip_changes_no_bit(dataset):
    content = unflatten(flatten(dataset), PATH, SOURCE)
    assert_same_bits(Dataset(content.recordings), dataset)
    assert [step.to_dict() for step in content.history] == [step.to_dict() for step in dataset.history]


def test_recordings_of_one_length_share_a_block_so_that_stacking_is_no_copy():
    data = Dataset([Recording(np.full((4, 6), i), rate_hz=500, label="a", name=str(i)) for i in range(3)])
    content = unflatten(flatten(data), PATH, SOURCE)
    read = Dataset(content.recordings)
    assert np.shares_memory(read.X, content.recordings[0].wrench)
    assert np.array_equal(read.X, data.X)


@pytest.mark.parametrize("n", [1, 3])
def test_samples_that_are_views_of_bytes_keep_their_bits(n):
    raw = np.frombuffer(np.random.default_rng(1).standard_normal((n, 4, 6)).tobytes(), np.uint8).copy()
    raw.flags.writeable = False
    block = raw.view(np.float64).reshape(n, 4, 6)
    data = Dataset([Recording(wrench, rate_hz=500, name=str(i)) for i, wrench in enumerate(block)])
    assert data[0].wrench.base is raw  # else the test proves nothing
    flat = flatten(data)
    assert flat.wrench.dtype == np.float64
    assert np.array_equal(flat.wrench, block.reshape(-1, 6))
    assert np.array_equal(data.X, block)


def test_equal_meta_is_parsed_once_and_shared():
    meta = {"sensor": {"model": "Mini45"}}
    data = Dataset([Recording(np.zeros((2, 6)), rate_hz=500, meta=meta) for _ in range(3)])
    read = unflatten(flatten(data), PATH, SOURCE).recordings
    assert read[0].meta is read[2].meta
    with pytest.raises(TypeError):
        read[0].meta["sensor"] = 1


def test_a_recording_without_a_name_is_called_after_the_file():
    read = unflatten(replace(_flat(), name=[None, None]), PATH, SOURCE).recordings
    assert [r.name for r in read] == ["set.npz[0]", "set.npz[1]"]


def test_real_numbers_of_other_types_are_converted():
    flat = _flat()
    other = replace(
        flat,
        wrench=flat.wrench.astype(">f4"),
        n_samples=flat.n_samples.astype(np.uint8),
        rate_hz=np.array([500, 500], np.int16),
        time_s=None,
        flags=np.ones(5, np.int32),
    )
    read = unflatten(other, PATH, SOURCE).recordings
    assert read[0].wrench.dtype == np.float64
    assert read[0].wrench[0, 1] == 1
    assert read[1].flags.dtype == np.uint8


def test_flatten_refuses_what_is_no_data_set_and_different_axes():
    with pytest.raises(TypeError, match="dataset must be a Dataset, got list"):
        flatten([])
    one, other = (Recording(np.zeros((2, 1)), rate_hz=1, axes=(axis,)) for axis in "ab")
    with pytest.raises(ValueError, match="differ in their axes"):
        flatten(Dataset([one, other]))


def _flat() -> FlatRecordings:
    """Two recordings of 3 and 2 samples, the second one irregular."""
    regular = Recording(np.arange(18.0).reshape(3, 6), rate_hz=500, label="rice", name="one", meta={"a": 1})
    stamped = Recording(np.zeros((2, 6)), time_s=[0, 0.25], name="two", trigger_index=1, flags=[0, 1])
    return flatten(Dataset([regular, stamped], [StepReport("made")]))


def _with(name, index, value):
    def change(flat):
        column = getattr(flat, name)
        changed = column.copy() if isinstance(column, np.ndarray) else list(column)
        changed[index] = value
        return {name: changed}

    return change


NAN, INF = float("nan"), float("inf")
COLUMN = {
    "lengths": "n_samples",
    "rate": "rate_hz|time_s",
    "stamps": "time_s",
    "start": "start_time",
    "trigger": "trigger_index",
    "axes": "ax[ei]s|recording",
    **{name: name for name in ("wrench", "flags", "label", "session", "name", "meta", "history")},
}
DEEP = "[" * 10_000 + "]" * 10_000
NESTED = '{"a":' * 400 + "1" + "}" * 400

HOSTILE = {
    "wrench: NaN": _with("wrench", (4, 2), NAN),
    "wrench: infinite": _with("wrench", (0, 0), INF),
    "wrench: text": {"wrench": np.full((5, 6), "1")},
    "wrench: complex": {"wrench": np.ones((5, 6), complex)},
    "wrench: objects": {"wrench": np.full((5, 6), None)},
    "wrench: one axis of the array": {"wrench": np.zeros(30)},
    "wrench: empty": {"wrench": np.zeros((0, 6))},
    "axes: too few": {"axes": ("fx",)},
    "axes: twice": {"axes": ("fx",) * 6},
    "axes: control character": {"axes": ("a", "b", "c", "d", "e", "f\x1b")},
    "axes: numbers": {"axes": (1, 2, 3, 4, 5, 6)},
    "lengths: negative": {"n_samples": np.array([6, -1])},
    "lengths: zero": {"n_samples": np.array([5, 0])},
    "lengths: too few": {"n_samples": np.array([2, 2])},
    "lengths: overflow": {"n_samples": np.array([2**63 - 1, 2])},
    "lengths: past int64": {"n_samples": np.array([2**64 - 1, 6], np.uint64)},
    "lengths: none": {"n_samples": np.array([], np.int64)},
    "lengths: more than samples": {"n_samples": np.ones(6, np.int64)},
    "lengths: floats": {"n_samples": np.array([3.0, 2.0])},
    "lengths: shape": {"n_samples": np.array([[3, 2]])},
    "rate: zero": _with("rate_hz", 0, 0.0),
    "rate: negative": _with("rate_hz", 0, -5.0),
    "rate: infinite": _with("rate_hz", 0, INF),
    "rate: lasts for ever": _with("rate_hz", 0, 5e-324),
    "rate: missing": _with("rate_hz", 0, NAN),
    "rate: count": {"rate_hz": np.array([500.0])},
    "rate: text": {"rate_hz": np.array(["500", "500"])},
    "stamps: missing": {"time_s": None},
    "stamps: beside a rate": _with("time_s", 1, 0.5),
    "stamps: backwards": _with("time_s", 4, -0.25),
    "stamps: repeated": _with("time_s", 4, 0.0),
    "stamps: do not begin at 0": _with("time_s", 3, 0.1),
    "stamps: infinite": _with("time_s", 4, INF),
    "stamps: count": {"time_s": np.zeros(4)},
    "start: infinite": _with("start_time", 1, -INF),
    "trigger: outside": _with("trigger_index", 1, 2),
    "trigger: below -1": _with("trigger_index", 0, -2),
    "trigger: past int64": {"trigger_index": np.array([0, 2**64 - 1], np.uint64)},
    "flags: unknown bit": _with("flags", 3, 64),
    "flags: negative": {"flags": np.array([0, 0, 0, 0, -1])},
    "flags: floats": {"flags": np.zeros(5)},
    "flags: count": {"flags": np.zeros(6, np.uint8)},
    "label: control character": _with("label", 1, "ri\x00ce"),
    "label: spaces": _with("label", 0, " rice"),
    "label: empty": _with("label", 0, ""),
    "label: surrogate": _with("label", 0, "\ud800"),
    "label: number": _with("label", 0, 3),
    "label: unhashable": _with("label", 0, []),
    "session: count": {"session": [None]},
    "session: no list": {"session": "ab"},
    "name: line break": _with("name", 0, "a\nb"),
    "meta: no JSON": _with("meta_json", 0, "{"),
    "meta: list": _with("meta_json", 0, "[1]"),
    "meta: NaN": _with("meta_json", 1, '{"a": NaN}'),
    "meta: deep": _with("meta_json", 0, DEEP),
    "meta: deep enough for freeze": _with("meta_json", 0, NESTED.replace("1", NESTED)),
    "meta: huge number": _with("meta_json", 0, '{"a": 1e999}'),
    "meta: bytes": _with("meta_json", 0, b"{}"),
    "history: no JSON": {"history_json": "x"},
    "history: no list": {"history_json": "{}"},
    "history: no steps": {"history_json": '[{"a": 1}]'},
    "history: wrong kind": {"history_json": '[{"step": "x", "rows": "ab"}]'},
    "history: deep": {"history_json": DEEP},
    "history: bytes": {"history_json": b"[]"},
}
"""By what is wrong with which column."""


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_columns_are_refused_by_the_name_of_the_column(case):
    change = HOSTILE[case]
    flat = _flat()
    wrong = replace(flat, **(change(flat) if callable(change) else change))
    with pytest.raises(RecordingFileError, match=COLUMN[case.partition(":")[0]]) as caught:
        unflatten(wrong, PATH, SOURCE)
    assert str(caught.value).startswith("set.npz")


def test_the_sample_and_the_recording_that_spoil_a_column_are_named():
    wrong = replace(_flat(), **_with("wrench", (4, 2), NAN)(_flat()))
    with pytest.raises(
        RecordingFileError, match=r"wrench\[4, 2\] \(recording 1 \('two'\), sample 1\) is nan"
    ):
        unflatten(wrong, PATH, SOURCE)
    wrong = replace(_flat(), **_with("rate_hz", 0, -5.0)(_flat()))
    with pytest.raises(RecordingFileError, match=r"rate_hz\[0\] \(recording 0 \('one'\)\) is -5.0"):
        unflatten(wrong, PATH, SOURCE)


def test_the_columns_above_are_fine_before_they_are_spoilt():
    assert len(unflatten(_flat(), PATH, SOURCE).recordings) == 2
