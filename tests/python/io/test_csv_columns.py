"""What names of columns mean: each alias once, and what is refused with its reason."""

import pytest
from hypothesis import given, strategies as st

from granular_id.io.columns import ColumnError, axis_of, columns_of, refusal
from granular_id.recording import AXES

KNOWN = {
    "fx": "fx Fx FX F_x f.x f-x force_x Force.X forceX 'wrench.force.x' field.force.x field.wrench.force.x wrench_fx "
    "/ft_sensor/wrench/force/x wrench/force/x Fx_N fx/N",
    "fy": "fy force_y",
    "fz": "fz wrench.force.z",
    "tx": "tx t_x mx M_x torque_x moment_x tau_x Tx_Nm mx_n_m wrench.torque.x /ft/wrench/torque/x",
    "ty": "ty my tauy",
    "tz": "tz mz momentZ",
    "time": "t time Time TIMESTAMP time_stamp stamp seconds sec __time time_s t_s time_sec timestamp_seconds",
    "flags": "flags Flags",
}
SPACED = {
    "fx": ["fx [N]", "Fx (N)", " fx ", "Force X [newton]", "fx[n]"],
    "tx": [
        "tx [N m]",
        "tx [Nm]",
        "Mx (N*m)",
        "tx [N\N{MIDDLE DOT}m]",
        "Torque x [N.m]",
        "tx [newton metres]",
    ],
    "time": ["time [s]", "Time (sec)", "t s", "time stamp", "T [s]"],
}
CASES = [
    *((name.strip("'"), axis) for axis, names in KNOWN.items() for name in names.split()),
    *((name, axis) for axis, names in SPACED.items() for name in names),
]


@pytest.mark.parametrize(("name", "axis"), CASES)
def test_what_is_known(name, axis):
    assert axis_of(name) == axis


@pytest.mark.parametrize(
    ("name", "unit", "wanted"),
    [
        ("fx_mN", "mN", "N"),
        ("fx [mN]", "mN", "N"),
        ("Fx (kN)", "kN", "N"),
        ("fz_lbf", "lbf", "N"),
        ("force_x_V", "V", "N"),
        ("fx [Nm]", "Nm", "N"),
        ("fx []", "", "N"),
        ("tx_Nmm", "Nmm", "N m"),
        ("mx [mNm]", "mNm", "N m"),
        ("tx [N]", "N", "N m"),
        ("tx [N/m]", "N/m", "N m"),
        ("time_ms", "ms", "s"),
        ("timestamp [us]", "us", "s"),
        ("t (\N{MICRO SIGN}s)", "\N{MICRO SIGN}s", "s"),
        ("stamp_ns", "ns", "s"),
        ("flags [1]", "1", "none"),
    ],
)
def test_other_units_are_named(name, unit, wanted):
    assert axis_of(name) is None
    assert refusal(name).startswith(f"the unit of column {name!r} is {unit!r}; wanted {wanted}")


UNCERTAIN = (
    "x ts %time temperature f force fx2 fxy f_wrench_x setpoint/force/x bias.fx field.header.stamp my_fx"
)


@pytest.mark.parametrize("name", ["", *UNCERTAIN.split()])
def test_what_is_not_certain_is_unknown(name):
    assert axis_of(name) is None
    assert refusal(name).startswith(f"unknown column {name!r}; wanted fx, fy")


@pytest.mark.parametrize("name", ["a" * 5000, "[" * 5000, " _" * 3000 + "x", "/" * 5000 + "wrench"])
def test_endless_names_are_unknown_at_once(name):
    assert axis_of(name) is None
    assert len(refusal(name)) < 300


def test_a_capital_t_is_three_things():
    assert axis_of("T") is None
    assert refusal("T") == "column 'T' may be time, torque or temperature; wanted a name that says which"


WRENCH = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]


def test_columns_in_any_order():
    assert columns_of([*reversed(WRENCH), "t"]) == {
        "tz": 0,
        "ty": 1,
        "tx": 2,
        "fz": 3,
        "fy": 4,
        "fx": 5,
        "time": 6,
    }


@pytest.mark.parametrize(
    ("names", "problem", "index"),
    [
        ([*WRENCH, "fx"], "column 'fx' occurs twice", 6),
        ([*WRENCH, "force_x"], "columns 'Fx' and 'force_x' both mean fx; wanted one of them", 6),
        (["t", "stamp", *WRENCH], "columns 't' and 'stamp' both mean time; wanted one of them", 1),
        (WRENCH[:5], "column 'tz' is missing; wanted fx, fy, fz, tx, ty, tz", None),
        ([*WRENCH[:5], "temp"], "unknown column 'temp'; wanted fx", 5),
        ([*WRENCH, "T"], "column 'T' may be time, torque or temperature", 6),
        ([*WRENCH, "time_min"], "the unit of column 'time_min' is 'min'", 6),
        ([*WRENCH, "id", "trial"], "columns 'id' and 'trial' both mean recording", 7),
    ],
)
def test_sets_of_columns_that_make_no_recording(names, problem, index):
    with pytest.raises(ColumnError) as caught:
        columns_of(names)
    assert caught.value.problem.startswith(problem)
    assert caught.value.index == index


def test_other_columns_are_left_out_and_those_about_recordings_found():
    names = ["seq", *WRENCH, "pos", "Trial ID", "material", "Session", "ts"]
    found = columns_of(names)
    assert {what: names[i] for what, i in found.items() if what not in AXES} == {
        "recording": "Trial ID",
        "label": "material",
        "session": "Session",
    }
    rates = ("rate_hz", "fs", "Sampling Rate (Hz)", "sample_rate_kHz")
    assert [columns_of([*WRENCH, name])["rate"] for name in rates] == [6] * 4
    assert columns_of([f"actual_TCP_force_{i}" for i in range(6)]) == {axis: i for i, axis in enumerate(AXES)}


@given(st.text(max_size=40) | st.text("fxyztmNs[]() _./-", max_size=20))
def test_any_name_is_known_or_refused(name):
    assert axis_of(name) in {*KNOWN, None}
    if axis_of(name) is None:
        assert refusal(name)


@pytest.mark.parametrize(
    ("names", "silent"),
    [
        (["Fx [kgf]", "Fy", "Fz", "Tx", "Ty", "Tz"], "Fy"),
        (["Fx", "Fy", "Fz", "Tx", "Ty", "Tz (N mm)"], "Tx"),
    ],
)
def test_a_unit_of_some_forces_or_torques_alone_is_refused(names, silent):
    with pytest.raises(ColumnError, match=f"and column '{silent}' none; wanted that of each"):
        columns_of(names)
    columns_of(
        [name.replace("kgf", "N").replace("(N mm)", "[N m]") for name in names]
    )  # what is meant anyway
