"""What gives the label away without the forces; the statistics behind it, beside plain twins."""

import numpy as np
import pytest

from checks_cases import MATERIALS, PER_CLASS, by_code, codes, damaged, sound_set
from granular_id.recording import Dataset, Recording
from granular_id.recording.checks.leaks import by_kind, by_number, by_place, naming

WHOLE = range(len(MATERIALS) * PER_CLASS)
SLOT = {label: k for k, label in enumerate(MATERIALS)}


@pytest.fixture(scope="module")
def sound():
    return sound_set()


def one_after_the_other(sound):
    starts = {name: 1e9 + 60 * k for k, name in enumerate(sound.names)}
    return {"start_time": lambda r: starts[r.name]}


def test_a_clock_that_names_the_label(sound):
    report = damaged(sound, WHOLE, session=None, **one_after_the_other(sound)).check()
    assert codes(report) == {"no-session", "leak-clock"}
    message = by_code(report)["leak-clock"].message
    assert message.startswith("the clock alone names 9")
    assert (
        "(chance 23 %): each was recorded in one stretch of its own. That is one session per label" in message
    )


def test_no_rate_is_too_low_for_a_certain_leak(sound):
    data = damaged(sound, WHOLE, session=None, **one_after_the_other(sound))
    assert "leak-clock" in codes(data.check(false_alarm_rate=1e-6))


def test_a_clock_of_several_stretches(sound):
    starts = {
        r.name: 1e9 + 60 * (i % 6) + 1e4 * SLOT[r.label] + 1e5 * (i // 6 % 2) for i, r in enumerate(sound)
    }
    report = damaged(sound, WHOLE, session=None, start_time=lambda r: starts[r.name]).check()
    assert (
        "recorded in 8 stretches, where random order would make about 37"
        in by_code(report)["leak-clock"].message
    )


def test_sessions_that_are_labels_need_no_clock(sound):
    report = damaged(sound, WHOLE, session=lambda r: r.label, **one_after_the_other(sound)).check()
    assert codes(report) == {"session-is-label"}
    assert by_code(report)["session-is-label"].values["labels"] == MATERIALS


def test_sessions_of_one_label_each(sound):
    report = damaged(sound, WHOLE, session=lambda r: f"{r.label} {r.session}").check()
    assert codes(report) == {"leak-session"}
    assert "names 100 % of the labels" in by_code(report)["leak-session"].message


@pytest.mark.parametrize(
    ("code", "fields", "words"),
    [
        (
            "leak-trigger",
            {"trigger_index": lambda r: 60 + SLOT[r.label]},
            "the time of the trigger alone names 100 %",
        ),
        (
            "leak-format",
            {"name": lambda r: r.name + (".csv", ".mat")[SLOT[r.label] % 2]},
            "only one of its 2 values",
        ),
        (
            "leak-meta",
            {"meta": lambda r: {"arm": {"tool": "abcd"[SLOT[r.label]]}}},
            "meta 'arm.tool' alone names 100 %",
        ),
        ("leak-meta", {"meta": lambda r: {"new": SLOT[r.label] > 1}}, "meta 'new' goes with the label"),
        (
            "leak-meta",
            {"meta": lambda r: {"speed": (0.02, 0.03)[SLOT[r.label] % 2]}},
            "meta 'speed' goes with",
        ),
        (
            "leak-meta",
            {"meta": lambda r: {"room": 20 + SLOT[r.label] + len(r.session) / 90}},
            "meta 'room' alone",
        ),
        (
            "leak-hour",
            {"start_time": lambda r: 1e9 + 3600 * SLOT[r.label] + 86400 * int(r.name[-2:])},
            "the hour of the day (UTC) alone names 100 %",
        ),
    ],
)
def test_what_is_stated_beside_the_samples(sound, code, fields, words):
    report = damaged(sound, WHOLE, **fields).check()
    assert codes(report) == {code}
    assert words in by_code(report)[code].message


def test_metadata_that_may_name_the_material(sound):
    described = damaged(
        sound, WHOLE, meta=lambda r: {"material": {"d": SLOT[r.label]}, "what": r.label, "file": r.name}
    )
    assert codes(described.check()) == set()


def test_lengths_rates_and_jitter(sound):
    rice = [i for i, r in enumerate(sound) if r.label == "rice"]
    finding = by_code(damaged(sound, rice, lambda w, _: w[:1400]).check())["leak-length"]
    assert (
        finding.message == "the duration gives 'rice' away: 2.8 s, others 3.2; so does the number of samples"
    )
    assert finding.indices == ()
    assert "leak-rate" in codes(damaged(sound, rice, rate_hz=501).check())


def test_rest_levels(sound):
    report = damaged(sound, WHOLE, lambda w, r: w + 0.6 * SLOT[r.label] * np.eye(6)[0]).check()
    assert codes(report) == {"leak-rest"}
    assert "the rest level of fx alone names" in by_code(report)["leak-rest"].message


def test_resolutions(sound):
    rice = [i for i, r in enumerate(sound) if r.label == "rice"]
    assert {"leak-resolution", "resolution-differs"} <= codes(
        damaged(sound, rice, lambda w, _: w.round(3)).check()
    )


def test_sets_without_a_leak_are_left_alone():
    rng = np.random.default_rng(0)
    alarms = 0
    for _ in range(10):
        data = Dataset(
            [
                Recording(
                    rng.normal(size=(50, 6)),
                    rate_hz=100,
                    label="abc"[i % 3],
                    session=f"s{i // 3 % 3}",
                    start_time=1e9 + 60 * i,
                    meta={"speed": float(rng.choice([0.02, 0.03])), "temperature": 20 + float(rng.normal())},
                )
                for i in range(36)
            ]
        )
        alarms += bool(codes(data.check()))
    assert alarms == 0  # the stated rate is one set in a hundred


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
    return (
        0.0
        if a == b or (np.isnan(a) and np.isnan(b))
        else np.inf
        if np.isnan(a) or np.isnan(b)
        else abs(a - b)
    )


@pytest.mark.parametrize("seed", range(5))
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
    assert found[1].share == pytest.approx(plain_share(kinds, labels, lambda a, b: 0.0 if a == b else np.inf))
    assert found[2].share == pytest.approx(plain_share(scaled, labels, lambda a, b: np.linalg.norm(a - b)))
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
