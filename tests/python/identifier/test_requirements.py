"""Recordings as a model takes them: its axes, rate and length, its rest before the motion."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from granular_id.identifier.requirements import Requirements
from granular_id.recording import AXES, Dataset, Recording

N, RATE = 20, 100.0


def takes(lead_s=0.05, *, at_first=False):
    return Requirements(N, RATE, AXES, ("N", "N", "N", "N m", "N m", "N m"), {}, lead_s, at_first)


def recording(n, trigger=None, **fields):
    wrench = np.random.default_rng(n).normal(size=(n, 6))
    return Recording(wrench, trigger_index=trigger, **{"rate_hz": RATE, "name": f"r{n}", **fields})


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(5, 10)), min_size=1, max_size=4))
def test_crop_of_longer_ones_begins_at_trigger_less_lead(sizes):
    data = Dataset([recording(N + more, trigger) for more, trigger in sizes])
    short = [more < trigger - 5 for more, trigger in sizes if more]
    if any(short):
        with pytest.raises(ValueError, match="is too short"):
            takes().crop(data)
        return
    cropped = takes().crop(data)
    assert cropped is data or any(more for more, _ in sizes)
    for (more, trigger), before, after in zip(sizes, data, cropped, strict=True):
        start = trigger - 5 if more else 0
        assert np.array_equal(after.wrench, before.wrench[start : start + N])


def test_crop_begins_at_first_sample_where_training_did():
    data = Dataset([recording(30, trigger=8), recording(N)])
    cropped = takes(None, at_first=True).crop(data)
    assert [r.wrench.tolist() for r in cropped] == [r.wrench[:N].tolist() for r in data]
    assert cropped.history[-1].notes == ("begins at the first sample, as in the training",)
    assert cropped.history[-1].totals["dropped_samples"] == 10
    # All had the same lead, whatever cropped them.
    assert np.array_equal(takes(at_first=True).crop(data)[0].wrench, data[0].wrench[3:23])


def test_crop_without_a_lead_says_what_to_call():
    data = Dataset([recording(30, trigger=8), recording(N)])
    with pytest.raises(ValueError, match=r"how much rest .* Dataset\.align\(20\)"):
        takes(None).crop(data)
    assert takes(None).crop(data.align(N)).X.shape == (2, N, 6)


@pytest.mark.parametrize(
    ("data", "known", "message"),
    [
        ([recording(N), recording(12)], takes(), r"'r12' has 12 samples .*, the model takes 20 .*; 1 of 2"),
        ([recording(12)], takes(), r"1 of 1 recording is shorter$"),
        ([recording(30)], takes(), r"has no trigger_index: 'r30'; call .find_onsets\(\)"),
        ([recording(30, 2)], takes(), "begins 3 samples too late for the lead"),
    ],
)
def test_crop_of_what_does_not_fit_is_refused(data, known, message):
    with pytest.raises(ValueError, match=message):
        known.crop(Dataset(data))


TWO_AXES = Recording(np.ones((N, 2)), rate_hz=100, axes=("fx", "fy"), name="x")
MORE_AXES = Recording(np.ones((N, 7)), rate_hz=100, axes=(*AXES, "pz"), name="x")
IRREGULAR = replace(recording(30, trigger=8), rate_hz=None, time_s=np.arange(30) / 100)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (recording(30, rate_hz=125.0), "'r30' has 125 Hz, the model was trained at 100 Hz"),
        (IRREGULAR, r"'r30' is sampled irregularly.*call \.resample\(100\)"),
        (TWO_AXES, "'x' has the axes fx fy; the model was trained on fx fy fz tx ty tz$"),
        (MORE_AXES, r"the model was trained on fx fy fz tx ty tz: call \.select\(axes="),
    ],
)
def test_check_refuses_other_rates_and_axes(other, message):
    with pytest.raises(ValueError, match=message):
        takes().check(Dataset([other]))
