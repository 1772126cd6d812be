"""Triggers of a whole data set: found, left, overruled, reported, and used to align."""

from dataclasses import replace

import numpy as np
import pytest

from granular_id.recording import Dataset, Recording, SampleFlag
from onset_cases import RATE_HZ, noise, push

STARTS = (60, 140, 90)


@pytest.fixture(scope="module")
def data():
    waves = [push(seed, start) for seed, start in enumerate(STARTS)]
    pushes = [Recording(w, rate_hz=RATE_HZ, label="rice", name=f"rice_{k:02d}") for k, w in enumerate(waves)]
    still = Recording(noise(7, 900), rate_hz=RATE_HZ, label="air", name="air_00")
    return Dataset([*pushes, still])


def test_triggers_are_set_and_reported(data):
    found = data.find_onsets()
    for recording, start in zip(found, STARTS, strict=False):
        assert abs(recording.trigger_index - start) <= 3
    assert found[3].trigger_index is None
    for before, after in zip(data, found, strict=True):
        assert replace(after, trigger_index=None) == before
    report = found.history[-1]
    assert report.step == "find_onsets"
    assert report.totals["recordings"] == 4
    assert (report.totals["found"], report.totals["not_found"]) == (3, 1)
    rows = {row["name"]: row for row in report.rows}
    why = "no change stands out from the noise of the first 0.1 s"
    assert rows["air_00"] == {"name": "air_00", "onset_s": None, "how": "not found", "why": why}
    assert rows["rice_00"]["onset_s"] == found[0].trigger_index / RATE_HZ
    assert report.rows[0]["name"] == "air_00", "what needs a look comes first"


def test_different_leads_are_aligned_as_in_the_paper(data):
    found = data.find_onsets()
    with pytest.raises(ValueError, match=r"1 recording has no trigger_index: 'air_00'; .*on_short='skip'"):
        found.align(800, trigger="recorded", lead_s=0.1)
    aligned = found.align(800, trigger="recorded", lead_s=0.1, on_short="skip")
    assert aligned.names == ("rice_00", "rice_01", "rice_02")
    assert {r.trigger_index for r in aligned} == {50}
    skipped = {"name": "air_00", "samples_before": 900, "skipped": "has no trigger"}
    assert skipped in [dict(row) for row in aligned.history[-1].rows]
    assert aligned.history[-1].totals["recordings_skipped"] == 1
    assert np.ptp(aligned.X[:, 200:, 0].mean(axis=1)) < 0.01, "the same place of the push in all"
    assert np.abs(aligned.X[:, :44, 0]).max() < 0.1, "rest"


def test_align_without_any_trigger(data):
    with pytest.raises(ValueError, match=r"none of the 4 recordings has a trigger_index; call \.find_onsets"):
        data.align(800, trigger="recorded", on_short="skip")


def test_recorded_triggers_stay_unless_replaced(data):
    known = Dataset([replace(data[0], trigger_index=500), *data[1:]])
    found = known.find_onsets()
    assert found[0] is known[0]
    assert found.history[-1].totals["recorded"] == 1
    replaced = known.find_onsets(replace=True)
    assert replaced == data.find_onsets()
    still = Dataset([replace(data[3], trigger_index=500)])
    assert still.find_onsets(replace=True)[0].trigger_index is None


def test_overruling(data):
    known = Dataset([replace(data[0], trigger_index=500), *data[1:]])
    found = known.find_onsets(overrule={"rice_00": 0.2, "air_00": 0.3009, "rice_01": None})
    assert [r.trigger_index for r in found][:2] == [100, None]
    assert found[3].trigger_index == 150
    rows = {row["name"]: row for row in found.history[-1].rows}
    assert [rows[name]["how"] for name in data.names] == ["overruled", "overruled", "found", "overruled"]
    assert found.history[-1].parameters["overrule"] == {"rice_00": 0.2, "air_00": 0.3009, "rice_01": None}
    with pytest.raises(ValueError, match="2 recordings are called 'rice_00'; one is wanted"):
        (data + data[:1]).find_onsets(overrule={"rice_00": 0.1})


def test_irregular_recordings_must_be_resampled_or_overruled():
    times = np.arange(900) / RATE_HZ
    times[5] += 0.0005
    irregular = Dataset([Recording(noise(1, 900), time_s=times, name="irregular")])
    with pytest.raises(ValueError, match=r"1 of 1 recording is irregularly sampled .*\.resample\(rate_hz\)"):
        irregular.find_onsets()
    stated = irregular.find_onsets(overrule={"irregular": 0.01})
    assert stated[0].trigger_index == 5


def test_filled_gaps_in_the_rest_are_said(data):
    flags = np.zeros(1600, np.uint8)
    flags[10:13] = SampleFlag.GAP_FILLED
    notes = Dataset([replace(data[0], flags=flags), *data[1:]]).find_onsets().history[-1].notes
    assert len(notes) == 1
    assert "1 recording has filled gaps in what is taken for rest (the first is 'rice_00')" in notes[0]
    assert not data.find_onsets().history[-1].notes


def test_lengths_rates_and_axes_may_differ(data):
    slow = Recording(push(1, 30, 320, rate_hz=100.0, course="jump"), rate_hz=100, name="slow")
    one = Recording(push(2)[:, :1], rate_hz=RATE_HZ, axes=("force",), name="one")
    short = Recording(push(3)[:40], rate_hz=RATE_HZ, name="short")
    found = Dataset([slow, one, short, data[0]]).find_onsets()
    assert abs(found[0].trigger_index - 30) <= 1
    assert abs(found[1].trigger_index - 90) <= 4
    assert found[2].trigger_index is None
    assert found[3] == data.find_onsets()[0]
    assert found.history[-1].rows[0]["why"].startswith("too short: 40 samples")
