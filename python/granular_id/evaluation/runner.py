"""``evaluate``: how well are materials told apart, measured so that it can be believed."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from granular_id._checks import checked_flag
from granular_id._estimators import convergence_warnings, describe_estimator, named_errors, versions
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id._progress import ProgressCallback, Ticker, showing
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.checkpoint import Checkpoint, fingerprint
from granular_id.evaluation.controls import Control, PlannedControl, judge, plan_controls
from granular_id.evaluation.gram import GramBank, plan_for
from granular_id.evaluation.report_data import Portrait, not_drawn, portrait
from granular_id.evaluation.result import EvaluationResult, SpaceSummary
from granular_id.evaluation.scoring import (
    STAGES,
    Answer,
    SpaceFeatures,
    Task,
    check_arguments,
    plan_seed,
    plan_spaces,
    seeded,
    timed,
)
from granular_id.partitions import Partition
from granular_id.recording import Dataset, data_warnings, describe_data
from granular_id.spaces import Chosen, FeatureSpace, tell_blocks
from granular_id.splits import groups_of, plan_partitions, plan_protocols

Codes = NDArray[np.intp]


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
    check_arguments(data, progress)
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
    transformers = {space.name: _described(space) for space in planned}
    kept = None
    if checkpoint is not None:
        described = {"settings": settings, "transformers": transformers, "versions": versions()}
        kept = Checkpoint(checkpoint, fingerprint(data, described, every), len(data.labels))

    labels, truth = np.unique(data.y, return_inverse=True)
    bank = GramBank(X)
    origins = groups_of(data)
    tasks = [Task(space, space.classifier or model, bank, origins) for space in planned]
    checks = plan_controls(data, planned, model, bank) if controls else []
    n_tasks = len(tasks) + sum(check.task is not None for check in checks)
    with showing(progress) as callback:
        ask = partial(
            _answers,
            partitions=partitions,
            labels=labels,
            truth=truth,
            seed=seed,
            n_jobs=n_jobs,
            ticker=Ticker(n_tasks * (len(every) + 1), callback),
            checkpoint=kept,
        )
        runs = {task.space.name: ask(task) for task in tasks}
        verdicts = tuple(_judged(check, ask, partitions, truth) for check in checks)
    answers = {
        (protocol, name): of_protocol
        for name, (by_protocol, _) in runs.items()
        for protocol, of_protocol in by_protocol.items()
    }
    of_space = {
        name: list(chain.from_iterable(by_protocol.values())) for name, (by_protocol, _) in runs.items()
    }
    result = EvaluationResult(
        spaces=tuple(_summary(space, of_space[space.name], transformers[space.name]) for space in planned),
        partitions=partitions,
        predicted={key: tuple(answer.predicted for answer in given) for key, given in answers.items()},
        chosen={
            key: tuple(answer.chosen for answer in given if answer.chosen is not None)
            for key, given in answers.items()
            if all(answer.chosen is not None for answer in given)
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
            *data_warnings(data),
            *not_drawn(data),
            *(line for _, not_converged in runs.values() for line in not_converged),
            *(kept.notes() if kept is not None else ()),
        ),
        synthetic=data.is_synthetic,
        command=_call(settings, classifier),
        controls=verdicts,
    )
    has_weights = {name: given[-1].has_weights for name, given in of_space.items()}
    seen = _portrait(data, result, planned, model, has_weights)
    return replace(result, portrait=seen, wall_s=time.perf_counter() - start)


def _answers(
    task: Task,
    *,
    partitions: Mapping[str, Sequence[Partition]],
    labels: NDArray[np.str_],
    truth: Codes,
    seed: int,
    n_jobs: int | None,
    ticker: Ticker,
    checkpoint: Checkpoint | None,
) -> tuple[dict[str, list[Answer]], list[str]]:
    """Answer one task for every partition, by protocol; return also lines on what did not converge.

    What the checkpoint has is not computed again.
    """
    space = task.space
    every = list(chain.from_iterable(partitions.values()))
    name, kind = (space.name, "feature space") if task.kind == "space" else (task.key, task.kind)
    known = [None if checkpoint is None else checkpoint.load(task.key, each) for each in every]
    missing = [each for each, answer in zip(every, known, strict=True) if answer is None]
    if missing:
        with named_errors(space.name, kind):
            features = SpaceFeatures(space.name, space.transformer, task.bank, seed, by_gram=task.by_gram)
    ticker.tick(f"{name}: ready")
    for _ in range(len(every) - len(missing)):
        ticker.tick(f"{name}: from the checkpoint")

    def compute(partition: Partition) -> Answer:
        with named_errors(space.name, kind):
            answer = _answer(task, features, partition, labels, truth, seed)
        if checkpoint is not None:
            checkpoint.save(task.key, partition, answer)
        ticker.tick(f"{name}: {partition.protocol}, {partition.description}")
        return answer

    # Threads, not processes: scalar products are shared, and libsvm works outside the interpreter lock. The
    # matrices of a pair of classes are small: more threads for each took twice the time of one.
    with single_threaded_blas(), convergence_warnings(name) as not_converged:
        computed = iter(in_threads(compute, missing, n_jobs))
    answers = iter([next(computed) if answer is None else answer for answer in known])
    return {protocol: [next(answers) for _ in drawn] for protocol, drawn in partitions.items()}, not_converged


def _answer(
    task: Task,
    features: SpaceFeatures,
    partition: Partition,
    labels: NDArray[np.str_],
    truth: Codes,
    seed: int,
) -> Answer:
    """Train on one part of a partition and name the recordings of the other."""
    # Our own classifier names classes in its messages; of others not all take text.
    takes_text = isinstance(task.classifier, ECOCClassifier)
    targets = labels[truth[partition.train]] if takes_text else truth[partition.train]
    if task.shuffled:
        words = np.random.SeedSequence(seed, spawn_key=(4, partition.index))
        targets = np.random.default_rng(words).permutation(targets)
    classifier: Any = seeded(task.classifier, seed, partition)
    seconds = dict.fromkeys(STAGES, 0.0)
    if task.by_gram:
        train, cross, n_features = features.products(partition, targets, seconds)
        with timed(seconds, "training"):
            classifier.fit_gram(train, targets)
        with timed(seconds, "prediction"):
            predicted = classifier.predict_gram(cross)
    else:
        with timed(seconds, "features"):
            train, test, sizes = features.rows(partition, targets)
        n_features = train.shape[1]
        with timed(seconds, "training"):
            tell_blocks(classifier, sizes)
            known = {} if task.origins is None else task.origins.fit_arguments(classifier, partition.train)
            classifier.fit(train, targets, **known)
        with timed(seconds, "prediction"):
            predicted = classifier.predict(test)
    codes = np.searchsorted(labels, predicted) if takes_text else predicted
    return Answer(
        predicted=np.asarray(codes, dtype=np.intp),
        n_features=n_features,
        seconds=seconds,
        shared_seconds=features.shared_seconds,
        chosen=Chosen.of(classifier),
        has_weights=task.by_gram or hasattr(classifier, "coef_"),
    )


def _judged(
    check: PlannedControl,
    ask: Callable[[Task], tuple[dict[str, list[Answer]], list[str]]],
    partitions: Mapping[str, Sequence[Partition]],
    truth: Codes,
) -> Control:
    predicted: dict[str, list[Codes]] = {}
    if check.task is not None:
        try:
            answers, _ = ask(check.task)
        except ValueError as error:
            # A classifier may suit the spaces and not a few samples of rest: no reason to lose what was measured.
            check = replace(check, task=None, why_not=str(error))
        else:
            predicted = {protocol: [one.predicted for one in given] for protocol, given in answers.items()}
    return judge(check, predicted, partitions, truth)


def _described(space: FeatureSpace) -> dict[str, Any]:
    settings = describe_estimator(space.transformer)
    if space.classifier is not None:
        settings["own_classifier"] = describe_estimator(space.classifier)
    return settings


def _summary(space: FeatureSpace, answers: Sequence[Answer], settings: Mapping[str, Any]) -> SpaceSummary:
    last = answers[-1]
    seconds = {
        stage: last.shared_seconds[stage] + sum(one.seconds[stage] for one in answers) for stage in STAGES
    }
    return SpaceSummary(space.name, space.paper_accuracy, space.learns, last.n_features, seconds, settings)


def _portrait(
    data: Dataset,
    result: EvaluationResult,
    planned: Sequence[FeatureSpace],
    classifier: BaseEstimator,
    has_weights: Mapping[str, bool],
) -> Portrait | None:
    """Look at the recordings, and at one model in the most accurate space whose features are not mixed."""
    if not_drawn(data):
        return None
    best_first = sorted(planned, key=lambda space: -result.mean_accuracy(space.name))
    unmixed = {
        space.name: space.transformer
        for space in best_first
        if (plan := plan_for(space.transformer)) is None or not plan.after
    }
    model = clone(classifier)
    if isinstance(model, ECOCClassifier):
        # All recordings together may overlap where the training rows of no partition did.
        model.set_params(hard_margin=False)
    own = {
        space.name: seeded(space.classifier, result.settings["seed"]) if has_weights[space.name] else None
        for space in planned
        if space.classifier is not None
    }
    return portrait(data, unmixed, classifier=model, own=own)


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
