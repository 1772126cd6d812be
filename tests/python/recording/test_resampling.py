"""Resampling: no frequency folds back, nothing made up without a mark; logs split at their pauses."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.interpolate import make_interp_spline
from scipy.signal import firwin

from granular_id.recording import Dataset, Recording, SampleFlag
from granular_id.recording.clock import Stamps, rate_of, time_order, uniform_rate
from granular_id.recording.columns import TableError

# whole microseconds: stamps as loggers write them, and differences that do not vanish in rounding
steps_us = st.lists(st.integers(100, 300_000), min_size=1, max_size=40)
rates = st.sampled_from([1.0, 7.3, 50.0, 100.0, 333.3, 500.0])


def times_of(steps):
    return np.concatenate([[0], np.cumsum(steps)]) / 1e6


def resampled(recording, rate, max_gap_s=None):
    return Dataset([recording]).resample(rate, max_gap_s=max_gap_s)[0]


def straight_line(times, values, rate_hz):
    at = np.arange(np.floor(times[-1] * rate_hz + 1e-9) + 1) / rate_hz
    return np.column_stack([np.interp(at, times, column) for column in values.T])


@given(steps=steps_us, rate=rates, seed=st.integers(0, 1000))
def test_a_higher_rate_is_the_straight_line_between_neighbours(steps, rate, seed):
    """Constants stay exactly what they are; nothing is extrapolated, and less than a step is lost."""
    times = times_of(steps)
    rate = max(rate, np.ceil(len(steps) / times[-1]))
    wrench = np.random.default_rng(seed).normal(size=(len(times), 6))
    wrench[:, :2] = 1 / 3, -7.7
    out = resampled(Recording(wrench, time_s=times), rate)
    np.testing.assert_allclose(out.wrench, straight_line(times, wrench, rate), rtol=0, atol=1e-12)
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
    assert out.names == ("jittered", "ready", "holed")
    assert out[1] is ready
    assert [row["name"] for row in out.history[-1].rows] == ["holed", "jittered"]
    totals = dict(out.history[-1].totals)
    assert totals.pop("largest_gap_s") == pytest.approx(0.3)
    # resampled, unchanged, skipped and low-passed; samples before, after and filled; recordings with filled gaps
    assert list(totals.values()) == [2, 1, 0, 0, 9, 3 + 35, 29, 1, "holed"]


def test_a_gap_beyond_the_limit_is_refused_or_left_out_when_told():
    holed = Recording(np.zeros((4, 6)), time_s=[0, 0.01, 0.4, 0.41], name="holed")
    worse = Recording(np.zeros((2, 6)), time_s=[0, 0.7], name="worse")
    data = Dataset([holed, Recording(np.zeros((4, 6)), rate_hz=100, name="sound")])
    many = r"a gap of 0\.39 s after sample 1 \(at 0\.010 s\).*max_gap_s=0\.25; 2 of 3 .* the largest 0\.7 s: call "
    with pytest.raises(ValueError, match=many):
        Dataset([*data, worse]).resample(100)
    assert data.resample(100, max_gap_s=None).history[-1].parameters["max_gap_s"] is None
    out = data.resample(100, on_gap="skip")
    assert out.history[-1].rows == ({"name": "holed", "skipped": "gap of 0.39 s"},)
    assert data.resample(100, max_gap_s=0.4).names == ("holed", "sound")
    assert data.split(gap_s=0.25).resample(100).names == ("holed @ 0 s", "holed @ 0.4 s", "sound")
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


def tone_left(times, rate_in, tone_hz, rate_hz):
    """Decibels of a tone that are left at another rate, away from the ends."""
    samples = np.sin(2 * np.pi * tone_hz * times + 0.3)[:, np.newaxis]
    clock = {"time_s": times - times[0]} if rate_in is None else {"rate_hz": rate_in}
    out = resampled(Recording(samples, axes=("fz",), **clock), rate_hz).wrench[30:-30]
    return 10 * np.log10(2 * np.mean(np.square(out)) + 1e-12)


@pytest.mark.parametrize("rate_in", [500.0, 1000.0, 512.3, 7000.0])
@pytest.mark.parametrize("rate_hz", [400.0, 333.3, 250.0, 100.0, 62.5])
def test_no_tone_above_half_the_new_rate_is_left(rate_in, rate_hz):
    times = np.arange(8 * rate_in) / rate_in
    for part in (1.05, 1.2, 1.5, 2.0, 2.7, 4.0):
        if (tone := part * rate_hz / 2) < 0.49 * rate_in:
            assert tone_left(times, rate_in, tone, rate_hz) < -50
    for part in (0.1, 0.5, 0.75):
        assert abs(tone_left(times, rate_in, part * rate_hz / 2, rate_hz)) < 0.3


@pytest.mark.parametrize("jitter", [0.01, 0.05, 0.1])
@pytest.mark.parametrize("rate_hz", [500.0, 333.3, 100.0])
def test_no_tone_is_left_of_jittered_stamps(jitter, rate_hz):
    times = (np.arange(8000) + np.random.default_rng(1).uniform(-jitter, jitter, 8000)) / 1000
    tones = [part * rate_hz / 2 for part in (1.05, 1.3, 1.6, 2.4, 4.0, 8.0)]
    for tone in (*(tone for tone in tones if tone <= 400), 420, 440, 460, 480):
        assert tone_left(times, None, tone, rate_hz) < -40
    assert abs(tone_left(times, None, 0.37 * rate_hz, rate_hz)) < 0.1


@pytest.mark.parametrize(("rate_in", "rate_out", "up", "down"), [(500, 100, 1, 5), (500, 200, 2, 5)])
def test_uniform_rows_are_filtered_as_by_hand(rate_in, rate_out, up, down):
    """Zeros between the samples, a symmetric window over a line beyond the ends, each `down`-th taken."""
    wrench = np.random.default_rng(3).normal(size=(400, 6)) + 5
    window = firwin(24 * down + 1, 0.925 / down, window=("kaiser", 4.5))
    for phase in range(up):
        window[phase::up] /= window[phase::up].sum()
    ends = np.arange(-100, 500)
    line = wrench[0] + ends[:, np.newaxis] / 399 * (wrench[-1] - wrench[0])
    stuffed = np.zeros((600 * up, 6))
    stuffed[::up] = np.where(((ends < 0) | (ends > 399))[:, np.newaxis], line, wrench[ends.clip(0, 399)])
    filtered = np.column_stack([np.convolve(column, window, "same") for column in stuffed.T])
    out = resampled(Recording(wrench, rate_hz=rate_in), rate_out)
    np.testing.assert_allclose(out.wrench, filtered[100 * up :: down][: out.n_samples], atol=1e-12)
    assert out.n_samples == np.floor(399 / rate_in * rate_out + 1e-9) + 1


def test_jittered_rows_go_through_a_curve_and_lines_in_gaps():
    """A straight line over a gap, as where nothing is filtered; what a spline gives of a low frequency elsewhere."""
    rng = np.random.default_rng(5)
    times = (np.arange(3000) + rng.uniform(-0.2, 0.2, 3000)) / 1000
    times -= times[0]
    keep = (np.arange(3000) < 1500) | (np.arange(3000) > 1700)
    force = np.sin(2 * np.pi * 20 * times[keep])[:, np.newaxis]
    out = resampled(Recording(force, time_s=times[keep], axes=("fz",)), 250.0)
    assert (out.flags == SampleFlag.GAP_FILLED).sum() == pytest.approx(50, abs=2)
    middle = (out.times() > 1.55) & (out.times() < 1.65)
    np.testing.assert_allclose(np.diff(out.wrench[middle, 0], 2), 0, atol=1e-3)
    curve = make_interp_spline(times[:1500], force[:1500, 0], k=7)(out.times()[30:300])
    np.testing.assert_allclose(out.wrench[30:300, 0], curve, atol=3e-3)


def test_bursts_of_stamps_are_not_swung_through_and_said():
    rng = np.random.default_rng(2)
    times = np.cumsum(np.where(np.arange(8000) % 4 == 0, 3.7e-3, 0.1e-3))
    bursts = Recording(rng.normal(size=(8000, 1)), time_s=times - times[0], axes=("fz",), name="bursts")
    data = Dataset([bursts]).resample(500, max_gap_s=None)
    assert abs(data[0].wrench).max() < 4
    assert "1 recording has too uneven stamps" in data.history[-1].notes[0]


@pytest.mark.parametrize("rate_hz", [500.02, 490.0, 500.0, 501.0])
def test_a_rate_close_to_the_own_one_is_not_filtered(rate_hz):
    wrench = np.random.default_rng(0).normal(size=(200, 6))
    out = resampled(Recording(wrench, rate_hz=500), rate_hz)
    line = straight_line(np.arange(200) / 500, wrench, rate_hz)
    np.testing.assert_allclose(out.wrench, line, atol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 5, 12, 60])
@pytest.mark.parametrize("is_uniform", [True, False])
def test_few_samples_are_resampled_too(n, is_uniform):
    clock = {"rate_hz": 500} if is_uniform else {"time_s": np.arange(n) ** 1.01 / 500}
    out = resampled(Recording(np.ones((n, 6)), trigger_index=0, **clock), 100)
    np.testing.assert_allclose(out.wrench, np.ones((out.n_samples, 6)), rtol=1e-9)
    assert out.trigger_index == 0


ROUND = st.sampled_from([62.5, 99.7, 100, 333.3, 500, 512, 1000, 1 / 3, 7000])


@given(rate=ROUND, n=st.integers(2, 5000), start=st.sampled_from([0.0, 12.5, 1.58e9]))
def test_uniform_stamps_give_back_their_rate(rate, n, start):
    stamps = start + np.arange(n) / rate
    found = uniform_rate(stamps - stamps[0], resolution_s=np.spacing(stamps[-1]))
    assert found is not None
    # the shortest number that fits: it may only differ by what moves the last stamp a hundredth of a step, or is round
    near = (0.02 + 4 * np.spacing(stamps[-1]) * rate) / (n - 1)
    assert abs(found / rate - 1) <= max(near, 0.001 + 1e-9)
    if n > 1000 and start < 1e8 and rate != 1 / 3:
        assert found == rate


@given(rate=st.sampled_from([125, 300, 400, 512, 700]), n=st.integers(300, 2000), first=st.integers(0, 999))
def test_rate_of_rounded_stamps_is_that_before_rounding(rate, n, first):
    time_s = np.round(first / 1000 + np.arange(n) / rate, 3)
    found, remark = rate_of(Stamps(time_s - time_s[0], first / 1000, 1e-16), None, None)
    assert abs(found / rate - 1) <= 0.001 + 0.002 / time_s[-1]
    assert remark is None or "rounded to 1 ms" in remark


def test_rate_of_jittered_stamps_in_milliseconds_is_unknown():
    steps = np.random.default_rng(0).choice([0.001, 0.002, 0.003], 1000)
    assert rate_of(Stamps(np.concatenate([[0], steps.cumsum()]), 0.0, 0.0), None, None) == (None, None)


@given(steps=st.lists(st.integers(1, 10), min_size=2, max_size=50))
def test_uneven_stamps_are_uniform_only_where_a_rate_fits(steps):
    times = np.concatenate([[0], np.cumsum(steps)]) / 100
    rate = uniform_rate(times)
    if rate is None:
        assert len(set(steps)) > 1
    else:
        assert np.abs(times - np.arange(len(times)) / rate).max() <= 0.01 / rate + 1e-3 * times[-1]


@given(ticks=st.lists(st.integers(0, 12), min_size=1, max_size=30))
def test_time_order_sorts_merges_equal_rows_and_averages_none(ticks):
    stamps, values = np.array(ticks, float), np.arange(float(len(ticks)))[:, None]
    stated = time_order(stamps, values, rate_stated=True, repair=True)
    assert stamps[stated.rows].tolist() == sorted(ticks)
    assert stated.n_moved == sum(tick < max(ticks[: i + 1]) for i, tick in enumerate(ticks))
    equal = time_order(stamps, stamps[:, None], rate_stated=False, repair=True)
    assert stamps[equal.rows].tolist() == sorted(set(ticks))
    assert equal.n_merged == len(ticks) - len(set(ticks))
    if len(set(ticks)) < len(ticks):
        with pytest.raises(TableError, match="packets"):
            time_order(stamps, values, rate_stated=False, repair=True)
    if ticks != sorted(ticks):
        with pytest.raises(TableError, match="time runs back"):
            time_order(stamps, values, rate_stated=True, repair=False)


def test_rates_near_a_round_figure_are_that_figure():
    rates = {500.02: 500, 1000.9: 1000, 62.47: 62.5, 33.02: 33, 0.2501: 0.25, 333.3: 333.3, 501.0: 501.0}
    assert {rate: uniform_rate(np.arange(20_000) / rate) for rate in rates} == rates


def log_with_pauses(pauses=(30.0, 45.0), n=200, **fields):
    starts = np.concatenate([[0.0], np.cumsum(np.array(pauses) + n / 500)])
    times = np.concatenate([start + np.arange(n) / 500 for start in starts])
    wrench = np.random.default_rng(4).normal(size=(len(times), 6))
    return Recording(wrench, **{"time_s": times, "label": "rice", "name": "log", **fields})


def test_split_makes_a_recording_of_each_stretch():
    flags = np.zeros(600, np.uint8)
    flags[450] = SampleFlag.SATURATED
    log = log_with_pauses(start_time=1e9, trigger_index=250, flags=flags, meta={"tool": "rod"})
    data = Dataset([log]).split(1)
    assert data.names == ("log @ 0 s", "log @ 30.4 s", "log @ 75.8 s")
    assert np.concatenate([r.wrench for r in data]).tobytes() == log.wrench.tobytes()
    assert {r.rate_hz for r in data} == {500.0}
    assert [r.trigger_index for r in data] == [None, 50, None]
    assert [r.flags is not None and int(r.flags.nonzero()[0][0]) for r in data] == [False, False, 50]
    np.testing.assert_allclose(data.start_times - 1e9, [0, 30.4, 75.8], atol=1e-6)
    assert {(r.label, r.session, r.meta["tool"]) for r in data} == {("rice", None, "rod")}
    assert dict(data.history[-1].totals) == {"recordings_before": 1, "recordings_after": 3}


@given(steps=steps_us, gap=st.sampled_from([0.05, 0.2]))
def test_split_leaves_no_gap_and_loses_no_sample(steps, gap):
    times = times_of(steps)
    recording = Recording(np.arange(6.0 * len(times)).reshape(-1, 6), time_s=times)
    parts = Dataset([recording]).split(gap)
    assert np.concatenate([r.wrench for r in parts]).tobytes() == recording.wrench.tobytes()
    for part in parts:
        assert np.diff(part.times()).max(initial=0) <= gap * (1 + 1e-6)
    assert len(parts) == 1 + sum(step > gap for step in np.diff(times))


def test_split_keeps_what_has_no_gap_and_refuses_what_is_none():
    sound = [log_with_pauses(()), Recording(np.zeros((5, 6)), rate_hz=0.1, session="s")]
    assert list(Dataset(sound).split(1)) == sound
    with pytest.raises(ValueError, match="gap_s"):
        Dataset(sound).split(0)
