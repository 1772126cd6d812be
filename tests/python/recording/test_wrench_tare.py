"""The zero that the rest before the motion gives."""

from dataclasses import replace

import numpy as np
import pytest

from granular_id.recording import Dataset, Recording, Setup, rest_zero
from granular_id.synthetic import synthesize


@pytest.fixture(scope="module")
def data():
    return synthesize(["rice", "dry peas"], n_per_class=3, duration_s=0.6, seed=2)


def test_a_stream_has_the_same_bits(data):
    for tared, before in zip(data.tare(lead_s=0.1), data, strict=True):
        total = np.zeros(6)
        for sample in before.wrench[before.trigger_index - 50 : before.trigger_index]:
            total = total + sample
        streamed = np.array([sample - total / 50 for sample in before.wrench])
        assert tared.wrench.tobytes() == streamed.tobytes()


@pytest.mark.parametrize("columns", [1, 6])
def test_the_zero_does_not_depend_on_how_samples_lie(columns):
    lead = np.random.default_rng(1).normal(size=(1000, columns))
    one_by_one = np.array([rest_zero(np.ascontiguousarray(lead[:, [c]]))[0] for c in range(columns)])
    assert rest_zero(np.asfortranarray(lead)).tobytes() == rest_zero(lead).tobytes() == one_by_one.tobytes()


def test_the_metadata_say_so(data):
    tared = data.tare(lead_s=0.1)
    assert {Setup.of(recording.meta).tare for recording in tared} == {"rest"}
    assert tared.history[-1].step == "tare"
    assert tared.history[-1].rows[0]["fx"] == rest_zero(data[0].wrench[data[0].trigger_index - 50 :][:50])[0]
    assert tared[0].trigger_index == data[0].trigger_index
    chosen = data.select(axes=["fz", "fx"]).tare(lead_s=0.1)
    assert np.array_equal(chosen.X, tared.select(axes=["fz", "fx"]).X)


def test_the_default_is_the_rest_that_is_there(data):
    for tared, before, row in zip(data.tare(), data, data.tare().history[-1].rows, strict=True):
        lead = before.wrench[: before.trigger_index]
        assert np.array_equal(tared.wrench, before.wrench - rest_zero(lead))
        assert row["lead_s"] == len(lead) / 500


def test_of_a_long_rest_the_last_two_seconds_are_taken():
    wrench = np.repeat(np.arange(30.0), 10)[:, None] + np.zeros((300, 6))
    tared = Dataset([Recording(wrench, rate_hz=100, trigger_index=280)]).tare()
    assert np.array_equal(tared[0].wrench, wrench - wrench[80:280].mean())


def test_too_short_a_rest_is_refused_with_one_that_fits(data):
    short = Dataset([replace(data[0], trigger_index=40)])
    with pytest.raises(ValueError, match=r"has 0.08 s of rest .* 0.1 s are wanted; lead_s=0.08 fits all"):
        short.tare()
    assert short.tare(lead_s=0.08).history[-1].rows[0]["lead_s"] == 0.08
    other = Dataset([data[0], replace(data[1], trigger_index=None)])
    with pytest.raises(ValueError, match=r"1 recording has no trigger_index: 'rice_01'.*find_onsets"):
        other.tare(lead_s=0.1)
