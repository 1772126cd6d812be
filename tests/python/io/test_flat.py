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
DEEP = "[" * 10_000 + "]" * 10_000
NESTED = '{"a":' * 400 + "1" + "}" * 400

HOSTILE = {
    "wrench: NaN": (_with("wrench", (4, 2), NAN), r"wrench\[4, 2\] .recording 1 \('two'\), sample 1. is nan"),
    "wrench: infinite": (_with("wrench", (0, 0), INF), r"wrench\[0, 0\].*'one'.*sample 0. is inf"),
    "wrench: text": ({"wrench": np.full((5, 6), "1")}, "wrench has dtype <U1"),
    "wrench: complex": ({"wrench": np.ones((5, 6), complex)}, "wrench has dtype complex128"),
    "wrench: objects": ({"wrench": np.full((5, 6), None)}, "wrench has dtype object"),
    "wrench: one axis of the array": ({"wrench": np.zeros(30)}, r"wrench has shape \(30,\)"),
    "wrench: empty": ({"wrench": np.zeros((0, 6))}, r"wrench has shape \(0, 6\)"),
    "axes: too few": ({"axes": ("fx",)}, "axes has 1 names, but wrench has 6 columns"),
    "axes: twice": ({"axes": ("fx",) * 6}, "names an axis twice"),
    "axes: control character": ({"axes": ("a", "b", "c", "d", "e", "f\x1b")}, "control character"),
    "axes: numbers": ({"axes": (1, 2, 3, 4, 5, 6)}, r"axes\[0\] must be a str"),
    "lengths: negative": ({"n_samples": np.array([6, -1])}, r"n_samples\[0\] is 6; wanted 1 to 5"),
    "lengths: zero": ({"n_samples": np.array([5, 0])}, r"n_samples\[1\] is 0"),
    "lengths: too few": ({"n_samples": np.array([2, 2])}, "adds up to 4, but wrench has 5"),
    "lengths: overflow": ({"n_samples": np.array([2**63 - 1, 2])}, r"n_samples\[0\] is 9223372036854775807"),
    "lengths: past int64": ({"n_samples": np.array([2**64 - 1, 6], np.uint64)}, "n_samples holds 1844"),
    "lengths: none": ({"n_samples": np.array([], np.int64)}, "n_samples has 0 values"),
    "lengths: more than samples": ({"n_samples": np.ones(6, np.int64)}, "n_samples has 6 values for 5"),
    "lengths: floats": ({"n_samples": np.array([3.0, 2.0])}, "n_samples has dtype float64"),
    "lengths: shape": ({"n_samples": np.array([[3, 2]])}, r"n_samples has shape \(1, 2\)"),
    "rate: zero": (_with("rate_hz", 0, 0.0), r"rate_hz\[0\] \(recording 0 \('one'\)\) is 0.0"),
    "rate: negative": (_with("rate_hz", 0, -5.0), r"rate_hz\[0\].* is -5.0"),
    "rate: infinite": (_with("rate_hz", 0, INF), r"rate_hz\[0\].* is inf"),
    "rate: lasts for ever": (_with("rate_hz", 0, 5e-324), r"rate_hz\[0\].* is 5e-324"),
    "rate: missing": (_with("rate_hz", 0, NAN), r"time_s\[0\].* is nan; wanted a stamp"),
    "rate: count": ({"rate_hz": np.array([500.0])}, r"rate_hz has shape \(1,\); wanted \(2,\)"),
    "rate: text": ({"rate_hz": np.array(["500", "500"])}, "rate_hz has dtype <U3"),
    "stamps: missing": ({"time_s": None}, "recording 1 .*no stamps in time_s"),
    "stamps: beside a rate": (_with("time_s", 1, 0.5), r"time_s\[1\].*'one'.*wanted NaN"),
    "stamps: backwards": (
        _with("time_s", 4, -0.25),
        r"time_s\[4\].*sample 1. is -0.25; wanted stamps that in",
    ),
    "stamps: repeated": (_with("time_s", 4, 0.0), r"time_s\[4\].* is 0.0; wanted stamps that increase"),
    "stamps: do not begin at 0": (_with("time_s", 3, 0.1), r"time_s\[3\].*wanted 0"),
    "stamps: infinite": (_with("time_s", 4, INF), r"time_s\[4\].* is inf; wanted a stamp"),
    "stamps: count": ({"time_s": np.zeros(4)}, r"time_s has shape \(4,\)"),
    "start: infinite": (_with("start_time", 1, -INF), r"start_time\[1\].* is -inf"),
    "trigger: outside": (_with("trigger_index", 1, 2), r"trigger_index\[1\].*'two'.* is 2; wanted a sample"),
    "trigger: below -1": (_with("trigger_index", 0, -2), r"trigger_index\[0\].* is -2"),
    "trigger: past int64": ({"trigger_index": np.array([0, 2**64 - 1], np.uint64)}, "trigger_index holds"),
    "flags: unknown bit": (_with("flags", 3, 64), r"flags\[3\].*'two'.*sample 0. is 64"),
    "flags: negative": ({"flags": np.array([0, 0, 0, 0, -1])}, r"flags\[4\].* is -1"),
    "flags: floats": ({"flags": np.zeros(5)}, "flags has dtype float64"),
    "flags: count": ({"flags": np.zeros(6, np.uint8)}, r"flags has shape \(6,\)"),
    "label: control character": (_with("label", 1, "ri\x00ce"), r"label\[1\].*control character '\\x00'"),
    "label: spaces": (_with("label", 0, " rice"), r"label\[0\] ' rice' begins or ends with a space"),
    "label: empty": (_with("label", 0, ""), r"label\[0\] is empty"),
    "label: surrogate": (_with("label", 0, "\ud800"), r"label\[0\].*control character"),
    "label: number": (_with("label", 0, 3), r"label\[0\] is a int; wanted a text"),
    "label: unhashable": (_with("label", 0, []), r"label\[0\] is a list"),
    "session: count": ({"session": [None]}, "session has 1 values for 2 recordings"),
    "session: no list": ({"session": "ab"}, "session is a str; wanted a list"),
    "name: line break": (_with("name", 0, "a\nb"), r"name\[0\].*control character"),
    "meta: no JSON": (_with("meta_json", 0, "{"), r"meta\[0\] is not JSON"),
    "meta: list": (_with("meta_json", 0, "[1]"), r"meta\[0\] is a JSON list; wanted a dict"),
    "meta: NaN": (_with("meta_json", 1, '{"a": NaN}'), r"meta\[1\]\['a'\] is nan"),
    "meta: deep": (_with("meta_json", 0, DEEP), r"meta\[0\] is nested too deeply"),
    "meta: deep enough for freeze": (_with("meta_json", 0, NESTED.replace("1", NESTED)), "nested too deeply"),
    "meta: huge number": (_with("meta_json", 0, '{"a": 1e999}'), r"meta\[0\]\['a'\] is inf"),
    "meta: bytes": (_with("meta_json", 0, b"{}"), r"meta\[0\] is a bytes"),
    "history: no JSON": ({"history_json": "x"}, "history is not JSON"),
    "history: no list": ({"history_json": "{}"}, "history is a JSON dict; wanted a list"),
    "history: no steps": ({"history_json": '[{"a": 1}]'}, r"history\[0\]: a step has the keys a"),
    "history: wrong kind": ({"history_json": '[{"step": "x", "rows": "ab"}]'}, r"history\[0\]: rows"),
    "history: deep": ({"history_json": DEEP}, "history is nested too deeply"),
    "history: bytes": ({"history_json": b"[]"}, "history is a bytes; wanted JSON text"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_columns_are_refused_by_name(case):
    change, message = HOSTILE[case]
    flat = _flat()
    wrong = replace(flat, **(change(flat) if callable(change) else change))
    with pytest.raises(RecordingFileError, match=message) as caught:
        unflatten(wrong, PATH, SOURCE)
    assert str(caught.value).startswith("set.npz")


def test_the_columns_above_are_fine_before_they_are_spoilt():
    assert len(unflatten(_flat(), PATH, SOURCE).recordings) == 2
