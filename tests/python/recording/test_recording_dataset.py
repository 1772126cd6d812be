"""``Dataset``: order, selection, alignment, and a history that says everything."""

import copy
import json
import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id.recording import Dataset, Recording, StepReport


def recording(n=10, *, seed=0, **fields):
    wrench = np.random.default_rng(seed).normal(size=(n, 6))
    return Recording(wrench, **{"rate_hz": 100, "label": "rice", "name": f"r{seed}", **fields})


UNEVEN = recording(3, rate_hz=None, time_s=[0, 1, 3], name="uneven")


@pytest.fixture(scope="module")
def mixed():
    return Dataset(
        [
            recording(10, seed=1, label="rice", session="a", start_time=30.0, trigger_index=2),
            recording(12, seed=2, label="peas", session="b", start_time=10.0, trigger_index=5),
            recording(11, seed=3, label="rice", session="b", start_time=20.0, trigger_index=0),
        ]
    )


def test_what_is_in_it(mixed):
    assert mixed.y.tolist() == ["rice", "peas", "rice"]
    assert mixed.labels == ("peas", "rice")
    assert mixed.sessions.tolist() == ["a", "b", "b"]
    assert mixed.start_times.tolist() == [30, 10, 20]
    assert mixed.names == ("r1", "r2", "r3")
    assert mixed.rate_hz == 100
    assert len(mixed) == 3
    assert [r.name for r in mixed] == ["r1", "r2", "r3"]
    assert mixed[-1].name == "r3"
    assert repr(mixed) == "Dataset(3 recordings, 2 labels, 100 Hz)"


def test_what_is_unknown_stays_unknown():
    data = Dataset([recording(), recording(session="a", start_time=1.0, label=None, name="nameless")])
    assert data.sessions.tolist() == [None, "a"]
    assert np.isnan(data.start_times[0])
    with pytest.raises(ValueError, match="1 recording has no label, the first is 'nameless'"):
        _ = data.y


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ([recording(12)], r"10 to 12 samples.*\.align\(n_samples"),
        ([recording(rate_hz=50)], r"differ in rate \(50 to 100 Hz\).*\.resample\(rate_hz\)"),
        ([UNEVEN], r"1 of 2 recordings is irregularly sampled.*'uneven'.*\.resample\(rate_hz\)"),
    ],
)
def test_stacked_refuses_what_differs_naming_the_step_that_helps(others, message):
    with pytest.raises(ValueError, match=message):
        _ = Dataset([recording(), *others]).X


def test_stacked_stacks_in_order_once_read_only(mixed):
    data = Dataset([recording(seed=i) for i in range(3)])
    np.testing.assert_array_equal(data.X, np.stack([r.wrench for r in data]))
    assert data.X is data.X
    assert not data.X.flags.writeable
    aligned = mixed.align(8)
    assert aligned.X is aligned[0].wrench.base, "no second copy"
    np.testing.assert_array_equal(aligned.X, np.stack([r.wrench[:8] for r in mixed]))
    for indices in ([2, 0, 1], [0, 1], [1, 1, 2], [2]):
        np.testing.assert_array_equal(aligned.select(indices=indices).X, aligned.X[indices])


def test_pickle_and_deepcopy_without_the_cached_array(mixed):
    aligned = mixed.align(8)
    bare = len(pickle.dumps(aligned))
    assert aligned.X.shape == (3, 8, 6)
    assert len(pickle.dumps(aligned)) == bare
    for twin in (pickle.loads(pickle.dumps(aligned)), copy.deepcopy(aligned)):
        assert twin == aligned
        assert twin.history == aligned.history
        np.testing.assert_array_equal(twin.X, aligned.X)


def test_equality_is_of_recordings_not_of_history(mixed):
    assert mixed == Dataset(list(mixed))
    assert mixed.select(labels=["rice", "peas"]) == mixed
    assert mixed != mixed[:2]
    assert mixed != mixed.select(indices=[1, 0, 2])
    assert mixed != list(mixed)
    with pytest.raises(TypeError, match="unhashable"):
        hash(mixed)


def test_select(mixed):
    assert mixed.select(labels="rice").names == ("r1", "r3")
    assert mixed.select(sessions=["b"]).names == ("r2", "r3")
    assert mixed.select(labels="rice", sessions="b").names == ("r3",)
    chosen = mixed.select(axes=np.array(["fz", "fx"]))
    assert chosen.axes == ("fz", "fx")
    np.testing.assert_array_equal(chosen[1].wrench, mixed[1].wrench[:, [2, 0]])
    assert mixed[[r.n_samples > 10 for r in mixed]].names == ("r2", "r3")
    assert mixed.select(indices=[2, -3]).names == ("r3", "r1")
    assert mixed.select(indices=mixed.y == "peas").names == ("r2",)
    assert mixed[1:].names == ("r2", "r3")
    assert mixed[[0]].names == ("r1",)
    for index in (None, True):
        with pytest.raises(TypeError, match="indices"):
            mixed[index]
    assert mixed.select(labels="rice").history[-1].totals == {"recordings_before": 3, "recordings_after": 2}


def test_concatenation_keeps_order_and_histories(mixed):
    rice, peas = mixed.select(labels="rice"), mixed.select(labels="peas")
    both = rice + peas
    assert both.names == ("r1", "r3", "r2")
    assert [step.step for step in both.history] == ["select", "select", "concatenate"]
    assert Dataset.concatenate([rice, peas]) == both
    with pytest.raises(TypeError, match=r"datasets\[1\] is a list"):
        Dataset.concatenate([rice, [1]])
    with pytest.raises(TypeError, match="unsupported operand"):
        _ = rice + 1


def test_align_crops_the_end_and_says_so(mixed):
    aligned = mixed.align(n_samples=10)
    report = aligned.history[-1]
    assert list(report.totals.values()) == [3, 2, 0, 3]
    dropped = [(row["name"], row["dropped_start"], row["dropped_end"]) for row in report.rows]
    assert dropped == [("r2", 0, 2), ("r3", 0, 1)]
    assert [r.trigger_index for r in aligned] == [2, 5, 0]
    assert aligned.start_times.tolist() == [30, 10, 20]
    assert mixed.align("shortest") == aligned == mixed.align(duration_s=0.1)


def test_align_carries_flags_and_moves_triggers():
    flagged = recording(6, flags=[1, 0, 0, 2, 0, 0], trigger_index=4)
    data = Dataset([flagged, recording(6, seed=1, trigger_index=5, start_time=10.0)])
    aligned = data.align(3, trigger="recorded", lead_s=0.02)
    np.testing.assert_array_equal(aligned.X[0], data[0].wrench[2:5])
    np.testing.assert_array_equal(aligned.X[1], data[1].wrench[3:6])
    assert aligned[0].flags.tolist() == [0, 2, 0]
    assert [one.trigger_index for one in aligned] == [2, 2]
    assert aligned[1].start_time == 10.0 + 3 / 100
    assert data.align(3)[0].trigger_index is None


@given(st.lists(st.integers(5, 30), min_size=1, max_size=5), st.integers(1, 8), st.integers(0, 4))
def test_align_accounts_for_every_sample(lengths, n, shift):
    data = Dataset([recording(length, seed=i, trigger_index=shift) for i, length in enumerate(lengths)])
    fits = [length - shift >= n for length in lengths]
    if not any(fits):
        with pytest.raises(ValueError, match="none of the"):
            data.align(n, trigger="recorded", on_short="skip")
        return
    aligned = data.align(n, trigger="recorded", on_short="skip")
    fitting = [r for r, fit in zip(data, fits, strict=True) if fit]
    totals = aligned.history[-1].totals
    assert totals["recordings_skipped"] == len(data) - len(fitting)
    assert totals["dropped_samples"] + n * len(fitting) == sum(r.n_samples for r in fitting)
    np.testing.assert_array_equal(aligned.X, np.stack([r.wrench[shift : shift + n] for r in fitting]))


def test_reports_print_and_serialise(mixed):
    history = mixed.select(labels="rice").align(9).history
    for report in history:
        assert json.loads(json.dumps(report.to_dict())) == report.to_dict()
        assert pickle.loads(pickle.dumps(report)) == report
    lines = str(history[-1]).splitlines()
    assert lines[-1].split() == ["r3", "11", "2"]
    assert not any("skipped" in line or "dropped_start" in line for line in lines), "zero, so not printed"
    long = str(StepReport("load", rows=[{"name": f"f{i}"} for i in range(25)]))
    assert "f9" in long
    assert "f10" not in long
