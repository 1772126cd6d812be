"""``evaluate``: how well are materials told apart, measured so that it can be believed."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator

from granular_id._checks import checked_flag
from granular_id._estimators import describe_estimator, versions
from granular_id._progress import ProgressCallback, Ticker, check_progress, showing
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.arguments import check_dataset, plan_seed, plan_spaces
from granular_id.evaluation.checkpoint import Checkpoint, fingerprint
from granular_id.evaluation.controls import plan_controls, run_control
from granular_id.evaluation.features import STAGES, GramBank
from granular_id.evaluation.outcome import SpaceSummary
from granular_id.evaluation.report_data import not_drawn, portrait_of_result
from granular_id.evaluation.result import EvaluationResult
from granular_id.evaluation.scoring import Task, answers_of
from granular_id.partitions import Partition
from granular_id.recording import Dataset, data_warnings, describe_data
from granular_id.spaces import FeatureSpace
from granular_id.splits import groups_of, plan_partitions, plan_protocols


def evaluate(
    data: Dataset,
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] = "all",
    protocol: str | Sequence[str] = "auto",
    *,
    n_partitions: int = 20,
    train_per_class: int = 50,
    test_per_class: int = 12,
    n_folds: int = 5,
    classifier: BaseEstimator | None = None,
    controls: bool = True,
    checkpoint: str | os.PathLike[str] | None = None,
    n_jobs: int | None = None,
    random_state: int | None = 0,
    progress: bool | ProgressCallback = True,
) -> EvaluationResult:
    """Train and test on many partitions of a data set, in one or more feature spaces.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    spaces : str, sequence of str or mapping
        ``"all"``: the spaces of the paper, then ``"multiband"`` and ``"best"`` of this package; ``"paper"``: the
        paper's alone; names such as ``["raw", "raw+hfmh"]``; or ``{name: transformer}`` for other settings (see
        `feature_spaces`) or one's own. A transformer that learns from data is fitted on the training rows of
        each partition.
    protocol : str or sequence of str
        ``"auto"``: the paper's and, beside it, the strictest that the data allow (`strictest`), so that the gap
        between them is seen without asking. Or one or more of ``"paper"`` (random partitions), ``"session"``
        (whole sessions held out; blocks in time where a class has one session only), ``"chronological"`` (first
        half of each class trains, second half is tested, and the reverse), ``"kfold"`` (stratified random
        folds, for small sets).
    n_partitions, train_per_class, test_per_class : int
        Of ``"paper"``. Defaults: 20 partitions with 50 and 12 recordings of each class, as in the paper.
    n_folds : int
        Of ``"kfold"``, and of ``"session"`` where blocks in time stand in for sessions. Default 5.
    classifier : estimator, optional
        Any scikit-learn classifier; default `ECOCClassifier`, the paper's. ``"best"`` has its own.
    controls : bool
        Whether to measure what could be answered without the method: from the rest before the motion, from
        means, from the clock, with shuffled labels, with samples in random order. Default True, as they are
        cheap and accuracies without them may mislead.
    checkpoint : path-like, optional
        Folder that keeps each space and partition as it is finished; the same call goes on from there after an
        interrupt. A folder of another evaluation is refused; of a transformer or classifier of one's own only the
        parameters can be compared, not the code.
    n_jobs : int, optional
        Threads over partitions, as in joblib: None is 1, -1 all cores. The numbers do not depend on it.
    random_state : int or None
        Seed of the partitions and of every ``random_state`` left None in transformers and classifier. None
        draws a fresh seed; either way the result records it.
    progress : bool or callable
        True draws a bar on a terminal (with rich installed), elsewhere a line at most every 30 s; a callable is called
        as ``progress(done, total, what)``.

    Returns
    -------
    EvaluationResult
        ``print(result)`` shows the table.

    Raises
    ------
    TypeError
        `data` is not a `Dataset`, or an argument has the wrong type.
    ValueError
        Lengths or rates differ, a recording has no label (or, for ``"session"``, some have no session), there is
        one class only, a class has too few recordings, no order in time exists, a name is unknown, features are
        not finite, a transformer is for another rate, or `checkpoint` belongs to something else.
    OSError
        `checkpoint` cannot be made or written.

    Notes
    -----
    Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606. Accuracy per partition is the share of tested recordings
    that were named rightly; the table gives its mean and sample standard deviation over partitions.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.recording import Dataset, Recording
    >>> rng = np.random.default_rng(0)
    >>> level = {"oat": 1.0, "rice": 2.0}
    >>> data = Dataset(
    ...     [
    ...         Recording(level[m] + rng.normal(size=(40, 6)), rate_hz=500, label=m, name=f"{m}{k}")
    ...         for m in level
    ...         for k in range(6)
    ...     ]
    ... )
    >>> result = evaluate(data, "raw", n_partitions=2, train_per_class=4, test_per_class=2)
    >>> result.protocols
    ('paper', 'chronological')
    >>> result.mean_accuracy("raw")
    1.0
    >>> [control.name for control in result.controls]
    ['rest', 'means', 'clock', 'shuffled', 'permuted']
    """
    start = time.perf_counter()
    check_dataset(data)
    check_progress(progress)
    controls = checked_flag("controls", controls)
    seed = plan_seed(random_state)
    X = data.X  # before the counts: resampling and cropping come first, and may change them
    protocols, notes = plan_protocols(protocol, data)
    planned = plan_spaces(spaces, data.rate_hz)
    counts = {
        "n_partitions": n_partitions,
        "train_per_class": train_per_class,
        "test_per_class": test_per_class,
        "n_folds": n_folds,
    }
    partitions: dict[str, tuple[Partition, ...]] = {}
    for name in protocols:
        drawn, note = plan_partitions(data, name, **counts, seed=seed)
        partitions[name] = tuple(drawn)
        notes.append(note)
    every = list(chain.from_iterable(partitions.values()))
    model = ECOCClassifier() if classifier is None else classifier
    settings = {
        "spaces": [space.name for space in planned],
        "protocol": protocols,
        **counts,
        "classifier": describe_estimator(model),
        "controls": controls,
        "seed": seed,
    }
    transformers = {space.name: describe_estimator(space.transformer) for space in planned}
    for space in planned:
        if space.classifier is not None:
            transformers[space.name]["own_classifier"] = describe_estimator(space.classifier)
    kept = None
    if checkpoint is not None:
        described = {"settings": settings, "transformers": transformers, "versions": versions()}
        kept = Checkpoint(checkpoint, fingerprint(data, described, every), len(data.labels))

    labels, truth = np.unique(data.y, return_inverse=True)
    bank, groups = GramBank(X), groups_of(data)
    checks = plan_controls(data, planned, model, bank) if controls else []
    n_tasks = len(planned) + sum(check.task is not None for check in checks)
    with showing(progress) as callback:
        ask = partial(
            answers_of,
            partitions=partitions,
            labels=labels,
            truth=truth,
            seed=seed,
            n_jobs=n_jobs,
            ticker=Ticker(n_tasks * (len(every) + 1), callback),
            checkpoint=kept,
        )
        runs = [ask(Task(space, space.classifier or model, bank, groups)) for space in planned]
        verdicts = tuple(run_control(check, ask, partitions, truth) for check in checks)
    summaries, predicted, chosen, has_weights = [], {}, {}, {}
    for space, (answers, _) in zip(planned, runs, strict=True):
        for name, given in answers.items():
            predicted[name, space.name] = tuple(answer.predicted for answer in given)
            choices = tuple(answer.chosen for answer in given if answer.chosen is not None)
            if len(choices) == len(given):
                chosen[name, space.name] = choices
        given = list(chain.from_iterable(answers.values()))
        seconds = {
            stage: given[-1].shared_seconds[stage] + sum(answer.seconds[stage] for answer in given)
            for stage in STAGES
        }
        summaries.append(
            SpaceSummary(
                space.name,
                space.paper_accuracy,
                space.learns,
                given[-1].n_features,
                seconds,
                transformers[space.name],
            )
        )
        has_weights[space.name] = given[-1].has_weights
    result = EvaluationResult(
        spaces=tuple(summaries),
        partitions=partitions,
        predicted=predicted,
        chosen=chosen,
        labels=tuple(labels.tolist()),
        truth=truth.astype(np.intp),
        names=tuple(data.names),
        sessions=tuple(session or "" for session in data.sessions),
        settings=settings,
        data=describe_data(data),
        versions=versions(),
        notes=(
            *notes,
            *data_warnings(data),
            *not_drawn(data),
            *(line for _, not_converged in runs for line in not_converged),
            *(kept.notes() if kept is not None else ()),
        ),
        synthetic=data.is_synthetic,
        command=_call(settings, classifier),
        controls=verdicts,
    )
    accuracies = {space.name: result.mean_accuracy(space.name) for space in planned}
    portrait = portrait_of_result(data, planned, accuracies, model, seed, has_weights)
    return replace(result, portrait=portrait, wall_s=time.perf_counter() - start)


def _call(settings: Mapping[str, Any], classifier: BaseEstimator | None) -> str:
    """Return the call as text, for the reader of a result."""
    arguments = [
        f"{name}={settings[name]!r}"
        for name in ("spaces", "protocol", "n_partitions", "train_per_class", "test_per_class", "n_folds")
    ]
    if classifier is not None:
        arguments.append(f"classifier={' '.join(repr(classifier).split())}")
    if not settings["controls"]:
        arguments.append("controls=False")
    return f"granular_id.evaluate(data, {', '.join(arguments)}, random_state={settings['seed']})"
