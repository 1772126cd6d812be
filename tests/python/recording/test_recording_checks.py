"""What ``check`` says of labels, sessions and rates, its report, and what ``summary`` counts."""

import json
import pickle

import numpy as np
import pytest

from checks_cases import by_code, codes, damaged, sound_set
from granular_id.recording import CheckReport, Dataset, Recording


def recording(n=20, *, seed=None, **fields):
    fields = {"rate_hz": 100, "label": "rice", "session": "s1", **fields}
    return Recording(np.random.default_rng(seed).normal(size=(n, 6)), **fields)


def alternating(wrenches, **fields):
    """Recordings of two labels in turn, each a session of its own."""
    return Dataset(
        Recording(wrench, rate_hz=100, label="ab"[i % 2], session=str(i), name=str(i), **fields)
        for i, wrench in enumerate(wrenches)
    )


SMALL = [
    recording(seed=i, label=label, session=f"s{i % 4 // 2}", name=f"{label}_{i % 4}")
    for i, label in enumerate(["rice"] * 4 + ["peas"] * 4)
]

DAYS = [{"seed": i, "start_time": 43200.0 * i} for i in range(4)]
UNKNOWN_DAYS = [recording(session=None, name="a[0]", meta={"day": i // 2}, **DAYS[i]) for i in range(4)]
TWO_FILES = [recording(session=None, name=f"{'ab'[i // 2]}[{i}]") for i in range(4)]
OWN_SESSIONS = [recording(session=f"s{i}", **day) for i, day in enumerate(DAYS)]


def found_in(*recordings):
    return by_code(Dataset(recordings).check())


def test_a_sound_set_is_only_said_to_be_small():
    assert "session-is-label" not in found_in(SMALL[0], SMALL[4])
    report = Dataset(SMALL).check()
    assert [finding.code for finding in report] == ["few"]
    assert report.worst == "ok"


@pytest.mark.parametrize(
    ("recordings", "code", "words"),
    [
        (SMALL[:4], "one-label", "all recordings are 'rice': nothing to tell apart"),
        ([recording(session=None), recording(label="peas", session=None)], "no-session", "column:NAME"),
        (UNKNOWN_DAYS, "no-session", "(data convert --session meta:day or evaluate --hold-out day)"),
        (TWO_FILES, "no-session", "(data convert --session file)"),
        (
            [*SMALL, recording(11, name="cut")],
            "short",
            "shorter than the usual 0.19 s, the shortest is 'cut'",
        ),
        ([recording(session="x"), recording(session="x", seed=1)], "one-session", "none can be held out"),
        (OWN_SESSIONS, "own-sessions", "(evaluate --hold-out day)"),
        ([SMALL[0], recording(label="peas", session="s9")], "session-is-label", "2 of 2 labels"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_stated_is_judged(recordings, code, words):
    assert words in found_in(*recordings)[code].message


@pytest.mark.parametrize("shape", [(1, 6), (2, 6), (3, 1), (1, 1)])
@pytest.mark.parametrize("n", [1, 12])
def test_tiny_recordings_are_judged_without_a_stumble(shape, n):
    axes = () if shape[1] == 6 else ("force",)
    wrenches = np.random.default_rng(0).normal(size=(n, *shape))
    assert set(alternating(wrenches, axes=axes).check().states) == {"ok"}


def test_constant_and_absurd_readings_are_judged():
    absurd = np.random.default_rng(0).normal(size=(12, 50, 6)) * 1e300
    with np.errstate(all="raise"):
        assert "stuck-axis" in codes(alternating(np.full((24, 200, 6), 3.0)).check())
        assert "units" in codes(alternating(absurd).check())


@pytest.fixture(scope="module")
def report():
    def stuck(w, _):
        w[:, 0] = 1.0

    return damaged(damaged(sound_set(), [2], label=None), range(10, 15), stuck).check()


def test_worst_first_with_a_state_each(report):
    assert [(finding.severity, finding.code) for finding in report] == [
        ("error", "no-label"),
        ("warning", "stuck-axis"),
    ]
    assert report.worst == "error"
    assert str(report).splitlines()[0] == "48 recordings checked: 42 ok, 5 with warnings, 1 with errors"
    assert [report.states[i] for i in (2, 10, 0)] == ["error", "warning", "ok"]
    assert len(report.states) == 48
    assert (len(report), report[1:]) == (2, (report[1],))
    assert not CheckReport((), 1)


def test_it_is_plain_values_and_can_be_pickled(report):
    plain = json.loads(json.dumps(report.to_dict()))
    assert set(plain) == {"worst", "findings", "states"}
    assert plain["findings"][1]["indices"] == [10, 11, 12, 13, 14]
    assert plain["states"][2] == "error"
    assert pickle.loads(pickle.dumps(report)) == report
    with pytest.raises(TypeError):
        report[0].values["share"] = 1


def test_summary_counts():
    irregular = recording(3, rate_hz=None, time_s=[0, 0.1, 0.5], flags=[0, 1, 3], label=None, session=None)
    summary = Dataset([*SMALL, recording(30, session="s3"), irregular]).summary()
    counts = {"recordings": 10, "labels": 2, "sessions": 3, "irregular": 1, "samples": 8 * 20 + 30 + 3}
    assert summary.totals == counts | {"rates_hz": [100.0], "flags": {"GAP_FILLED": 2, "SATURATED": 1}}
    peas, rice, unknown = summary.rows
    assert (peas["label"], peas["recordings"], peas["sessions"], peas["samples"]) == ("peas", 4, 2, "20")
    assert (rice["label"], rice["samples"], rice["seconds"]) == ("rice", "20 to 30", "0.19 to 0.29")
    assert (unknown["label"], unknown["sessions"], unknown["rate_hz"]) == (None, None, "~4 irregular")
    assert (unknown["largest_gap_s"], unknown["flagged_samples"]) == (0.4, 2)
    assert str(summary).splitlines()[-3].split() == ["peas", "4", "2", "20", "0.19", "100", "0", "0"]
    plain = str(Dataset(SMALL).summary())
    assert not any(word in plain for word in ("irregular", "flag", "gap")), "zero everywhere: not printed"
    assert json.loads(json.dumps(summary.to_dict()))["totals"]["samples"] == 193
