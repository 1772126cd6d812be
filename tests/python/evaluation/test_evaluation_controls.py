"""Controls: they find what gives a class away, stay at chance where nothing does, and say what they cannot do."""

import numpy as np
import pytest

from evaluation_cases import SMALL, THREE, changed, make_data
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.evaluation.controls import MOST_PARTITIONS, PlannedControl, judge, plan_controls
from granular_id.partitions import kfold_partitions, paper_partitions
from granular_id.recording import Dataset, Recording

ON = {**SMALL, "controls": True}


def noise(n=16, samples=400, *, rest=0.0, level=0.0, minutes_apart=60.0, trigger=100, seed=0):
    """Recordings of pure noise, to which one trait of the class is added."""
    rng = np.random.default_rng(seed)
    recordings = []
    for k, label in enumerate(("oat", "peas", "rice")):
        for i in range(n):
            wrench = rng.normal(0, 1, (samples, 6))
            wrench[:trigger] += rest * k
            wrench[trigger:] += level * k
            recordings.append(
                Recording(
                    wrench,
                    rate_hz=500.0,
                    label=label,
                    name=f"{label}_{i}",
                    start_time=1e9 + 3600.0 * minutes_apart * k + 60.0 * i,
                    trigger_index=trigger,
                )
            )
    return Dataset(recordings)


@pytest.fixture(scope="module")
def level():
    """Materials that differ in the level of their pushes: nothing before the motion."""
    return evaluate(noise(level=3.0), ["raw", "raw+hfmh"], "paper", **ON)


def named(result):
    return {control.name: control for control in result.controls}


def test_controls_come_in_order_and_change_nothing_that_is_measured(data, evaluated):
    assert [control.name for control in evaluated.controls] == ["rest", "clock"]
    without = evaluate(data, THREE, ["paper", "chronological"], **SMALL)
    assert without.controls == ()
    assert list(evaluated.predictions()) == list(without.predictions())


def test_controls_run_on_few_partitions_of_the_strictest_protocol(data):
    seen = []
    evaluate(
        data,
        "raw",
        ["kfold", "session"],
        controls=True,
        progress=lambda *step: seen.append(step[2]),
        n_folds=7,
    )
    assert sum(step.startswith("control clock: ") for step in seen) == 2
    seen.clear()
    evaluate(data, "raw", "kfold", progress=lambda *step: seen.append(step[2]), n_folds=7)
    assert sum(step.startswith("control clock: ") for step in seen) == MOST_PARTITIONS


def test_raw_samples_of_controls_are_downsampled():
    assert planned(noise(n=4, samples=1000, trigger=900))["rest"].task.bank.X.shape == (12, 180, 6)
    assert planned(noise(n=4, samples=400))["rest"].task.bank.X.shape == (12, 100, 6)


def test_rest_alone_is_found_where_the_rest_tells(level):
    told = named(evaluate(noise(rest=1.0), "raw", "paper", **ON))["rest"]
    assert told.accuracy > 0.9
    assert told.what == "the 0.20 s before the motion only"
    assert told.verdict == "random partitions can be answered above chance before anything moves"
    untold = named(level)["rest"]
    assert untold.accuracy < 0.6
    assert untold.verdict == "not above chance"


def planned(data):
    """Return the controls as they are planned, of which nothing is trained."""
    return {control.name: control for control in plan_controls(data, ECOCClassifier())}


def one_starts_at(sample):
    return changed(noise(n=4), trigger_index=lambda r: sample if r.name == "rice_3" else 100)


@pytest.mark.parametrize(
    ("data", "what", "left_out"),
    [
        (one_starts_at(25), "the 0.05 s before the motion only", ""),
        (one_starts_at(0), "", "a motion begins at the first sample"),
        (one_starts_at(None), "the first 0.3 s only, as the start of the motion is not known", ""),
        (make_data(samples=200), "", "0.3 s are 150 of 200 samples"),
    ],
)
def test_rest_is_the_shortest_before_any_motion_and_the_first_samples_where_unknown(data, what, left_out):
    rest = planned(data)["rest"]
    assert (rest.task is None) == bool(left_out)
    assert left_out in rest.why_not
    if what:
        assert rest.what == what


def test_the_clock_alone_answers_classes_recorded_one_after_the_other(evaluated):
    apart = named(evaluate(noise(), "raw", ["paper", "chronological"], **ON))["clock"]
    assert apart.accuracy == 1.0
    assert apart.verdict == "halves in time order can be answered above chance without touching the material"
    mixed = named(evaluated)["clock"]  # one recording of each class a minute
    assert mixed.accuracy < 0.4
    assert mixed.verdict == "not above chance"


@pytest.mark.parametrize(
    ("start_time", "why"),
    [
        (lambda r: None, "no recording carries a start time"),
        (lambda r: None if r.name == "rice_3" else r.start_time, "1 of 40 carry no start time"),
        (lambda r: 7.0, "all recordings start at the same time"),
    ],
)
def test_the_clock_is_left_out_where_it_says_nothing(data, start_time, why):
    clock = planned(changed(data, start_time=start_time))["clock"]
    assert (clock.task, clock.why_not) == (None, why)


def judged(partitions, truth, said, above=""):
    return judge(PlannedControl("clock", "w", task=object(), above=above), said, partitions, truth)


def test_chance_is_that_of_naming_the_most_frequent_class():
    truth = np.repeat([0, 1], [30, 10])
    partitions = kfold_partitions(truth, n_folds=5)
    always = judged(partitions, truth, [np.zeros(p.test.size, dtype=int) for p in partitions])
    assert always.chance == always.accuracy == pytest.approx(0.75)
    assert always.verdict == "not above chance"
    right = [truth[p.test] for p in partitions]
    assert judged(partitions, truth, right, "can be").verdict == "random folds can be"


@pytest.mark.parametrize(("share", "above"), [(0.10, False), (0.30, True)])
def test_above_chance_takes_three_standard_errors_of_the_recordings_tested(share, above):
    """100 recordings at 1/4: three SE are 13 points, whatever the number of partitions."""
    truth = np.repeat(np.arange(4), 25)
    partitions = paper_partitions(truth, n_partitions=20, train_per_class=20, test_per_class=5)
    rng = np.random.default_rng(0)
    said = []
    for p in partitions:
        lucky = rng.random(p.test.size) < share
        said.append(np.where(lucky, truth[p.test], (truth[p.test] + rng.integers(0, 4, p.test.size)) % 4))
    assert (judged(partitions, truth, said, "yes").verdict == "random partitions yes") == above


def test_what_few_recordings_cannot_tell_is_said():
    truth = np.repeat([0, 1], 4)
    partitions = paper_partitions(truth, n_partitions=2, train_per_class=2, test_per_class=2)
    right = [truth[p.test] for p in partitions]
    verdict = judged(partitions, truth, right).verdict
    assert verdict.startswith("too few partitions of random partitions to tell")


class Picky(ECOCClassifier):
    """Suits the spaces, and nothing smaller."""

    def fit_gram(self, gram, y, sample_weight=None):
        if np.trace(gram) < 1e5:
            raise ValueError("too little to see")
        return super().fit_gram(gram, y, sample_weight)


def test_a_control_that_the_classifier_cannot_do_is_left_out_and_says_why():
    data = noise(level=100.0)
    result = evaluate(data, "raw", "paper", classifier=Picky(), **ON)
    assert result.mean_accuracy("raw") == 1.0
    rest, clock = result.controls
    assert rest.verdict == "left out: control 'rest': too little to see"
    assert clock.accuracy == 1.0
    assert "classifier=Picky()" in result.command
