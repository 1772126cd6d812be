"""``Recording``: checked once, frozen afterwards."""

import copy
import pickle

import numpy as np
import pytest

from granular_id.recording import Dataset, Recording, SampleFlag, common_units, same_unit, unit_of

WRENCH = np.arange(24.0).reshape(4, 6)


def test_keeps_what_it_was_given():
    r = Recording(
        WRENCH.astype(np.float32),
        rate_hz=500,
        label="rice",
        session="monday",
        start_time=1.5e9,
        trigger_index=2,
        meta={"tool": "cylinder", "speed_m_s": 0.03, "frame": [1, 2]},
        flags=[0, 1, 0, 8],
        name="rice_01",
    )
    assert r.wrench.dtype == np.float64
    np.testing.assert_array_equal(r.wrench, WRENCH)
    assert (r.rate_hz, r.label, r.session) == (500.0, "rice", "monday")
    assert (r.start_time, r.trigger_index, r.name) == (1.5e9, 2, "rice_01")
    assert r.meta == {"tool": "cylinder", "speed_m_s": 0.03, "frame": (1, 2)}
    assert r.flags.tolist() == [0, 1, 0, SampleFlag.TIME_REPAIRED]
    assert (r.n_samples, r.duration_s) == (4, 3 / 500)
    np.testing.assert_array_equal(r.times(), np.arange(4) / 500)
    assert repr(r) == "Recording('rice_01', label='rice', 4 samples at 500 Hz)"
    one = Recording(WRENCH[:1, :2], time_s=[0], axes=["a", "b"])
    assert repr(one) == "Recording('', label=None, 1 samples irregular, axes a b)"


@pytest.mark.parametrize(
    ("axis", "units", "unit"),
    [
        ("fx", None, "N"),
        ("tz", {}, "N m"),
        ("tz", {"tz": "N mm"}, "N mm"),
        ("wx", {"wx": "rad/s"}, "rad/s"),
        *[("wx", units, "") for units in ({"ax": "m/s2"}, None, "rad/s", {"wx": 1})],
    ],
)
def test_a_unit_is_stated_or_that_of_a_wrench_or_not_known(axis, units, unit):
    assert unit_of(axis, None if units is None else {"units": units}) == unit


def test_irregular_recording_keeps_its_stamps():
    r = Recording(WRENCH, time_s=[0, 0.1, 0.5, 0.6])
    assert r.duration_s == 0.6
    assert repr(r) == "Recording('', label=None, 4 samples irregular, 5 Hz on average)"
    assert r.times() is r.time_s


def test_changes_to_the_source_do_not_reach_it():
    source, meta = WRENCH.copy(), {"list": [1]}
    view = source.view()
    view.flags.writeable = False
    made = [Recording(given, rate_hz=1, meta=meta) for given in (source, view)]
    source[:] = 0
    meta["list"].append(2)
    for r in made:
        np.testing.assert_array_equal(r.wrench, WRENCH)
        assert r.meta == {"list": (1,)}
    source.flags.writeable = False
    assert Recording(source, rate_hz=1).wrench is source


def test_frozen_through_and_through():
    r = Recording(WRENCH, time_s=[0, 1, 2, 3], flags=[1, 0, 0, 0], meta={"a": {"b": 1}})
    for array in (r.wrench, r.time_s, r.flags):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(AttributeError):
        r.label = "x"
    with pytest.raises(TypeError):
        r.meta["a"]["b"] = 2
    with pytest.raises(TypeError, match="unhashable"):
        hash(r)


FIELDS = {
    "wrench": WRENCH,
    "time_s": [0, 1, 2, 3],
    "label": "rice",
    "session": "a",
    "start_time": 1.0,
    "trigger_index": 1,
    "meta": {"a": 1},
    "flags": [1, 0, 0, 0],
    "name": "n",
}


@pytest.mark.parametrize(
    "change",
    [
        {"wrench": WRENCH + 1},
        {"wrench": WRENCH[:3], "time_s": [0, 1, 2], "flags": None},
        {"time_s": [0, 1, 2, 4]},
        {"time_s": None, "rate_hz": 1},
        {"label": None},
        {"session": "b"},
        {"start_time": 3.0},
        {"trigger_index": 0},
        {"meta": {"a": 2}},
        {"flags": [2, 0, 0, 0]},
        {"name": "other"},
    ],
)
def test_equality_looks_at_everything(change):
    assert Recording(**FIELDS) == Recording(**copy.deepcopy(FIELDS))
    assert Recording(**FIELDS) != Recording(**{**FIELDS, **change})
    zero = Recording(WRENCH, rate_hz=1, flags=np.zeros(4, int))
    assert zero.flags is None
    assert zero == Recording(WRENCH, rate_hz=1) != "a recording"


def test_survives_pickle_and_deepcopy_frozen():
    r = Recording(WRENCH, time_s=[0, 1, 2, 3], meta={"a": {"b": [1, 2]}}, flags=[0, 0, 4, 0], label="rice")
    for twin in (pickle.loads(pickle.dumps(r)), copy.deepcopy(r)):
        assert twin == r
        assert not twin.wrench.flags.writeable
        assert not twin.time_s.flags.writeable


def test_units_in_a_row_are_those_of_the_axes():
    units = ["rad/s"] * 3 + ["m/s2"] * 3
    axes = ("wx", "wy", "wz", "ax", "ay", "az")
    recording = Recording(np.zeros((5, 6)), 100, axes=axes, meta={"units": units})
    assert [unit_of(axis, recording.meta) for axis in axes] == units


def imu(meta):
    return Recording(np.zeros((5, 3)), rate_hz=10, axes=("ax", "ay", "az"), name="imu", meta=meta)


SAME = [
    ("m/s2", "m/s^2", "m/s\N{SUPERSCRIPT TWO}", "m s^-2", "m/s/s", "[m/s**2]"),
    ("N m", "Nm", "N*m", "N-m", "N\N{MIDDLE DOT}m", "newton metre", "Newton meters"),
    ("deg/s", "\N{DEGREE SIGN}/s", "dps", "deg s-1"),
    ("mN m", "N mm", "N-mm"),
]


@pytest.mark.parametrize("unit", [spelling for spellings in SAME for spelling in spellings])
def test_units_are_the_same_however_they_are_written(unit):
    for spellings in SAME:
        for other in spellings:
            assert same_unit(unit, other) == same_unit(other, unit) == (unit in spellings)
    data = [imu(meta={"units": dict.fromkeys(("ax", "ay", "az"), one)}) for one in (unit, " ".join(unit))]
    assert common_units(Dataset(data)) == [unit] * 3


@pytest.mark.parametrize("units", [("", "rad/s", "deg/s"), ("rad/s", "", "deg/s"), ("rad/s", "deg/s", "")])
def test_recordings_of_different_units_are_refused(units):
    data = [imu(meta={"units": dict.fromkeys(("ax", "ay", "az"), unit)} if unit else {}) for unit in units]
    with pytest.raises(ValueError, match=r"has ax: rad/s, 'imu' has ax: deg/s"):
        common_units(Dataset(data))
