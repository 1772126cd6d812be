"""Baselines: what could be known without touching the material, and when that spoils an evaluation."""

import numpy as np
import pytest
from scipy.stats import binom

from evaluation_cases import Centroids, changed, held, make_data
from granular_id.evaluation import Baseline, evaluate
from granular_id.recording import Dataset, Recording


def test_baselines_count_cells_of_material_and_session():
    """Six cells of 20 answers each: all answers of a cell are right together, which is no evidence of 120."""
    truth, sessions = np.repeat([0, 1] * 3, 20), np.repeat(list("ssttuu"), 20)
    one = Baseline("clock", "when", held(np.repeat([1, 1, 1, 1, 0, 0], 20), truth, sessions))
    assert one.p == pytest.approx(binom.sf(3, 6, 0.5))
    assert one.p > 0.3
    assert one.finding(held(np.ones(120), truth, sessions)) is None


@pytest.mark.parametrize(
    ("n_wrong", "of", "headline", "spoils"), [(1, 10, 1.0, True), (1, 10, 0.6, True), (2, 8, 1.0, False)]
)
def test_a_baseline_near_the_headline_is_a_finding(n_wrong, of, headline, spoils):
    truth, sessions = np.tile([0, 1], 40), np.repeat([f"{k}" for k in range(10)], 8)
    one = Baseline("clock", "when", held(np.arange(80) % of >= n_wrong, truth, sessions))
    found = one.finding(held(np.arange(80) / 80 < headline, truth, sessions))
    assert one.p < 0.005
    assert (found is not None) is spoils
    if spoils:
        assert found.code == "baseline-clock"
        wanted = "the clock alone names 90 %: recorded one material after the other"
        assert found.message.startswith(wanted)


def noise(rest=0.0, level=0.0, start=None):
    """Recordings of noise to which a trait of the material is added, before or after the motion begins."""
    rng = np.random.default_rng(0)
    recordings = []
    for k, label in enumerate(("oat", "peas", "rice")):
        for i in range(16):
            wrench = rng.normal(0, 1, (120, 6))
            wrench[:50] += rest * k
            wrench[50:] += level * k
            at = start(k, i) if start else 1e9 + 1e5 * (i % 4) + rng.uniform(0, 3600)
            own = {"session": f"day {i % 4}", "start_time": at, "trigger_index": 50}
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


def test_baselines_at_chance_stand_in_the_table_only():
    result, of = baselines_of(noise(level=3.0))
    assert result.spoiling == ()
    assert of["rest"].held.accuracy < 0.6
    assert result.accuracy() > 0.95
    lines = [line.split()[0] for line in str(result).splitlines() if line]
    assert lines.index("raw") < lines.index("(rest)") < lines.index("(clock)")


def test_clock_is_found_where_materials_follow_each_other():
    result, of = baselines_of(noise(level=3.0, start=lambda k, i: 1e9 + 1e5 * (i % 4) + 3600.0 * k + i))
    assert of["clock"].held.accuracy == 1.0
    assert {one.code for one in result.spoiling} & {"leak-clock", "baseline-clock"}


@pytest.mark.parametrize(
    ("fields", "name", "why"),
    [
        ({"trigger_index": lambda r: None}, "rest", "no onset known"),
        ({"trigger_index": lambda r: 0}, "rest", "a motion begins at the first sample"),
        ({"start_time": lambda r: None if r.name == "rice_3" else 7.0}, "clock", "1 of 40 recordings carry"),
        ({"start_time": lambda r: 7.0}, "clock", "all recordings start at the same time"),
    ],
)
def test_a_baseline_that_cannot_be_had_says_why(fields, name, why):
    result, of = baselines_of(changed(make_data(), **{"trigger_index": lambda r: 9, **fields}))
    assert of[name].held is None
    assert np.isnan(of[name].p)
    assert f"({name}) left out: {why}" in str(result)
