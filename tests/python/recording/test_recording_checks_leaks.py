"""What gives the label away without the forces; the statistics behind it."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from checks_cases import MATERIALS, WHOLE, by_code, codes, damaged, sound_set
from granular_id.recording import Dataset, Recording
from granular_id.recording.checks.leaks import nearest_on_a_line

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
