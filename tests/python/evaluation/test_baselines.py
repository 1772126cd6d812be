"""Gap and baselines: what sessions cost, and what could be known without touching the material."""

import numpy as np
import pytest
from scipy.stats import binom

from evaluation_cases import QUIET, Centroids, changed, make_data, of_levels
from granular_id.evaluation import Baseline, Gap, evaluate
from granular_id.recording import Dataset, Recording
from granular_id.score import Held
from granular_id.splits import Fold, Folds


def held(right, truth, sessions, n_classes=2, by="session"):
    """Answers about recordings, in one fold."""
    right, truth = np.asarray(right, dtype=bool), np.asarray(truth)
    rows = np.arange(truth.size)
    return Held(
        classes=tuple(f"m{k}" for k in range(n_classes)),
        rows=rows,
        fold=np.zeros(truth.size, dtype=np.intp),
        truth=truth,
        predicted=np.where(right, truth, (truth + 1) % n_classes),
        values=np.zeros((truth.size, n_classes)),
        sessions=np.asarray(sessions, dtype=object),
        clusters=np.asarray(sessions, dtype=object),
        folds=Folds(by, (Fold(rows[:0], rows, "all"),)),
    )


# The gap.


@pytest.mark.parametrize(("n_below", "p", "lost"), [(0, 0.05, True), (1, 0.10, False), (19, 1.0, False)])
def test_p_of_the_gap_is_the_rank_among_twenty(n_below, p, lost):
    strict = held([1, 1, 0, 0], [0, 1, 0, 1], list("stst"))
    gap = Gap.of("raw", strict, [0.5] * n_below + [0.6] * (19 - n_below))
    assert gap.p == pytest.approx(p)
    assert gap.is_lost is lost
    assert str(gap).startswith(
        "10.0 points are lost" if lost else "no loss shown with held-out sessions (p ="
    )


def test_gap_is_at_most_the_draws_less_the_lower_end_of_the_interval():
    right = [1, 1, 1, 0, 1, 1, 0, 1]
    strict = held(right, [0, 1] * 4, np.repeat(list("stuv"), 2))
    gap = Gap.of("raw", strict, [0.8] * 19)
    assert gap.points == pytest.approx(0.05)
    assert gap.most == pytest.approx(0.8 - strict.interval[0])
    assert Gap.of("raw", strict, [0.0] * 19).most == 0
    strict = held([1, 1, 0, 0], [0, 1, 0, 1], list("ssst"))
    assert np.isnan(Gap.of("raw", strict, [0.4] * 19).most)


def sessions_of(effect, n_sessions=4, own=True):
    """Four materials that differ in level, in sessions that add an offset."""
    rng = np.random.default_rng(3)
    session, material = (rows.ravel() for rows in np.indices((n_sessions, 4, 6))[:2])
    offsets = effect * rng.normal(size=(n_sessions, 4, 6))
    levels = 2.5 * np.eye(6)[material] + offsets[session, material] + rng.normal(size=(material.size, 6))
    names = [f"{m} {s}" if own else f"{s}" for m, s in zip(material, session, strict=True)]
    return of_levels(levels, [f"m{m}" for m in material], names)


@pytest.mark.parametrize(("effect", "lost"), [(0.0, False), (1.5, True)])
def test_sessions_that_cost_are_found_and_others_not(effect, lost):
    result = evaluate(sessions_of(effect), "raw", classifier=Centroids(), **QUIET)
    assert result.gap.is_lost is lost
    assert result.gap.points == pytest.approx(np.mean(result.at_random["raw"]) - result.accuracy())
    assert len(result.at_random["raw"]) == 19


def test_overlapping_windows_without_sessions_show_no_gap():
    """Half of each window is that of the next: drawn apart they would be told by their copies."""
    rng = np.random.default_rng(0)
    long = [
        Recording(
            (1 + 0.2 * m) * rng.normal(size=(300, 6)),
            100.0,
            label=f"m{m}",
            session=f"{m} {s // 2}",
            name=f"{m} {s}",
        )
        for m in range(3)
        for s in range(10)
    ]
    data = Dataset(long).windows(0.6, 0.3)
    result = evaluate(data, "hfmh", classifier=Centroids(), **QUIET)
    assert not result.gap.is_lost
    assert abs(result.gap.points) < 0.05
    few = Dataset(long[::2]).windows(0.6, 0.3)
    result = evaluate(few, "hfmh", classifier=Centroids(), **QUIET)
    assert result.gap is None
    assert "gap not measured: m0: 5 recordings cut into windows that share samples" in " ".join(
        str(result).split()
    )


# Baselines.


def test_baselines_count_cells_of_material_and_session():
    """Six cells of 20 answers each: all answers of a cell are right together, which is no evidence of 120."""
    truth = np.repeat([0, 1] * 3, 20)
    sessions = np.repeat(list("ssttuu"), 20)
    lucky = np.repeat([1, 1, 1, 1, 0, 0], 20)
    one = Baseline("clock", "when", held(lucky, truth, sessions))
    assert one.p == pytest.approx(binom.sf(3, 6, 0.5))
    assert one.p > 0.3
    assert one.finding(held(np.ones(120), truth, sessions)) is None


@pytest.mark.parametrize("headline", [1.0, 0.6])
def test_a_baseline_near_the_headline_is_a_finding(headline):
    truth = np.tile([0, 1], 40)
    sessions = np.repeat([f"{k}" for k in range(10)], 8)
    right = np.arange(80) % 10 > 0
    one = Baseline("clock", "when", held(right, truth, sessions))
    finding = one.finding(held(np.arange(80) / 80 < headline, truth, sessions))
    assert finding.code == "baseline-clock"
    assert finding.message.startswith("the clock alone names 90 %: recorded one material after the other")


def test_a_baseline_far_below_the_headline_is_no_finding():
    truth = np.tile([0, 1], 40)
    sessions = np.repeat([f"{k}" for k in range(10)], 8)
    one = Baseline("clock", "when", held(np.arange(80) % 8 > 1, truth, sessions))
    assert one.p < 0.005
    assert one.finding(held(np.ones(80), truth, sessions)) is None


def noise(n=16, rest=0.0, level=0.0, start=None, trigger=50):
    """Recordings of noise to which a trait of the material is added, before or after the motion begins."""
    rng = np.random.default_rng(0)
    recordings = []
    for k, label in enumerate(("oat", "peas", "rice")):
        for i in range(n):
            wrench = rng.normal(0, 1, (120, 6))
            wrench[:trigger] += rest * k
            wrench[trigger:] += level * k
            at = start(k, i) if start else 1e9 + 1e5 * (i % 4) + rng.uniform(0, 3600)
            own = {"session": f"day {i % 4}", "start_time": at, "trigger_index": trigger}
            recordings.append(Recording(wrench, 500.0, label=label, name=f"{label}_{i}", **own))
    return Dataset(recordings)


def baselines_of(data):
    result = evaluate(data, "raw", classifier=Centroids(), progress=False)
    return result, {one.name: one for one in result.baselines}


def test_rest_is_found_where_it_gives_the_material_away():
    result, of = baselines_of(noise(rest=1.0))
    assert of["rest"].what == "the 0.10 s before the motion"
    assert of["rest"].held.accuracy > 0.9
    assert [one.code for one in result.spoiling] == ["baseline-rest"]
    assert str(result).startswith("SPOILED by baseline-rest: the rest alone names ")


def test_baselines_stand_in_the_table_and_spoil_nothing_at_chance():
    result, of = baselines_of(noise(level=3.0))
    assert result.spoiling == ()
    assert of["rest"].held.accuracy < 0.6
    assert result.accuracy() > 0.95
    lines = [line.split()[0] for line in str(result).splitlines() if line]
    assert lines.index("raw") < lines.index("(rest)") < lines.index("(clock)")


def test_clock_is_found_where_materials_follow_each_other():
    result, of = baselines_of(noise(level=3.0, start=lambda k, i: 1e9 + 1e5 * (i % 4) + 3600.0 * k + i))
    assert of["clock"].held.accuracy == 1.0
    assert {one.code for one in result.spoiling} & {"leak-clock", "leak-hour", "baseline-clock"}


@pytest.mark.parametrize(
    ("fields", "name", "why"),
    [
        ({"trigger_index": lambda r: None}, "rest", "no onset known"),
        ({"trigger_index": lambda r: 0}, "rest", "a motion begins at the first sample"),
        (
            {"start_time": lambda r: None if r.name == "rice_3" else 7.0},
            "clock",
            "1 of 40 recordings carry no",
        ),
        ({"start_time": lambda r: 7.0}, "clock", "all recordings start at the same time"),
    ],
)
def test_a_baseline_that_cannot_be_had_says_why(fields, name, why):
    result, of = baselines_of(changed(make_data(), **{"trigger_index": lambda r: 9, **fields}))
    assert of[name].held is None
    assert np.isnan(of[name].p)
    assert f"({name}) left out: {why}" in str(result)


def test_a_rest_that_never_changes_is_at_chance():
    data = noise(level=3.0)
    for recording in data:
        recording.wrench.flags.writeable = True
        recording.wrench[:50] = 0.0
    _, of = baselines_of(data)
    assert of["rest"].held.accuracy == pytest.approx(1 / 3, abs=0.01)
