"""What an evaluation measured: predictions of every partition, and the figures that follow from them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._checks import argument_error, named
from granular_id.evaluation.compare import Comparison, compare
from granular_id.evaluation.controls import Control
from granular_id.evaluation.report_data import ReportData
from granular_id.partitions import CONDITION, Partition, are_blocks, protocol_name
from granular_id.recording import Finding
from granular_id.spaces import Chosen
from granular_id.statistics import confusion_counts, macro_f1, mean_interval, recall_per_class, sample_sd

_ALIKE = 0.05
"""Numbers of recordings that differ by no more than this share count as equal."""


@dataclass(frozen=True)
class SpaceSummary:
    """One feature space as it was evaluated.

    Parameters
    ----------
    name : str
        ``"raw"``, ``"hfmh"``, ``"raw+hfmh"`` or the caller's own name.
    paper_accuracy : float or None
        Accuracy that the paper reports for this space on its own recordings, in [0, 1]. Never measured here.
    learns : bool
        True when the features were fitted on the training rows of each partition.
    n_features : int
        Length of a feature vector.
    seconds : mapping of str to float
        Time spent in the stages ``features``, ``gram``, ``training`` and ``prediction``, controls left out. What
        several spaces share is counted for each, as it would take alone, and with several threads the stages of
        different partitions overlap: the sum exceeds the time that passed, which is `EvaluationResult.wall_s`.
    settings : mapping
        Parameters of the transformer.
    """

    name: str
    paper_accuracy: float | None
    learns: bool
    n_features: int
    seconds: Mapping[str, float]
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Prediction:
    """What one partition said about one recording.

    Attributes
    ----------
    protocol, partition, space
        Which partition of which protocol (from 0), and in which feature space.
    row, recording, session
        Place of the recording in the data set, its name and its session.
    label, predicted : str
        The material, and what was answered.
    """

    protocol: str
    partition: int
    space: str
    row: int
    recording: str
    session: str
    label: str
    predicted: str


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """The numbers of an `EvaluationResult`, which says what the fields hold; tables are drawn from them."""

    spaces: tuple[SpaceSummary, ...]
    partitions: Mapping[str, tuple[Partition, ...]]
    predicted: Mapping[tuple[str, str], tuple[NDArray[np.intp], ...]]
    labels: tuple[str, ...]
    truth: NDArray[np.intp]
    names: tuple[str, ...]
    sessions: tuple[str, ...]
    settings: Mapping[str, Any]
    data: Mapping[str, Any]
    versions: Mapping[str, str]
    report_data: ReportData
    notes: tuple[str, ...] = ()
    synthetic: bool = False
    command: str = ""
    controls: tuple[Control, ...] = ()
    chosen: Mapping[tuple[str, str], tuple[Chosen, ...]] = field(default_factory=dict)
    wall_s: float = math.nan
    findings: tuple[Finding, ...] = ()
    adapted: Mapping[str, tuple[NDArray[np.intp], ...]] = field(default_factory=dict)

    @property
    def protocols(self) -> tuple[str, ...]:
        """Protocols that ran, in order."""
        return tuple(self.partitions)

    @property
    def strictest(self) -> str | None:
        """The strictest protocol that ran and held out a condition, time or session; None where none did.

        A condition, whole sessions, then halves in time order, then blocks in time that stood in for sessions.
        """
        return strictest_of(self.partitions)

    @property
    def random(self) -> str | None:
        """The protocol with random draws that ran, against which the strictest is held; None where none did."""
        return next((name for name in ("matched", "paper", "kfold") if name in self.partitions), None)

    @property
    def held_out(self) -> str | None:
        """The condition of which one value after the other was held out; None where none was."""
        drawn = self.partitions.get(CONDITION)
        return None if drawn is None else drawn[0].condition

    @property
    def headline(self) -> str:
        """The protocol whose figures count: `strictest`, or the first that ran."""
        return self.strictest or self.protocols[0]

    @property
    def spoiling(self) -> tuple[Finding, ...]:
        """Those of `findings` that nobody accepted: the figures mislead."""
        accepted = self.settings.get("accept", ())
        return tuple(finding for finding in self.findings if finding.code not in accepted)

    @property
    def exceptions(self) -> dict[str, str]:
        """Classes whose own sessions were not held out where those of others were, and what was done instead."""
        drawn = self.partitions.get("session", ())
        if are_blocks(drawn):
            return {}
        found = {}
        sessions = np.array(self.sessions, dtype=object)
        for code, label in enumerate(self.labels):
            sides = [
                [sessions[rows[self.truth[rows] == code]].tolist() for rows in (p.test, p.train)]
                for p in drawn
            ]
            if drawn and not any(test for test, _ in sides):
                found[label] = "never tested"
            elif any(set(test) & set(train) for test, train in sides):
                found[label] = "split in time"
        return found

    @property
    def chance(self) -> float:
        """Accuracy of guessing when every class is equally frequent: 1 / K."""
        return 1 / len(self.labels)

    def protocol_name(self, protocol: str) -> str:
        """Name a protocol that ran in words, such as ``"held-out sessions"``."""
        return protocol_name(protocol, self.partitions[protocol])

    def space(self, name: str) -> SpaceSummary:
        """Return one space by name, or raise a ValueError that lists the names."""
        found: SpaceSummary = named({space.name: space for space in self.spaces}, "space", name)
        return found

    def best_space(self, protocol: str | None = None) -> str:
        """Name of the space with the highest mean accuracy; of equals that which the strictest protocol prefers.

        The choice uses the tested recordings: good for picking what to look at, not for claiming its accuracy.
        """
        protocols = (protocol, self.strictest)
        return max(self.spaces, key=lambda s: [self.mean_accuracy(s.name, p) for p in protocols]).name

    def accuracies(self, space: str, protocol: str | None = None) -> NDArray[np.float64]:
        """Share of tested recordings named rightly, one value per partition.

        Parameters
        ----------
        space : str
            Name of a feature space.
        protocol : str, optional
            Default: the first protocol that ran.

        Returns
        -------
        (n_partitions,) float array
            In [0, 1].
        """
        partitions, predicted = self._runs(space, protocol)
        return np.array(
            [np.mean(self.truth[p.test] == said) for p, said in zip(partitions, predicted, strict=True)]
        )

    def balanced_accuracies(self, space: str, protocol: str | None = None) -> NDArray[np.float64]:
        """Mean over the tested classes of the share named rightly, one value per partition; see `accuracies`."""
        return self._balanced(*self._runs(space, protocol))

    def adapted_accuracies(self, space: str) -> NDArray[np.float64] | None:
        """Balanced accuracy on each held-out value of a condition after adapting to its recordings without labels.

        Parameters
        ----------
        space : str
            Name of a feature space.

        Returns
        -------
        (n_values,) float array or None
            None where no condition was held out, the classifier cannot be adapted, or not every value holds all
            materials about equally.
        """
        named = self.adapted.get(self.space(space).name)
        return None if named is None else self._balanced(self.partitions[CONDITION], named)

    def _balanced(
        self, partitions: Sequence[Partition], named: Sequence[NDArray[np.intp]]
    ) -> NDArray[np.float64]:
        n_classes = len(self.labels)
        return np.array(
            [
                np.nanmean(recall_per_class(confusion_counts(self.truth[p.test], said, n_classes)))
                for p, said in zip(partitions, named, strict=True)
            ]
        )

    def mean_accuracy(self, space: str, protocol: str | None = None) -> float:
        """Mean of `accuracies`, in [0, 1]."""
        return float(self.accuracies(space, protocol).mean())

    def sd_accuracy(self, space: str, protocol: str | None = None) -> float:
        """Sample standard deviation of `accuracies` (divisor J - 1); NaN for one partition."""
        return sample_sd(self.accuracies(space, protocol))

    def interval(self, space: str, protocol: str | None = None) -> tuple[float, float]:
        """95 % interval of `mean_accuracy`, corrected for the recordings that partitions share.

        NaN with fewer than three partitions and where all agree. The correction is that of Nadeau & Bengio (2003).
        """
        partitions, _ = self._runs(space, protocol)
        return mean_interval(self.accuracies(space, protocol), *_sizes(partitions))

    def comparison(self, protocol: str | None = None) -> Comparison:
        """Compare every space with every other on the same partitions; ``print`` it for a table.

        Parameters
        ----------
        protocol : str, optional
            Default: the first protocol that ran.

        Raises
        ------
        ValueError
            A protocol that did not run, or a single space.
        """
        partitions, _ = self._runs(self.spaces[0].name, protocol)
        accuracies = {space.name: self.accuracies(space.name, protocol) for space in self.spaces}
        return compare(accuracies, *_sizes(partitions), self.protocol_name(partitions[0].protocol))

    def confusion(self, space: str | None = None, protocol: str | None = None) -> NDArray[np.int64]:
        """Confusion matrix summed over the partitions of a protocol.

        Parameters
        ----------
        space : str, optional
            Default: `best_space`.
        protocol : str, optional
            Default: the first protocol that ran.

        Returns
        -------
        (K, K) int array
            Row: true class, column: predicted class, in the order of `labels`.
        """
        partitions, predicted = self._runs(space or self.best_space(protocol), protocol)
        truth = np.concatenate([self.truth[partition.test] for partition in partitions])
        return confusion_counts(truth, np.concatenate(predicted), len(self.labels))

    def recall(self, space: str | None = None, protocol: str | None = None) -> NDArray[np.float64]:
        """Share of each class named rightly, over all partitions: (K,) in the order of `labels`."""
        return recall_per_class(self.confusion(space, protocol))

    def macro_f1(self, space: str | None = None, protocol: str | None = None) -> float:
        """Mean F1 over classes, from the confusion matrix summed over partitions."""
        return macro_f1(self.confusion(space, protocol))

    def gap(self, space: str) -> float | None:
        """Accuracy lost between random draws and the strictest protocol; None unless both ran on equal numbers.

        Mean accuracy of `random` minus that of `strictest`, each over its partitions; None too where the numbers of
        training or test recordings of a class differ by more than 5 %.
        """
        if self.random is None or self.strictest is None or not self._are_equals(self.random, self.strictest):
            return None
        return self.mean_accuracy(space, self.random) - self.mean_accuracy(space, self.strictest)

    def predictions(self) -> Iterator[Prediction]:
        """Every prediction: by protocol, space and partition, then row."""
        for protocol, partitions in self.partitions.items():
            for space in self.spaces:
                for partition, said in zip(partitions, self.predicted[protocol, space.name], strict=True):
                    for row, code in zip(partition.test.tolist(), said.tolist(), strict=True):
                        yield Prediction(
                            protocol=protocol,
                            partition=partition.index,
                            space=space.name,
                            row=row,
                            recording=self.names[row],
                            session=self.sessions[row],
                            label=self.labels[self.truth[row]],
                            predicted=self.labels[code],
                        )

    def class_sizes(self, protocol: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Count the recordings of each class that train and that are tested, (K,) each, the mean over partitions."""
        drawn = self.partitions[protocol]
        train, test = (
            np.mean([np.bincount(self.truth[rows], minlength=len(self.labels)) for rows in each], axis=0)
            for each in ([p.train for p in drawn], [p.test for p in drawn])
        )
        return train, test

    def _are_equals(self, first: str, second: str) -> bool:
        sizes = zip(self.class_sizes(first), self.class_sizes(second), strict=True)
        return all((np.abs(one - other) <= _ALIKE * np.maximum(one, other)).all() for one, other in sizes)

    def _runs(
        self, space: str, protocol: str | None
    ) -> tuple[tuple[Partition, ...], tuple[NDArray[np.intp], ...]]:
        name = self.space(space).name
        chosen = self.protocols[0] if protocol is None else protocol
        if chosen not in self.partitions:
            known = ", ".join(map(repr, self.partitions))
            problem = f"must be one of those that ran ({known}), got {protocol!r}"
            raise argument_error(ValueError, "protocol", problem)
        return self.partitions[chosen], self.predicted[chosen, name]


def strictest_of(partitions: Mapping[str, Sequence[Partition]]) -> str | None:
    """Name the strictest of the protocols that held out a condition, time or session; None where none did."""
    order = ["session", "chronological"]
    if "session" in partitions and are_blocks(partitions["session"]):
        order.reverse()
    order.insert(0, CONDITION)
    return next((name for name in order if name in partitions), None)


def _sizes(partitions: tuple[Partition, ...]) -> tuple[list[int], list[int]]:
    """Count recordings that train and that are tested, per partition."""
    return [p.train.size for p in partitions], [p.test.size for p in partitions]
