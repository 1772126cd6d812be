"""Controls: they find what gives a class away, stay at chance where nothing does, and say what they cannot do."""

import numpy as np
import pytest

from evaluation_cases import SMALL, changed, make_data
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation import evaluate
from granular_id.evaluation.controls import Control, PlannedControl, judge
from granular_id.partitions import kfold_partitions, paper_partitions
from granular_id.recording import Dataset, Recording

ON = {**SMALL, "controls": True}


def controls_of(data, protocol="paper", **arguments):
    result = evaluate(data, "raw", protocol, **{**ON, **arguments})
    return {control.name: control for control in result.controls}


def noise(n=16, samples=400, *, rest=0.0, level=0.0, wave=0.0, minutes_apart=60.0, trigger=100, seed=0):
    """Recordings of pure noise, to which one trait of the class is added."""
    rng = np.random.default_rng(seed)
    recordings = []
    for k, label in enumerate(("oat", "peas", "rice")):
        for i in range(n):
            wrench = rng.normal(0, 1, (samples, 6))
            wrench[:trigger] += rest * k
            wrench[trigger:] += level * k
            turns = np.linspace(0, 1, samples - trigger, endpoint=False) * (5 + 10 * k)  # whole ones: no mean
            wrench[trigger:] += wave * np.sin(2 * np.pi * turns)[:, None]
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


def test_order_and_names():
    assert list(controls_of(make_data())) == ["rest", "means", "clock", "shuffled", "permuted"]
    assert evaluate(make_data(), "raw", "paper", **SMALL).controls == ()


def test_rest_alone_is_found_where_the_rest_tells():
    told = controls_of(noise(rest=1.0))["rest"]
    assert told.accuracies["paper"] > 0.9
    assert told.what == "the 0.20 s before the motion only"
    assert told.verdict == "random partitions can be answered above chance before anything moves"
    untold = controls_of(noise(level=1.0))["rest"]
    assert untold.accuracies["paper"] < 0.6
    assert untold.verdict == "not above chance"


def test_rest_is_the_shortest_before_any_motion_and_the_first_samples_where_unknown():
    data = noise()
    early = changed(data, trigger_index=lambda r: 25 if r.name == "rice_3" else 100)
    assert controls_of(early)["rest"].what == "the 0.05 s before the motion only"
    at_once = changed(data, trigger_index=lambda r: 0 if r.name == "rice_3" else 100)
    assert controls_of(at_once)["rest"].verdict == "left out: a motion begins at the first sample"
    some = changed(data, trigger_index=lambda r: None if r.name == "rice_3" else 100)
    assert controls_of(some)["rest"].what == "the first 0.3 s only, as the start of the motion is not known"
    short = controls_of(make_data(samples=200))["rest"]
    assert short.verdict == "left out: 0.3 s are 150 of 200 samples"
    assert short.accuracies == {}


def test_means_alone_are_found_where_they_tell():
    assert controls_of(noise(level=1.0))["means"].accuracies["paper"] > 0.95
    waves = controls_of(noise(wave=3.0))
    assert waves["means"].accuracies["paper"] < 0.7
    assert waves["means"].what == "6 per-axis means, standardised"


def test_the_clock_alone_answers_random_partitions_of_classes_recorded_one_after_the_other():
    apart = controls_of(noise(), ["paper", "chronological"])["clock"]
    assert apart.accuracies == {"paper": 1.0, "chronological": 1.0}
    assert apart.verdict == (
        "random partitions and halves in time order can be answered above chance without touching the material"
    )
    mixed = controls_of(make_data())["clock"]  # one recording of each class a minute
    assert mixed.accuracies["paper"] < 0.4
    assert mixed.verdict == "not above chance"


@pytest.mark.parametrize(
    ("start_time", "why"),
    [
        (lambda r: None, "no recording carries a start time"),
        (lambda r: None if r.name == "rice_3" else r.start_time, "1 of 40 carry no start time"),
        (lambda r: 7.0, "all recordings start at the same time"),
    ],
)
def test_the_clock_is_left_out_where_it_says_nothing(start_time, why):
    control = controls_of(changed(make_data(), start_time=start_time))["clock"]
    assert control.accuracies == {}
    assert control.verdict == f"left out: {why}"


def test_shuffled_labels_sit_at_chance_however_easy_the_data():
    result = evaluate(noise(level=3.0), ["raw", "raw+hfmh"], **ON)
    shuffled = next(control for control in result.controls if control.name == "shuffled")
    assert shuffled.what == "raw+hfmh, trained on shuffled labels"
    assert result.mean_accuracy("raw+hfmh") > 0.8
    for protocol in result.protocols:
        # 48 recordings, p = 1/3: three SD are 0.2
        assert abs(shuffled.accuracies[protocol] - 1 / 3) < 0.2
    assert shuffled.verdict == "not above chance, as it must be"


def test_permuted_samples_keep_the_level_and_lose_the_wave():
    assert controls_of(noise(level=1.0))["permuted"].accuracies["paper"] > 0.95
    waves = noise(wave=3.0)
    assert evaluate(waves, "raw", "paper", **SMALL).mean_accuracy("raw") > 0.95
    assert controls_of(waves)["permuted"].accuracies["paper"] < 0.7


def test_controls_do_not_change_what_is_measured_and_are_the_same_for_any_number_of_threads():
    data = make_data()
    one, two = (evaluate(data, "raw", n_jobs=n_jobs, **ON) for n_jobs in (1, 2))
    without = evaluate(data, "raw", **SMALL)
    assert one.controls == two.controls
    assert list(one.predictions()) == list(without.predictions())
    other = evaluate(data, "raw", **{**ON, "random_state": 5})
    assert other.controls != one.controls


def judged(partitions, truth, said):
    planned = PlannedControl("clock", "w", task=object(), above="can be answered")
    return judge(planned, {"kfold": said}, {"kfold": partitions}, truth)


def test_chance_is_that_of_naming_the_most_frequent_class():
    truth = np.repeat([0, 1], [30, 10])
    partitions = kfold_partitions(truth, n_folds=5)
    always = judged(partitions, truth, [np.zeros(p.test.size, dtype=int) for p in partitions])
    assert always.chance == pytest.approx(0.75)
    assert always.accuracies["kfold"] == pytest.approx(0.75)
    assert always.verdict == "not above chance"
    right = judged(partitions, truth, [truth[p.test] for p in partitions])
    assert right.verdict == "random folds can be answered"


def test_above_chance_takes_three_standard_errors_of_the_recordings_tested():
    truth = np.repeat(np.arange(4), 25)
    partitions = paper_partitions(truth, n_partitions=20, train_per_class=20, test_per_class=5)
    rng = np.random.default_rng(0)
    # 100 recordings at 1/4: three SE are 13 points, whatever the number of partitions
    for share, above in ((0.10, False), (0.30, True)):
        said = []
        for p in partitions:
            lucky = rng.random(p.test.size) < share
            said.append(np.where(lucky, truth[p.test], (truth[p.test] + rng.integers(0, 4, p.test.size)) % 4))
        control = judge(
            PlannedControl("clock", "w", task=object(), above="yes"),
            {"paper": said},
            {"paper": partitions},
            truth,
        )
        assert (control.verdict == "random partitions yes") == above


def test_a_leak_is_called_one():
    truth = np.repeat([0, 1], 20)
    partitions = kfold_partitions(truth)
    planned = PlannedControl("shuffled", "w", task=object())
    control = judge(planned, {"kfold": [truth[p.test] for p in partitions]}, {"kfold": partitions}, truth)
    assert control.verdict == (
        "above chance on random folds with labels that mean nothing, so the accuracies there cannot be trusted"
    )


def test_recordings_of_a_class_that_are_answered_alike_are_lucky_together():
    """Twenty classes of ten: two classes that are right by luck are 10 % where 5 % are chance."""
    truth = np.repeat(np.arange(20), 20)
    partitions = paper_partitions(truth, n_partitions=2, train_per_class=10, test_per_class=10)
    rng = np.random.default_rng(0)
    for n_lucky, clumps, leaks in ((2, True, False), (2, False, True), (8, True, True)):
        said = []
        for p in partitions:
            answer = np.where(np.arange(20) < n_lucky, np.arange(20), (np.arange(20) + 1) % 20)
            alike = answer[truth[p.test]]
            alone = np.where(
                rng.random(p.test.size) < n_lucky / 20,
                truth[p.test],
                (truth[p.test] + 1 + rng.integers(0, 19, p.test.size)) % 20,
            )
            said.append(alike if clumps else alone)
        planned = PlannedControl("shuffled", "w", task=object())
        control = judge(planned, {"paper": said}, {"paper": partitions}, truth)
        assert ("cannot be trusted" in control.verdict) == leaks, (n_lucky, clumps, control)


def test_what_few_classes_cannot_tell_is_said():
    """Two classes, each answered alike: both are right by luck once in four times."""
    truth = np.repeat([0, 1], 20)
    planned = PlannedControl("shuffled", "w", task=object())
    for n_partitions, verdict in (
        (2, "too few partitions of random partitions to tell"),
        (20, "cannot be trusted"),
    ):
        partitions = paper_partitions(truth, n_partitions=n_partitions, train_per_class=10, test_per_class=10)
        right = [truth[p.test] for p in partitions]
        assert verdict in judge(planned, {"paper": right}, {"paper": partitions}, truth).verdict


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
    rest, _, clock, *_ = result.controls
    assert rest.verdict == "left out: control 'rest': too little to see"
    assert clock.accuracies["paper"] == 1.0
    assert "classifier=Picky()" in result.command


def test_round_trip():
    for control in controls_of(make_data()).values():
        assert Control.from_dict(control.to_dict()) == control
