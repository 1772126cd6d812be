"""What an evaluation found, with everything needed to recompute each figure."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import write_json
from granular_id._words import counted
from granular_id.evaluation import export, restore, tables
from granular_id.evaluation.chosen import Chosen
from granular_id.evaluation.compare import compare
from granular_id.evaluation.comparison import MIN_PARTITIONS, Comparison
from granular_id.evaluation.controls import Control
from granular_id.evaluation.metrics import confusion_counts, macro_f1, recall_per_class, sample_sd
from granular_id.evaluation.partition import Partition
from granular_id.evaluation.portrait import Portrait
from granular_id.evaluation.protocol_names import are_blocks
from granular_id.evaluation.statistics import corrected_interval
from granular_id.evaluation.summary import Prediction, SpaceSummary
from granular_id.evaluation.text import plain_text

__all__ = ["EvaluationResult", "Prediction", "SpaceSummary"]


@dataclass(frozen=True, eq=False, repr=False)
class EvaluationResult:
    """Predictions of every partition, and the figures that follow from them.

    Made by `granular_id.evaluate`. The fields hold what happened; the methods compute, and store nothing.

    Parameters
    ----------
    spaces : tuple of SpaceSummary
        In the order of the table.
    partitions : mapping of str to tuple of Partition
        Protocol name to its partitions.
    predicted : mapping of (str, str) to tuple of int arrays
        (protocol, space) to the class numbers predicted for ``partition.test``, one array per partition.
    labels : tuple of str
        The K classes; class number k is ``labels[k]``.
    truth : (n,) int array
        Class number of each recording.
    names, sessions : tuple of str
        Name and session (empty when unknown) of each recording.
    settings : mapping
        Arguments of the evaluation, with the seed, the classifier and its parameters.
    data : mapping
        Summary of the recordings and the history of the steps that prepared them.
    versions : mapping of str to str
        Versions of what computed the numbers.
    notes : tuple of str
        What a reader has to know, one line each.
    synthetic : bool
        True when recordings were simulated: such accuracies say nothing about real materials.
    command : str
        What to type to repeat it.
    controls : tuple of Control
        What could have been answered without the method; empty when they were not asked for.
    portrait : Portrait or None
        How the recordings look, for a report.
    chosen : mapping of (str, str) to tuple of Chosen
        (protocol, space) to what the classifier of the space chose in each partition, of spaces that choose.
    wall_s : float
        Seconds that passed from start to end, controls included; after a resumed run, those of its last part.
    """

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
    notes: tuple[str, ...] = ()
    synthetic: bool = False
    command: str = ""
    controls: tuple[Control, ...] = ()
    portrait: Portrait | None = None
    chosen: Mapping[tuple[str, str], tuple[Chosen, ...]] = field(default_factory=dict)
    wall_s: float = math.nan

    @property
    def protocols(self) -> tuple[str, ...]:
        """Protocols that ran, in order."""
        return tuple(self.partitions)

    @property
    def strictest(self) -> str | None:
        """The strictest protocol that ran and held out a time or session of its own; None where none did.

        Whole sessions, then halves in time order, then blocks in time that stood in for sessions.
        """
        order = ["session", "chronological"]
        if "session" in self.partitions and are_blocks(self.partitions["session"]):
            order.reverse()
        return next((name for name in order if name in self.partitions), None)

    @property
    def random(self) -> str | None:
        """The protocol with random draws that ran, against which the strictest is held; None where none did."""
        return next((name for name in ("paper", "kfold") if name in self.partitions), None)

    @property
    def chance(self) -> float:
        """Accuracy of guessing when every class is equally frequent: 1 / K."""
        return 1 / len(self.labels)

    def space(self, name: str) -> SpaceSummary:
        """Return one space by name, or raise a ValueError that lists the names."""
        named = {space.name: space for space in self.spaces}
        if name not in named:
            raise ValueError(f"space must be one of {', '.join(map(repr, named))}, got {name!r}")
        return named[name]

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

    def mean_accuracy(self, space: str, protocol: str | None = None) -> float:
        """Mean of `accuracies`, in [0, 1]."""
        return float(self.accuracies(space, protocol).mean())

    def sd_accuracy(self, space: str, protocol: str | None = None) -> float:
        """Sample standard deviation of `accuracies` (divisor J - 1); NaN for one partition."""
        return sample_sd(self.accuracies(space, protocol))

    def interval(self, space: str, protocol: str | None = None) -> tuple[float, float]:
        """95 % interval of `mean_accuracy`, corrected for the recordings that partitions share.

        NaN with fewer than three partitions and where all agree: see
        `granular_id.evaluation.statistics.corrected_interval`.
        """
        partitions, _ = self._runs(space, protocol)
        if len(partitions) < MIN_PARTITIONS:
            return math.nan, math.nan
        n_train, n_test = (float(np.mean(sizes)) for sizes in _sizes(partitions))
        return corrected_interval(self.accuracies(space, protocol), n_train, n_test)

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
        names = [space.name for space in self.spaces]
        partitions, _ = self._runs(names[0], protocol)
        accuracies = {name: self.accuracies(name, protocol) for name in names}
        return compare(names, accuracies, *_sizes(partitions), protocol=partitions[0].protocol)

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
        """Accuracy lost between random draws and the strictest protocol; None unless both ran.

        Mean accuracy of `random` minus that of `strictest`, each over its partitions.
        """
        if self.random is None or self.strictest is None:
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

    def table(self) -> str:
        """Tables of accuracies, gaps, choices and seconds as plain text."""
        return plain_text(self)

    __str__ = table

    def __repr__(self) -> str:
        means = ", ".join(f"{s.name} {tables.percent(self.mean_accuracy(s.name))}" for s in self.spaces)
        mark = "SYNTHETIC, " if self.synthetic else ""
        return f"EvaluationResult({mark}{counted(len(self.names))}, {counted(len(self.labels), 'label')}, {means})"

    def to_dict(self) -> dict[str, Any]:
        """Everything, in types that JSON knows; see `to_json`."""
        return export.as_dict(self)

    def to_json(self, path: str | os.PathLike[str]) -> None:
        """Write figures, settings, partitions and predictions as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())

    @classmethod
    def from_json(cls, path: str | os.PathLike[str]) -> EvaluationResult:
        """Read what `to_json` wrote; a ValueError names a file that is anything else, and what is wrong.

        Figures are computed from the predictions; those in the file are for other programs.
        """
        return cls(**restore.read_json(path))

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write one line per prediction of every partition, space and protocol; whole or not at all."""
        export.write_csv(self, path)

    def report(self, path: str | os.PathLike[str]) -> None:
        """Write one HTML file with everything, for a browser; see `granular_id.evaluation.report`.

        Raises
        ------
        ImportError
            matplotlib or jinja2 is missing, naming the extra to install.
        ValueError
            The path ends like another kind of file; a page that is there is replaced.
        """
        from granular_id.evaluation.report import report  # noqa: PLC0415 (its libraries are an extra)

        report(self, path)

    def _runs(
        self, space: str, protocol: str | None
    ) -> tuple[tuple[Partition, ...], tuple[NDArray[np.intp], ...]]:
        name = self.space(space).name
        chosen = self.protocols[0] if protocol is None else protocol
        if chosen not in self.partitions:
            known = ", ".join(map(repr, self.partitions))
            raise ValueError(f"protocol must be one of those that ran ({known}), got {protocol!r}")
        return self.partitions[chosen], self.predicted[chosen, name]


def _sizes(partitions: tuple[Partition, ...]) -> tuple[list[int], list[int]]:
    """Count recordings that train and that are tested, per partition."""
    return [p.train.size for p in partitions], [p.test.size for p in partitions]
