"""What gives the label away without the forces; the statistics behind it, beside plain twins."""

import numpy as np
import pytest

from checks_cases import MATERIALS, WHOLE, by_code, codes, damaged, sound_set
from granular_id.recording import Dataset, Recording
from granular_id.recording.checks.leaks import by_kind, by_number, by_place, naming

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


def at_its_hour(r):
    return 1e9 + 3600 * SLOT[r.label] + 86400 * int(r.name[-2:])


@pytest.mark.parametrize(
    ("fields", "found", "words"),
    [
        ({"session": None, "start_time": in_a_row}, "no-session leak-clock", "one session per label"),
        ({"session": None, "start_time": in_stretches}, "no-session leak-clock", "recorded in 8 stretches"),
        ({"session": lambda r: r.label, "start_time": in_a_row}, "session-is-label", "4 of 4 labels"),
        ({"session": lambda r: f"{r.label} {r.session}"}, "leak-session", "names 100 % of the labels"),
        ({"trigger_index": lambda r: 60 + SLOT[r.label]}, "leak-trigger", "the trigger alone names 100 %"),
        ({"name": lambda r: r.name + file_type(r)}, "leak-format", "only one of its 2 values"),
        ({"start_time": at_its_hour}, "leak-hour", "the hour of the day (UTC) alone names 100 %"),
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


def test_an_answer_that_was_given_live_is_no_leak():
    answered = {"meta": lambda r: {"answer": {"label": "abcd"[SLOT[r.label]], "margin": SLOT[r.label] / 9}}}
    assert codes(damaged(sound_set(), WHOLE, **answered).check()) == set()
    said = {"meta": lambda r: {"answer": "abcd"[SLOT[r.label]]}}
    assert codes(damaged(sound_set(), WHOLE, **said).check()) == {"leak-meta"}


def test_what_the_samples_of_one_label_have_alone():
    cut = by_code(damaged(sound_set(), rice(), lambda w, _: w[:1400]).check())["leak-length"]
    assert cut.message == "the duration gives 'rice' away: 2.8 s, others 3.2; so does the number of samples"
    assert cut.indices == ()
    assert "leak-rate" in codes(damaged(sound_set(), rice(), rate_hz=501).check())
    rounded = damaged(sound_set(), rice(), lambda w, _: w.round(3)).check()
    assert codes(rounded) == {"leak-resolution", "resolution-differs"}
    tared = damaged(sound_set(), WHOLE, lambda w, r: w + 0.6 * SLOT[r.label] * np.eye(6)[0]).check()
    assert codes(tared) == {"leak-rest"}
    assert "the rest level of fx alone names" in by_code(tared)["leak-rest"].message


def test_no_rate_is_too_low_for_a_certain_leak():
    data = damaged(sound_set(), WHOLE, session=None, start_time=in_a_row)
    assert "leak-clock" in codes(data.check(false_alarm_rate=1e-6))


def test_metadata_may_name_the_material():
    described = {"meta": lambda r: {"material": {"d": SLOT[r.label]}, "what": r.label, "file": r.name}}
    assert codes(damaged(sound_set(), WHOLE, **described).check()) == set()


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


# -- the statistics


def plain_share(values, labels, alike):
    """How often the nearest other recording has the same label, one recording after the other."""
    shares = []
    for i, value in enumerate(values):
        distance = np.array([np.inf if j == i else alike(value, other) for j, other in enumerate(values)])
        if np.isinf(distance.min()):
            shares.append(0.0)
            continue
        nearest = np.flatnonzero(distance == distance.min())
        shares.append(np.mean(labels[nearest] == labels[i]))
    return np.mean(shares)


def far(a, b):
    if a == b or (np.isnan(a) and np.isnan(b)):
        return 0.0
    return np.inf if np.isnan(a) or np.isnan(b) else abs(a - b)


def unlike(a, b):
    return 0.0 if a == b else np.inf


def apart(a, b):
    return np.linalg.norm(a - b)


@pytest.mark.parametrize("seed", range(3))
def test_the_share_of_one_attribute_is_that_of_a_plain_loop(seed):
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 3, 40)
    line = rng.normal(size=40)
    ties = rng.integers(0, 12, 40) * 1.0
    ties[rng.integers(0, 40, 6)] = np.nan
    kinds = rng.integers(0, 4, 40).tolist()
    points = rng.normal(size=(40, 3))
    found = naming([by_number(line), by_kind(kinds), by_place(points)], labels)
    scaled = points / points.std(axis=0)
    assert found[0].share == pytest.approx(plain_share(line, labels, far))
    assert found[1].share == pytest.approx(plain_share(kinds, labels, unlike))
    assert found[2].share == pytest.approx(plain_share(scaled, labels, apart))
    grouped = by_number(ties)
    tied = np.bincount(grouped.group)[grouped.group] > 1
    assert (grouped.nearest[tied] == -1).all()
    same = np.array([np.isnan(ties) & np.isnan(value) | (ties == value) for value in ties])
    np.testing.assert_array_equal(same, grouped.group[:, None] == grouped.group)


def test_p_values_are_corrected_for_the_number_of_attributes():
    rng = np.random.default_rng(1)
    labels = np.repeat([0, 1], 20)
    noise = [by_number(rng.normal(size=40)) for _ in range(40)]
    assert min(found.p for found in naming(noise, labels)) > 0.01
    clear = naming([*noise, by_number(labels + 0.1 * rng.normal(size=40))], labels)[-1]
    assert clear.p == 0.005
    assert clear.share > 0.95
    assert clear.agreement == pytest.approx([1, 1], abs=0.05)


def test_attributes_that_only_go_with_the_label():
    labels = np.repeat(np.arange(6), 8)
    sensor = (labels % 2).tolist()
    forward, reverse = naming([by_kind(sensor), by_kind(sensor, reverse=True)], labels)
    assert forward.share == pytest.approx(7 / 23)
    assert reverse.share == 1
    assert reverse.chance == pytest.approx(23 / 47, abs=0.02)
    assert reverse.p == 0.005
