"""Where a push begins: against known starts, invariances, noise of many kinds."""

import re

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, norm, t

from granular_id import load
from granular_id.recording import AXES, Recording
from granular_id.recording.onset import FALSE_ALARM_RATE, _factor, find_onset as onset_of
from granular_id.synthetic import synthesize
from onset_cases import NOISE, RATE_HZ, START, noise, push


def find_onset(wrench, rate_hz, rest_s=0.1, false_alarm_rate=FALSE_ALARM_RATE, axes=None):
    names = axes or (AXES if wrench.shape[1] == 6 else [f"axis {i}" for i in range(wrench.shape[1])])
    recording = Recording(wrench, rate_hz=rate_hz, axes=names)
    return onset_of(recording, round(rest_s * rate_hz), false_alarm_rate)


@pytest.mark.parametrize(("course", "early_ms", "late_ms"), [("jump", 4, 0), ("ramp", 4, 6), ("bend", 6, 14)])
def test_where_the_change_begins(course, early_ms, late_ms):
    errors = []
    for seed in range(12):
        start = START + 7 * seed
        onset = find_onset(push(seed, start, course=course), RATE_HZ)
        errors.append(1000 * (onset.index - start) / RATE_HZ)
        assert set(onset.axes) <= {"fx", "fz", "ty"}
    assert -early_ms <= min(errors)
    assert max(errors) <= late_ms


def test_synthetic_pushes_of_all_materials():
    data = synthesize(n_per_class=3, seed=11)
    onsets = [find_onset(r.wrench, r.rate_hz) for r in data]
    errors_ms = [1000 * (o.index / r.rate_hz - r.meta["lead_s"]) for o, r in zip(onsets, data, strict=True)]
    assert max(map(abs, errors_ms)) < 16
    assert 0 < np.median(errors_ms) < 6


PLAIN = find_onset(push(2), RATE_HZ)
OWN_SCALES, OWN_ZEROS = np.array([1, 1e3, 1e-3, 7, 0.1, 1e5]), np.array([5, -700, 0.01, 0, -20, 3e4])


@pytest.mark.parametrize(
    ("scale", "offset", "order"),
    [
        *[(scale, 0.0, range(6)) for scale in (2.0**-40, -1.0, 0.2248, 1e300)],
        (OWN_SCALES, OWN_ZEROS, [5, 2, 0, 4, 1, 3]),
    ],
)
def test_units_signs_zeros_and_places_of_axes_make_no_difference(scale, offset, order):
    wrench = (push(2) * scale + offset)[:, order]
    other = find_onset(wrench, RATE_HZ, axes=[AXES[i] for i in order])
    assert (other.index, other.axes) == (PLAIN.index, PLAIN.axes)


def autocorrelated(rng, shape):
    n, n_samples, n_axes = shape
    noise = rng.standard_normal((n, n_samples + 200, n_axes))
    return lfilter([np.sqrt(0.19)], [1, -0.9], noise, axis=1)[:, 200:]


NOISES = {
    "white": lambda rng, shape: rng.standard_normal(shape),
    "autocorrelated": autocorrelated,
    "of one source": lambda rng, shape: rng.standard_normal((*shape[:2], 1)) @ np.ones((1, 6)),
    "in counts": lambda rng, shape: np.rint(
        0.3 * rng.standard_normal(shape) + rng.uniform(-1, 1, (shape[0], 1, 6))
    ),
    "drifting": lambda rng, shape: rng.standard_normal(shape) + np.linspace(0, 20, shape[1])[:, None],
}


def n_found(block, rate_hz, rest, rate):
    onsets = (find_onset(one, rate_hz, rest_s=rest / rate_hz, false_alarm_rate=rate) for one in block)
    return sum(onset.index is not None for onset in onsets)


def held(rng, shape):
    """A sensor that is slower than its messages: all axes repeat their reading."""
    reading = (rng.integers(8) + np.arange(shape[1])) // 8
    return rng.standard_normal((shape[0], reading[-1] + 1, shape[2]))[:, reading]


@pytest.mark.parametrize("kind", NOISES)
@pytest.mark.parametrize(("rate_hz", "n"), [(100, 300), (500, 100)])
def test_no_motion_gives_no_onset_but_for_the_stated_rate(kind, rate_hz, n):
    block = NOISES[kind](np.random.default_rng(1), (n, round(3.2 * rate_hz), 6))
    for rate in (0.05, 0.001):
        assert n_found(block, rate_hz, round(0.1 * rate_hz), rate) <= binom.ppf(0.999, n, rate)


def glitch_at(place, wrench=None):
    wrench = noise(7) if wrench is None else wrench
    wrench[place] += 50
    return wrench


def one_count(other_axes):
    wrench = other_axes * noise(1) * [1, 0, 0, 0, 0, 0]
    wrench[400:, 2] += 0.0044
    wrench[900:, 3] -= 0.001
    return wrench


TOO_SHORT = "too short: {} samples, 80 wanted (50 at rest and 30 to compare)"


@pytest.mark.parametrize(
    ("wrench", "why"),
    [
        *[(glitch_at(place), "no ") for place in (20, 60, 300, 1590)],
        (one_count(other_axes=0), "no "),
        (one_count(other_axes=1), "no "),
        (np.full((1600, 6), 3.3), "no axis ever changes"),
        (np.clip(noise() / NOISE, -1, 1) * 1.79e308, "no "),
        *[(noise(0, n), TOO_SHORT.format(n)) for n in (1, 2, 10, 79)],
        (noise(0, 80), "no change stands out from the noise of the first 0.1 s"),
    ],
)
def test_what_is_no_motion(wrench, why):
    onset = find_onset(wrench, RATE_HZ)
    assert onset.index is None
    assert onset.why.startswith(why)


def coarser_than_any_noise():
    wrench = np.rint((20 * push(10) - 19 * noise(10)) / 0.5) * 0.5
    assert (wrench[:80] == 0).all()
    return wrench


@pytest.mark.parametrize(
    ("wrench", "start", "early", "late"),
    [
        (glitch_at((slice(200, 209), 1), push(8, 400)), 400, 5, 5),
        (push(11, 2000, n_samples=3000) + np.arange(3000)[:, None] / RATE_HZ * 5 * NOISE, 2000, 5, 5),
        (coarser_than_any_noise(), START, 1, 20),
        (push(14) * 1e307 / 5, START, 3, 3),
        (push(14) * 1e-307 / 5, START, 3, 3),
    ],
)
def test_what_does_not_hide_the_motion(wrench, start, early, late):
    assert start - early <= find_onset(wrench, RATE_HZ).index <= start + late


@pytest.mark.parametrize("rate_hz", [10.0, 62.5, 1000.0, 10000.0])
def test_any_rate(rate_hz):
    start = round(1.5 * rate_hz)
    wrench = push(12, start, n_samples=round(3 * rate_hz), rate_hz=rate_hz, course="jump")
    onset = find_onset(wrench, rate_hz, rest_s=1.0)
    assert abs(onset.index - start) <= max(1, 0.006 * rate_hz)


@pytest.mark.parametrize("n_axes", [1, 2, 12])
def test_any_number_of_axes(n_axes):
    wrench = np.tile(push(13, course="jump")[:, :1], n_axes)
    wrench += np.random.default_rng(0).normal(0, 0.02, (1600, n_axes))
    onset = find_onset(wrench, RATE_HZ)
    assert abs(onset.index - START) <= 2
    assert set(onset.axes) == {f"axis {i}" for i in range(n_axes)}


def test_real_recordings_that_start_in_motion(data_dir):
    from granular_id.io import load

    data = load(data_dir / "sliding_wrench" / "mat07").resample(100, max_gap_s=None).find_onsets()
    rows = data.history[-1].rows
    assert sum(row["how"] == "found" for row in rows) < 0.05 * len(rows)
    assert sum(row.get("why", "").startswith("no abrupt change, though ") for row in rows) > 0.95 * len(rows)


@pytest.mark.parametrize(("dof", "n_tests"), [(3, 10), (3, 200), (8, 19), (20, 50)])
def test_no_more_than_the_stated_rate_lies_above_the_factor(dof, n_tests):
    """All tests share one estimate of the noise: the upper point of a studentised maximum, by simulation."""
    rng = np.random.default_rng(dof)
    largest = np.abs(rng.standard_normal((20_000, n_tests))).max(axis=1)
    above = (largest / np.sqrt(rng.chisquare(dof, 20_000) / dof) > _factor(dof, 0.05, n_tests)).mean()
    assert 0.01 < above < 0.055
    assert _factor(dof, 0.01, 1) == pytest.approx(t.isf(0.005, dof))
    assert _factor(1e9, 0.01, n_tests) == pytest.approx(norm.isf(0.01 / n_tests / 2), rel=1e-4)


def test_a_rest_of_few_readings_is_refused_with_one_that_will_do():
    wrench = held(np.random.default_rng(2), (1, 320, 6))[0]
    wrench[160:] += 50
    onset = find_onset(wrench, 100)
    assert re.search(r"new values at 12\.5 Hz only, .* rest_s=0\.4 or more is wanted", onset.why)
    assert abs(find_onset(wrench, 100, rest_s=0.4).index - 160) <= 8
    assert find_onset(wrench, 100, rest_s=0.39).index is None


def test_readings_that_were_resampled_are_still_held():
    wrench = held(np.random.default_rng(3), (1, 320, 6))[0]
    time = np.arange(320) + 0.3 * np.sin(np.arange(320))
    again = np.stack([np.interp(np.arange(320), time, axis) for axis in wrench.T], axis=1)
    assert re.search("new values at 1[24]", find_onset(again, 100).why)


@pytest.fixture(scope="module")
def windows(data_dir):
    """Rests of 3.2 s."""
    rests = [r.wrench for r in load(data_dir / "sand_press") if r.label == "rest"]
    return [rest[i : i + 320] for rest in rests for i in range(0, len(rest) - 319, 320)]


@pytest.mark.parametrize("rest_s", [0.1, 0.5, 1.0])
def test_real_rests_have_no_onset(windows, rest_s):
    """31 recordings; of 0.001 each, one or more in 3 %. Held readings as independent samples: 13 at 0.1 s."""
    assert len(windows) == 31
    assert n_found(windows, 100, round(100 * rest_s), 1e-3) == 0
    assert n_found(windows, 100, round(100 * rest_s), 0.05) <= 3
