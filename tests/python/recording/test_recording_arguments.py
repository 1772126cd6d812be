"""Odd arguments of the steps: the message names the argument; lengths and axes in unusual places."""

import numpy as np
import pytest

from granular_id.recording import Dataset, Recording


def recording(name, n_samples=20, **fields):
    wrench = np.random.default_rng(n_samples).normal(size=(n_samples, 6))
    return Recording(wrench, rate_hz=100, name=name, label="rice", **fields)


@pytest.fixture(scope="module")
def data():
    return Dataset([recording("a", trigger_index=10), recording("b", 30, trigger_index=10)])


@pytest.mark.parametrize("value", [5, 1.5, b"rice", [1, "rice"], [["rice"]], object()])
@pytest.mark.parametrize("argument", ["labels", "sessions", "names", "axes"])
def test_texts_are_wanted(data, argument, value):
    with pytest.raises(TypeError, match=rf"^{argument} must be a str or a sequence of str|^{argument}\["):
        data.select(**{argument: value})


def test_axes_of_a_numpy_array(data):
    assert data.select(axes=np.array(["fz", "fx"])).axes == ("fz", "fx")
    with pytest.raises(TypeError, match="axes must be a sequence of names, got ndarray"):
        Recording(np.zeros((5, 2)), rate_hz=100, axes=np.array(["a", "b"]))


@pytest.mark.parametrize("index", [None, True])
def test_what_is_no_index(data, index):
    with pytest.raises(TypeError, match="indices"):
        data[index]


def test_concatenate_wants_data_sets():
    with pytest.raises(TypeError, match="datasets must be a sequence of Dataset, got int"):
        Dataset.concatenate(5)


def test_the_shortest_of_those_that_have_the_lead():
    early = recording("early", 8, trigger_index=1)
    data = Dataset([early, recording("a", trigger_index=10), recording("b", 30, trigger_index=10)])
    aligned = data.align("shortest", trigger="recorded", lead_s=0.05, on_short="skip")
    assert aligned.names == ("a", "b")
    assert aligned.X.shape == (2, 15, 6)


def test_a_lead_that_no_recording_has_is_said():
    data = Dataset([recording("a", trigger_index=1), recording("b", trigger_index=2)])
    for n_samples in ("shortest", 4):
        with pytest.raises(ValueError, match=r"none of the 2 recordings has the lead before its trigger"):
            data.align(n_samples, trigger="recorded", lead_s=0.05, on_short="skip")


@pytest.mark.parametrize(
    ("step", "argument"),
    [
        (lambda d: d.resample(1e12), "rate_hz"),
        (lambda d: d.resample(100, max_gap_s=-1), "max_gap_s"),
        (lambda d: d.resample(100, on_gap="x"), "on_gap"),
        (lambda d: d.find_onsets(rest_s=0.001, replace=True), "rest_s"),
        (lambda d: d.find_onsets(false_alarm_rate=0.9), "false_alarm_rate"),
        (lambda d: d.find_onsets(overrule={"no such": 1}), "overrule"),
        (lambda d: d.align(10, lead_s=0.1), "lead_s"),
        (lambda d: d.align(10, trigger=[1]), "trigger"),
        (lambda d: d.align(0), "n_samples"),
        (lambda d: d.check(sensor_range=-1.0), "sensor_range"),
        (lambda d: d.check(sensor_range="unheard of"), "sensor_range"),
    ],
)
def test_an_error_about_an_argument_holds_and_begins_with_its_name(data, step, argument):
    with pytest.raises(ValueError, match=f"^{argument}") as error:
        step(data)
    assert error.value.argument == argument
