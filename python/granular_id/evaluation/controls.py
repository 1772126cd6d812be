"""What could have been answered without the method: controls beside the accuracies.

A material that was recorded on its own day is told apart by anything that differs between days. No accuracy shows that,
however high; what the clock or the rest before the motion reach alone does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.neighbors import KNeighborsClassifier
from sklearn.preprocessing import FunctionTransformer

from granular_id._memory import copied
from granular_id._text import fixed
from granular_id.evaluation.features import GramBank
from granular_id.evaluation.scoring import Answer, Task
from granular_id.partitions import Partition, protocol_name
from granular_id.recording import Dataset
from granular_id.spaces import FeatureSpace, RawSignal

Codes = NDArray[np.intp]

REST_S = 0.3
"""What is taken for rest where the start of the motion is not known."""

MOST_INSTANTS = 200
"""Raw samples are downsampled to so many: what gives the label away in more does in these."""

MOST_PARTITIONS = 5

STANDARD_ERRORS = 3.0
"""An accuracy this far above chance is called above chance: one in a thousand by luck."""


@dataclass(frozen=True)
class Control:
    """One control, under the headline's protocol; raw samples are downsampled to at most 200 instants.

    Attributes
    ----------
    name : str
        "rest" or "clock".
    what : str
        What was known to the classifier.
    accuracy : float or None
        Mean over the first partitions, five at most, in [0, 1]; None when the control was left out.
    chance : float
        Accuracy of naming whatever class is most frequent.
    verdict : str
        What the figures say, or why the control was left out.
    """

    name: str
    what: str
    accuracy: float | None
    chance: float
    verdict: str


@dataclass(frozen=True)
class PlannedControl:
    """A control to run (`above` says what an accuracy above chance means), or why it cannot be run."""

    name: str
    what: str
    task: Task | None
    above: str = ""
    why_not: str = ""


def plan_controls(data: Dataset, classifier: BaseEstimator) -> list[PlannedControl]:
    """Plan all controls."""
    return [_rest(data, classifier), _clock(data)]


def _task(name: str, transformer: Any, classifier: BaseEstimator, X: NDArray[np.float64]) -> Task:
    return Task(FeatureSpace(name, transformer, None), classifier, GramBank(X), kind="control")


def _rest(data: Dataset, classifier: BaseEstimator) -> PlannedControl:
    triggers = [recording.trigger_index for recording in data]
    n_samples = data.X.shape[1]
    known = [trigger for trigger in triggers if trigger is not None]
    if len(known) == len(triggers):
        n_rest = min(known)
        what = f"the {fixed(n_rest / data.rate_hz, 2)} s before the motion only"
        above = "can be answered above chance before anything moves"
        why_not = "a motion begins at the first sample" if n_rest == 0 else ""
    else:
        n_rest = round(REST_S * data.rate_hz)
        what = f"the first {REST_S:g} s only, as the start of the motion is not known"
        above = f"can be answered above chance from the first {REST_S:g} s"
        why_not = "" if 1 <= n_rest <= n_samples / 2 else f"{REST_S:g} s are {n_rest} of {n_samples} samples"
    if why_not:
        return PlannedControl("rest", what, None, why_not=why_not)
    downsampled = copied(data.X[:, : n_rest : math.ceil(n_rest / MOST_INSTANTS)], "downsampled recordings")
    return PlannedControl("rest", what, _task("rest", RawSignal(), classifier, downsampled), above)


def _clock(data: Dataset) -> PlannedControl:
    what = "the time of acquisition only (nearest neighbour)"
    times = data.start_times
    unknown = int(np.isnan(times).sum())
    if unknown:
        which = "no recording carries a" if unknown == times.size else f"{unknown} of {times.size} carry no"
        return PlannedControl("clock", what, None, why_not=f"{which} start time")
    if (times == times[0]).all():
        return PlannedControl("clock", what, None, why_not="all recordings start at the same time")
    # Seconds since 1970 squared leave no digits for seconds: distances need times about their middle.
    centred = (times - times.mean())[:, np.newaxis]
    task = _task("clock", FunctionTransformer(), KNeighborsClassifier(1), centred)
    return PlannedControl("clock", what, task, "can be answered above chance without touching the material")


def run_control(
    planned: PlannedControl,
    ask: Callable[[Task], tuple[Sequence[Answer], list[str]]],
    partitions: Sequence[Partition],
    truth: Codes,
) -> Control:
    """Answer a control for every partition, and say what that shows."""
    predicted: list[Codes] = []
    if planned.task is not None:
        try:
            answers, _ = ask(planned.task)
        except ValueError as error:
            # A classifier may suit the spaces and not a few samples of rest: no reason to lose what was measured.
            planned = replace(planned, task=None, why_not=str(error))
        else:
            predicted = [answer.predicted for answer in answers]
    return judge(planned, predicted, partitions, truth)


def judge(
    planned: PlannedControl, predicted: Sequence[Codes], partitions: Sequence[Partition], truth: Codes
) -> Control:
    """Say what the predictions of a control show: class numbers, one array per partition."""
    chance = float(np.mean([_guessing(partition, truth) for partition in partitions]))
    if planned.task is None:
        return Control(planned.name, planned.what, None, chance, f"left out: {planned.why_not}")
    hits = [truth[p.test] == named for p, named in zip(partitions, predicted, strict=True)]
    accuracy = float(np.mean([np.mean(hit) for hit in hits]))
    n_tested = np.unique(np.concatenate([partition.test for partition in partitions])).size
    limit = chance + STANDARD_ERRORS * math.sqrt(chance * (1 - chance) / n_tested)
    protocol = protocol_name(partitions[0].protocol, partitions)
    verdict = "not above chance"
    if accuracy > limit:
        verdict = f"{protocol} {planned.above}"
    elif accuracy > chance and limit >= 1:
        verdict = f"too few partitions of {protocol} to tell: not even 100 % would be beyond luck"
    return Control(planned.name, planned.what, accuracy, chance, verdict)


def _guessing(partition: Partition, truth: Codes) -> float:
    """Accuracy of always naming the class that is most frequent in training, of those that are tested."""
    tested = np.unique(truth[partition.test])
    counts = np.bincount(truth[partition.train], minlength=int(tested[-1]) + 1)[tested]
    frequent = tested[counts == counts.max()]
    return float(np.mean(np.isin(truth[partition.test], frequent)) / frequent.size)
