"""One method over the partitions of one data set: accuracies and seconds."""

from __future__ import annotations

import gc
import statistics
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from accuracy_data import BenchSet
from accuracy_methods import Method, OurFeatures
from accuracy_stages import NotAvailableError, Setting
from granular_id.partitions import Partition
from granular_id.recording import Dataset
from granular_id.splits import groups_of

THREADS = 1
"""Of everything: peers are told by their own settings, libraries of linear algebra by a limit."""

clock = time.process_time
"""Seconds that the processor spent on this process: on one thread the time it takes, whatever else the machine does."""

LEAST_S, MOST_ROUNDS = 0.05, 9
"""Features and predictions are timed anew until this time is spent, or this often; the median counts."""

LONGEST = 300
"""Characters of an error message that are kept: some peers' go on for pages."""

STAGES = ("features", "fit", "predict")


@dataclass
class Row:
    """What one method reached on one data set.

    Attributes
    ----------
    data_set, group, method, what : str
    ours : bool
    status : {"ok", "not available", "failed"}
    why : str
        Where the status is not "ok".
    n_train, n_test : list of int
        Recordings of each partition.
    accuracies : list of float
        Of each partition, as shares of 1.
    seconds : dict of str to list of float
        Processor seconds per recording, for each partition: ``"features"`` and ``"predict"`` of a tested recording,
        ``"fit"`` (all that is done with the training recordings) per training recording.
    n_features : int or None
        Numbers that the classifier gets.
    warnings : list of str
        Each once.
    """

    data_set: str
    group: str
    method: str
    what: str
    ours: bool
    status: str = "ok"
    why: str = ""
    n_train: list[int] = field(default_factory=list)
    n_test: list[int] = field(default_factory=list)
    accuracies: list[float] = field(default_factory=list)
    seconds: dict[str, list[float]] = field(default_factory=lambda: {stage: [] for stage in STAGES})
    n_features: int | None = None
    warnings: list[str] = field(default_factory=list)

    @property
    def mean(self) -> float:
        """Mean accuracy."""
        return statistics.fmean(self.accuracies)

    def median_s(self, stage: str) -> float:
        """Median seconds per recording of a stage."""
        return statistics.median(self.seconds[stage])


def run_method(
    method: Method,
    bench_set: BenchSet,
    partitions: Sequence[Partition],
    seed: int,
    tick: Callable[[int], None],
) -> Row:
    """Train and test one method on every partition.

    A method that cannot run here, or stops with an error, gives a row that says so: the others go on.
    """
    row = Row(bench_set.name, bench_set.group, method.name, method.what, method.ours)
    data = bench_set.data
    setting = Setting(data.rate_hz, data.X.shape[1], seed)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            _warm_up(method, setting, data, partitions[0])
            with threadpool_limits(THREADS):  # what was loaded by the warm-up is limited too
                for number, partition in enumerate(partitions):
                    tick(number)
                    gc.collect()  # what the method before has left is not collected on this one's time
                    _add(row, *method.stages(setting), data, partition)
        row.warnings = sorted({str(warning.message).split("\n")[0] for warning in caught})
    except NotAvailableError as error:
        row.status, row.why = "not available", str(error)
    except Exception as error:  # a peer's fault must not lose the rows of the others; it is shown, and counts
        row.status, row.why = "failed", f"{type(error).__name__}: {str(error)[:LONGEST].strip()}"
    return row


def _warm_up(method: Method, setting: Setting, data: Dataset, partition: Partition) -> None:
    """Compile and load what a method needs, on two training recordings of each class: that is no time of its own."""
    features, _ = method.stages(setting)
    y = data.y[partition.train]
    few = np.concatenate([np.flatnonzero(y == label)[:2] for label in np.unique(y)])
    rows = partition.train[few]
    features.fit(data.X[rows], data.y[rows])
    features.transform(data.X[rows])


def _add(row: Row, features: Any, classifier: Any, data: Dataset, partition: Partition) -> None:
    train, test = partition.train, partition.test
    X_train, X_test, y_train = data.X[train], data.X[test], data.y[train]
    start = clock()
    rows = features.fit_transform(X_train, y_train)
    known = {}
    if isinstance(
        features, OurFeatures
    ):  # a classifier of ours may ask for blocks, sessions, and order in time
        features.tell_blocks(classifier)
        known = groups_of(data).fit_arguments(classifier, train)
    classifier.fit(rows, y_train, **known)
    fit_s = clock() - start
    features_s, tested = _timed(lambda: features.transform(X_test))
    predict_s, predicted = _timed(lambda: classifier.predict(tested))
    row.n_features = rows.shape[1]
    row.n_train.append(len(train))
    row.n_test.append(len(test))
    row.accuracies.append(float(np.mean(predicted == data.y[test])))
    row.seconds["features"].append(features_s / len(test))
    row.seconds["fit"].append(fit_s / len(train))
    row.seconds["predict"].append(predict_s / len(test))


def _timed(work: Callable[[], Any]) -> tuple[float, Any]:
    """Median processor seconds of a call, and what it gave."""
    times: list[float] = []
    result = None
    while sum(times) < LEAST_S and len(times) < MOST_ROUNDS:
        start = clock()
        result = work()
        times.append(clock() - start)
    return statistics.median(times), result
