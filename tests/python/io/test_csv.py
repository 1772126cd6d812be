"""Text tables: what is read, what stands in line 1 and 2, and bad files with the line of their first fault."""

import gzip
import pickle
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings, strategies as st

from effort import cases
from granular_id.io import RecordingFileError, load
from granular_id.recording import AXES

HEADER = b"time,fx,fy,fz,tx,ty,tz\n"
ROW1 = b"0.00,1.5,2,3,4,5,6\n"
ROW2 = b"0.01,1,2,3,4,5,6\n"
ROW3 = b"0.02,1,2,3,4,5,6\n"
GOOD = HEADER + ROW1 + ROW2 + ROW3
WRENCH = [[1.5, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]]


def changed(separator=",", comma=".", end="\n"):
    return GOOD.decode().replace(",", separator).replace(".", comma).replace("\n", end)


READ = {
    "plain": (GOOD, {}),
    "CR LF": (changed(end="\r\n").encode(), {}),
    "semicolons": (changed(";").encode(), {}),
    "blanks": (changed(" ").encode(), {}),
    "a line of Excel": (b"sep=;\n" + changed(";").encode(), {}),
    "decimal commas": (changed(";", ",").encode(), {"csv": {"decimal": ","}}),
    "byte order mark": (b"\xef\xbb\xbf" + GOOD, {}),
    "UTF-16": (GOOD.decode().encode("utf-16"), {}),
    "UTF-16 with a tab in the line of Excel": (
        ("sep=\t\r\n" + changed("\t", end="\r\n")).encode("utf-16"),
        {},
    ),
    "quotes and blanks": (
        b'"time", "Fx" ,fy,fz,tx,ty,tz\n' + ROW1.replace(b"1.5", b' "1.5"') + ROW2 + ROW3,
        {},
    ),
    "names of numpy.savetxt": (b"# " + GOOD, {}),
    "comments": (b"% lab 3\n% by anna\n" + GOOD, {"csv": {"comment": "%"}}),
    "names given": (GOOD.partition(b"\n")[2], {"csv": {"header": None, "names": ["time", *AXES]}}),
    "separators at the end": (GOOD.replace(b"\n", b",\n"), {}),
    "index of pandas": (
        b",fx,fy,fz,tx,ty,tz\n0,1.5,2,3,4,5,6\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n",
        {"rate_hz": 100},
    ),
    "index of dates": (
        b",fx,fy,fz,tx,ty,tz\n" + b"".join(b"2025-03-04 10:00:0%s" % row for row in (ROW1, ROW2, ROW3)),
        {},
    ),
    "a line of units": (GOOD.replace(b"\n", b"\ns,N,N,N,Nm,Nm,Nm\n", 1), {}),
    "a line of other units": (
        b"time,fx,fy,fz,tx,ty,tz\n[ms],N,N,N,N mm,N mm,N mm\n"
        b"0,1.5,2,3,4e3,5e3,6e3\n10,1,2,3,4e3,5e3,6e3\n20,1,2,3,4e3,5e3,6e3\n",
        {},
    ),
    "units and decimal commas": (
        changed(";", ",").replace("\n", "\n[s];[N];[N];[N];[Nm];[Nm];[Nm]\n", 1).encode(),
        {"csv": {"decimal": ","}},
    ),
    "units in names": (GOOD.replace(HEADER, b"time_s,fx_N,Fy [N],fz (N),Mx,my,mz\n"), {}),
    "words ahead of names": (
        b"Zeit [s],Kraft Fx [mN],Kraft Fy [mN],Kraft Fz [mN],Moment Mx [Nmm],Moment My [Nmm],Moment Mz [Nmm]\n"
        b"0,1500,2e3,3e3,4e3,5e3,6e3\n0.01,1e3,2e3,3e3,4e3,5e3,6e3\n0.02,1e3,2e3,3e3,4e3,5e3,6e3\n",
        {},
    ),
    "words of Spanish": (GOOD.replace(HEADER, b"Tiempo,Fuerza_X,Fuerza_Y,Fuerza_Z,Par_X,Par_Y,Par_Z\n"), {}),
    "couples": (GOOD.replace(HEADER, b"t,Force X,Force Y,Force Z,Couple X,Couple Y,Couple Z\n"), {}),
    "names of MATLAB": (GOOD.replace(HEADER, b"Time_s_,Fx_N_,Fy_N_,Fz_N_,Mx_Nm_,My_Nm_,Mz_Nm_\n"), {}),
    "names with paths": (GOOD.replace(HEADER, b"Time,FT/Fx,FT/Fy,FT/Fz,FT/Mx,FT/My,FT/Mz\n"), {}),
    "units of LabVIEW": (
        b"Y_Unit_Label\tmN\tmN\tmN\tN mm\tN mm\tN mm\n***End_of_Header***\nX_Value\tFx\tFy\tFz\tTx\tTy\tTz\tComment\n"
        b"0\t1500\t2e3\t3e3\t4e3\t5e3\t6e3\tgo\n0.01\t1e3\t2e3\t3e3\t4e3\t5e3\t6e3\n"
        b"0.02\t1e3\t2e3\t3e3\t4e3\t5e3\t6e3\n",
        {"csv": {"skiprows": 2}},
    ),
    "others beside": (
        GOOD.replace(b"time", b"time,valve,fz_min").replace(b"0.0", b"0.0", 1).replace(b",1", b",open,,1"),
        {},
    ),
    "flags of others": (GOOD.replace(b"time", b"flags,time").replace(b"0.0", b"1,0.0"), {}),
    "a clock beside": (GOOD.replace(b"time", b"timestamp,time").replace(b"0.0", b"99,0.0"), {}),
    "empty rows at the end": (GOOD + b"0.03,,,,,,\n", {}),
    "names with separators in quotes": (
        b'"Lab 3, time","Force, x, in N","fy","fz","tx","ty","tz"\n' + GOOD.partition(b"\n")[2],
        {"time": "Lab 3, time", "axes": ["Force, x, in N", *AXES[1:]]},
    ),
    "gzip": (gzip.compress(GOOD), {}),
}


@pytest.mark.parametrize("case", READ)
def test_tables_are_read(tmp_path, case):
    data, options = READ[case]
    file = tmp_path / ("a_1.csv.gz" if case == "gzip" else "a_1.csv")
    file.write_bytes(data)
    (recording,) = load(file, **options)
    np.testing.assert_allclose(recording.wrench, WRENCH, rtol=1e-15)
    assert recording.rate_hz == 100
    assert recording.flags is None
    assert recording.label is None
    if "axes" in options:
        return
    assert recording.meta.get("read_as") == (
        ", ".join(f"csv {key}={value!r}" for key, value in sorted(options.get("csv", {}).items())) or None
    )


@pytest.mark.parametrize(
    ("unit", "per_newton_metre"),
    [
        *(("N-mm", 1000), ("cN-m", 100), ("kgf-cm", 100 / 9.80665), ("ft-lbf", 1 / 1.3558179483314004)),
        *(("lbf-in", 1 / 0.1129848290276167), ("oz-in", 1 / 0.00706155181422604)),
    ],
)
def test_units_of_torque_are_converted(tmp_path, unit, per_newton_metre):
    rows = np.array(WRENCH) * [1, 1, 1, *[per_newton_metre] * 3]
    names = ",".join([*AXES[:3], *(f"{axis} [{unit}]" for axis in AXES[3:])])
    (tmp_path / "a.csv").write_text(
        "\n".join([names, *(",".join(map(repr, row)) for row in rows.tolist()), ""])
    )
    np.testing.assert_allclose(load(tmp_path / "a.csv", rate_hz=100)[0].wrench, WRENCH, rtol=1e-12)


def test_values_have_the_bits_that_python_reads(tmp_path):
    rng = np.random.default_rng(0)
    values = rng.normal(size=(50, 6)) * 10.0 ** rng.integers(-300, 300, (50, 6))
    rows = [",".join([repr(i / 100), *map(repr, row)]) for i, row in enumerate(values.tolist())]
    (tmp_path / "a.csv").write_text("\n".join(["time," + ",".join(AXES), *rows, ""]))
    assert load(tmp_path / "a.csv")[0].wrench.tobytes() == values.tobytes()


NO_AXES = b"time,ax,ay,az,wx,wy,wz\n" + ROW1 + ROW2 + ROW3
LATIN = GOOD.replace(b"time", b"Zeit \xe4,time").replace(b"0.0", b"x,0.0")
IN_MS = GOOD.replace(b"0.00", b"0").replace(b"0.01", b"10").replace(b"0.02", b"20")
TWO_FX = GOOD.replace(b"time", b"force_x,time").replace(b"fx", b"F_x").replace(b"0.0", b"0,0.0")
TWO_LABELS = GOOD.replace(b"time", b"class,label,time").replace(b"0.0", b"a,b,0.0")
BARE = GOOD.partition(b"\n")[2]
TWO_LINES = b"Time,Force,,,Torque,,\n,x,y,z,x,y,z\n" + BARE
SEVEN = ["time", *AXES]
DASHES = GOOD.replace(b"0.00,1.5,2,3,4,5,6", b"0.00,--,--,--,--,--,--") + b"0.03,1,2,3,4,5,6\n"


@pytest.mark.parametrize(
    ("data", "way_out", "options"),
    [
        (NO_AXES, "axes='ax,ay,az,wx,wy,wz'", {"axes": "ax,ay,az,wx,wy,wz"}),
        (TWO_LINES, f"'skiprows': 2, 'names': {SEVEN}}}", {"csv": {"header": None, "skiprows": 2, "names": SEVEN}}),
        (GOOD.decode().encode("utf-16-le"), "csv={'encoding': 'utf-16-le'}", {"csv": {"encoding": "utf-16-le"}}),
        (DASHES, "csv={'na_values': '--'}", {"csv": {"na_values": "--"}}),
        (GOOD + b"0.03,1,2,3,4,5,6,7\n", "csv={'on_bad_lines': 'skip'}", {"csv": {"on_bad_lines": "skip"}}),
        (GOOD + b"Mean,1,2,3,4,5,6\n", "csv={'skipfooter': 1}", {"csv": {"skipfooter": 1}}),
        (GOOD + b"0.03,1,2,3", "csv={'skipfooter': 1}", {"csv": {"skipfooter": 1}}),
        (GOOD.replace(b"1.5", b'"1,001.5"'), "csv={'thousands': ','}", {"csv": {"thousands": ","}}),
        (LATIN, "csv={'encoding': 'cp1252'}", {"csv": {"encoding": "cp1252"}}),
        (GOOD.replace(b"time", b"clock"), "the clock pass time='clock' (--time clock)", {"time": "clock"}),
        (IN_MS, "time_unit=", {"time_unit": "ms"}),
        (HEADER + ROW2 + ROW1 + ROW3, "on_time_error='repair'", {"on_time_error": "repair"}),
        (TWO_LABELS, "label='column:class'", {"label": "column:class"}),
        (TWO_FX, "pass axes=", {"axes": "F_x,fy,fz,tx,ty,tz"}),
    ],
)  # fmt: skip
def test_the_way_out_of_a_refusal_works(tmp_path, data, way_out, options):
    (tmp_path / "a_1.csv").write_bytes(data)
    with pytest.raises(RecordingFileError) as caught:
        load(tmp_path / "a_1.csv")
    assert any(one in str(caught.value) for one in way_out.split("|"))
    recording = load(tmp_path / "a_1.csv", **options)[0]
    assert recording.n_samples == 3


BAD = {
    "numbers without names": (b"7,1,2,3,4,5,6,0\n7,1,2,3,4,5,6,0\n", 1, None),
    "empty": (b"", None, None),
    "header only": (HEADER, 1, None),
    "no header": (ROW1 + ROW2, 1, None),
    "cut in a row": (HEADER + ROW1 + b"0.01,1,2,3", 3, None),
    "cut in an exponent": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6e", 3, "tz"),
    "a clock without a name": (b",fx,fy,fz,tx,ty,tz\n" + ROW1 + ROW2, 1, None),
    "missing column": (b"time,fx,fy,fz,tx,ty\n0,1,2,3,4,5\n", 1, None),
    "doubled column": (b"time,fx,fy,fz,tx,ty,tz,fx\n0,1,2,3,4,5,6,7\n", 1, None),
    "too many cells": (HEADER + ROW1 + b"0.01,1,2,3,4,5,6,7\n", None, None),
    "empty cell behind empty lines": (HEADER + b"\n" + ROW1 + b"\n\n0.01,1,,3,4,5,6\n", 6, "fy"),
    "empty cell": (HEADER + ROW1 + b"0.01,1,,3,4,5,6\n", 3, "fy"),
    "nan in one axis": (HEADER + ROW1 + b"0.01,nan,2,3,4,5,6\n", 3, "fx"),
    "underscores": (HEADER + b"0.00,1_000,2,3,4,5,6\n", 2, "fx"),
    "an empty stamp": (HEADER + ROW1 + b",1,2,3,4,5,6\n", 3, "time"),
    "milliseconds since 1970": (HEADER + b"1581072654215,1,2,3,4,5,6\n", 2, "time"),
    "flags out of range": (HEADER[:-1] + b",sample_flags\n0,1,2,3,4,5,6,16\n", 2, "sample_flags"),
    "units that contradict": (
        GOOD.replace(b"fx", b"fx [mN]").replace(b"\n", b"\ns,N,N,N,Nm,Nm,Nm\n", 1),
        None,
        "fx [mN]",
    ),
    "gzip cut off": (gzip.compress(GOOD)[:-12], None, None),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_tables_are_refused_by_line_and_column(tmp_path, case):
    data, line, column = BAD[case]
    file = tmp_path / ("a.csv.gz" if "gzip" in case else "a.csv")
    file.write_bytes(data)
    with pytest.raises(RecordingFileError) as caught:
        load(file, rate_hz=None if "time" in case or "stamp" in case else 100)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert str(caught.value).startswith(str(file))
    (tmp_path / "good_1.csv").write_bytes(GOOD)
    assert load(tmp_path, on_error="skip").names == ("good_1.csv",)


def test_errors_survive_pickle_and_unprintable_names():
    error = RecordingFileError(b"a\xff.csv".decode("utf-8", "surrogateescape"), "is odd", line=3, column="fx")
    assert str(error) == "a\\udcff.csv, line 3, column fx: is odd"
    twin = pickle.loads(pickle.dumps(error))
    assert (str(twin), twin.line, twin.column) == (str(error), 3, "fx")


ODD = ',|\n|\r|\0|nan|-inf|1e999|-|1_0|0x1|1e-999|"|"1"|\xff|\ufeff| |\t|\u2212|../|Fx [N]|tx_Nmm|;'
PIECES = st.sampled_from(ODD.split("|")).map(str.encode)


@st.composite
def damaged(draw, good):
    data = bytearray(good)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 8)))
        data[start:end] = draw(PIECES | st.binary(max_size=6))
    return bytes(data)


INDEX = (
    b"file,label,session,start_time,rate_hz,trigger_index,name,meta,tool\n"
    b'good.csv,rice,s1,1e9,100,1,"a, b","{""x"": [1]}",t\n'
)
ANY = {
    "suppress_health_check": [HealthCheck.function_scoped_fixture],
    "max_examples": cases(100),
    "deadline": None,
}


@given(
    data=st.binary(max_size=300) | damaged(GOOD) | damaged(INDEX),
    name=st.sampled_from(["a_1.csv", "index.csv"]),
)
@example(GOOD, "a_1.csv")
@example(INDEX, "index.csv")
@settings(**ANY)
def test_damaged_tables_are_recordings_or_one_exception(tmp_path, data, name):
    for old in tmp_path.iterdir():
        old.unlink()
    (tmp_path / "good.csv").write_bytes(GOOD)
    (tmp_path / name).write_bytes(data)
    for options in ({}, {"on_error": "skip"}, {"on_time_error": "repair"}, {"rate_hz": 100.0}):
        with suppress(RecordingFileError):
            read = load(tmp_path, **options)
            assert all(np.isfinite(recording.wrench).all() for recording in read)
            assert all((np.diff(recording.times()) > 0).all() for recording in read)


AMID = {
    "sensor error": (40, None),
    "# pause": (7, None),
    "end of log": (101, None),
    "# pause, by Ann, again": (50, "comment"),
    "Mean,1,2,3,4,5,6": (101, "skipfooter"),
    "Gain 2,1,2,3,4,5,6": (60, "is no number|skiprows"),
}


@pytest.mark.parametrize("text", AMID)
@pytest.mark.parametrize("clock", ["time", "Nr"])
def test_lines_that_are_no_samples_are_noted_or_refused(tmp_path, text, clock):
    at, problem = AMID[text]
    rows = [f"{i / 100},1,2,3,4,5,6" for i in range(100)]
    lines = [f"{clock},fx,fy,fz,tx,ty,tz", *rows]
    lines.insert(at, text)
    (tmp_path / "a_1.csv").write_text("\n".join([*lines, ""]))
    options = {} if clock == "time" else {"rate_hz": 100}
    if problem is not None:
        with pytest.raises(RecordingFileError, match=problem) as caught:
            load(tmp_path / "a_1.csv", **options)
        assert caught.value.line == at + 1
        return
    data = load(tmp_path / "a_1.csv", **options)
    assert (data[0].n_samples, data.rate_hz) == (100, 100)
    assert f"1 line of text left out, the first is line {at + 1}: '{text}'" in " ".join(
        data.history[-1].notes
    )


@pytest.mark.parametrize(
    ("names", "axes"),
    [
        ("run,a,b,c,d,e,f,pos_x,pos_y,T [degC]", "a,b,c,d,e,f"),
        ("a,b,c,d,e,f,pos_z,Temperature,z [mm],Versuch", "a,b,c,d,e,f"),
        ("ax,ay,az,wx,wy,wz,magx,magy,magz", "ax,ay,az,wx,wy,wz,magx,magy,magz"),
        ("a,b,c,d,e,f,g", None),
        ("x,y,z", "x,y,z"),
    ],
)
def test_proposed_axes_are_no_ids_positions_and_temperatures(tmp_path, names, axes):
    rows = [",".join([str(i / 100), *(f"{i % 7}.5" for _ in names.split(","))]) for i in range(20)]
    (tmp_path / "a_1.csv").write_text("\n".join([f"time,{names}", *rows, ""]))
    with pytest.raises(RecordingFileError, match="axes=") as caught:
        load(tmp_path / "a_1.csv")
    assert [way.get("axes") for way in caught.value.ways] == [axes] * (axes is not None)


def test_labels_sessions_and_ids_are_read_as_they_are_written(tmp_path):
    texts = ["007,NA,1.1", "7,1e5,1.10", "7.0,None,1.1"]
    rows = [f"{text},{i / 100},1,2,3,4,5,6" for text in texts for i in range(3)]
    (tmp_path / "a.csv").write_text("\n".join(["trial,grain,session,time,fx,fy,fz,tx,ty,tz", *rows, ""]))
    data = load(tmp_path / "a.csv", label="column:grain")
    assert data.y.tolist() == ["NA", "1e5", "None"]
    assert (data.sessions.tolist(), data.names) == (["1.1", "1.10", "1.1"], ("007", "7", "7.0"))
    with pytest.raises(RecordingFileError, match="label='grain' is the column of ids"):
        load(tmp_path / "a.csv", id="grain", label="column:grain")


@pytest.mark.parametrize("units", ["lbs", "furlong/s2", "N,lbs,N,N,N,N"])
def test_units_of_other_axes_that_are_unknown_are_refused(tmp_path, units):
    (tmp_path / "a_1.csv").write_bytes(NO_AXES)
    with pytest.raises(RecordingFileError, match="no unit that is known"):
        load(tmp_path / "a_1.csv", axes="ax,ay,az,wx,wy,wz", units=units)
    data = load(tmp_path / "a_1.csv", axes="ax,ay,az,wx,wy,wz", units="lbf,uT")
    assert "lbf stay as they are: only axes called fx to tz are converted" in data.history[-1].notes
