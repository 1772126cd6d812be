"""``evaluate``: how well are materials told apart, measured so that it can be believed."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from granular_id._estimators import describe_estimator, seeded_clone, versions
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.checkpoint import Checkpoint, fingerprint
from granular_id.evaluation.controls import Control, PlannedControl, judge, plan_controls
from granular_id.evaluation.gram import GramBank, plan_for
from granular_id.evaluation.report_data import Portrait, not_drawn, portrait
from granular_id.evaluation.result import EvaluationResult, SpaceSummary
from granular_id.evaluation.scoring import Space, SpaceRun, Task, plan_seed, plan_spaces, run_space
from granular_id.recording import Dataset, describe_data, warnings_in
from granular_id.spaces import FeatureSpace
from granular_id.splits import Partition, origins_of, plan_partitions, plan_protocols

Codes = NDArray[np.intp]
T = TypeVar("T")


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
    if not isinstance(data, Dataset):
        raise TypeError(f"data must be a granular_id.Dataset, got {type(data).__name__}")
    if not (isinstance(progress, bool) or callable(progress)):
        raise TypeError(f"progress must be True, False or callable, got {type(progress).__name__}")
    if not isinstance(controls, bool):
        raise TypeError(f"controls must be True or False, got {controls!r}")
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
    chosen = ECOCClassifier() if classifier is None else classifier
    settings = {
        "spaces": [space.name for space in planned],
        "protocol": protocols,
        **counts,
        "classifier": describe_estimator(chosen),
        "controls": controls,
        "seed": seed,
    }
    transformers = {space.name: _described(space) for space in planned}
    every = [partition for drawn in partitions.values() for partition in drawn]
    kept = None
    if checkpoint is not None:
        described = {"settings": settings, "transformers": transformers, "versions": versions()}
        kept = Checkpoint(checkpoint, fingerprint(data, described, every), len(data.labels))

    labels, truth = np.unique(data.y, return_inverse=True)
    bank = GramBank(X)
    checks = plan_controls(data, planned, chosen, bank) if controls else []
    origins = origins_of(data)
    tasks = [Task(space, space.classifier or chosen, bank, origins) for space in planned]
    with showing(progress) as callback:
        ticker = Ticker((len(tasks) + sum(c.task is not None for c in checks)) * (len(every) + 1), callback)
        ask = partial(
            run_space, y=data.y, partitions=every, seed=seed, n_jobs=n_jobs, ticker=ticker, answers=kept
        )
        runs = {task.space.name: ask(task) for task in tasks}
        verdicts = tuple(_judged(check, ask, partitions, truth) for check in checks)
    result = EvaluationResult(
        spaces=tuple(_summary(space, runs[space.name], transformers[space.name]) for space in planned),
        partitions=partitions,
        predicted={
            (protocol, name): said
            for name, run in runs.items()
            for protocol, said in _by_protocol(run.predicted, partitions).items()
        },
        chosen={
            (protocol, name): tuple(one for one in said if one is not None)
            for name, run in runs.items()
            for protocol, said in _by_protocol(run.chosen, partitions).items()
            if None not in said
        },
        labels=tuple(labels.tolist()),
        truth=truth.astype(np.intp),
        names=tuple(data.names),
        sessions=tuple(session or "" for session in data.sessions),
        settings=settings,
        data=describe_data(data),
        versions=versions(),
        notes=(
            *notes,
            *warnings_in(data),
            *not_drawn(data),
            *(line for run in runs.values() for line in run.complaints),
            *(kept.notes() if kept is not None else ()),
        ),
        synthetic=data.is_synthetic,
        command=_call(settings, None if classifier is None else chosen),
        controls=verdicts,
    )
    seen = _portrait(data, result, planned, chosen, runs)
    return replace(result, portrait=seen, wall_s=time.perf_counter() - start)


def _judged(
    check: PlannedControl,
    ask: Callable[[Task], SpaceRun],
    partitions: Mapping[str, Sequence[Partition]],
    truth: Codes,
) -> Control:
    if check.task is None:
        return judge(check, {}, partitions, truth)
    try:
        predicted = _by_protocol(ask(check.task).predicted, partitions)
    except ValueError as error:
        # A classifier may suit the spaces and not a few samples of rest: no reason to lose what was measured.
        return judge(replace(check, task=None, why_not=str(error)), {}, partitions, truth)
    return judge(check, predicted, partitions, truth)


def _by_protocol(
    of_all: Sequence[T], partitions: Mapping[str, Sequence[Partition]]
) -> dict[str, tuple[T, ...]]:
    """Deal what was said in all partitions out to their protocols."""
    said = iter(of_all)
    return {name: tuple(next(said) for _ in drawn) for name, drawn in partitions.items()}


def _described(space: Space) -> dict[str, Any]:
    settings = describe_estimator(space.transformer)
    if space.classifier is not None:
        settings["own_classifier"] = describe_estimator(space.classifier)
    return settings


def _summary(space: Space, run: SpaceRun, settings: Mapping[str, Any]) -> SpaceSummary:
    return SpaceSummary(space.name, space.paper_accuracy, space.learns, run.n_features, run.seconds, settings)


def _portrait(
    data: Dataset,
    result: EvaluationResult,
    planned: Sequence[Space],
    classifier: BaseEstimator,
    runs: Mapping[str, SpaceRun],
) -> Portrait | None:
    """Look at the recordings, and at one model in the most accurate space whose features are not mixed."""
    if not_drawn(data):
        return None
    order = sorted(planned, key=lambda space: -result.mean_accuracy(space.name))
    plans = {space.name: plan_for(space.transformer) for space in order}
    unmixed = {s.name: s.transformer for s in order if (plan := plans[s.name]) is None or not plan.after}
    model = clone(classifier)
    if isinstance(model, ECOCClassifier):
        # All recordings together may overlap where the training rows of no partition did.
        model.set_params(hard_margin=False)
    seed = np.random.SeedSequence(result.settings["seed"], spawn_key=(3,))
    own = {
        s.name: seeded_clone(s.classifier, seed) if runs[s.name].has_weights else None
        for s in planned
        if s.classifier is not None
    }
    return portrait(data, unmixed, classifier=model, own=own)


def _call(settings: Mapping[str, Any], classifier: BaseEstimator | None) -> str:
    said = [
        f"{name}={settings[name]!r}"
        for name in ("spaces", "protocol", "n_partitions", "train_per_class", "test_per_class", "n_folds")
    ]
    said += [] if classifier is None else [f"classifier={' '.join(repr(classifier).split())}"]
    said += [] if settings["controls"] else ["controls=False"]
    return f"granular_id.evaluate(data, {', '.join(said)}, random_state={settings['seed']})"
