"""What ``check`` notices and ``summary`` counts."""

import json

import numpy as np
import pytest

from granular_id.recording import Dataset, Finding, Recording, SampleFlag

RNG = np.random.default_rng(5)


def recording(n=20, **fields):
    fields = {"rate_hz": 100, "label": "rice", "session": "s1", **fields}
    return Recording(RNG.normal(size=(n, 6)), **fields)


def codes(*recordings):
    return {finding.code: finding for finding in Dataset(recordings).check()}


@pytest.fixture
def sound():
    return [
        recording(label=label, session=session, name=f"{label}_{session}_{i}")
        for label in ("rice", "peas")
        for session in ("s1", "s2")
        for i in range(2)
    ]


def test_a_sound_set_gives_no_findings(sound):
    assert [finding.code for finding in Dataset(sound).check()] == ["few"]


def test_labels(sound):
    found = codes(*sound, recording(label=None, name="nameless"))
    assert found["no-label"].severity == "error"
    assert found["no-label"].recordings == ("nameless",)
    assert codes(*sound[:4])["one-label"].message == "all recordings are 'rice': nothing to tell apart"
    assert codes(*sound[:7])["uneven"].message == "between 3 and 4 recordings per label"


def test_sessions(sound):
    unknown = [recording(label=label, session=None) for label in ("rice", "peas")]
    assert "no recording says" in codes(*unknown)["no-session"].message
    assert "1 of 9" in codes(*sound, recording(session=None))["some-sessions"].message
    apart = codes(recording(label="rice", session="s1"), recording(label="peas", session="s2"))
    assert "2 of 2 labels" in apart["session-is-label"].message
    shared = codes(recording(label="rice", session="s1"), recording(label="peas", session="s1"))
    assert "session-is-label" not in shared


def test_rates_lengths_and_gaps(sound):
    times = np.arange(20) / 100
    times[10:] += 0.3
    holed = recording(rate_hz=None, time_s=times, name="holed")
    found = codes(*sound, holed, recording(rate_hz=50), recording(30))
    assert found["irregular"].recordings == ("holed",)
    assert found["rates-differ"].message == "2 different rates, 50 to 100 Hz; 1 not at 100"
    assert found["lengths-differ"].message.startswith("lengths differ, 20 to 30 samples")
    assert "0.31 s in 'holed'" in found["gaps"].message
    assert "slow" not in found
    assert "in seconds?" in codes(*sound, recording(rate_hz=0.5))["slow"].message


def test_a_label_that_its_length_gives_away(sound):
    short = [recording(14, label="oats", session=s) for s in ("s1", "s2") for _ in range(4)]
    found = codes(*sound, *short)["leak-length"]
    assert (
        found.message == "the duration gives 'oats' away: 0.13 s, others 0.19; so does the number of samples"
    )


def test_stuck_axes_and_duplicates(sound):
    wrench = sound[0].wrench.copy()
    wrench[:, [1, 5]] = 0.25
    stuck = Recording(wrench, rate_hz=100, label="rice", session="s1", name="stuck")
    assert (
        codes(*sound, stuck)["stuck-axis"].message == "1 recording with an axis that never changes (fy, tz)"
    )
    twin = Recording(sound[0].wrench, rate_hz=100, label="peas", session="s1", name="twin")
    found = codes(*sound, twin)["duplicates"]
    assert found.severity == "error"
    assert (
        found.message == "1 recording holds exactly the samples of another one, some under a different label"
    )
    assert found.recordings == (sound[0].name, "twin")
    assert "different label" not in codes(*sound, sound[0])["duplicates"].message


def test_flags_and_order_of_severity(sound):
    flags = np.zeros(20, np.uint8)
    flags[3:7] = SampleFlag.SATURATED
    findings = Dataset([*sound, recording(flags=flags, name="clipped"), recording(label=None)]).check()
    assert [f.severity for f in findings] == sorted(
        (f.severity for f in findings), key=["error", "warning", "info"].index
    )
    clipped = next(f for f in findings if f.code == "saturated")
    assert (
        clipped.message == "4 samples in 1 recording (2 %) were marked as saturated when they were recorded"
    )
    assert str(clipped) == f"warning: {clipped.message} [clipped]"
    assert json.loads(json.dumps(clipped.to_dict()))["recordings"] == ["clipped"]


def test_a_finding_prints_three_names():
    assert str(Finding("info", "x", "four", ("a", "b", "c", "d"))) == "info: four [a, b, c, ...]"


def test_summary_counts(sound):
    irregular = recording(3, rate_hz=None, time_s=[0, 0.1, 0.5], flags=[0, 1, 3], label=None, session=None)
    summary = Dataset([*sound, recording(30, session="s3"), irregular]).summary()
    assert summary.totals == {
        "recordings": 10,
        "labels": 2,
        "sessions": 3,
        "irregular": 1,
        "rates_hz": [100.0],
        "samples": 8 * 20 + 30 + 3,
        "flags": {"GAP_FILLED": 2, "SATURATED": 1},
    }
    peas, rice, unknown = summary.rows
    assert (peas["label"], peas["recordings"], peas["sessions"], peas["samples"]) == ("peas", 4, 2, "20")
    assert (rice["label"], rice["samples"], rice["seconds"]) == ("rice", "20 to 30", "0.19 to 0.29")
    assert (unknown["label"], unknown["sessions"], unknown["rate_hz"]) == (None, None, "~4 irregular")
    assert (unknown["largest_gap_s"], unknown["flagged_samples"]) == (0.4, 2)
    lines = str(summary).splitlines()
    assert "rates_hz: 100" in lines
    assert "flags: 2 GAP_FILLED, 1 SATURATED" in lines
    assert lines[-3].split() == ["peas", "4", "2", "20", "0.19", "100", "0", "0"]
    assert lines[-1].split()[:3] == ["-", "1", "-"]
    plain = str(Dataset(sound).summary())
    assert not any(word in plain for word in ("irregular", "flag", "gap")), "zero everywhere: not printed"
    assert json.loads(json.dumps(summary.to_dict()))["totals"]["samples"] == 193
