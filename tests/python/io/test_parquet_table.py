"""Single Parquet files that others wrote: recordings told apart by a column, clocks, labels; and what is refused."""

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
WRENCH = np.random.default_rng(2).standard_normal((6, 6))


def columns(**more):
    return {**{axis: WRENCH[:, j] for j, axis in enumerate(AXES)}, **more}


def write(tmp_path, values, **options):
    path = tmp_path / "pushes.parquet"
    pq.write_table(pa.table(values), path, **options)
    return path


def test_recordings_are_told_apart_by_a_column(tmp_path):
    values = columns(
        recording=["b"] * 3 + ["a"] * 3,
        label=["rice"] * 3 + [None] * 3,
        session=["s1"] * 6,
        time=[0.0, 0.1, 0.2, 5.0, 5.1, 5.2],
        flags=np.array([0, 0, 0, 2, 0, 4], np.int8),
    )
    data = load(write(tmp_path, values, row_group_size=2))
    assert data.names == ("b", "a")
    assert [r.label for r in data] == ["rice", None]
    assert data.sessions.tolist() == ["s1", "s1"]
    assert [r.rate_hz for r in data] == [10, 10]
    assert data[0].wrench.tobytes() == WRENCH[:3].tobytes()
    assert data[1].flags.tolist() == [2, 0, 4]
    assert data[0].flags is None


def test_trials_may_be_counted_anew_for_each_material_or_session(tmp_path):
    for column in ("material", "session"):
        about = {
            "trial": [1, 1, 2, 1, 2, 2],
            "time": [0.0, 1, 0, 0, 0, 1],
            column: ["rice"] * 3 + ["peas"] * 3,
        }
        data = load(write(tmp_path, columns(**about)), time_unit="s", rate_hz=1)
        assert [r.n_samples for r in data] == [2, 1, 1, 2]
        assert data.names[::3] == ("pushes.parquet[1] (rice)", "pushes.parquet[2] (peas)")
        assert [r.label or r.session for r in data] == ["rice", "rice", "peas", "peas"]


@pytest.mark.parametrize("ending", ["parquet", "csv"])
@pytest.mark.parametrize(
    "more",
    [
        {"valid": [True] * 6}, {"mask": [1] * 6}, {"padding_mask": [0.0] * 6}, {"T": [20.5] * 6},
        {"frequency": [50] * 6}, {"rate": [499, 500, 501, 500, 500, 500]},
    ],
)  # fmt: skip
def test_what_stands_beside_stamps_and_changes_nothing(tmp_path, more, ending):
    path = write(tmp_path, columns(time=np.arange(6) / 500, **more))
    if ending == "csv":
        table, path = pq.read_table(path), tmp_path / "pushes.csv"
        pytest.importorskip("pyarrow.csv").write_csv(table, path)
    data = load(path)
    assert data.rate_hz == 500
    np.testing.assert_array_equal(data[0].wrench, WRENCH)


def test_numbers_name_recordings_and_other_names_of_columns_are_known(tmp_path):
    values = {
        name: WRENCH[:, j].astype(np.float32) for j, name in enumerate(["Fx", "Fy", "Fz", "Mx", "My", "Mz"])
    }
    values |= {"Recording ID": [7, 7, 7, 3, 3, 3], "material": ["rice"] * 6, "temperature": [20.0] * 6}
    data = load(write(tmp_path, values), rate_hz=100)
    assert data.names == ("pushes.parquet[7]", "pushes.parquet[3]")
    assert data.labels == ("rice",)
    assert data[0].wrench.tolist() == WRENCH[:3].astype(np.float32).astype(np.float64).tolist()
    assert any("not read: temperature" in note for note in data.history[-1].notes)


@pytest.mark.parametrize("unit", ["s", "us", "ns"])
def test_dates_and_times_give_start_and_rate(tmp_path, unit):
    per_s = {"s": 1, "us": 1e6, "ns": 1e9}[unit]
    stamps = (np.arange(6) * per_s + 1_600_000_000 * per_s).astype(np.int64)
    data = load(write(tmp_path, columns(time=pa.array(stamps, pa.timestamp(unit, "UTC")))))
    assert data[0].rate_hz == 1
    assert data[0].start_time == 1_600_000_000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": None}, "column 'fx' is missing"),
        ({name: pa.array([], pa.float64()) for name in AXES}, "holds no samples"),
        ({"fx": [{"a": 1.0}] * 6}, "row group 0|column fx"),
        ({"fx": ["1"] * 6}, "column fx: holds .*string.*; wanted numbers"),
        ({"fx": [1.0, 2, None, 4, 5, 6]}, "column fx: has 1 empty cells"),
        ({"fx": [1.0, 2, np.inf, 4, 5, 6]}, "column fx, row 2: is inf"),
        ({"fx": [True] * 6}, "column fx: holds bool; wanted numbers"),
        ({"time": [0.0, 1, 2, 2, 3, 4]}, "row 3: the stamp 2.0 is repeated"),
        ({"time": [0.0, 1, 2, np.nan, 3, 4]}, "column time, row 3: is nan"),
        (
            {"time": pa.array(range(6), pa.duration("s"))},
            "holds duration.*; wanted seconds as numbers, or dates",
        ),
        ({"flags": [0, 1, 2, 3, 4, 99]}, "column flags, .*row 5: 99 is not a sum of SampleFlag bits"),
        (
            {"flags": [0, 0, 0, 0, 99, 0], "recording": [1, 1, 1, 2, 2, 2]},
            r"column flags, recording '.*\[2\]', row 4: 99 is",
        ),
        ({"label": ["a", "a", "b", "a", "a", "a"]}, "has 2 values: 'a', 'b'; wanted one"),
        ({"label": [1] * 6}, "column label: holds int64; wanted texts"),
        ({"label": ["a\tb"] * 6}, "control character"),
        ({"recording": [0.5] * 6}, "holds double; wanted whole numbers or texts that name recordings"),
        ({"recording": [1, 1, None, 1, 1, 1]}, "recording: has 1 empty cells"),
        ({"recording": [1, 1, 2, 2, 1, 1]}, "recording: has the same value again"),
        ({"valid": [True] * 5 + [False]}, "column valid: tells which rows are samples"),
    ],
)
def test_what_is_refused(tmp_path, change, message):
    values = {name: value for name, value in columns(**change).items() if value is not None}
    path = write(tmp_path, values)
    with pytest.raises(RecordingFileError, match=message):
        load(path, rate_hz=None if "time" in change else 500)


def test_dictionaries_with_indices_of_any_width(tmp_path):
    """As pandas (int8), polars (uint32 and uint8) and pyarrow (any) write categories."""
    for width in (
        pa.int8(),
        pa.uint8(),
        pa.int16(),
        pa.uint16(),
        pa.int32(),
        pa.uint32(),
        pa.int64(),
        pa.uint64(),
    ):
        kind = pa.dictionary(width, pa.large_string())
        label = pa.array(["rice"] * 3 + [None] * 3).cast(kind)
        trial = pa.array(["b"] * 3 + ["a"] * 3).cast(kind)
        number = pa.array(WRENCH[:, 0].round(1)).dictionary_encode()
        path = write(tmp_path, columns(label=label, trial=trial, fx=number), row_group_size=2)
        data = load(path, rate_hz=10)
        assert [(r.name, r.label) for r in data] == [("b", "rice"), ("a", None)]
        assert data[0].wrench[:, 0].tolist() == WRENCH[:3, 0].round(1).tolist()


@pytest.mark.parametrize("kind", ["large_string", "string_view"])
def test_texts_of_every_type_of_arrow(tmp_path, kind):
    try:
        labels = pa.array(["rice"] * 3 + ["peas"] * 3).cast(getattr(pa, kind)())
        path = write(tmp_path, columns(label=labels, id=labels))
    except (AttributeError, pa.ArrowNotImplementedError):
        pytest.skip(f"this pyarrow writes no {kind}")
    assert [(r.name, r.label) for r in load(path, rate_hz=10)] == [("rice", "rice"), ("peas", "peas")]


def rows_of_lists(kind=None, **more):
    """A table of two recordings, each a row whose cells hold all samples of an axis."""
    parts = {axis: [WRENCH[:3, j], WRENCH[3:, j]] for j, axis in enumerate(AXES)}
    return {axis: pa.array(cells, kind) for axis, cells in parts.items()} | more


@pytest.mark.parametrize("kind", [None, pa.large_list(pa.float64()), pa.list_(pa.float64(), 3)])
def test_a_row_may_be_a_recording(tmp_path, kind):
    times = [[0.0, 0.1, 0.2], [7.0, 7.5, 8.0]]
    labels = pa.array(["rice", "peas"]).dictionary_encode()
    data = load(write(tmp_path, rows_of_lists(kind, time=times, label=labels, trial=["b", "a"])))
    assert [(r.name, r.label, r.rate_hz) for r in data] == [("b", "rice", 10), ("a", "peas", 2)]
    assert np.vstack([r.wrench for r in data]).tobytes() == WRENCH.tobytes()


def test_rows_of_lists_have_a_rate_each(tmp_path):
    path = write(tmp_path, rows_of_lists(fs=[500, 100]))
    found = [(r.name, r.rate_hz) for r in load(path)]
    assert found == [("pushes.parquet[0]", 500), ("pushes.parquet[1]", 100)]
    with pytest.raises(RecordingFileError, match="200 Hz is stated"):
        load(path, rate_hz=200)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"tz": [[1.0, 2, 3], [1.0, 2]]}, "column tz: row 1 has 2 values; wanted as many as 'fx'"),
        ({"time": [0.0, 1.0]}, "column time: holds a value a row"),
        ({"tz": [[1.0, 2, None]] * 2}, "column tz: has 2 empty cells"),
        ({"tz": [[[1.0], [2.0], [3.0]]] * 2}, "column tz: holds list"),
        ({axis: [[], [1.0]] for axis in AXES}, "row 0 has 0 values"),
        ({"rate_hz": [[500, 500, 100]] * 2}, r"states the rates \[100.0, 500.0\]; wanted one"),
    ],
)
def test_rows_of_lists_that_are_refused(tmp_path, change, problem):
    with pytest.raises(RecordingFileError, match=problem):
        load(write(tmp_path, rows_of_lists(**change)), rate_hz=None if "rate_hz" in change else 10)


def test_a_wrench_in_each_row_comes_with_a_way_round(tmp_path):
    values = {"wrench": pa.array(WRENCH.tolist(), pa.list_(pa.float64(), 6))}
    with pytest.raises(RecordingFileError, match=r"with pandas: frame\[.* = frame\['wrench'\]\.tolist\(\)"):
        load(write(tmp_path, values), rate_hz=10)
