"""Resampling: a stated method, nothing made up without a mark."""

import re
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.signal import resample_poly

from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.recording.resampling import MAX_SAMPLES, repair_time, uniform_rate

# whole microseconds: stamps as loggers write them, and differences that do not vanish in rounding
steps_us = st.lists(st.integers(100, 300_000), min_size=1, max_size=40)
rates = st.sampled_from([1.0, 7.3, 50.0, 100.0, 333.3, 500.0])


def times_of(steps):
    return np.concatenate([[0], np.cumsum(steps)]) / 1e6


def resampled(recording, rate, **how):
    return Dataset([recording]).resample(rate, **{"max_gap_s": None, **how})[0]


def straight_line_twin(times, values, rate):
    """Interpolate one sample at a time, the way one would on paper."""
    result = []
    for k in range(int(np.floor(times[-1] * rate + 1e-9)) + 1):
        t = k / rate
        i = max(i for i in range(len(times)) if times[i] <= t)
        if i == len(times) - 1:
            result.append(values[i])
        else:
            part = (t - times[i]) / (times[i + 1] - times[i])
            result.append(values[i] * (1 - part) + values[i + 1] * part)
    return np.array(result)


@given(steps=steps_us, rate=rates, seed=st.integers(0, 1000))
def test_linear_is_the_straight_line_between_neighbours(steps, rate, seed):
    """Constants stay exactly what they are; nothing is extrapolated, and less than a step is lost."""
    times = times_of(steps)
    wrench = np.random.default_rng(seed).normal(size=(len(times), 6))
    wrench[:, :2] = 1 / 3, -7.7
    out = resampled(Recording(wrench, time_s=times), rate)
    np.testing.assert_allclose(out.wrench, straight_line_twin(times, wrench, rate), rtol=0, atol=1e-12)
    assert (out.wrench[:, :2] == wrench[0, :2]).all()
    assert out.rate_hz == rate
    assert times[-1] - 1 / rate < out.duration_s <= times[-1] + 1e-9 / rate


@given(steps=steps_us, rate=rates)
def test_flags_mark_exactly_the_samples_inside_gaps(steps, rate):
    times = times_of(steps)
    data = Dataset([Recording(np.ones((len(times), 6)), time_s=times)]).resample(rate, max_gap_s=None)
    gap = 2 * max(np.median(np.diff(times)), 1 / rate)
    expected = [any(a < t < b and b - a > gap for a, b in pairwise(times)) for t in data[0].times()]
    flags = np.zeros(len(expected)) if data[0].flags is None else data[0].flags
    assert (flags == SampleFlag.GAP_FILLED).tolist() == expected
    totals = data.history[-1].totals
    assert totals["gap_filled_samples"] == sum(expected)
    assert totals["largest_gap_s"] == np.diff(times).max()


def test_the_report_names_the_recordings_and_the_widest_gap():
    jittered = Recording(np.zeros((3, 6)), time_s=np.array([0, 1, 2.1]) / 99.5, name="jittered")
    ready = Recording(np.zeros((6, 6)), rate_hz=100, name="ready")
    holed = Recording(np.zeros((6, 6)), time_s=np.array([0, 1, 2, 3, 33, 34]) / 100, name="holed")
    out = Dataset([jittered, ready, holed]).resample(100, max_gap_s=0.5)
    report = out.history[-1]
    assert out.names == ("jittered", "ready", "holed")
    assert out[1] is ready
    totals = report.totals
    assert (totals["recordings_resampled"], totals["recordings_unchanged"]) == (2, 1)
    assert (totals["samples_before"], totals["samples_after"]) == (9, 3 + 35)
    assert (totals["gap_filled_samples"], totals["recordings_with_filled_gaps"]) == (29, 1)
    assert (totals["largest_gap_s"], totals["largest_gap_in"]) == (pytest.approx(0.3), "holed")
    assert [row["name"] for row in report.rows] == ["holed", "jittered"]
    assert report.parameters == {"rate_hz": 100.0, "method": "linear", "max_gap_s": 0.5, "on_gap": "raise"}


def test_a_gap_beyond_the_limit_is_refused_or_left_out_when_told():
    holed = Recording(np.zeros((4, 6)), time_s=[0, 0.01, 0.4, 0.41], name="holed")
    data = Dataset([holed, Recording(np.zeros((4, 6)), rate_hz=100, name="sound")])
    with pytest.raises(
        ValueError, match=re.escape("'holed' has a gap of 0.39 s after sample 1 (at 0.010 s)")
    ):
        data.resample(100)
    worse = Recording(np.zeros((2, 6)), time_s=[0, 0.7], name="worse")
    many = "2 of 3 recordings have such gaps, the largest 0.7 s"
    with pytest.raises(ValueError, match=f"'holed' .*beyond max_gap_s=0.25; {many}: raise max_gap_s"):
        Dataset([*data, worse]).resample(100)
    for unlimited in (None, np.inf):
        report = data.resample(100, max_gap_s=unlimited).history[-1]
        assert report.parameters["max_gap_s"] is None
    out = data.resample(100, on_gap="skip")
    assert out.names == ("sound",)
    assert out.history[-1].rows == ({"name": "holed", "skipped": "gap of 0.39 s"},)
    assert data.resample(100, max_gap_s=0.4).names == ("holed", "sound")
    with pytest.raises(ValueError, match="each of 1 recording has gaps beyond"):
        data[:1].resample(100, on_gap="skip")


def test_flags_trigger_and_names_carry_over():
    about = {"label": "rice", "session": "a", "start_time": 5.0, "meta": {"a": 1}, "name": "n"}
    flags = [0, 0, SampleFlag.SATURATED, 0, 0]
    times = [0, 0.1, 0.2, 0.35, 0.4]
    out = resampled(Recording(np.zeros((5, 6)), time_s=times, trigger_index=3, flags=flags, **about), 20)
    assert {name: getattr(out, name) for name in about} == about
    assert out.trigger_index == 7
    # at 0.15 and 0.25 and 0.30 the saturated sample is a neighbour; at 0.2 it is the sample itself
    assert out.flags.tolist() == [0, 0, 0, 2, 2, 2, 2, 0, 0]


def test_faster_sampling_is_said_to_fold_back():
    data = Dataset([Recording(np.zeros((50, 6)), rate_hz=500)])
    assert "content above 50 Hz folds back" in data.resample(100).history[-1].notes[0]
    assert data.resample(1000).history[-1].notes == ()
    assert data.resample(100, "polyphase").history[-1].notes == ()


@pytest.mark.parametrize(
    ("rate_in", "rate_out"), [(500, 100), (100, 500), (500, 200), (62.5, 500), (500, 500 / 3)]
)
def test_polyphase_is_scipys_cut_to_what_was_measured(rate_in, rate_out):
    wrench = np.random.default_rng(3).normal(size=(400, 6)) + 5
    ratio = Fraction(rate_out / rate_in).limit_denominator(100)
    out = resampled(Recording(wrench, rate_hz=rate_in), rate_out, method="polyphase")
    n = int(np.floor(399 / rate_in * rate_out + 1e-9)) + 1
    expected = resample_poly(wrench, ratio.numerator, ratio.denominator, axis=0, padtype="line")[:n]
    np.testing.assert_array_equal(out.wrench, expected)
    assert out.n_samples == n


def test_polyphase_keeps_constants_and_removes_what_would_fold_back():
    t = np.arange(2000) / 500
    wrench = np.column_stack(
        [np.full(2000, 3.0), 1 + 2 * t, *(np.sin(2 * np.pi * f * t) for f in (5, 80, 120, 200))]
    )
    out = resampled(Recording(wrench, rate_hz=500), 100, method="polyphase").wrench[50:-50]
    np.testing.assert_allclose(out[:, 0], 3.0, rtol=1e-12)
    assert np.ptp(out[:, 1]) > 1
    assert np.abs(out[:, 2]).max() == pytest.approx(1, abs=0.01)
    assert np.abs(out[:, 3:]).max() < 0.01


@pytest.mark.parametrize(
    ("how", "error", "message"),
    [
        ({"rate_hz": 0}, ValueError, "rate_hz must be positive"),
        ({"rate_hz": np.nan}, ValueError, "rate_hz must be finite"),
        ({"rate_hz": "100"}, TypeError, "rate_hz must be a number"),
        ({"rate_hz": 1e12}, ValueError, f"at most {MAX_SAMPLES} are made"),
        ({"rate_hz": 1e308}, ValueError, f"at most {MAX_SAMPLES} are made"),
        ({"method": "cubic"}, ValueError, "method='cubic'; wanted 'linear' or 'polyphase'"),
        ({"max_gap_s": 0}, ValueError, "max_gap_s must be positive"),
        ({"max_gap_s": np.nan}, ValueError, "max_gap_s must be finite"),
        ({"on_gap": "fill"}, ValueError, "on_gap='fill'"),
        ({"method": "polyphase"}, ValueError, "'irregular' is irregular: method='polyphase' needs"),
    ],
)
def test_refuses(how, error, message):
    data = Dataset([Recording(np.zeros((3, 6)), time_s=[0, 0.1, 0.22], name="irregular")])
    with pytest.raises(error, match=re.escape(message)):
        data.resample(**{"rate_hz": 50, **how})


@pytest.mark.parametrize("rate", [np.pi, 1e-9, 500.0001])
def test_polyphase_refuses_odd_ratios(rate):
    data = Dataset([Recording(np.zeros((30, 6)), rate_hz=500, name="r")])
    with pytest.raises(ValueError, match="ratio of whole numbers up to 10000; use method='linear'"):
        data.resample(rate, "polyphase")


@pytest.mark.parametrize("method", ["linear", "polyphase"])
def test_a_single_sample_stays_one(method):
    out = resampled(Recording(np.arange(6.0)[None], rate_hz=500, trigger_index=0), 100, method=method)
    np.testing.assert_allclose(out.wrench, np.arange(6.0)[None], rtol=1e-9)
    assert out.trigger_index == 0


@given(
    rate=st.sampled_from([62.5, 99.9, 100, 333.3, 500, 1000, 1 / 3, 7000]),
    n=st.integers(2, 5000),
    start=st.sampled_from([0.0, 12.5, 1.58e9]),
)
def test_uniform_stamps_give_back_their_rate(rate, n, start):
    stamps = start + np.arange(n) / rate
    found = uniform_rate(stamps - stamps[0], resolution_s=np.spacing(stamps[-1]))
    assert found is not None
    # the shortest number that fits: it may only differ by what moves the last stamp a hundredth of a step
    assert abs(found / rate - 1) <= (0.02 + 4 * np.spacing(stamps[-1]) * rate) / (n - 1)
    if n > 1000 and start < 1e8 and rate != 1 / 3:
        assert found == rate


@given(steps=st.lists(st.integers(1, 10), min_size=2, max_size=50))
def test_uneven_stamps_are_uniform_only_where_a_rate_fits(steps):
    times = np.concatenate([[0], np.cumsum(steps)]) / 100
    rate = uniform_rate(times)
    if rate is None:
        assert len(set(steps)) > 1
    else:
        assert np.abs(times - np.arange(len(times)) / rate).max() <= 0.01 / rate


@given(ticks=st.lists(st.integers(0, 12), min_size=1, max_size=30), seed=st.integers(0, 100))
def test_repaired_time_ascends_and_averages_what_shares_a_stamp(ticks, seed):
    values = np.random.default_rng(seed).normal(size=(len(ticks), 3))
    fixed = repair_time(np.array(ticks, float), values)
    assert fixed.stamps.tolist() == sorted(set(ticks))
    for stamp, row, touched in zip(fixed.stamps, fixed.values, fixed.touched, strict=True):
        same = [i for i, tick in enumerate(ticks) if tick == stamp]
        np.testing.assert_allclose(row, values[same].mean(axis=0), rtol=1e-12, atol=1e-12)
        late = any(max(ticks[: i + 1]) > stamp for i in same)
        assert touched == (len(same) > 1 or late)
    assert fixed.n_merged == len(ticks) - len(set(ticks))
    assert fixed.n_moved == sum(tick < max(ticks[: i + 1]) for i, tick in enumerate(ticks))


def test_one_stamp_has_no_rate_and_repeated_messages_come_out_unchanged():
    assert uniform_rate(np.zeros(1)) is None
    values = np.full((3, 6), 0.1)
    assert (repair_time(np.zeros(3), values).values == 0.1).all()
