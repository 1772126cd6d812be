"""What ``check`` says of labels, sessions, copies and leaks, its report, and what ``summary`` counts."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from checks_cases import MATERIALS, WHOLE, by_code, codes, damaged, sound_set
from granular_id.recording import CheckReport, Dataset, Recording
from granular_id.recording.checks.copies import find_overlaps
from granular_id.recording.checks.leaks import nearest_on_a_line


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


SLOT = {label: k for k, label in enumerate(MATERIALS)}


def in_a_row(r):
    """One after the other, label by label."""
    return 1e9 + 60 * sound_set().names.index(r.name)


def in_stretches(r):
    """Labels in turn, six recordings at a time, in two long blocks."""
    i = sound_set().names.index(r.name)
    return 1e9 + 60 * (i % 6) + 1e4 * SLOT[r.label] + 1e5 * (i // 6 % 2)


@pytest.mark.parametrize(
    ("fields", "found", "words"),
    [
        ({"session": None, "start_time": in_a_row}, "no-session leak-clock", "one session per label"),
        ({"session": None, "start_time": in_stretches}, "no-session leak-clock", "record the labels in turn"),
        ({"session": lambda r: r.label, "start_time": in_a_row}, "session-is-label", "4 of 4 labels"),
        ({"session": lambda r: f"{r.label} {r.session}"}, "leak-session", "names 100 % of the labels"),
    ],
)
def test_what_is_stated_beside_the_samples(fields, found, words):
    report = damaged(sound_set(), WHOLE, **fields).check()
    assert codes(report) == set(found.split())
    assert words in by_code(report)[found.split()[-1]].message


def random_recording(i, rng):
    about = {"label": "abc"[i % 3], "session": f"s{i // 3 % 3}", "start_time": 1e9 + 60 * i}
    return Recording(rng.normal(size=(50, 6)), rate_hz=100, **about)


def test_sets_without_a_leak_are_left_alone():
    rng = np.random.default_rng(0)
    for _ in range(10):  # the stated rate is one set in a hundred
        assert not codes(Dataset([random_recording(i, rng) for i in range(36)]).check())


def own_tool(r):
    return {"tool": f"tool {SLOT[r.label]}", "speed_m_s": 0.03}


@pytest.mark.parametrize(
    ("meta", "names"),
    [
        (own_tool, ["tool"]),
        (lambda r: {"lab": {"person": f"{SLOT[r.label]}"}, "source": own_tool(r)}, ["tool", "lab.person"]),
        (lambda r: {"speed_m_s": 0.03 + SLOT[r.label]}, ["motion"]),
        (lambda r: {"material": r.label.upper(), "grain_mm": SLOT[r.label]}, []),
        (lambda r: {"tool": f"tool {SLOT[r.label] // 2}"}, []),  # two labels share one
        (lambda r: {"tool": f"tool {SLOT[r.label]}, {r.session}"}, []),  # a label has several
        (lambda r: own_tool(r) if r.label != "rice" else {}, []),
    ],
)
def test_check_what_each_label_has_of_its_own_is_named(meta, names):
    report = damaged(sound_set(), WHOLE, meta=meta).check()
    assert codes(report) == ({"setup-is-label"} if names else set())
    if names:
        assert by_code(report)["setup-is-label"].values["names"] == tuple(names)


@given(st.lists(st.sampled_from([0.0, 1.0, 1.5, 4.0, np.nan]), min_size=2, max_size=30))
def test_the_nearest_on_a_line_is_as_near_as_any(values):
    values = np.array(values)
    nearest = nearest_on_a_line(values, np.random.default_rng(0))
    for i, (value, place) in enumerate(zip(values, nearest.tolist(), strict=True)):
        others = np.delete(values, i)
        known = not np.isnan(value) and (~np.isnan(others)).any()
        assert (place != -1) == known
        if known:
            assert abs(values[place] - value) == np.nanmin(abs(others - value))
        assert place != i
