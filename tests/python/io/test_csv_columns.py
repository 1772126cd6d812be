"""What names of columns mean: each alias once, and what is refused with its reason."""

import pytest
from hypothesis import given, strategies as st

from granular_id.io.columns import _FACTORS, ColumnError, axis_of, columns_of, factor, refusal
from granular_id.recording import AXES

KNOWN = {
    "fx": "fx Fx FX F_x f.x f-x force_x Force.X forceX wrench.force.x field.force.x field.wrench.force.x wrench_fx "
    "/ft_sensor/wrench/force/x wrench/force/x Fx_N fx/N|fx [N]|Fx (N)| fx |Force X [newton]|fx[n]",
    "fy": "fy force_y",
    "fz": "fz wrench.force.z",
    "tx": "tx t_x mx M_x torque_x moment_x tau_x Tx_Nm mx_n_m wrench.torque.x /ft/wrench/torque/x|tx [N m]|tx [Nm]|"
    "Mx (N*m)|tx [N\N{MIDDLE DOT}m]|Torque x [N.m]|tx [newton metres]",
    "ty": "ty my tauy",
    "tz": "tz mz momentZ",
    "time": "t time Time TIMESTAMP time_stamp stamp seconds sec __time time_s t_s time_sec timestamp_seconds|time [s]|"
    "Time (sec)|t s|time stamp|T [s]",
    "flags": "flags Flags",
}


@pytest.mark.parametrize("axis", KNOWN)
def test_what_is_known(axis):
    words, *spaced = KNOWN[axis].split("|")
    for name in (*words.split(), *spaced):
        assert axis_of(name) == axis, name


OTHER_UNITS = "fx_mN|fx [mN]|Fx (kN)|fz_lbf|force_x_V|fx [Nm]|fx []|tx_Nmm|mx [mNm]|tx [N]|tx [N/m]|time_ms"


def test_other_units_are_named():
    for name in [*OTHER_UNITS.split("|"), "t (\N{MICRO SIGN}s)", "stamp_ns", "flags [1]"]:
        assert axis_of(name) is None
        assert refusal(name).startswith(f"the unit of column {name!r} is ")


@pytest.mark.parametrize(
    ("name", "quantity", "taken"),
    [
        ("fx [kg]", "N", "N, mN, kN, lbf or kgf (kilograms-force)"),
        ("tx [kgf mm]", "N m", "N m, mN m, kN m, N mm or lbf in"),
        ("time [min]", "s", "s, ms, us or ns"),
    ],
)
def test_a_refused_unit_comes_with_every_unit_that_is_taken(name, quantity, taken):
    assert refusal(name).endswith(f"; wanted {taken}; convert other values first")
    units = taken.partition(" (")[0].replace(" or ", ", ").split(", ")
    assert {factor(unit, quantity) for unit in units} == set(_FACTORS[quantity])


UNCERTAIN = (
    "x ts %time temperature f force fx2 fxy f_wrench_x setpoint/force/x bias.fx field.header.stamp my_fx"
)


def test_what_is_not_certain_is_unknown_endless_names_at_once():
    for name in ["", *UNCERTAIN.split()]:
        assert axis_of(name) is None
        assert refusal(name).startswith(f"unknown column {name!r}; wanted fx, fy")
    for name in ["a" * 5000, "[" * 5000, " _" * 3000 + "x", "/" * 5000 + "wrench"]:
        assert axis_of(name) is None
        assert len(refusal(name)) < 300


WRENCH = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]


def test_columns_in_any_order():
    found = columns_of([*reversed(WRENCH), "t"])
    assert found == {"tz": 0, "ty": 1, "tx": 2, "fz": 3, "fy": 4, "fx": 5, "time": 6}


@pytest.mark.parametrize(
    ("names", "index"),
    [
        ([*WRENCH, "fx"], 6),
        ([*WRENCH, "force_x"], 6),
        (["t", "stamp", *WRENCH], 1),
        (WRENCH[:5], None),
        ([*WRENCH[:5], "temp"], 5),
        ([*WRENCH, "T"], 6),  # time, torque or temperature
        ([*WRENCH, "time_min"], 6),
        ([*WRENCH, "id", "trial"], 7),
    ],
)
def test_sets_of_columns_that_make_no_recording(names, index):
    with pytest.raises(ColumnError) as caught:
        columns_of(names)
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


@given(st.text("fxyztmNs[]() _./-\N{MICRO SIGN}\0\n", max_size=20))
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
    assert columns_of([name.replace("kgf", "N").replace("N mm", "N m") for name in names])  # meant anyway
