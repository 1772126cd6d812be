"""What could have been answered without the method: controls beside the accuracies.

A material that was recorded on its own day is told apart by anything that differs between days. No accuracy shows that,
however high; what the clock, the rest before the motion or six means reach alone does. Labels that mean nothing must
give chance, else the evaluation itself leaks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler

from granular_id._files import json_value
from granular_id._memory import copied
from granular_id._schema import from_json
from granular_id._text import fixed, listed
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.checkpoint import Answer
from granular_id.evaluation.features import GramBank
from granular_id.evaluation.scoring import Task
from granular_id.partitions import Partition, protocol_name
from granular_id.recording import Dataset
from granular_id.spaces import FeatureSpace, RawSignal, TimePermutation
from granular_id.statistics import confusion_counts

Codes = NDArray[np.intp]

REST_S = 0.3
"""What is taken for rest where the start of the motion is not known."""

MOST_INSTANTS = 200
"""Raw samples are downsampled to so many: what gives the label away in more does in these."""

MOST_PARTITIONS = 5

MOST_SHUFFLED = 500
"""So many rows with shuffled labels train: no plane tells them apart, and more take minutes to find that out."""

STANDARD_ERRORS = 3.0
"""An accuracy this far above chance is called above chance: one in a thousand by luck."""


@dataclass(frozen=True)
class Control:
    """One control, under the strictest protocol that ran; raw samples are downsampled to at most 200 instants.

    Attributes
    ----------
    name : str
        "rest", "means", "clock", "shuffled" or "permuted".
    what : str
        What was known to the classifier.
    accuracies : mapping of str to float
        Protocol to mean accuracy over its first partitions, five at most, in [0, 1]; empty when the control was left
        out.
    chance : float
        Accuracy of naming whatever class is most frequent; the highest of the protocols.
    verdict : str
        What the figures say, or why the control was left out.
    """

    name: str
    what: str
    accuracies: Mapping[str, float]
    chance: float
    verdict: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and text."""
        return {name: json_value(value) for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Control:
        """Make one from what `to_dict` gave."""
        return from_json(cls, values, what="a control")


@dataclass(frozen=True)
class PlannedControl:
    """A control to run (`above` says what an accuracy above chance means), or why it cannot be run."""

    name: str
    what: str
    task: Task | None
    above: str = ""
    why_not: str = ""


def plan_controls(
    data: Dataset, spaces: Sequence[FeatureSpace], classifier: BaseEstimator, bank: GramBank
) -> list[PlannedControl]:
    """Plan all controls: labels are shuffled in "raw+hfmh", or in the first of the spaces that are evaluated."""
    means = make_pipeline(StandardScaler(), ECOCClassifier())
    shuffled = next((space for space in spaces if space.name == "raw+hfmh"), spaces[0])
    permuted = make_pipeline(TimePermutation(random_state=0), RawSignal())
    fewer = GramBank(_downsampled(data.X))
    return [
        _rest(data, classifier),
        PlannedControl(
            "means",
            f"{data.X.shape[2]} per-axis means, standardised",
            _task("means", FunctionTransformer(), means, GramBank(data.X.mean(axis=1))),
            above="can be answered above chance without the course in time",
        ),
        _clock(data),
        PlannedControl(
            "shuffled",
            f"{shuffled.name}, trained on shuffled labels",
            replace(
                _task("shuffled", shuffled.transformer, shuffled.classifier or classifier, bank),
                shuffled=True,
                most_rows=MOST_SHUFFLED,
            ),
        ),
        PlannedControl(
            "permuted",
            "the raw samples of each recording in random order",
            _task("permuted", permuted, classifier, fewer),
            above="can be answered above chance without the order in time",
        ),
    ]


def _task(name: str, transformer: Any, classifier: BaseEstimator, bank: GramBank) -> Task:
    return Task(FeatureSpace(name, transformer, None), classifier, bank, kind="control")


def _downsampled(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Take every so manieth sample of recordings (n, T, C), at most `MOST_INSTANTS`."""
    return copied(X[:, :: math.ceil(X.shape[1] / MOST_INSTANTS)], "downsampled recordings")


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
    bank = GramBank(_downsampled(data.X[:, :n_rest]))
    return PlannedControl("rest", what, _task("rest", RawSignal(), classifier, bank), above)


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
    bank = GramBank((times - times.mean())[:, np.newaxis])
    task = _task("clock", FunctionTransformer(), KNeighborsClassifier(1), bank)
    return PlannedControl("clock", what, task, "can be answered above chance without touching the material")


def run_control(
    planned: PlannedControl,
    ask: Callable[[Task], tuple[Mapping[str, Sequence[Answer]], list[str]]],
    partitions: Mapping[str, Sequence[Partition]],
    truth: Codes,
) -> Control:
    """Answer a control for every partition, and say what that shows."""
    predicted: dict[str, list[Codes]] = {}
    if planned.task is not None:
        try:
            answers, _ = ask(planned.task)
        except ValueError as error:
            # A classifier may suit the spaces and not a few samples of rest: no reason to lose what was measured.
            planned = replace(planned, task=None, why_not=str(error))
        else:
            predicted = {protocol: [one.predicted for one in given] for protocol, given in answers.items()}
    return judge(planned, predicted, partitions, truth)


def judge(
    planned: PlannedControl,
    predicted: Mapping[str, Sequence[Codes]],
    partitions: Mapping[str, Sequence[Partition]],
    truth: Codes,
) -> Control:
    """Say what the predictions of a control show: class numbers by protocol, one array per partition."""
    chances = {
        protocol: float(np.mean([_guessing(p, truth) for p in drawn]))
        for protocol, drawn in partitions.items()
    }
    chance = max(chances.values())
    if planned.task is None:
        return Control(planned.name, planned.what, {}, chance, f"left out: {planned.why_not}")
    means, above, untold = {}, [], []
    for protocol, drawn in partitions.items():
        hits = [truth[p.test] == said for p, said in zip(drawn, predicted[protocol], strict=True)]
        means[protocol] = float(np.mean([np.mean(hit) for hit in hits]))
        n_tested = np.unique(np.concatenate([p.test for p in drawn])).size
        guess = chances[protocol]
        error = math.sqrt(guess * (1 - guess) / n_tested)
        if planned.name == "shuffled":
            error = max(error, _error_of_clumps(drawn, predicted[protocol], truth))
        if means[protocol] > guess + STANDARD_ERRORS * error:
            above.append(protocol_name(protocol, drawn))
        elif means[protocol] > guess and guess + STANDARD_ERRORS * error >= 1:
            untold.append(protocol_name(protocol, drawn))
    return Control(planned.name, planned.what, means, chance, _verdict(planned, above, untold))


def _guessing(partition: Partition, truth: Codes) -> float:
    """Accuracy of always naming the class that is most frequent in training, of those that are tested."""
    tested = np.unique(truth[partition.test])
    counts = np.bincount(truth[partition.train], minlength=int(tested[-1]) + 1)[tested]
    frequent = tested[counts == counts.max()]
    return float(np.mean(np.isin(truth[partition.test], frequent)) / frequent.size)


def _error_of_clumps(drawn: Sequence[Partition], predicted: Sequence[Codes], truth: Codes) -> float:
    """Return the standard error of the accuracy of answers that mean nothing.

    Recordings of one class may be answered alike, and are then right or wrong together. Were the names of the answers
    drawn anew for each class and partition, as shuffling does it, the hits of n recordings of which shares q of K
    classes were answered would have the variance n^2 (mean of q^2 - 1 / K^2).
    """
    n_classes = int(truth.max()) + 1
    variance, n_answers = 0.0, 0
    for partition, said in zip(drawn, predicted, strict=True):
        counts = confusion_counts(truth[partition.test], said, n_classes)
        variance += float(((counts**2).mean(axis=1) - counts.mean(axis=1) ** 2).sum())
        n_answers += said.size
    return math.sqrt(variance) / n_answers


def _verdict(planned: PlannedControl, above: Sequence[str], untold: Sequence[str]) -> str:
    which = listed(above)
    if untold and not above:
        return f"too few partitions of {listed(untold)} to tell: not even 100 % would be beyond luck"
    if planned.name == "shuffled":
        leak = f"above chance on {which} with labels that mean nothing, so the accuracies there cannot be trusted"
        return leak if above else "not above chance, as it must be"
    return f"{which} {planned.above}" if above else "not above chance"
