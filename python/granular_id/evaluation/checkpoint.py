"""What an interrupted evaluation had finished, kept on disk, one file for each space and partition.

`run.json` says what the folder belongs to, by a fingerprint of recordings, settings, partitions and versions: anything
else would mix numbers of two evaluations.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_id._files import json_value, made_folder, whole_file
from granular_id._schema import from_json
from granular_id.evaluation.features import STAGES
from granular_id.partitions import Partition
from granular_id.recording import Dataset
from granular_id.spaces import Chosen

FORMAT = "granular_id.checkpoint/3"
RUN = "run.json"
"""Name of the file that says what a folder belongs to."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What one partition answered; kept in checkpoints."""

    predicted: NDArray[np.intp]
    n_features: int
    seconds: Mapping[str, float]
    """By stage, of this partition alone."""
    shared_seconds: Mapping[str, float]
    """By stage, of what all partitions share."""
    chosen: Chosen | None
    has_weights: bool
    """Whether the classifier, trained on features, has weights in `coef_`: such can be drawn."""
    adapted: NDArray[np.intp] | None = None
    """What it names after it was adapted to the tested recordings, declared to hold all materials."""


def fingerprint(data: Dataset, described: Mapping[str, Any], partitions: Sequence[Partition]) -> str:
    """Digest of all that has a say in the predictions: recordings, settings and versions, rows of each partition."""
    plain = {
        **_what_counts(described),
        "shape": data.X.shape,
        "rate_hz": data.rate_hz,
        "recordings": [
            [one.name, one.label, one.session, one.start_time, one.trigger_index] for one in data.recordings
        ],
        "partitions": [[p.protocol, p.index, p.train.tolist(), p.test.tolist()] for p in partitions],
    }
    digest = hashlib.blake2b(json.dumps(plain, sort_keys=True).encode(), digest_size=16)
    digest.update(np.ascontiguousarray(data.X, dtype="<f8").data)
    return digest.hexdigest()


def _what_counts(described: Any) -> Any:
    """Leave out numbers of threads, which change no number of a result."""
    if isinstance(described, list | tuple):
        return [_what_counts(item) for item in described]
    if not isinstance(described, Mapping):
        return described
    idle = {"threads", "n_jobs"}
    return {name: _what_counts(value) for name, value in described.items() if name not in idle}


class Checkpoint:
    """A folder of finished partitions; a ValueError where it belongs to another evaluation or holds something else.

    `mark` comes from `fingerprint`; class numbers lie below `n_classes`. `n_loaded` counts partitions of earlier
    runs, `damaged` names files that could not be used: their partitions are computed anew, and the files replaced.
    """

    def __init__(self, folder: str | os.PathLike[str], mark: str, n_classes: int) -> None:
        self.folder = Path(folder)
        self.n_loaded = 0
        self.damaged: list[str] = []
        self._mark = mark
        self._n_classes = n_classes
        run = self.folder / RUN
        if run.exists():
            self._check_owner(run)
            return
        with made_folder(self.folder):
            others = sorted(path.name for path in self.folder.iterdir() if not path.name.startswith("."))
            if others:
                raise self._error(
                    f" holds {others[0]!r} and no {RUN}: it is no checkpoint; give an empty or a new folder"
                )
            with whole_file(run) as draft:
                draft.write_text(json.dumps({"format": FORMAT, "fingerprint": mark}), encoding="utf-8")

    def load(self, task: str, partition: Partition) -> Answer | None:
        """Return what an earlier run said about a partition; None where there is nothing, or nothing usable."""
        path = self._path(task, partition)
        try:
            answer = self._answer(json.loads(path.read_text(encoding="utf-8")), task, partition)
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError):
            # A disk that was full or lost power: computing one partition again beats giving up.
            self.damaged.append(path.name)
            return None
        self.n_loaded += 1
        return answer

    def save(self, task: str, partition: Partition, answer: Answer) -> None:
        """Keep what a partition said; the file is whole or absent."""
        saved = {**self._owner(task, partition), **json_value(answer)}
        with whole_file(self._path(task, partition)) as draft:
            draft.write_text(json.dumps(saved), encoding="utf-8")

    def notes(self) -> list[str]:
        """Lines for the reader of the result."""
        lines = (
            [f"resumed: {self.n_loaded} partitions were finished by an earlier run"] if self.n_loaded else []
        )
        if self.damaged:
            count, first = len(self.damaged), self.damaged[0]
            lines.append(f"{count} damaged checkpoint files were computed anew, the first is {first!r}")
        return lines

    def _path(self, task: str, partition: Partition) -> Path:
        # A space may have any name; a file may not.
        short = "".join(c if c.isascii() and (c.isalnum() or c in "+-") else "_" for c in task)[:40]
        mark = hashlib.blake2b(task.encode(), digest_size=4).hexdigest()
        return self.folder / f"{short}-{mark}-{partition.protocol}-{partition.index:04d}.json"

    def _owner(self, task: str, partition: Partition) -> dict[str, Any]:
        """Say what a file belongs to."""
        return {
            "fingerprint": self._mark,
            "task": task,
            "protocol": partition.protocol,
            "partition": partition.index,
        }

    def _answer(self, saved: Any, task: str, partition: Partition) -> Answer:
        owner = self._owner(task, partition)
        if {key: saved[key] for key in owner} != owner:
            raise ValueError("another partition")
        chosen = None if saved["chosen"] is None else Chosen.from_dict(saved["chosen"])
        answer = from_json(Answer, {**saved, "chosen": None})
        if any(set(seconds) != set(STAGES) for seconds in (answer.seconds, answer.shared_seconds)):
            raise ValueError("not the seconds of every stage")
        for named in (answer.predicted, *([] if answer.adapted is None else [answer.adapted])):
            if named.shape != partition.test.shape:
                raise ValueError("not one class number for each tested recording")
            if named.min() < 0 or named.max() >= self._n_classes:
                raise ValueError("a class number out of range")
        return replace(answer, chosen=chosen)

    def _check_owner(self, run: Path) -> None:
        try:
            saved = json.loads(run.read_text(encoding="utf-8"))
            form, mark = saved["format"], saved["fingerprint"]
        except (ValueError, KeyError, TypeError):
            raise self._error(
                f": {RUN} is damaged, so that nobody can say what the folder belongs to; give a new folder"
            ) from None
        if form != FORMAT:
            raise self._error(f" has format {form!r}, wanted {FORMAT!r}")
        if mark != self._mark:
            raise self._error(
                " belongs to another evaluation (other recordings, settings or versions): give a new folder, or the "
                "arguments with which it was begun"
            )

    def _error(self, problem: str) -> ValueError:
        return ValueError(f"checkpoint={str(self.folder)!r}{problem}")
