"""Recordings as a model takes them: its axes, rate and length, its rest before the motion."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id._core import FeatureSpec, Model
from granular_id.identifier import Identifier, cropped_to_model
from granular_id.recording import Dataset, Recording

N, RATE = 20, 100.0


def model(lead_s=0.05, n_samples=N, crops=()):
    """Of recordings that were cropped from these triggers, one after the other."""
    spec = FeatureSpec(rate_hz=RATE, cutoff_hz=20.0, hfmh=False)
    history = [{"step": "align", "parameters": {"trigger": trigger}} for trigger in crops]
    trained = {"history": [{"step": "load", "parameters": {}}, *history]}
    metadata = {"lead_s": "" if lead_s is None else repr(lead_s), "trained": json.dumps(trained)}
    coef = np.random.default_rng(0).normal(size=(1, 6 * n_samples))
    return Model(spec, coef, [0.0], [[1], [-1]], ["a", "b"], n_samples=n_samples, metadata=metadata)


def recording(n, trigger=None, **fields):
    wrench = np.random.default_rng(n).normal(size=(n, 6))
    return Recording(wrench, trigger_index=trigger, **{"rate_hz": RATE, "name": f"r{n}", **fields})


def test_recordings_of_the_length_are_taken_as_they_are():
    data = Dataset([recording(N), recording(N, trigger=1)])
    assert cropped_to_model(data, model()) is data
    assert cropped_to_model(data, model(lead_s=None)) is data


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(5, 10)), min_size=1, max_size=4))
def test_longer_ones_begin_at_the_trigger_less_the_lead(sizes):
    data = Dataset([recording(N + more, trigger) for more, trigger in sizes])
    short = [more < trigger - 5 for more, trigger in sizes if more]
    if any(short):
        with pytest.raises(ValueError, match="is too short"):
            cropped_to_model(data, model())
        return
    for (more, trigger), before, after in zip(sizes, data, cropped_to_model(data, model()), strict=True):
        start = trigger - 5 if more else 0
        assert np.array_equal(after.wrench, before.wrench[start : start + N])


def test_a_stated_beginning_comes_first():
    data = Dataset([recording(30, trigger=8), recording(N, trigger=8)])
    first = cropped_to_model(data, model(), begin_at="first")
    assert np.array_equal(first[0].wrench, data[0].wrench[:N])
    (kept,) = cropped_to_model(data, model(), begin_at="trigger", lead_s=0.02, on_short="skip")
    assert np.array_equal(kept.wrench, data[0].wrench[6:26])
    with pytest.raises(ValueError, match="'r20' is too short"):
        cropped_to_model(data, model(), begin_at="trigger")


def test_longer_ones_begin_at_the_first_sample_where_the_training_did():
    data = Dataset([recording(30, trigger=8), recording(N)])
    cropped = cropped_to_model(data, model(lead_s=None, crops=[None, None]))
    assert [r.wrench.tolist() for r in cropped] == [r.wrench[:N].tolist() for r in data]
    assert cropped.history[-1].notes == ("begins at the first sample, as in the training",)
    assert cropped.history[-1].totals["dropped_samples"] == 10
    for core, lead_s in (
        (model(crops=[None]), None),  # all had the same lead, whatever cropped them
        (model(lead_s=None, crops=[None]), 0.05),
    ):
        assert np.array_equal(cropped_to_model(data, core, lead_s=lead_s)[0].wrench, data[0].wrench[3:23])
    for crops in (["recorded", None], ["given"], []):
        with pytest.raises(ValueError, match="does not know how much rest"):
            cropped_to_model(data, model(lead_s=None, crops=crops))


@pytest.mark.parametrize(
    ("data", "core", "message"),
    [
        (
            [recording(N), recording(12)],
            model(),
            r"'r12' has 12 samples \(0.12 s\), the model takes 20 .*; 1 of 2",
        ),
        ([recording(30)], model(), r"has no trigger_index: 'r30'; call .find_onsets\(\)"),
        (
            [recording(30, 9)],
            model(lead_s=None),
            "'r30' has 30 samples, the model takes 20, and does not know",
        ),
        ([recording(30, 2)], model(), "begins 3 samples too late for the lead"),
    ],
)
def test_what_does_not_fit_is_refused(data, core, message):
    with pytest.raises(ValueError, match=message):
        cropped_to_model(Dataset(data), core)


def test_what_does_not_fit_can_be_left_out():
    data = Dataset([recording(N), recording(12), recording(30), recording(31, 9)])
    assert cropped_to_model(data[:2], model(lead_s=None), on_short="skip").names == ("r20",)
    kept = cropped_to_model(data, model(), on_short="skip")
    assert kept.names == ("r20", "r31")
    assert {row["name"]: row["skipped"] for row in kept.history[-1].rows if "skipped" in row}.keys() == {
        "r12",
        "r30",
    }


def test_identify_takes_whole_recordings():
    identifier = Identifier(model())
    whole = recording(30, trigger=8)
    answer = identifier.identify(whole)
    assert answer.label == identifier.predict(whole.wrench[3:23])[0]
    assert answer.final
    assert identifier.identify(whole.wrench[3:23]).ranking == answer.ranking
    from_first = identifier.identify(whole, begin_at="first")
    assert from_first.ranking == identifier.identify(whole.wrench[:N]).ranking


TWO_AXES = Recording(np.ones((N, 2)), rate_hz=100, axes=("fx", "fy"), name="x")
IRREGULAR = replace(recording(30, trigger=8), rate_hz=None, time_s=np.arange(30) / 100)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (
            recording(30, rate_hz=125.0),
            "'r30' has 125 Hz, the model was trained at 100 Hz; nothing is resampled",
        ),
        (IRREGULAR, "'r30' is sampled irregularly"),
        (TWO_AXES, "'x' has the axes fx fy; the model was"),
    ],
)
def test_identify_refuses_recordings_of_other_rates_and_axes(other, message):
    with pytest.raises(ValueError, match=message):
        Identifier(model()).identify(other)
