"""What gives the label away without the forces; the statistics behind it, beside scikit-learn's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from sklearn.model_selection import LeaveOneOut
from sklearn.neighbors import KNeighborsClassifier

from checks_cases import MATERIALS, WHOLE, by_code, codes, damaged, sound_set
from granular_id.recording import Dataset, Recording
from granular_id.recording.checks.leaks import nearest_on_a_line

SLOT = {label: k for k, label in enumerate(MATERIALS)}


def rice():
    return [i for i, r in enumerate(sound_set()) if r.label == "rice"]


def in_a_row(r):
    """One after the other, label by label."""
    return 1e9 + 60 * sound_set().names.index(r.name)


def in_stretches(r):
    """Labels in turn, six recordings at a time, in two long blocks."""
    i = sound_set().names.index(r.name)
    return 1e9 + 60 * (i % 6) + 1e4 * SLOT[r.label] + 1e5 * (i // 6 % 2)


def file_type(r):
    return (".csv", ".mat")[SLOT[r.label] % 2]


@pytest.mark.parametrize(
    ("fields", "found", "words"),
    [
        ({"session": None, "start_time": in_a_row}, "no-session leak-clock", "one session per label"),
        ({"session": None, "start_time": in_stretches}, "no-session leak-clock", "record the labels in turn"),
        ({"session": lambda r: r.label, "start_time": in_a_row}, "session-is-label", "4 of 4 labels"),
        ({"session": lambda r: f"{r.label} {r.session}"}, "leak-session", "names 100 % of the labels"),
        ({"trigger_index": lambda r: 60 + SLOT[r.label]}, "leak-trigger", "the trigger alone names 100 %"),
        ({"name": lambda r: r.name + file_type(r)}, "leak-format", "only one of its 2 values"),
        ({"meta": lambda r: {"arm": {"tool": "abcd"[SLOT[r.label]]}}}, "leak-meta", "'arm.tool' alone names"),
        ({"meta": lambda r: {"new": SLOT[r.label] > 1}}, "leak-meta", "meta 'new' goes with the label"),
        ({"meta": lambda r: {"speed": 0.02 + 0.01 * (SLOT[r.label] % 2)}}, "leak-meta", "'speed' goes with"),
        ({"meta": lambda r: {"room": 20 + SLOT[r.label] + len(r.session) / 90}}, "leak-meta", "'room' alone"),
    ],
)
def test_what_is_stated_beside_the_samples(fields, found, words):
    report = damaged(sound_set(), WHOLE, **fields).check()
    assert codes(report) == set(found.split())
    assert words in by_code(report)[found.split()[-1]].message


def test_answers_and_descriptions_of_the_material_are_no_leaks():
    answered = {"meta": lambda r: {"answer": {"label": "abcd"[SLOT[r.label]], "margin": SLOT[r.label] / 9}}}
    described = {"meta": lambda r: {"material": {"d": SLOT[r.label]}, "what": r.label, "file": r.name}}
    for fields in (answered, described):
        assert codes(damaged(sound_set(), WHOLE, **fields).check()) == set()
    said = {"meta": lambda r: {"answer": "abcd"[SLOT[r.label]]}}
    assert codes(damaged(sound_set(), WHOLE, **said).check()) == {"leak-meta"}


@pytest.mark.parametrize(
    ("wrench", "fields", "found", "words"),
    [
        (lambda w, _: w[:1400], {}, "leak-length", "the duration goes with the label: each"),
        (None, {"rate_hz": 501}, "leak-rate", "the median step goes with the label"),
    ],
)
def test_what_the_samples_of_labels_have_alone(wrench, fields, found, words):
    report = damaged(sound_set(), rice(), wrench, **fields).check()
    assert found in codes(report)
    assert words in by_code(report)[found].message


def random_recording(i, rng):
    return Recording(
        rng.normal(size=(50, 6)),
        rate_hz=100,
        label="abc"[i % 3],
        session=f"s{i // 3 % 3}",
        start_time=1e9 + 60 * i,
        meta={"speed": float(rng.choice([0.02, 0.03])), "temperature": 20 + float(rng.normal())},
    )


def test_sets_without_a_leak_are_left_alone():
    rng = np.random.default_rng(0)
    for _ in range(10):  # the stated rate is one set in a hundred
        assert not codes(Dataset([random_recording(i, rng) for i in range(36)]).check())


# The statistics.


@pytest.mark.parametrize("seed", range(3))
def test_the_share_is_that_of_a_nearest_neighbour_classifier(seed):
    rng = np.random.default_rng(seed)
    labels, line = rng.integers(0, 3, 40), rng.normal(size=(40, 1))
    nearest = nearest_on_a_line(line[:, 0], rng)
    one = KNeighborsClassifier(1)
    right = [
        one.fit(line[train], labels[train]).predict(line[[i]])[0] == labels[i]
        for train, (i,) in LeaveOneOut().split(line)
    ]
    assert (labels[nearest] == labels).tolist() == right


@given(st.lists(st.sampled_from([0.0, 1.0, 1.5, 4.0, np.nan]), min_size=2, max_size=30))
def test_the_nearest_on_a_line_is_as_near_as_any(values):
    values = np.array(values)
    nearest = nearest_on_a_line(values, np.random.default_rng(0))
    for i, (value, place) in enumerate(zip(values, nearest.tolist(), strict=True)):
        others = np.delete(values, i)
        alike = np.isnan(others).any() if np.isnan(value) else (~np.isnan(others)).any()
        assert (place == -1) == (not alike)
        if alike and not np.isnan(value):
            assert abs(values[place] - value) == np.nanmin(abs(others - value))
        assert place != i


def test_the_best_of_many_attributes_is_no_leak():
    """Forty numbers of metadata that say nothing; one more that does is found among them."""
    rng = np.random.default_rng(1)
    data = [random_recording(i, rng) for i in range(36)]
    noise = [{f"n{k}": float(rng.normal()) for k in range(40)} for _ in data]
    silent = Dataset([replace(r, meta=meta) for r, meta in zip(data, noise, strict=True)])
    assert not codes(silent.check())
    said = [{**meta, "room": 20.0 + "abc".index(r.label)} for r, meta in zip(data, noise, strict=True)]
    found = by_code(Dataset([replace(r, meta=meta) for r, meta in zip(data, said, strict=True)]).check())
    assert found["leak-meta"].values["attributes"] == ("meta 'room'",)
    assert found["leak-meta"].values["p"] == 0.001
