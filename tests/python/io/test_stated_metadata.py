"""What a file says of its arrays is obeyed, or the file is refused naming the way out; whatever library wrote it."""

import json

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load
from layouts_written import AXES, FORCES, LABELS, TORQUES, T, W, X, formats_of, written

h5py = pytest.importorskip("h5py")
pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")
csv_of_arrow = pytest.importorskip("pyarrow.csv")

TURNED = [5, 2, 0, 4, 1, 3]
NAMES = ["Mz", "Fz", "Fx", "My", "Fy", "Mx"]
BYTES = np.bytes_(NAMES)
IN_MILLI = ["mN"] * 3 + ["mN m"] * 3
LENGTHS = [50, 40, 30, 50]
PADDED = np.where(np.arange(50)[:, None] < np.array(LENGTHS)[:, None, None], X, 0)
CUT = [x[:n] for x, n in zip(X, LENGTHS, strict=True)]
MILLI = X * [1e3, 1e3, 1e3, 1e3, 1e3, 1e3]
BLOCK = np.zeros(50, [("index", "i8"), ("values_block_0", "f8", (6,))])
ACROSS = X.transpose(1, 0, 2)
HALF = [1e3, 1e3, 1e3, 1, 1, 1]
GRID = [[X[0], X[1]], [X[2], X[3]]]
JOINTS = np.full((50, 6), 0.5)


def tree(**arrays):
    """Arrays under their names, in a file of every format that can hold them."""
    return arrays


def at_500(X, **more):
    return tree(X=X, fs=500, **more)


def turned(**names):
    """Recordings whose axes stand in another order, and what names that."""
    return tree(X=X[..., TURNED], fs=500, **names)


def h5(arrays, **attributes):
    """Data sets by path; a pair is one with attributes."""

    def write(path):
        with h5py.File(path, "w") as file:
            file.attrs.update(attributes)
            for name, value in arrays.items():
                array, about = value if isinstance(value, tuple) else (value, {})
                file[name] = array
                file[name].attrs.update(about)

    return "set.h5", write


def h5_at_500(X, about):
    return h5({"X": (X, about), "fs": 500})


def labelled_dimensions(*names, array=X):
    def write(path):
        with h5py.File(path, "w") as file:
            file["X"] = array
            for dimension, name in zip(file["X"].dims, names, strict=True):
                dimension.label = name

    return "set.h5", write


def demos(**arrays):
    return tree(data={f"demo_{i}": arrays for i in range(2)}, fs=500)


def parquet(units=None, about=None, values=W, **more):
    def write(path):
        table = pa.table({**dict(zip(AXES, values.T, strict=True)), **more})
        fields = [
            table.schema.field(name).with_metadata({"units": units[name]} if name in (units or {}) else {})
            for name in table.schema.names
        ]
        pq.write_table(pa.table(table.columns, schema=pa.schema(fields, metadata=about)), path)

    return "push.parquet", write


def pandas(index=None, **attributes):
    def write(path):
        frame = pytest.importorskip("pandas").DataFrame(W, columns=AXES, index=index)
        frame.attrs.update(attributes)
        frame.to_parquet(path)

    return "push.parquet", write


def structs(**fields):
    """A struct array of two recordings, each with a label."""
    return tree(data=[{**fields, "label": label} for label in ("rice", "peas")], fs=500.0)


def fields(names, stamps, values):
    return "push.npy", lambda path: np.save(path, np.rec.fromarrays([stamps, *values.T], names=names))


def csv(stamps, name="time", axes=AXES, values=W):
    rows = "\n".join(
        ",".join(map(repr, [float(t), *w.tolist()])) for t, w in zip(stamps, values, strict=True)
    )
    return "push.csv", lambda path: path.write_text(f"{name},{','.join(axes)}\n{rows}\n")


READ = {
    # names of axes beside the array
    **{
        f"{name}=": (turned(**{name: NAMES}), X)
        for name in ("columns", "feature_names", "channel_names", "axes", "X_columns", "header")
    },
    "axis_order=": (turned(axis_order="mz fz fx my fy mx"), X),
    "h5 attribute axis_order": (h5({"X": (X[..., TURNED], {"axis_order": " ".join(NAMES)}), "fs": 500}), X),
    "columns and header": (turned(columns=NAMES, header=",".join(NAMES)), X),
    "columns with units": (
        at_500(X[..., TURNED] * 1e3, columns=[f"{n} [mN m]" if n[0] == "M" else f"{n} [mN]" for n in NAMES]),
        X,
    ),
    "columns in one text": (turned(columns=", ".join(NAMES)), X),
    "columns in JSON": (turned(columns=json.dumps(NAMES)), X),
    "columns with time": (tree(X=np.column_stack([T, W[:, TURNED]]), columns=["time", *NAMES]), [W]),
    "columns with time in ms": (tree(X=np.column_stack([T * 1e3, W]), columns=["time [ms]", *AXES]), [W]),
    "columns and more": (tree(X=np.dstack([X, X[..., 0]]), fs=500, columns=[*AXES, "temp"]), X),
    "other features": (at_500(X, hfmh=np.zeros((4, 600)), feature_names=[f"f{i}" for i in range(600)]), X),
    "h5 attribute columns": (h5({"X": (X[..., TURNED], {"columns": NAMES}), "fs": 500}), X),
    "h5 pandas fixed": (
        h5({"df/block0_values": W[:, TURNED], "df/block0_items": BYTES, "df/axis0": BYTES, "fs": 500}),
        [W],
    ),
    # units
    "units of each": (at_500(MILLI, units=IN_MILLI), X),
    "units of two": (at_500(MILLI, units=["mN", "N mm"]), X),
    "units N": (at_500(X, units="N"), X),
    "force_units": (at_500(MILLI, force_unit="mN", torque_unit="N·mm"), X),
    "kN, lbf in": (
        tree(X=X / ([1e3] * 3 + [4.4482216152605 * 0.0254] * 3), fs=500, units=["kN"] * 3 + ["lbf in"] * 3),
        X,
    ),
    "lbf, kgf": (
        tree(X=X / [4.4482216152605, 9.80665, 1, 1, 1, 1], fs=500, units=["lbf", "kgf", "N"] + ["Nm"] * 3),
        X,
    ),
    "units struct": (tree(X=MILLI, fs=500.0, units={"force": "mN", "torque": "mN m"}), X),
    "vectors with units": (
        tree(**{f"{a}_mN" if a[0] == "f" else a: v for a, v in zip(AXES, (W * HALF).T, strict=True)}, fs=500),
        [W],
    ),
    "npy fields with units": (
        fields(["time [ms]", "fx [mN]", "fy [mN]", "fz [mN]", *AXES[3:]], T * 1e3, W * HALF),
        [W],
    ),
    "h5 unit of halves": (h5({"force": (FORCES * 1e3, {"unit": "mN"}), "torque": TORQUES, "fs": 500}), X),
    "h5 units of parts": (h5({"X": (MILLI, {"force_units": "mN", "torque_units": "mN m"}), "fs": 500}), X),
    "h5 units of parts beside units": (
        h5({"X": (X * HALF, {"force_units": "mN", "units": "N"}), "fs": 500}),
        X,
    ),
    "h5 units of vectors": (
        h5(
            {a: (w * 1e3, {"units": unit}) for a, w, unit in zip(AXES, W.T, IN_MILLI, strict=True)}
            | {"fs": 500}
        ),
        [W],
    ),
    "parquet units": (
        parquet(dict(zip(AXES, IN_MILLI, strict=True)), values=W * 1e3, time=T),
        [W],
    ),
    "parquet units of the table": (
        parquet(about={"units": json.dumps({"fx": "mN"})}, values=W * [1e3, 1, 1, 1, 1, 1], time=T),
        [W],
    ),
    "parquet time_ms": (parquet(time_ms=T * 1e3), [W]),
    "parquet fs in kHz": (parquet(**{"fs [kHz]": np.full(50, 0.5)}), [W]),
    "csv units": (
        csv(T, axes=["Fx [mN]", "fy_mN", "fz_kN", *AXES[3:]], values=W * [1e3, 1e3, 1e-3, 1, 1, 1]),
        [W],
    ),
    "csv time_ms": (csv(T * 1e3, "time_ms"), [W]),
    "csv wrench of a joint sensor": (csv(T, axes=[f"/joint_ft/wrench/{a}" for a in AXES]), [W]),
    "csv fs as column": (csv(np.full(50, 500.0), "fs"), [W]),
    # the clock
    "dt": (tree(X=X, dt=0.002), X),
    "dt in ms": (tree(X=X, dt_ms=2.0), X),
    "time_ms": (tree(X=X, time_ms=T * 1e3), X),
    "time_unit": (tree(X=X, t=np.arange(50) * 2000, time_unit="us"), X),
    "Ts": (tree(X=X, Ts=0.002), X),
    "ns since 1970": (tree(X=W, timestamp_ns=1_700_000_000 * 10**9 + (T * 1e9).astype(np.int64)), [W]),
    "clocks that agree": (tree(X=W, time=T, timestamp=1.7e9 + T), [W]),
    "parquet fs as column": (parquet(fs=np.full(50, 500.0)), [W]),
    "parquet recordings by run": (
        parquet(run_id=np.repeat([1, 2], 25), time=np.tile(T[:25], 2)),
        [W[:25], W[25:]],
    ),
    "fs that fits": (tree(X=X, t=T, fs=500.1), X),
    "h5 units of time": (h5({"X": X, "t": (np.arange(50) * 2_000_000, {"units": "ns"})}), X),
    "h5 units of fs": (h5({"X": X, "fs": (0.5, {"units": "kHz"})}), X),
    "parquet units of time": (parquet({"time": "ms"}, time=T * 1e3), [W]),
    "pandas dates as index": (
        pandas(index=np.arange(50) * np.timedelta64(2, "ms") + np.datetime64("2026-01-01")),
        [W],
    ),
    # padding
    **{f"{name}": (at_500(PADDED, **{name: LENGTHS}), CUT) for name in ("lengths", "n_samples", "seq_len")},
    **{
        f"{name}": (at_500(PADDED, **{name: np.arange(50) < np.array(LENGTHS)[:, None]}), CUT)
        for name in ("mask", "valid_mask")
    },
    "lengths of what lies in a row": (tree(X=np.concatenate(CUT), lengths=LENGTHS, fs=500, y=LABELS), CUT),
    "n_samples counts recordings": (at_500(X, n_samples=4), X),
    "padding_mask": (at_500(PADDED, padding_mask=np.arange(50) >= np.array(LENGTHS)[:, None]), CUT),
    **{
        f"{name}={value}": (at_500(X, **{name: value}), X)
        for name, value in {"length": 40, "n_steps": 200, "num_samples": 20, "channels": 6, "axes": 6}.items()
    },
    "columns by number": (at_500(X, columns=np.arange(6)), X),
    "lengths and stamps in a row": (
        tree(X=np.concatenate(CUT), lengths=LENGTHS, t=np.concatenate([T[:n] for n in LENGTHS])),
        CUT,
    ),
    "length in m": (at_500(X, length=0.08), X),
    "lengths and stamps": (tree(X=PADDED, t=T, lengths=LENGTHS), CUT),
    # which axis is which
    "(T, n, 6) with labels": (at_500(ACROSS, y=LABELS), X),
    "(T, n, 6) with dims": (at_500(ACROSS, dims=["time", "trial", "channel"]), X),
    "h5 dimensions: time alone": (labelled_dimensions("time", "", array=W), [W]),
    "h5 dimensions, (6, T)": (labelled_dimensions("", "time", array=W.T), [W]),
    "h5 dimensions": (labelled_dimensions("time", "recording", "axis", array=ACROSS), X),
    # what is no wrench
    "ee_wrench and joint_pos": (demos(ee_wrench=W, joint_pos=JOINTS), [W, W]),
    **{
        f"wrench and {name}": (demos(wrench=W, **{name: JOINTS}), [W, W])
        for name in ("robot0_joint_vel", "actions", "ee_pose", "qpos", "imu", "strain_gauges", "TCP speed")
    },
    "obs and actions": (demos(obs={"ee_wrench": W}, actions=JOINTS), [W, W]),
    "groups of a speed": (
        tree(**{m: {f"speed_{v}": {"ft": W} for v in (30, 60)} for m in "ab"}, fs=500),
        [W] * 4,
    ),
    "joint_states": (demos(**{"ft": W, "joint_states": {"position": JOINTS, "effort": JOINTS}}), [W, W]),
    "structs with joints": (structs(wrench=W, q=JOINTS), [W, W]),
    "joints of all": (tree(ft=X, joint_positions=X * 0, fs=500), X),
    **{
        f"materials and one {name}": (tree(peas=W, rice=W + 1, **{"fs": 500, name: value}), [W, W + 1])
        for name, value in {"name": "day 1", "start_time": 1.7e9, "trigger_index": 9}.items()
    },
}

REFUSED = {
    "two units of one axis": (
        at_500(X, columns=[f"{a} [N]" for a in AXES[:3]] + AXES[3:], units="mN, mN m"),
        "two units of fx",
    ),
    "dims that do not fit": (at_500(X, dims=["axis", "time", "recording"]), "dimensions are stated"),
    "dt in volt": (tree(X=X, dt=2.0, dt_units="V"), "is in 'V'"),
    "two names of one axis": (at_500(X, columns=["fx", "Fx", "fz", "tx", "ty", "tz"]), "fx"),
    "two orders": (at_500(X, columns=NAMES, header=AXES), "orders"),
    "names of seven": (at_500(X, columns=["time", *AXES]), "6 columns, columns names 7"),
    "csv time in two": (csv(T, "sec", axes=[*AXES, "nanosec"], values=X[0][:, [*range(6), 0]]), "nanosec"),
    "units mN": (at_500(MILLI, units="mN"), "units"),
    "units of five": (at_500(X, units=["N"] * 5), "units"),
    "units counts": (at_500(X, units=["counts"] * 6), "units"),
    "wrench_mN": (tree(wrench_mN=X, fs=500), "mN"),
    "h5 attribute scale_factor": (h5_at_500(X, {"scale_factor": 0.1}), "scale_factor"),
    "scale_factor": (at_500(X, scale_factor=0.01), "scale_factor"),
    "counts": (at_500(X.astype(int), counts_per_force=1e6), "counts_per_force"),
    "parquet rate of the table": (parquet(about={"fs": "100"}, time=T), "100"),
    "h5 fill values": (
        h5({"X": (np.where(PADDED == 0, -9999, PADDED), {"_FillValue": -9999.0}), "fs": 500}),
        "_FillValue",
    ),
    "axes of joints": (at_500(X, axes=[f"joint_{i}" for i in range(6)]), "no wrench"),
    "start of text": (tree(X=W, fs=500, start_time="monday"), "start_time"),
    "parts in another order": (tree(force=FORCES, torque=TORQUES, fs=500, columns=NAMES), "axes"),
    "start in ms": (at_500(X, start_time=1.7e12 + np.arange(4)), "start_time"),
    "Ts beside fs": (at_500(X, Ts=0.001), "Ts"),
    "h5 date as unit of time": (h5({"X": X, "t": (T, {"units": "hours since 2026-01-01"})}), "hours"),
    "parquet fs beside time": (parquet(fs=np.full(50, 100.0), time=T), "100 Hz"),
    "parquet mask": (parquet(valid=np.arange(50) < 40, time=T), "valid"),
    "h5 pandas table": (h5({"df/table": BLOCK, "fs": 500}), "array="),
    "stamps in ms": (tree(X=X, t=T * 1e3), "time_unit="),
    "index": (tree(X=X, t=np.arange(50)), "time_unit="),
    "days": (tree(X=W, t=739000 + T / 86400), "time_unit="),
    "csv mask": (csv(np.arange(50) < 40, "valid"), "valid"),
    "parquet stamps in us": (parquet(time=(T * 1e6).astype(np.int64)), "time_unit="),
    "dt of 2": (tree(X=X, dt=2.0), "time_unit="),
    "fs beside stamps": (tree(X=X, t=T, fs=1000), "fs"),
    "fs beside uneven stamps": (tree(X=W, t=T**1.01, fs=1000), "fs"),
    "dt beside fs": (at_500(X, dt=0.001), "dt"),
    "two clocks": (tree(X=X, t=T, timestamps=T * 2), "timestamps"),
    "lengths too long": (at_500(X, lengths=[51, 50, 50, 50]), "lengths"),
    "lengths of three": (at_500(X, lengths=[50] * 3), "lengths"),
    "lengths of something else": (at_500(X, lengths=[20] * 4), "lengths"),
    "mask with holes": (at_500(X, mask=np.arange(200).reshape(4, 50) % 2), "mask"),
    "npy (T, n, 6)": (("push.npy", lambda path: np.save(path, ACROSS)), "labels"),
    "(T, n, 6)": (at_500(ACROSS), "labels"),
    "dims of other words": (at_500(X, dims=["a", "b", "c"]), "dims"),
    "2 x 2 cell": (tree(data=GRID, materials=["rice", "peas"], fs=500.0), "materials"),
    "two wrenches": (demos(ft_left=W, ft_right=W + 1), "array="),
    "a wrench and what nobody knows": (demos(wrench=W, arm=W + 1), "array="),
    "obs and next_obs": (
        tree(**{f"demo_{i}": {o: {"ft": W} for o in ("obs", "next_obs")} for i in range(2)}, fs=500),
        "array=",
    ),
    "structs with two": (structs(ft=W, arm=W + 1), "array="),
    "parts that differ": (tree(wrench=X, force=FORCES + 1, torque=TORQUES, fs=500), "array="),
    "vectors that differ": (tree(X=W + 1, fs=500, **dict(zip(AXES, W.T, strict=True))), "array="),
    "torques of joints": (tree(torques=W, fs=500), "array="),
    "joints alone": (tree(joint_pos=X, fs=500), "array="),
    "two lists of labels": (at_500(X, labels=LABELS, material=LABELS[::-1]), "label="),
    "trials in a row": (tree(X=W, fs=500, trial=np.repeat([1, 2], 25)), "trial"),
}


CHOSEN = {
    "one of two": (tree(wrench_raw=X + 1, wrench_f=X, fs=500), {"array": "wrench_f"}, X),
    "a group": (tree(test={"X": X + 1}, train={"X": X}, fs=500), {"array": "train"}, X),
    "one of each struct": (structs(ft=W, arm=W + 1), {"array": "ft"}, [W, W]),
    "ms": (tree(X=X, t=T * 1e3), {"time_unit": "ms"}, X),
    "us in a table": (parquet(time=(T * 1e6).astype(np.int64)), {"time_unit": "us"}, [W]),
    "ns since 1970": (csv(1.7e18 + T * 1e9), {"time_unit": "ns"}, [W]),
    "an index and a rate": (tree(X=X, t=np.arange(50)), {"time_unit": "sample", "rate_hz": 500}, X),
    "a step in ms": (tree(X=X, dt=2.0), {"time_unit": "ms"}, X),
    "an index and the file's rate": (tree(X=X, t=np.arange(50), fs=500), {"time_unit": "sample"}, X),
}

CHOSEN_WRONGLY = {
    "no such array": (tree(X=X, fs=500), {"array": "Y"}, RecordingFileError, "array='Y'"),
    "an array without samples": (tree(X=X, fs=500), {"array": "fs"}, RecordingFileError, "array='fs'"),
    "no such label": (tree(X=X, fs=500), {"label": "z"}, RecordingFileError, "label='z'"),
    "no such column": (parquet(time=T), {"label": "z"}, RecordingFileError, "label='z'"),
    "another rate than the file's": (
        csv(np.full(50, 500.0), "fs"),
        {"rate_hz": 200},
        RecordingFileError,
        "200 Hz is stated",
    ),
    "no label where ROS printed": (csv(T, "%time"), {"label": "z"}, RecordingFileError, "label='z'"),
    "an array of a table": (csv(T), {"array": "fx"}, ValueError, "array must be left out"),
    "another unit than the file's": (
        tree(X=X, time_ms=T * 1e3),
        {"time_unit": "us"},
        RecordingFileError,
        "ms",
    ),
    "an index without a rate": (
        tree(X=X, t=np.arange(50)),
        {"time_unit": "sample"},
        RecordingFileError,
        "no rate",
    ),
    "an unknown unit": (tree(X=X, t=T), {"time_unit": "min"}, ValueError, "time_unit='min'"),
    "no text": (tree(X=X, t=T), {"array": 3}, TypeError, "array"),
}


def in_two_formats(table):
    """Name the cases of a table, and for trees two formats: the first that can hold it, and the others in turn."""
    cases = []
    for i, (name, (file, *_)) in enumerate(table.items()):
        first, *others = formats_of(file) if isinstance(file, dict) else [""]
        forms = [first, others[i % len(others)]] if others else [first]
        cases += [pytest.param(name, form, id=f"{name} {form}") for form in forms]
    return cases


def made(tmp_path, file, form="npz"):
    if isinstance(file, dict):
        return written(file, form, tmp_path)
    name, write = file
    path = tmp_path / name
    write(path)
    return path


@pytest.mark.parametrize(("case", "form"), in_two_formats(READ))
def test_what_is_stated_is_obeyed(tmp_path, case, form):
    file, wrenches = READ[case]
    data = load(made(tmp_path, file, form), rate_hz=500 if "h5 dimensions" in case else None)
    assert [r.n_samples for r in data] == [len(wrench) for wrench in wrenches]
    for recording, wrench in zip(data, wrenches, strict=True):
        np.testing.assert_allclose(recording.wrench, wrench, rtol=1e-12)
        assert recording.axes == tuple(AXES)
    assert data.rate_hz == 500


@pytest.mark.parametrize(("case", "form"), in_two_formats(REFUSED))
def test_what_cannot_be_obeyed_is_refused(tmp_path, case, form):
    file, way_out = REFUSED[case]
    path = made(tmp_path, file, form)
    with pytest.raises(RecordingFileError, match=way_out):
        load(path, rate_hz=500 if path.suffix == ".npy" or "alone" in case else None)


@pytest.mark.parametrize(("case", "form"), in_two_formats(CHOSEN))
def test_options_choose(tmp_path, case, form):
    file, options, wrenches = CHOSEN[case]
    data = load(made(tmp_path, file, form), **options)
    assert len(data) == len(wrenches)
    assert all(np.array_equal(r.wrench, wrench) for r, wrench in zip(data, wrenches, strict=True))
    assert data.rate_hz == 500


@pytest.mark.parametrize(("case", "form"), in_two_formats(CHOSEN_WRONGLY))
def test_options_that_choose_nothing_are_refused(tmp_path, case, form):
    file, options, error, message = CHOSEN_WRONGLY[case]
    with pytest.raises(error, match=message):
        load(made(tmp_path, file, form), **options)


@pytest.mark.parametrize("file", [at_500(X, labels=LABELS[::-1], material=LABELS, arr_1=LABELS)])
@pytest.mark.parametrize("label", ["material", "arr_1"])
def test_labels_are_chosen(tmp_path, file, label):
    assert load(made(tmp_path, file), label=label).y.tolist() == LABELS


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_labels_of_a_table_are_chosen(tmp_path, ending):
    path = made(tmp_path, parquet(label=["a"] * 50, material=["rice"] * 50, time=T))
    if ending == "csv":
        table, path = pq.read_table(path), tmp_path / "push.csv"
        csv_of_arrow.write_csv(table, path)
    assert load(path, label="material").y.tolist() == ["rice"]
    with pytest.raises(RecordingFileError, match=r"both mean label.* label="):
        load(path)


def test_the_class_of_pytables_is_no_label(tmp_path):
    data = load(made(tmp_path, h5_at_500(X, {"CLASS": np.bytes_("ARRAY")})))
    assert data.labels == ()


def test_what_pandas_keeps_of_attrs_is_about_the_table(tmp_path):
    (push,) = load(made(tmp_path, pandas(label="rice", session="monday", dt=0.002, units={"fx": "mN"})))
    assert (push.label, push.session, push.rate_hz) == ("rice", "monday", 500)
    np.testing.assert_allclose(push.wrench[:, :2], W[:, :2] * [1e-3, 1])


def test_a_clock_that_names_its_unit_is_obeyed_however_fast(tmp_path):
    assert load(made(tmp_path, csv(T, "time_ms"))).rate_hz == 500_000
    with pytest.raises(RecordingFileError, match=r"2e-06 apart: that would be 5e\+05 Hz.*time_unit="):
        load(made(tmp_path, csv(T / 1000)))


def test_units_of_other_axes_are_kept(tmp_path):
    file = tree(X=X[..., :2], fs=500, axes=["force", "depth"], units=["mN", "mm"])
    (first, *_) = load(made(tmp_path, file))
    assert (first.axes, dict(first.meta["units"])) == (("force", "depth"), {"force": "mN", "depth": "mm"})


@pytest.mark.parametrize(
    ("names", "labels"),
    [
        (["trial_01", "trial_02"], ()), (["wrench_1", "wrench_2"], ()), (["demo_0", "demo_1"], ()),
        (["rice_01", "peas_01"], ("peas", "rice")), (["speed_30/ft", "speed_60/ft"], ()),
    ],
)  # fmt: skip
def test_words_for_recordings_are_no_labels(tmp_path, names, labels):
    file = h5({name: W + i for i, name in enumerate(names)}, fs=500)
    assert load(made(tmp_path, file)).labels == labels


@pytest.mark.parametrize(
    ("path", "about", "wanted"),
    [
        ("{m}/{s}/run{i}", {}, ("{m}", "{s}")),
        ("{m}/{s}/run{i}/ft", {}, ("{m}", "{s}")),
        ("{m}/day {i}/{s}/run{i}", {}, ("{m}", "{s}")),
        ("{m}/{s}/run{i}", {"session": "x"}, ("{m}", "x")),
        ("{m}/{s}/run{i}", {"label": "x"}, ("x", None)),
        ("day {i}/{m}/{s}", {}, ("{m}", None)),
    ],
)
def test_outer_groups_are_labels_and_inner_ones_sessions(tmp_path, path, about, wanted):
    places = [{"m": m, "s": s, "i": i} for i in range(2) for m in ("rice", "peas") for s in ("slow", "fast")]
    data = load(made(tmp_path, h5({path.format(**place): (W, about) for place in places}, fs=500)))
    found = {(r.label, r.session) for r in data}
    assert found == {tuple(text and text.format(**place) for text in wanted) for place in places}
