"""Data sets of arrays and of tables in memory, and what `to_recordings` settles for every way in."""

import datetime

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from array_kinds import Polars
from granular_id import Dataset, Recording, SampleFlag
from granular_id.recording import AXES

RNG = np.random.default_rng(0)
X = RNG.normal(size=(4, 50, 6))
Y = ["rice", "peas", "rice", "peas"]
T = np.arange(50) / 500


def frame(values=X[0], names=AXES, **columns):
    return pd.DataFrame(values, columns=list(names)).assign(**columns)


def test_from_arrays_shares_one_block_and_keeps_every_bit():
    data = Dataset.from_arrays(X, Y, 500, sessions=[1, 1, 2.0, None], names=list("abcd"))
    rows = zip(X, Y, ["1", "1", "2", None], "abcd", strict=True)
    assert list(data) == [Recording(x, rate_hz=500, label=y, session=s, name=n) for x, y, s, n in rows]
    assert np.shares_memory(data.X, data[0].wrench)
    assert X.flags.writeable
    assert data.history[-1].totals["uniform"] == 4


def test_from_arrays_takes_lists_units_and_other_axes():
    ragged = Dataset.from_arrays([X[0], X[1, :30]], [3, 3.0], rate_hz=100)
    assert ([r.n_samples for r in ragged], ragged.y.tolist()) == ([50, 30], ["3", "3"])
    scaled = Dataset.from_arrays(X, rate_hz=500, units="N,mN m")
    assert np.array_equal(scaled.X, X * [1, 1, 1, 1e-3, 1e-3, 1e-3])
    imu = Dataset.from_arrays(X, rate_hz=500, axes="wx,wy,wz,ax,ay,az", units=["rad/s", "m/s^2"])
    assert (imu.axes[0], imu[0].meta["units"]["ax"]) == ("wx", "m/s2")


def test_from_arrays_empty_rows_are_padding_or_a_gap():
    padded = X.copy()
    padded[0, 40:] = padded[1, 20:23] = np.nan
    first, second, *_ = Dataset.from_arrays(padded, Y, 500)
    assert (first.rate_hz, first.n_samples) == (500, 40)
    assert (second.rate_hz, second.n_samples) == (None, 47)
    assert np.array_equal(second.time_s, np.delete(T, [20, 21, 22]))
    filled = Dataset([second]).resample(500)
    assert np.flatnonzero(filled[0].flags).tolist() == [20, 21, 22]


TABLES = pytest.mark.parametrize("table", [lambda pandas: pandas, Polars, pa.table, dict])


@TABLES
def test_from_frames_one_table_a_recording(table):
    tables = [table(frame(x, t=T, temperature=20.0)) for x in X]
    data = Dataset.from_frames(tables, Y, sessions=[1, 1, 2, 2])
    assert np.array_equal(data.X, X)
    assert (data.y.tolist(), data.rate_hz, data.sessions.tolist()) == (Y, 500, ["1", "1", "2", "2"])
    assert any("'temperature'" in note for note in data.history[-1].notes)


@TABLES
def test_from_frames_one_table_of_many_recordings(table):
    parts = [frame(x, t=T, trial=i // 2, material=Y[i], day=f"d{i % 2}") for i, x in enumerate(X)]
    data = Dataset.from_frames(table(pd.concat(parts, ignore_index=True)), session="day")
    assert (data.y.tolist(), data.sessions.tolist()) == (Y, ["d0", "d1", "d0", "d1"])
    assert np.array_equal(data.X, X)
    assert data.names == tuple(f"frames[{k}] ({name})" for k in (0, 1) for name in ("rice, d0", "peas, d1"))


ISO = pd.Timestamp("2025-03-04 21:46:21.88") + pd.to_timedelta(np.arange(50) * 2, unit="ms")
START = 1741124781.88
EVEN = 500.0


@pytest.mark.parametrize(
    ("clock", "keywords", "start_time"),
    [
        ({"t": T}, {}, None),
        ({"time [ms]": T * 1000}, {}, None),
        ({"tick": np.arange(50) * 2}, {"time": "tick", "time_unit": "ms"}, None),
        ({"time": np.arange(50)}, {"time_unit": "sample", "rate_hz": 500}, None),
        ({"stamp": T + 1.7e9}, {}, 1.7e9),
        ({"time": ISO}, {}, START),
        ({"time": ISO.tz_localize("UTC").tz_convert("Europe/Helsinki")}, {}, START),
        ({"time": [stamp.to_pydatetime() for stamp in ISO]}, {}, START),
        ({"secs": np.full(50, 1_700_000_000), "nsecs": np.arange(50) * 2_000_000}, {}, 1.7e9),
        ({}, {"rate_hz": 500}, None),
        ({"fs": np.full(50, 500)}, {}, None),
    ],
)
def test_from_frames_clock_is_read(clock, keywords, start_time):
    data = Dataset.from_frames(frame(**clock), ["rice"], **keywords)
    assert (data.rate_hz, data[0].start_time) == (EVEN, start_time)
    assert np.array_equal(data[0].wrench, X[0])


def test_from_frames_index_is_the_clock_or_columns():
    data = Dataset.from_frames(frame().set_index(ISO), ["rice"])
    assert (data.rate_hz, data[0].start_time) == (500, START)
    named = frame().set_index(pd.Index(T, name="seconds"))
    assert Dataset.from_frames(named, ["rice"]).rate_hz == 500
    levels = pd.concat([frame(time=T, trial=i, label=name) for i, name in enumerate("ab")])
    assert Dataset.from_frames(levels.set_index(["label", "trial"])).y.tolist() == ["a", "b"]


IN_NMM = {axis: "N" if axis[0] == "f" else "N mm" for axis in AXES}


def with_attributes(table, **attributes):
    table.attrs = attributes
    return table


def of_pyarrow(table):
    fields = [pa.field(name, pa.float64(), metadata={"unit": IN_NMM.get(name, "s")}) for name in table]
    return pa.Table.from_pandas(table, pa.schema(fields))


@pytest.mark.parametrize("form", [lambda table: with_attributes(table, units=IN_NMM), of_pyarrow])
def test_from_frames_units_beside_the_columns_are_obeyed(form):
    data = Dataset.from_frames([form(frame(X[0] * [1, 1, 1, 1e3, 1e3, 1e3], time=T))], ["rice"])
    np.testing.assert_allclose(data[0].wrench, X[0], rtol=1e-15)
    assert data.history[-1].notes == ("converted from N mm to N m",)


@pytest.mark.parametrize(
    "units", [{"force": "N", "torque": "N mm"}, ["N", "N", "N", "N mm", "N mm", "N mm"], "N,N mm"]
)
def test_from_frames_units_of_no_columns_are_refused(units):
    with pytest.raises(ValueError, match=r"states units .*pass units='N,"):
        Dataset.from_frames([with_attributes(frame(time=T), units=units)], ["rice"])


def test_from_frames_attributes_of_others_are_passed_over():
    given = with_attributes(frame(time=T), units={"fx": None, "torque": "N m"}, payload_unit="kgf")
    given.attrs[1] = "one"
    assert Dataset.from_frames([given], ["rice"], units="N,N m").labels == ("rice",)


def test_from_arrays_dead_recordings_are_not_padded():
    assert len(Dataset.from_arrays(X * np.array([1, 1, 0, 1])[:, None, None], Y, 500)) == 4


def test_from_frames_units_under_another_name_are_refused():
    with pytest.raises(ValueError, match=r"'torque_unit' states units .*pass units='N,N mm'"):
        Dataset.from_frames([with_attributes(frame(time=T), torque_unit="N mm", rig=3)], ["rice"])


def test_identical_rows_with_one_stamp_are_merged():
    twice = pd.concat([frame(time=T)] * 2).sort_values("time", kind="stable")
    data = Dataset.from_frames(twice, ["rice"])
    assert np.array_equal(data[0].wrench, X[0])
    assert (data.rate_hz, data.history[-1].totals["merged_samples"]) == (500, 50)
    assert set(data[0].flags) == {SampleFlag.TIME_REPAIRED}


@pytest.mark.parametrize(
    ("given", "keywords", "named"),
    [
        (frame(names=["a", *AXES[1:]]), {"rate_hz": 1}, "column 'fx' is missing"),
        (frame(names=list("abcdef")), {"rate_hz": 1}, "names none of fx"),
        (frame(), {}, "has no time and no rate"),
        (frame(time=T), {"time": "clock"}, "time='clock' is no column"),
        (frame(time=T), {"axes": "fx,gyro"}, "axes names 'gyro'"),
        (frame(time=T[::-1]), {}, "time runs back"),
        (
            frame(time=[*T[:25]] * 2),
            {},
            "time runs back .* several recordings must be distinguished(?!.*repair)",
        ),
        (frame(id=[1, 2] * 25), {"rate_hz": 100}, "the same value again"),
        (frame(fs=[100] * 49 + [50]), {}, r"states the rates \[50.0, 100.0\]"),
        (frame(id=1, trial=1), {"rate_hz": 100}, "both mean recording; name one of them: id="),
        (frame(time=[f"{stamp:%H:%M:%S.%f}" for stamp in ISO[::-1]]), {}, "runs back from 0 to -0.002 s"),
        (frame(time=T * 500), {}, "stamps lie 1 apart"),
        (frame(time=T, material=["a"] * 25 + ["b"] * 25), {}, "2 values in one recording.*id='material'"),
        (
            frame(label=[*"aab"] * 16 + ["a", "b"]),
            {"rate_hz": 100},
            "has 2 values in one recording: 'a', 'b'",
        ),
        (frame(time=T, label="ri\x07ce"), {}, "column 'label': label .* control character"),
        (frame(time=T, id=["a"] * 49 + [None]), {}, "row 49, column 'id': the cell is empty"),
        (frame(time=T).assign(fx=["1,5"] * 50), {}, "'1,5' is no number; wanted a number$"),
        (frame(time=T).assign(fx=[[1.0]] * 50), {}, "holds lists.*explode"),
        (frame(time=T).rename(columns={"fx": "fx [lb]"}), {}, "the unit of column 'fx \\[lb\\]' is 'lb'"),
        (frame(time=T).rename(columns={"fx": "fx_mN"}), {}, "states a unit and column 'fy' none"),
        (frame(time=T, force_x=1.0).rename(columns={"fx": "F_x"}), {}, "may both be 'fx'"),
        (frame(time=T), {"label": "material"}, "label='material' is no column"),
        (frame(time=T, m="a"), {"label": "m", "labels": ["b"]}, "label names a column, and labels are given"),
        (frame(time=T, day="a"), {"session": "day", "sessions": ["b"]}, "session names a column, and"),
        (pd.DataFrame(X[0]), {"rate_hz": 1}, "frames is a DataFrame; wanted a table"),
        (frame(time=T)[:0], {}, "frames has no rows"),
        (frame(time=T, id="a"), {"labels": ["a", "b"]}, "labels has 2 values for 1 table; .* which label="),
        ({**frame(time=T), "fx": X[0]}, {}, r"column 'fx' has the shape \(50, 6\); wanted \(50,\)"),
        ({"time": T, **frame(), 3: T}, {}, "frames has a column with the name 3"),
        ({"rice": frame(time=T)}, {}, r"frames is a dict of tables; .* list\(frames.values\(\)\)"),
    ],
)
def test_from_frames_bad_table_is_refused_by_place(given, keywords, named):
    with pytest.raises((ValueError, TypeError), match=named):
        Dataset.from_frames(given, **keywords)


def test_from_frames_label_of_several_columns_is_chosen():
    given = frame(time=T, material="rice", label="peas")
    with pytest.raises(ValueError, match="both mean label; name one of them: label='column:material'"):
        Dataset.from_frames(given)
    for label in ("material", "column:material"):
        assert Dataset.from_frames(given, label=label).labels == ("rice",)
    assert Dataset.from_frames(given, ["oats"]).labels == ("oats",)


@pytest.mark.parametrize("rows", [np.arange(50), np.arange(50.0, 0, -1), [f"row {i}" for i in range(50)]])
def test_columns_that_are_not_of_a_recording_are_left_out(rows):
    """Names that only look like axes with a unit, flags of others, numbers of rows."""
    given = frame(time=T, fz_min=0.0, flags=1, id=rows, datum=datetime.date(2025, 1, 1))
    data = Dataset.from_frames(given, ["rice"])
    assert np.array_equal(data[0].wrench, X[0])
    assert data[0].flags is None
    assert "'fz_min', 'flags', 'id', 'datum'" in " ".join(data.history[-1].notes)


def test_from_frames_labels_given_win_over_a_column():
    tables = [frame(x, time=T, label="peas", session="1") for x in X[:2]]
    data = Dataset.from_frames(tables, ["rice", None], sessions=[2, None])
    assert ([r.label for r in data], data.sessions.tolist()) == (["rice", "peas"], ["2", "1"])
    assert "columns that are not read: 'label', 'session'" in data.history[-1].notes


def test_from_frames_cells_that_pandas_calls_empty_are_none():
    given = frame(time=T, label=pd.array([pd.NA] * 50, dtype="string"))
    assert Dataset.from_frames(given)[0].label is None
