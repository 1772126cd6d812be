"""``evaluate``: how well are materials told apart, measured so that it can be believed."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import chain, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from granular_id._checks import argument_error, checked_flag
from granular_id._estimators import describe_estimator, versions
from granular_id._progress import ProgressCallback, Ticker, check_progress, displaying
from granular_id._text import percent
from granular_id.evaluation.arguments import check_dataset, plan_classifier, plan_seed, plan_spaces
from granular_id.evaluation.controls import (
    MOST_PARTITIONS,
    Control,
    PlannedControl,
    plan_controls,
    run_control,
)
from granular_id.evaluation.features import STAGES, GramBank, check_disk
from granular_id.evaluation.findings import accepted_names, refuse_copies, spoiling
from granular_id.evaluation.outcome import SpaceSummary, strictest_of
from granular_id.evaluation.report_data import report_data_of
from granular_id.evaluation.result import EvaluationResult
from granular_id.evaluation.scoring import Answer, Task, answers_of
from granular_id.features import FeatureSpec
from granular_id.partitions import CONDITION, PROTOCOLS, Partition, protocol_name
from granular_id.recording import Dataset, Finding, common_units, condition_of, data_warnings, describe_data
from granular_id.spaces import FeatureSpace
from granular_id.splits import AUTO, groups_of, plan_held_out, plan_protocols

USUAL_SPACES = ("raw+hfmh", "multiband", "best")
"""The paper's best space and this package's two."""


def evaluate(
    data: Dataset,
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] = USUAL_SPACES,
    protocol: str | Sequence[str] = "auto",
    *,
    hold_out: str | None = None,
    n_partitions: int | None = None,
    train_per_class: int | None = None,
    test_per_class: int | None = None,
    n_folds: int | None = None,
    classifier: BaseEstimator | None = None,
    controls: bool = True,
    accept: str | Sequence[str] = (),
    n_jobs: int | None = None,
    random_state: int | None = 0,
    progress: bool | ProgressCallback = True,
) -> EvaluationResult:
    """Train and test on partitions of a data set, the strictest that it allows first, in one or more feature spaces.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    spaces : str, sequence of str or mapping
        Names such as ``["raw", "raw+hfmh"]``; ``"paper"``: those of the paper's table, then its control
        ``"time-permuted"``; ``"all"``: those of the table, then ``"multiband"`` and ``"best"`` of this package; or
        ``{name: transformer}`` for other settings (see `feature_spaces`) or one's own. A transformer that learns from
        data is fitted on the training rows of each partition. Default: the paper's best, ``"multiband"`` and
        ``"best"``, which together take a minute or so.
    protocol : str or sequence of str
        ``"auto"``: the strictest that the data allow, and beside it as many recordings of each class drawn at random,
        fold by fold, so that the gap compares equals. The strictest are whole sessions held out of every class that has
        several (another class is split in time, or stays in training where no order is known; the result marks it);
        else halves in time; else random folds. Or one or more of ``"paper"`` (random partitions), ``"session"``
        (whole sessions held out; blocks in time where a class has one session only), ``"chronological"`` (first
        half of each class trains, second half is tested, and the reverse), ``"kfold"`` (stratified random
        folds, for small sets). The paper's table: ``spaces="paper", protocol="paper"``.
    hold_out : str, optional
        A condition of the recordings instead of a protocol: ``"session"``, ``"day"`` (UTC), a field of `Setup` such as
        ``"tool"`` or ``"sensor"``, or an entry of the metadata by its path, as ``"rig.speed_m_s"``. One value of it
        after the other is held out whole, and beside each as many recordings at random: the gap is what another
        value costs. A material without recordings of another value is not tested there, and a note says so.
        `EvaluationResult.hold_out_table` has one row a value.
    n_partitions, train_per_class, test_per_class : int, optional
        Of ``"paper"``. Default: 20 partitions with 50 and 12 recordings of each class, as in the paper.
    n_folds : int, optional
        Of ``"kfold"``, of ``"session"`` where blocks in time stand in for sessions, and of ``"auto"`` the most folds of
        sessions. Default: 5; of ``"auto"`` 3 where there are more than 2000 recordings, whose folds take minutes.
    classifier : estimator, optional
        Any scikit-learn classifier; default `ECOCClassifier`, the paper's. ``"best"`` has its own.
    controls : bool
        Whether to measure what could be answered without the method: from the rest before the motion, and from the
        clock. Default True, as they are cheap and accuracies without them may mislead. They run last, under the
        strictest protocol.
    accept : str or sequence of str
        Findings of `Dataset.check` that are known, by their code, such as ``"leak-clock"``. Findings that spoil an
        evaluation (errors, clocks that name the label, copies on both sides of a split) stand above the table, and in
        `EvaluationResult.spoiling` unless they are accepted; copies on both sides of the headline's split stop it.
    n_jobs : int, optional
        Threads over partitions, as in joblib: None is 1, -1 all cores. The numbers do not depend on it.
    random_state : int or None
        Seed of the partitions and of every ``random_state`` left None in transformers and classifier. None
        draws a fresh seed; either way the result records it.
    progress : bool or callable
        True prints each accuracy as soon as it is known, and draws a bar on a terminal (with rich installed), elsewhere
        a line at most every 30 s. A callable is called as ``progress(done, total, what)``.

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
        one class only, a class has too few recordings, no order in time exists, a name is unknown, recordings hold
        the same samples and one trains while the other is tested, features are not finite, a transformer is for
        another rate, or `hold_out` is a condition that is not known of all recordings, has one value, or one value for
        each material.

    Notes
    -----
    Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606. Accuracy per partition is the share of tested recordings
    that were named rightly; the table gives its mean and sample standard deviation over partitions.

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id import Dataset, Recording
    >>> rng = np.random.default_rng(0)
    >>> level = {"oat": 1.0, "rice": 2.0}
    >>> data = Dataset(
    ...     [
    ...         Recording(level[m] + rng.normal(size=(40, 6)), rate_hz=500, label=m, name=f"{m}{k}")
    ...         for m in level
    ...         for k in range(6)
    ...     ]
    ... )
    >>> result = evaluate(data, "raw", progress=False)
    >>> result.protocols
    ('chronological', 'matched')
    >>> result.mean_accuracy("raw")
    1.0
    >>> [control.name for control in result.controls]
    ['rest', 'clock']
    """
    start = time.perf_counter()
    check_dataset(data)
    check_progress(progress)
    controls, accepted = checked_flag("controls", controls), accepted_names(accept)
    seed, model = plan_seed(random_state), plan_classifier(classifier)
    X = data.X  # before the counts: resampling and cropping come first, and may change them
    common_units(data)
    of_paper = {
        "n_partitions": n_partitions,
        "train_per_class": train_per_class,
        "test_per_class": test_per_class,
    }
    given = {name: value for name, value in of_paper.items() if value is not None}
    partitions, notes, conditions = _partitions(data, protocol, hold_out, n_folds, seed, given)
    notes += _unused(given, partitions)
    if spaces is USUAL_SPACES and data.rate_hz <= 2 * FeatureSpec().cutoff_hz:
        spaces = ("raw", *USUAL_SPACES[1:])
        notes += [f"raw instead of raw+hfmh: a high-pass at 23 Hz leaves nothing of {data.rate_hz:g} Hz"]
    planned = plan_spaces(spaces, data.rate_hz)
    judged = strictest_of(partitions) or next(iter(partitions))
    check_disk(X, [space.transformer for space in planned], n_jobs)
    checked = data.check()
    findings = spoiling(checked, partitions[judged], data)
    refuse_copies(findings, accepted, partitions[judged], data.names)
    notes += _not_found(accepted, (*checked, *findings))
    settings = {
        "spaces": [space.name for space in planned],
        "protocol": AUTO if protocol == AUTO else list(partitions),
        **({} if hold_out is None else {"hold_out": partitions[CONDITION][0].condition}),
        **given,
        **({} if n_folds is None else {"n_folds": n_folds}),
        "classifier": describe_estimator(model),
        "controls": controls,
        **({"accept": list(accepted)} if accepted else {}),
        "seed": seed,
    }
    transformers = {space.name: describe_estimator(space.transformer) for space in planned}
    for space in planned:
        if space.classifier is not None:
            transformers[space.name]["own_classifier"] = describe_estimator(space.classifier)
    labels, truth = np.unique(data.y, return_inverse=True)
    bank, groups = GramBank(X), replace(groups_of(data), conditions=conditions)
    tasks = [Task(space, space.classifier or model, bank, groups) for space in planned]
    checks = plan_controls(data, model) if controls else []
    ask = partial(answers_of, labels=labels, truth=truth, seed=seed, n_jobs=n_jobs)
    answered, not_converged, measured = _run(tasks, checks, partitions, judged, truth, ask, progress)
    summaries = [_summary(space, answered[space.name], transformers[space.name]) for space in planned]
    predicted, chosen, adapted = _gathered(answered)
    return EvaluationResult(
        spaces=tuple(summaries),
        partitions=partitions,
        predicted=predicted,
        chosen=chosen,
        adapted=adapted,
        labels=tuple(labels.tolist()),
        truth=truth.astype(np.intp),
        names=tuple(data.names),
        sessions=tuple(session or "" for session in data.sessions),
        settings=settings,
        data=describe_data(data),
        versions=versions(),
        report_data=report_data_of(data, [space.transformer for space in planned]),
        notes=(
            *notes,
            *data_warnings(data, [finding for finding in checked if finding not in findings]),
            *dict.fromkeys(not_converged),
        ),
        synthetic=data.is_synthetic,
        command=_call(settings, classifier),
        controls=measured,
        findings=findings,
        wall_s=time.perf_counter() - start,
    )


def _partitions(
    data: Dataset,
    protocol: str | Sequence[str],
    hold_out: str | None,
    n_folds: int | None,
    seed: int,
    given: Mapping[str, int],
) -> tuple[dict[str, tuple[Partition, ...]], list[str], NDArray[np.object_] | None]:
    """Draw the partitions by protocol; return lines on them, too, and the values of the condition to hold out."""
    if hold_out is None:
        return *plan_protocols(data, protocol, n_folds=n_folds, seed=seed, **given), None
    if protocol != AUTO or n_folds is not None:
        other = "n_folds" if protocol == AUTO else f"protocol={protocol!r}"
        problem = f" takes each value of {hold_out!r} in turn: leave out {other}"
        raise argument_error(ValueError, "hold_out", problem)
    name, values = condition_of(data, hold_out)
    return *plan_held_out(data, name, values, seed=seed), values


def _gathered(answered: Mapping[str, Mapping[str, Sequence[Answer]]]) -> tuple[dict[Any, Any], ...]:
    """Return what was predicted and chosen by (protocol, space), and predicted after adapting by space."""
    predicted, chosen, adapted = {}, {}, {}
    for space, answers in answered.items():
        for protocol, own in answers.items():
            predicted[protocol, space] = tuple(answer.predicted for answer in own)
            choices = tuple(answer.chosen for answer in own if answer.chosen is not None)
            if len(choices) == len(own):
                chosen[protocol, space] = choices
            named = tuple(answer.adapted for answer in own if answer.adapted is not None)
            if len(named) == len(own):
                adapted[space] = named
    return predicted, chosen, adapted


def _not_found(accepted: Sequence[str], findings: Sequence[Finding]) -> list[str]:
    found = {finding.code for finding in findings}
    return [f"accept: the checks found nothing called {name!r}" for name in accepted if name not in found]


def _unused(given: Mapping[str, Any], partitions: Mapping[str, Any]) -> list[str]:
    if not given or "paper" in partitions:
        return []
    return [f"{', '.join(given)} had no use: that is of the protocol 'paper' (--paper), which did not run"]


def _run(
    tasks: Sequence[Task],
    checks: Sequence[PlannedControl],
    partitions: Mapping[str, Sequence[Partition]],
    judged: str,
    truth: NDArray[np.intp],
    ask: Callable[..., tuple[list[Answer], list[str]]],
    progress: bool | ProgressCallback,
) -> tuple[dict[str, dict[str, list[Answer]]], list[str], tuple[Control, ...]]:
    """Answer every space under one protocol after the other, then the controls under `judged`; show each at once.

    Returns answers by space and protocol, lines on what did not converge, and the controls.
    """
    # The cheapest first, so that an accuracy is known soon: classifiers that choose take longest.
    in_turn = sorted(tasks, key=lambda task: (task.space.classifier is not None, task.space.learns))
    to_control = partitions[judged][:MOST_PARTITIONS]
    n_controls = sum(check.task is not None for check in checks)
    n_steps = len(tasks) * sum(map(len, partitions.values())) + n_controls * len(to_control)
    widest = max(map(len, [*(task.space.name for task in tasks), *(check.name for check in checks)]))
    answered: dict[str, dict[str, list[Answer]]] = {task.space.name: {} for task in tasks}
    not_converged: list[str] = []
    controls = []
    with displaying(progress) as display:
        ask = partial(ask, ticker=Ticker(n_steps, display.step))
        for (protocol, drawn), task in product(partitions.items(), in_turn):
            begun = time.perf_counter()
            answers, lines = ask(task, drawn)
            answered[task.space.name][protocol] = answers
            not_converged += lines
            hits = [np.mean(truth[p.test] == one.predicted) for p, one in zip(drawn, answers, strict=True)]
            place = f"{protocol_name(protocol, drawn):<{_WIDEST}}  {task.space.name:<{widest}}"
            seconds = f"({time.perf_counter() - begun:.0f} s)"
            display.line(f"{place}  {percent(float(np.mean(hits))):>7}  {seconds}")
        for check in checks:
            control = run_control(check, partial(ask, partitions=to_control), to_control, truth)
            controls.append(control)
            if check.task is not None:
                display.line(
                    f"{'control':<{_WIDEST}}  {check.name:<{widest}}  {percent(control.accuracy):>7}"
                )
    return answered, not_converged, tuple(controls)


_WIDEST = max(map(len, PROTOCOLS.values()))


def _summary(
    space: FeatureSpace, answers: Mapping[str, Sequence[Answer]], settings: Mapping[str, Any]
) -> SpaceSummary:
    """Sum up the seconds of a space."""
    every = list(chain.from_iterable(answers.values()))
    last = every[-1]
    seconds = {
        stage: last.shared_seconds[stage] + sum(one.seconds[stage] for one in every) for stage in STAGES
    }
    return SpaceSummary(space.name, space.paper_accuracy, space.learns, last.n_features, seconds, settings)


def _call(settings: Mapping[str, Any], classifier: BaseEstimator | None) -> str:
    """Return the call as text, for the reader of a result."""
    arguments = [
        f"{name}={settings[name]!r}"
        for name in (
            *(
                "spaces",
                "hold_out" if "hold_out" in settings else "protocol",
                "n_partitions",
                "train_per_class",
                "test_per_class",
                "n_folds",
            ),
            "accept",
        )
        if name in settings
    ]
    if classifier is not None:
        arguments.append(f"classifier={' '.join(repr(classifier).split())}")
    if not settings["controls"]:
        arguments.append("controls=False")
    return f"granular_id.evaluate(data, {', '.join(arguments)}, random_state={settings['seed']})"
