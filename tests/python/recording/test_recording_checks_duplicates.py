"""Copies and shared stretches are found, wherever they begin; other recordings are not."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from checks_cases import by_code, sound_set
from granular_id.recording import Dataset, Recording
from granular_id.recording.checks.copies import find_overlaps


def with_copy(data, wrench, **fields):
    copy = replace(data[5], wrench=wrench, name="copy", trigger_index=None, **fields)
    return Dataset([*data, copy])


def test_exact_copies():
    sound = sound_set()
    finding = by_code(with_copy(sound, sound[5].wrench).check())["duplicates"]
    assert finding.severity == "error"
    assert (finding.indices, finding.values["pairs"]) == ((5, 48), ((5, 48),))
    assert finding.message == "1 recording holds exactly the samples of another one"
    other = by_code(with_copy(sound, sound[5].wrench, label="peas").check())["duplicates"]
    assert other.message.endswith("some under a different label")


@pytest.mark.parametrize(
    ("change", "share", "shift"),
    [
        (lambda w, _: w[200:1400], 1.0, 200),
        (lambda w, other: np.vstack([other[:300], w[:1300]]), 1300 / 1600, -300),
        (lambda w, other: np.vstack([w[1200:], other[:1200]]), 400 / 1600, 1200),
        (lambda w, other: np.where((np.arange(1600) % 40 < 10)[:, None], other, w), 0.75, 0),
    ],
    ids=["cropped", "later", "the end of it", "most rows"],
)
def test_shared_stretches(change, share, shift):
    sound = sound_set()
    report = with_copy(sound, change(sound[5].wrench, sound[30].wrench)).check()
    finding = by_code(report)["near-duplicates"]
    pairs = {tuple(pair[:2]): pair[2:] for pair in finding.values["pairs"]}
    assert pairs[5, 48] == (shift, pytest.approx(share))
    assert finding.severity == "error"
    assert report.states[48] == report.states[5] == "error"


def test_recordings_that_only_resemble_each_other_are_left_alone():
    sound, rng = sound_set(), np.random.default_rng(0)
    near = (sound[5].wrench + rng.normal(0, 0.05, (1600, 6)) for _ in range(2))
    same_push = [replace(sound[5], wrench=wrench, name="near") for wrench in near]
    assert find_overlaps([*sound, *same_push]) == []
    constant = [Recording(np.full((200, 6), k), rate_hz=100, name=f"{k}") for k in range(4)]
    assert find_overlaps(constant) == []
    assert find_overlaps([constant[0], Recording(np.ones((1, 6)), rate_hz=1)]) == []


@settings(max_examples=30)
@given(st.integers(0, 300), st.integers(9, 300), st.sampled_from([1, 2, 3, 6]), st.integers(0, 99))
def test_any_crop_is_found(start, length, n_axes, seed):
    rng = np.random.default_rng(seed)
    names = tuple(f"a{i}" for i in range(n_axes))
    noise = [Recording(rng.normal(size=(600, n_axes)), rate_hz=100, axes=names) for _ in range(6)]
    copy = Recording(noise[3].wrench[start : start + length], rate_hz=100, axes=names)
    (overlap,) = find_overlaps([*noise, copy])
    assert (overlap.first, overlap.second, overlap.shift) == (3, 6, start)
    assert overlap.share == 1


def test_recordings_of_different_axes_are_not_compared():
    samples = np.random.default_rng(0).normal(size=(300, 2))
    pair = [Recording(samples, rate_hz=9, axes=axes) for axes in (("a", "b"), ("a", "c"))]
    assert find_overlaps(pair) == []


@pytest.mark.data
def test_a_thousand_real_recordings_hold_none(data_dir):
    from granular_id.io import load  # reading takes its time: only where the data are there

    sliding = load(data_dir / "sliding_wrench")
    assert find_overlaps(sliding.recordings) == []
    cropped = Recording(sliding[500].wrench[100:], rate_hz=100, axes=sliding.axes)
    (overlap,) = find_overlaps([*sliding, cropped])
    assert (overlap.first, overlap.second) == (500, 1000)
