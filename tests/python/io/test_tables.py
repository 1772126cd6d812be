"""Long tables: the same rows as CSV and as Parquet give the same recordings, or the same refusal."""

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from granular_id.io import RecordingFileError, load
from remedies import lines_of, refusal, run

AXES = ["fx", "fy", "fz", "tx", "ty", "tz"]
W = np.random.default_rng(2).standard_normal((6, 6))
T6 = [0.0, 0.01, 0.02] * 2


def written(folder, form, **more):
    frame = pd.DataFrame({**{axis: W[:, j] for j, axis in enumerate(AXES)}, **more})
    path = folder / f"pushes.{form}"
    frame.to_csv(path, index=False) if form == "csv" else frame.to_parquet(path, index=False)
    return path


FORMS = pytest.mark.parametrize("form", ["csv", "parquet"])

READ = {
    "texts": ({"recording": list("bbbaaa"), "label": ["rice"] * 3 + ["peas"] * 3}, {}, ["b", "a"]),
    "numbers": ({"trial": [7, 7, 7, 3, 3, 3]}, {}, ["pushes.{}[7]", "pushes.{}[3]"]),
    "named": ({"push": [1, 1, 1, 2, 2, 2]}, {"id": "push"}, ["pushes.{}[1]", "pushes.{}[2]"]),
    "counted anew": (
        {"id": [1] * 6, "material": list("aaabbb")},
        {},
        ["pushes.{}[1] (a)", "pushes.{}[1] (b)"],
    ),
    "interleaved": (
        {"id": [1, 2] * 3, "time": [0, 0, 0.01, 0.01, 0.02, 0.02]},
        {},
        ["pushes.{}[1]", "pushes.{}[2]"],
    ),
    "with a rate each": (
        {"id": [1, 1, 1, 2, 2, 2], "fs": [100.0] * 6, "time": None},
        {},
        ["pushes.{}[1]", "pushes.{}[2]"],
    ),
    "by material": ({"material": list("aaabbb")}, {"id": "material"}, ["a", "b"]),
}


@FORMS
@pytest.mark.parametrize("case", READ)
def test_recordings_of_a_long_table(tmp_path, case, form):
    more, options, names = READ[case]
    columns = {name: values for name, values in {"time": T6, **more}.items() if values is not None}
    data = load(written(tmp_path, form, **columns), **options)
    assert data.names == tuple(name.format(form) for name in names)
    assert data.rate_hz == 100
    rows = W[[0, 2, 4, 1, 3, 5]] if case == "interleaved" else W
    assert data.X.tobytes() == rows.tobytes()
    label = more.get("label") or more.get("material")
    assert [r.label for r in data] == ([label[0], label[3]] if label else [None, None])


@FORMS
def test_a_long_table_without_an_id_is_refused(tmp_path, form):
    with pytest.raises(RecordingFileError, match=r"time runs back .* must be distinguished"):
        load(written(tmp_path, form, time=T6))


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_dates_of_parquet_give_start_and_rate(tmp_path, unit):
    stamps = np.array(1_600_000_000, f"M8[{unit}]" if unit == "s" else "M8[s]") + np.arange(6).astype("m8[s]")
    table = pa.table(
        {**{a: W[:, j] for j, a in enumerate(AXES)}, "time": pa.array(stamps.astype(f"M8[{unit}]"))}
    )
    pq.write_table(table, tmp_path / "a.parquet")
    recording = load(tmp_path / "a.parquet")[0]
    assert (recording.rate_hz, recording.start_time) == (1, 1_600_000_000)


def test_units_in_the_metadata_of_parquet_are_obeyed(tmp_path):
    fields = [pa.field(a, pa.float64(), metadata={"unit": "mN" if a[0] == "f" else "N mm"}) for a in AXES]
    pq.write_table(pa.table(list(W.T), schema=pa.schema(fields)), tmp_path / "a.parquet")
    np.testing.assert_allclose(load(tmp_path / "a.parquet", rate_hz=10)[0].wrench, W / 1000, rtol=1e-15)


def test_categories_and_an_index_of_dates_of_pandas(tmp_path):
    frame = pd.DataFrame(W, columns=AXES).assign(material=pd.Categorical(["rice"] * 6))
    frame.index = pd.date_range("2025-03-04 10:00", periods=6, freq="10ms")
    frame.to_parquet(tmp_path / "a.parquet")
    recording = load(tmp_path / "a.parquet")[0]
    assert (recording.rate_hz, recording.label) == (100, "rice")
    assert recording.start_time == 1741082400


def test_lists_in_cells_come_with_the_way_out(tmp_path):
    frame = pd.DataFrame({axis: [W[:3, j].tolist(), W[3:, j].tolist()] for j, axis in enumerate(AXES)})
    frame.assign(trial=[1, 2]).to_parquet(tmp_path / "a.parquet")
    data = run(*lines_of(refusal(tmp_path / "a.parquet", rate_hz=10)))
    assert data.X.reshape(6, 6).tolist() == W.tolist()


def test_parquet_without_rows_is_refused(tmp_path):
    pq.write_table(pa.table({axis: pa.array([], pa.float64()) for axis in AXES}), tmp_path / "a.parquet")
    with pytest.raises(RecordingFileError, match="no samples"):
        load(tmp_path / "a.parquet", rate_hz=10)
