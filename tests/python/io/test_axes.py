"""Other sensors: which columns or arrays are the axes, their units, and what was recorded in one go."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from granular_id.io import RecordingFileError, load, save, save_csv
from granular_id.recording import AXES, Dataset, Recording

IMU = ("wx", "wy", "wz", "ax", "ay", "az")
UNITS = dict.fromkeys(IMU[:3], "rad/s") | dict.fromkeys(IMU[3:], "m/s2")
STAMPS = np.arange(8) / 100
SAMPLES = np.random.default_rng(7).normal(size=(8, 6)).round(4)


def table(names, values=SAMPLES, separator=","):
    rows = np.column_stack([STAMPS, values]).tolist()
    return "\n".join(
        [separator.join(("time", *names)), *(separator.join(map(repr, row)) for row in rows), ""]
    )


def csv(folder, names=IMU, name="drive.csv", **how):
    (folder / name).write_text(table(names, **how), encoding="utf-8")
    return folder / name


def units_of(data):
    return dict(data[0].meta.get("units", {}))


# -- tables

NAMED = {
    "as they are called": IMU,
    "in large letters": [name.upper() for name in IMU],
    "with units": [f"{axis} [{UNITS[axis]}]" for axis in IMU],
    "with units in round brackets": [f"{axis} ({UNITS[axis]})" for axis in IMU],
}


@pytest.mark.parametrize("name", NAMED)
def test_axes_choose_and_order_columns(tmp_path, name):
    data = load(csv(tmp_path, NAMED[name]), axes="az,wx", units=("m/s2", "rad/s"))
    assert data.axes == ("az", "wx")
    assert data.X[0].tolist() == SAMPLES[:, [5, 0]].tolist()
    assert units_of(data) == {"az": "m/s2", "wx": "rad/s"}
    assert data.rate_hz == 100
    assert any("columns that are not read" in note for note in data.history[-1].notes)


@pytest.mark.parametrize("separator", [";", "\t", " ", "|"])
def test_axes_of_tables_with_other_separators(tmp_path, separator):
    assert load(csv(tmp_path, separator=separator), axes=IMU).X[0].tolist() == SAMPLES.tolist()


def test_columns_that_mean_forces_elsewhere_are_not_taken_for_them(tmp_path):
    names = ("mx", "my", "mz", "fx", "Force X", "T")  # a magnetometer, two forces, a temperature
    data = load(csv(tmp_path, names), axes="mx,my,mz,fx", units="uT,uT,uT,N")
    assert data.X[0].tolist() == SAMPLES[:, :4].tolist()
    assert units_of(data) == {"mx": "uT", "my": "uT", "mz": "uT"}


def test_forces_are_chosen_by_what_they_mean(tmp_path):
    data = load(csv(tmp_path, ("Force_X [mN]", "b", "F_z [mN]", "Ty", "e", "f")), axes=("fz", "ty", "fx"))
    assert np.allclose(data.X[0], SAMPLES[:, [2, 3, 0]] * [1e-3, 1, 1e-3], rtol=1e-15)
    assert units_of(data) == {}


def test_a_long_table_of_another_sensor(tmp_path):
    head, *rows = table(IMU).splitlines()
    lines = [f"{head},trial,ground,day"]
    lines += [f"{row},{k // 4},{'mud' if k < 4 else 'sand'},d{k // 4}" for k, row in enumerate(rows)]
    (tmp_path / "all.csv.gz").write_bytes(gzip.compress("\n".join(lines).encode()))
    data = load(tmp_path / "all.csv.gz", axes=IMU, label="ground", session="day")
    assert data.y.tolist() == ["mud", "sand"]
    assert data.sessions.tolist() == ["d0", "d1"]
    assert data.X.reshape(8, 6).tolist() == SAMPLES.tolist()


def test_the_column_of_sessions_parts_the_recordings_of_a_long_table(tmp_path):
    head, *rows = table(IMU).splitlines()
    lines = [f"{head},ground,drive"]
    for ground, drive in (("mud", "m1"), ("mud", "m2"), ("sand", "s1")):
        lines += [f"{row},{ground},{drive}" for row in rows]
    (tmp_path / "all.csv").write_text("\n".join(lines), encoding="utf-8")
    data = load(tmp_path / "all.csv", axes=IMU, label="ground", session="drive")
    assert list(zip(data.names, data.y, data.sessions, strict=True)) == [
        ("m1", "mud", "m1"),
        ("m2", "mud", "m2"),
        ("s1", "sand", "s1"),
    ]


def test_a_parquet_table_of_another_sensor(tmp_path):
    arrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    columns = [STAMPS, *SAMPLES.T, ["d1"] * 8]
    frame = arrow.table(columns, ["time", *IMU, "day"])
    kinds = [
        field.with_metadata({"unit": UNITS[field.name]}) if field.name in UNITS else field
        for field in frame.schema
    ]
    parquet.write_table(frame.cast(arrow.schema(kinds)), tmp_path / "t.parquet")
    with pytest.raises(RecordingFileError, match=r"pass axes='wx,wy,wz,ax,ay,az'$"):
        load(tmp_path / "t.parquet")
    data = load(tmp_path / "t.parquet", axes=IMU, session="day")
    assert data.X[0].tolist() == SAMPLES.tolist()
    assert (units_of(data), data.sessions.tolist()) == (UNITS, ["d1"])


# -- the way out of a table without forces


@pytest.mark.parametrize(
    ("names", "shown"),
    [
        (IMU, "wx,wy,wz,ax,ay,az"),
        (NAMED["with units"], "wx,wy,wz,ax,ay,az"),
        (("wx [rad/s]", "wx [deg/s]", "c", "d", "e", "f"), "wx [rad/s],wx [deg/s],c,d,e,f"),
        (("fx", "fy", "fz", "tx", "ty", "tzz"), "fx,fy,fz,tx,ty,tzz"),
    ],
)
def test_a_table_without_the_six_names_the_columns_that_may_be_axes(tmp_path, names, shown):
    with pytest.raises(RecordingFileError) as refusal:
        load(csv(tmp_path, names))
    assert str(refusal.value).endswith(f"; for other axes pass axes='{shown}'")
    assert load(tmp_path / "drive.csv", axes=shown)[0].n_samples == 8


@pytest.mark.parametrize("text", ["0,1.5,2.5\n0.01,1,2\n", "time,a,b\n0,x,y\n", "time,a,b"])
def test_no_columns_are_proposed_that_hold_no_numbers_or_have_no_names(tmp_path, text):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(RecordingFileError) as refusal:
        load(tmp_path / "x.csv")
    assert "axes=" not in str(refusal.value)


# -- what is refused

REFUSED = {
    "no such column": (
        IMU,
        {"axes": "wx,speed"},
        r"no column 'speed'; there are time, wx, wy, wz, ax, ay, az$",
    ),
    "two units of one": (
        ("wx [rad/s]", "wx [deg/s]", "c", "d", "e", "f"),
        {"axes": "wx"},
        r"'wx \[rad/s\]' and 'wx \[deg/s\]' may both be 'wx'",
    ),
    "one column, two names": (("fx", *IMU[1:]), {"axes": "fx,FX"}, "names column 'fx' twice"),
    "the clock as an axis": (IMU, {"axes": "time,wx"}, "axes names 'time', which means something else"),
    "another unit": (
        NAMED["with units"],
        {"axes": IMU, "units": "deg/s,m/s2"},
        r"unit of wx is 'rad/s' in the file, and units= states 'deg/s'",
    ),
    "a unit of no force": (
        ("fx", *IMU[1:]),
        {"axes": "fx", "units": "m/s2"},
        "units= states 'm/s2' of fx; wanted N",
    ),
    "another unit of force": (
        ("fx [kN]", *IMU[1:]),
        {"axes": "fx", "units": "mN"},
        r"two units of fx: kN .* and mN \(units=\)",
    ),
    "a unit too many": (IMU, {"axes": IMU, "units": "a,b,c,d"}, r"units has 4 for 6 axes \(wx, wy, wz, ax"),
    "units that do not divide six": (
        AXES,
        {"units": "N,N,N m,N m"},
        r"drive.csv.*: units has 4 for 6 axes \(fx, fy",
    ),
    "minutes": (("time (min)", *IMU[1:]), {"axes": "wy"}, "unit of column 'time"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_axes_and_units_that_do_not_fit(tmp_path, name):
    names, options, problem = REFUSED[name]
    with pytest.raises(ValueError, match=problem):
        load(csv(tmp_path, names), **options)


@pytest.mark.parametrize(
    ("options", "error", "problem"),
    [
        ({"axes": 3}, TypeError, "axes must be texts, got int"),
        ({"axes": ()}, ValueError, "axes is empty"),
        ({"axes": "wx,,wy"}, ValueError, r"axes\[1\] is empty"),
        ({"axes": "wx,wx"}, ValueError, "names one twice"),
        ({"units": [1]}, TypeError, r"units\[0\] must be a str"),
        ({"window_s": 0}, ValueError, "window_s must be positive"),
        ({"hop_s": 1}, ValueError, "hop_s is the way from one window to the next: give window_s too"),
        ({"session": ""}, ValueError, "session is empty"),
    ],
)
def test_options_that_are_none(tmp_path, options, error, problem):
    with pytest.raises(error, match=problem):
        load(csv(tmp_path), **options)


# -- units


def test_units_of_forces_are_converted_where_the_file_does_not_state_them(tmp_path):
    data = load(csv(tmp_path, AXES), units="mN,N mm")
    assert np.allclose(data.X[0], SAMPLES * 1e-3, rtol=1e-15)
    assert units_of(data) == {}


def test_units_of_forces_that_the_file_states_are_converted_to_those_asked_for(tmp_path):
    data = load(csv(tmp_path, ("fx [mN]", *IMU[1:])), axes="fx", units="N")
    assert np.allclose(data.X[0], SAMPLES[:, :1] * 1e-3, rtol=1e-15)


@pytest.mark.parametrize("unit", ["m/s^2", "m/s\N{SUPERSCRIPT TWO}", "m / s2"])
def test_one_unit_in_two_ways_of_writing(tmp_path, unit):
    assert units_of(load(csv(tmp_path, (f"ax [{unit}]", *IMU[1:])), axes="ax", units="m/s2")) == {
        "ax": "m/s2"
    }


def test_columns_that_are_clocks_elsewhere_may_be_axes(tmp_path):
    data = load(csv(tmp_path, ("t", "sec", *IMU[2:])), axes=("sec", "t"))
    assert data.X[0].tolist() == SAMPLES[:, [1, 0]].tolist()
    assert data.rate_hz == 100


def test_units_of_arrays_with_names_of_their_own(tmp_path):
    np.savez(tmp_path / "x.npz", X=SAMPLES[:, :3], axes=np.array(IMU[:3]), fs=100)
    assert units_of(load(tmp_path / "x.npz", units="rad/s")) == dict.fromkeys(IMU[:3], "rad/s")
    with pytest.raises(RecordingFileError, match=r"x.npz.*: units has 2 for 3 axes \(wx, wy, wz\)"):
        load(tmp_path / "x.npz", units="rad/s,m/s2")


def test_units_that_nobody_states_are_not_guessed(tmp_path):
    assert units_of(load(csv(tmp_path), axes=IMU)) == {}


# -- arrays


@pytest.mark.parametrize("named", [False, True])
def test_axes_of_arrays(tmp_path, named):
    beside = {"axes": np.array(IMU)} if named else {}
    np.savez(tmp_path / "x.npz", imu=np.stack([SAMPLES] * 3), fs=100, **beside)
    data = load(tmp_path / "x.npz", axes=IMU, units="rad/s,m/s2")
    assert (data.axes, data.X.shape, units_of(data)) == (IMU, (3, 8, 6), UNITS)
    if named:
        assert load(tmp_path / "x.npz", axes="az,wx").X[2].tolist() == SAMPLES[:, [5, 0]].tolist()


def test_axes_of_vectors_with_their_names(tmp_path):
    np.savez(tmp_path / "x.npz", t=STAMPS, **dict(zip(("b", *IMU[1:]), SAMPLES.T, strict=True)))
    assert load(tmp_path / "x.npz", axes="az,wy").X[0].tolist() == SAMPLES[:, [5, 1]].tolist()


def test_vectors_in_groups_of_a_label_and_a_drive(tmp_path):
    axes = dict(zip(IMU, SAMPLES.T, strict=True))
    drives = {
        f"{ground}/drive_{k}/{name}": each
        for ground in ("mud", "sand")
        for k in (1, 2)
        for name, each in axes.items()
    }
    np.savez(tmp_path / "x.npz", fs=100, **drives)
    data = load(tmp_path / "x.npz", axes=IMU)
    assert data.y.tolist() == ["mud", "mud", "sand", "sand"]
    assert data.X[3].tolist() == SAMPLES.tolist()


@pytest.mark.parametrize("name", ["imu", "a"])
def test_arrays_of_other_sensors_say_that_axes_name_them(tmp_path, name):
    np.savez(tmp_path / "x.npz", fs=100, **{name: SAMPLES[:, : 6 if name == "imu" else 4]})
    with pytest.raises(RecordingFileError, match=r"of another sensor (pass )?axes= with"):
        load(tmp_path / "x.npz")


def test_an_unnamed_array_of_another_width(tmp_path):
    np.save(tmp_path / "x.npy", SAMPLES[:, :3])
    assert load(tmp_path / "x.npy", rate_hz=100, axes="wx,wy,wz").X[0].tolist() == SAMPLES[:, :3].tolist()
    assert load(tmp_path / "x.npy", rate_hz=100, axes="fx,fy,fz").axes == AXES[:3]


def test_forces_of_an_unnamed_wrench(tmp_path):
    np.save(tmp_path / "x.npy", SAMPLES)
    assert load(tmp_path / "x.npy", rate_hz=100, axes="fz,tx").X[0].tolist() == SAMPLES[:, [2, 3]].tolist()


def test_two_arrays_of_other_sensors_are_no_materials(tmp_path):
    np.savez(tmp_path / "x.npz", gyro=SAMPLES[:, :3], acc=SAMPLES[:, 3:], fs=100)
    with pytest.raises(RecordingFileError, match="'gyro' and 'acc' may all be the recordings; pass array="):
        load(tmp_path / "x.npz", axes="ax,ay,az")
    data = load(tmp_path / "x.npz", axes="ax,ay,az", array="acc")
    assert data.X[0].tolist() == SAMPLES[:, 3:].tolist()


# -- formats that state their axes themselves


@pytest.mark.parametrize("name", ["csv", "npz", "parquet"])
def test_axes_of_own_files(tmp_path, name):
    pytest.importorskip("pyarrow" if name == "parquet" else "numpy")
    path = tmp_path / ("x.npz" if name == "npz" else "x")
    one = Recording(SAMPLES, rate_hz=100, axes=IMU, label="mud", meta={"units": UNITS, "day": "d1"})
    save(Dataset([one]), path, name)
    data = load(path, axes="az,wx", units="m/s2,rad/s", session="day")
    assert data.X[0].tolist() == SAMPLES[:, [5, 0]].tolist()
    assert data.sessions.tolist() == ["d1"]
    with pytest.raises(RecordingFileError, match=r"axes: there is no column 'q'; there are"):
        load(path, axes="q")
    with pytest.raises(RecordingFileError, match="units= states"):
        load(path, axes="wx", units="deg/s")


def test_units_of_own_files_that_have_none(tmp_path):
    path = save(Dataset([Recording(SAMPLES, rate_hz=100, axes=IMU)]), tmp_path / "x.npz")
    assert units_of(load(path, units="rad/s,m/s2")) == UNITS


# -- writing CSV


def test_csv_of_another_sensor_says_its_axes_and_units(tmp_path):
    data = Dataset([Recording(SAMPLES, rate_hz=100, axes=IMU, label="mud", meta={"units": UNITS})])
    folder = save_csv(data, tmp_path / "drives")
    assert load(folder) == data
    (file,) = folder.glob("mud/*.csv")
    assert file.read_text().startswith(
        "time,wx [rad/s],wy [rad/s],wz [rad/s],ax [m/s2],ay [m/s2],az [m/s2]\n"
    )
    assert units_of(load(file, axes=IMU)) == UNITS


def test_csv_of_wrenches_is_written_as_ever(tmp_path):
    folder = save_csv(
        Dataset([Recording(SAMPLES, rate_hz=100, label="mud", meta={"units": {"fx": "N"}})]), tmp_path / "a"
    )
    assert (
        (folder / "index.csv")
        .read_text()
        .startswith("file,label,session,start_time,rate_hz,trigger_index,name,meta\n")
    )
    assert (folder / "mud" / "mud_1.csv").read_text().startswith("time,fx,fy,fz,tx,ty,tz\n")


@pytest.mark.parametrize("axis", ["a,b", '"a"', "time", "label"])
def test_axes_that_cannot_stand_in_a_head(tmp_path, axis):
    with pytest.raises(
        ValueError, match="cannot stand in line 1 of a CSV file; name it otherwise, or save npz"
    ):
        save_csv(Dataset([Recording(SAMPLES[:, :2], rate_hz=100, axes=(axis, "x"))]), tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_an_index_states_the_axes_of_other_peoples_files(tmp_path):
    csv(tmp_path)
    (tmp_path / "index.csv").write_text('file,label,axes\ndrive.csv,mud,"wz, ax"\n')
    assert load(tmp_path).X[0].tolist() == SAMPLES[:, [2, 3]].tolist()
    (tmp_path / "index.csv").write_text('file,label,axes\ndrive.csv,mud,"[]"\n')
    with pytest.raises(RecordingFileError, match=r"line 2, column axes: '\[\]' is no list of names"):
        load(tmp_path)


# -- sessions


@pytest.fixture
def drives(tmp_path):
    for ground in ("mud", "sand"):
        (tmp_path / ground).mkdir()
        for k in (1, 2):
            csv(tmp_path / ground, name=f"drive_{k}.csv")
    return tmp_path


@pytest.mark.parametrize(
    ("session", "expected"),
    [
        (None, [None] * 4),
        ("file", ["mud/drive_1.csv", "mud/drive_2.csv", "sand/drive_1.csv", "sand/drive_2.csv"]),
        ("folder", ["mud", "mud", "sand", "sand"]),
    ],
)
def test_sessions_by_place(drives, session, expected):
    data = load(drives, axes=IMU, session=session)
    assert data.sessions.tolist() == expected
    assert data.y.tolist() == ["mud", "mud", "sand", "sand"]


@pytest.mark.parametrize("session", ["file", "folder"])
def test_the_session_of_a_single_file(drives, session, monkeypatch):
    monkeypatch.chdir(drives / "mud")
    assert (
        load("drive_1.csv", axes=IMU, session=session)[0].session
        == {"file": "drive_1.csv", "folder": "mud"}[session]
    )


def test_sessions_by_a_column_of_the_index(drives):
    lines = ["file,label,Day,session", "mud/drive_1.csv,mud,d1,a", "sand/drive_2.csv,sand,,b"]
    (drives / "index.csv").write_text("\n".join(lines))
    assert load(drives, axes=IMU, session="Day").sessions.tolist() == ["d1", None]
    assert load(drives, axes=IMU, session="session").sessions.tolist() == ["a", "b"]
    assert load(drives, axes=IMU).sessions.tolist() == ["a", "b"]
    assert load(drives, axes=IMU, session="file").sessions.tolist() == ["mud/drive_1.csv", "sand/drive_2.csv"]


def test_sessions_by_the_names_of_folders(drives):
    (drives / "mud").rename(drives / "day=1")
    (drives / "sand").rename(drives / "day=2")
    assert load(drives, axes=IMU, session="day").sessions.tolist() == ["1", "1", "2", "2"]


def test_sessions_by_a_column_of_each_file(tmp_path):
    head, *rows = table(IMU).splitlines()
    (tmp_path / "x.csv").write_text(
        "\n".join([f"{head},day,part", *(f"{row},3,{k}" for k, row in enumerate(rows))])
    )
    assert load(tmp_path / "x.csv", axes=IMU, session="day")[0].session == "3"
    with pytest.raises(RecordingFileError, match=r"column part: has another value in every row"):
        load(tmp_path / "x.csv", axes=IMU, session="part")


@pytest.mark.parametrize(
    ("columns", "session", "problem"),
    [
        ("day", "week", "session='week' is no column of it; there are time, wx, wy, wz, ax, ay, az, day"),
        ("trial", "trial", "session='trial' is the column of the recording; wanted another one"),
        ("material", "material", "session='material' is the column of the label; wanted another one"),
    ],
)
def test_columns_that_are_no_sessions(tmp_path, columns, session, problem):
    head, *rows = table(IMU).splitlines()
    (tmp_path / "x.csv").write_text("\n".join([f"{head},{columns}", *(f"{row},3" for row in rows)]))
    with pytest.raises(RecordingFileError, match=problem):
        load(tmp_path / "x.csv", axes=IMU, session=session)


def test_arrays_have_sessions_by_what_is_known_of_them(tmp_path):
    np.savez(tmp_path / "x.npz", X=SAMPLES, fs=100, day="d1")
    assert load(tmp_path / "x.npz", session="day")[0].session == "d1"
    with pytest.raises(RecordingFileError, match=r"session='week' is no column of it, .* \(meta: day\)"):
        load(tmp_path / "x.npz", session="week")


# -- windows while loading


def test_windows_while_loading(drives):
    data = load(drives, axes=IMU, window_s=0.03, hop_s=0.02)
    assert data.X.shape == (4 * 3, 3, 6)
    assert len(set(data.sessions)) == 4
    assert [step.step for step in data.history] == ["load", "windows"]


def test_windows_while_loading_need_a_rate(tmp_path):
    text = table(IMU).replace("\n0.03,", "\n0.034,")
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(
        ValueError, match=r"window_s=0.02: 1 of 1 recording is irreg.*\.resample\(rate_hz\) and \.windows"
    ):
        load(tmp_path / "x.csv", axes=IMU, window_s=0.02)


@pytest.mark.parametrize("axes", ["tx,ty,tz,fx,fy,fz", "ax,ty,tz,fx,fy,fz"])
def test_unnamed_columns_have_the_axes_that_are_named(tmp_path, axes):
    X = np.tile(np.arange(6.0), (4, 50, 1))
    np.savez(tmp_path / "pushes.npz", X=X, y=[0, 0, 1, 1], fs=100)
    one = load(tmp_path / "pushes.npz", axes=axes)[0]
    stands = dict(zip(one.axes, one.wrench[0].tolist(), strict=True))
    assert stands == dict(zip(axes.split(","), range(6), strict=True))


def test_other_numbers_of_axes_than_columns_are_told(tmp_path):
    np.savez(tmp_path / "pushes.npz", X=np.zeros((4, 50, 6)), y=[0, 0, 1, 1], fs=100)
    with pytest.raises(
        RecordingFileError, match=r"axes= names 3, wanted an array with an axis of that length"
    ):
        load(tmp_path / "pushes.npz", axes="a,b,c")


def test_a_session_is_no_axis(tmp_path):
    with pytest.raises(RecordingFileError, match=r"session='wx' is one of the axes; wanted another column"):
        load(csv(tmp_path), axes=IMU, session="wx")


def test_files_shorter_than_a_window_are_left_out_where_asked(tmp_path):
    for name, n in (("a_1", 40), ("b_1", 400)):
        rows = np.column_stack([np.arange(n) / 100, np.zeros((n, 6))])
        np.savetxt(
            tmp_path / f"{name}.csv", rows, delimiter=",", header="time,fx,fy,fz,tx,ty,tz", comments=""
        )
    with pytest.raises(ValueError, match=r"'a_1.csv' is shorter than a window: .* pass on_error='skip'"):
        load(tmp_path, window_s=1)
    assert set(load(tmp_path, window_s=1, on_error="skip").labels) == {"b"}
