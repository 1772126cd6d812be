"""``evaluate``: how well are materials distinguished, measured so that it can be believed."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.pipeline import Pipeline

from granular_id._checks import argument_error, checked_flag, whole_number
from granular_id._core import GranularIdError
from granular_id._estimators import describe_estimator, versions, with_rate
from granular_id._progress import ProgressCallback, Ticker, check_progress, show_line, showing
from granular_id._text import percent, verb
from granular_id.ecoc import ECOCClassifier
from granular_id.evaluation.differences import Gap, matched_draws
from granular_id.evaluation.leakage import (
    Untouched,
    accepted_names,
    copies_together,
    planned_baselines,
    refuse_copies,
    spoiling,
)
from granular_id.evaluation.report_data import report_data_of
from granular_id.evaluation.result import EvaluationResult
from granular_id.features import FeatureSpec
from granular_id.recording import SESSION_NAMES, Dataset, common_units, data_warnings, describe_data
from granular_id.score import Held, fit_and_score, space_pipeline
from granular_id.spaces import (
    BestClassifier,
    Choice,
    FeatureSpace,
    adapted_classifier,
    all_spaces,
    choice_of,
    feature_spaces,
    limit_components,
    paper_spaces,
)
from granular_id.splits import NAMES, Folds, hold_out, paper_folds

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

USUAL_SPACES = ("best", "multiband", "raw+hfmh")
"""The one that `Identifier.fit` trains, the same without a choice, and the paper's best."""

_SESSION_CODES = ("no-session", "some-sessions", "one-session", "own-sessions")
"""Findings that say nothing where days are held out."""

_LEAST_TO_ADAPT = 3  # recordings of each material in each half
_ABOUT_EQUAL = 2  # the most recordings of a material against the least of another


def evaluate(
    data: Dataset,
    spaces: str | Sequence[str] | Mapping[str, BaseEstimator | FeatureSpace] | None = None,
    *,
    by: str = "auto",
    paper: bool | tuple[int, int, int] = False,
    classifier: BaseEstimator | None = None,
    baselines: bool = True,
    accept: str | Sequence[str] = (),
    n_jobs: int | None = None,
    random_state: int | None = 0,
    progress: bool | ProgressCallback = True,
) -> EvaluationResult:
    """Measure how well materials are distinguished on recordings that were held out.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    spaces : str, sequence of str or mapping, optional
        Feature spaces by name, such as ``["best", "raw+hfmh"]``. The first is the headline's: it is named beforehand,
        as the best of several would be too good. ``"paper"``: those of the paper's table, then its control
        ``"time-permuted"``; ``"all"``: ``"best"``, ``"multiband"``, then those of the table; or
        ``{name: transformer}`` for other settings (see `feature_spaces`) or one's own. What learns from data is fitted
        on the training rows of each fold. Default: ``"best"``, which `Identifier.fit` trains, ``"multiband"`` and
        ``"raw+hfmh"``; with `paper` ``"paper"``.
    by : str
        What is held out. ``"auto"``: whole sessions where at least half of the materials have two or more, else halves
        in time, else random folds; ``"session"``, ``"time"`` or ``"random"`` for one of them. Or a condition of the
        recordings: ``"day"`` (UTC), a field of `Setup` such as ``"tool"``, or an entry of the metadata by its path, as
        ``"rig.speed_m_s"``: one value after the other is held out whole.
    paper : bool or tuple of three int
        Random partitions in place of `by`, as in the paper: 20 partitions with 50 training and 12 test recordings of
        each material, or as many as the three numbers say.
    classifier : estimator, optional
        Any scikit-learn classifier; default `ECOCClassifier`, the paper's. ``"best"`` and ``"multiband"`` have their
        own.
    baselines : bool
        Whether to measure what could be known without touching the material: from the rest before the motion and from
        the clock. Default True, as they are cheap and accuracies without them may mislead.
    accept : str or sequence of str
        Findings that are known, by their code, such as ``"leak-clock"``. Findings that spoil an evaluation (errors of
        `Dataset.check`, clocks that name the label, a baseline that reaches two thirds of the way to the headline)
        stand above the table, and in `EvaluationResult.spoiling` unless they are accepted; copies of which one trains
        while the other is tested are refused.
    n_jobs : int, optional
        Threads over folds, as in joblib: None is 1, -1 all cores. The numbers do not depend on it.
    random_state : int or None
        Seed of random draws and of every ``random_state`` left None in transformers and classifier. None
        draws a fresh seed; either way the result records it.
    progress : bool or callable
        True prints each accuracy as soon as it is known, and draws a bar on a terminal (with rich installed), elsewhere
        a line at most every 30 s. A callable is called as ``progress(done, total, what)``.

    Returns
    -------
    EvaluationResult
        ``print(result)`` shows one screen; ``result.details()`` has the rest.

    Raises
    ------
    TypeError
        `data` is not a `Dataset`, or an argument has the wrong type.
    ValueError
        Lengths or rates differ, a recording has no label, there is one material only, a material has too few
        recordings, a name is unknown, recordings hold the same samples and one trains while the other is tested,
        features are not finite, a transformer is for another rate, or `by` cannot be held out.

    Notes
    -----
    Accuracies are balanced: the mean over materials of the share of its tested recordings that is named right. Where
    sessions, halves or a condition are held out, as many recordings of each material are drawn at random 19 times, with
    sessions mixed; the rank of the strict accuracy among those is an exact test of whether something is lost. For
    ``"best"`` the draws use ``"multiband"``, where that is evaluated too. Hynninen, Nguyen Le, Kyrki, arXiv 2403.17606.

    Examples
    --------
    >>> from granular_id import evaluate, synthesize
    >>> data = synthesize(["rice", "fine sugar"], n_per_class=8, sessions=4, duration_s=0.5)
    >>> result = evaluate(data, "hfmh", progress=False)
    >>> result.folds.name, result.accuracy()
    ('held-out sessions', 1.0)
    >>> str(result.gap)
    'no loss shown with held-out sessions (p = 1.00)'
    """
    start = time.perf_counter()
    if not isinstance(data, Dataset):
        raise argument_error(TypeError, "data", f"must be a granular_id.Dataset, got {type(data).__name__}")
    check_progress(progress)
    checked_flag("baselines", baselines)
    accepted, seed = accepted_names(accept), _seed(random_state)
    _ = data.X  # before anything is drawn: resampling and cropping come first, and may change the counts
    common_units(data)
    planned, notes = _planned(data, spaces, paper is not False)
    usual = _usual(classifier, planned)

    folds = _folds(data, by, paper, seed)
    checked = data.check()
    findings = spoiling(checked)
    refuse_copies(findings, accepted, folds, data)
    draws, why_no_gap = matched_draws(data, folds, copies=copies_together(checked, folds, data))
    untouched = planned_baselines(data) if baselines else ()
    trials, drawn_for, fewer = _trials(planned, usual, untouched, folds, len(draws))

    held: dict[str, Held] = {}
    at_random: dict[str, tuple[float, ...]] = {}
    with showing(progress) as step:
        ticker = Ticker(len(folds) * sum(1 + trial.n_draws for trial in trials), step)
        score = partial(fit_and_score, data=data, seed=seed, n_jobs=n_jobs, tick=ticker.tick)
        observe = partial(_observed, data.y, folds.by not in NAMES)
        for name, pipeline, _, X in trials:
            held[name] = score(pipeline, folds=folds, X=X, observe=observe, name=name)
            if X is None:
                show_line(progress, f"{folds.name}  {name}  {percent(held[name].accuracy)}")
        for name, pipeline, n_draws, X in sorted(trials, key=lambda trial: -trial.n_draws):
            if not n_draws:
                continue
            together = replace(draws[0], folds=tuple(fold for draw in draws[:n_draws] for fold in draw))
            drawn = score(pipeline, folds=together, X=X, name=name).fold_accuracies(len(folds))
            at_random[name] = tuple(drawn.tolist())
            if X is None:
                show_line(progress, f"at random  {name}  {percent(float(drawn.mean()))}")

    measured = tuple(
        replace(one, held=held.pop(trial, None), at_random=at_random.pop(trial, (np.nan,))[0])
        for trial, one in ((f"baseline {one.name}", one) for one, _, _ in untouched)
    )
    headline = held[planned[0].name]
    spoiled = {finding.code for finding in findings}
    more = [one.finding(headline) for one in measured if f"leak-{one.name}" not in spoiled]
    findings += tuple(finding for finding in more if finding is not None)
    unknown = set(accepted) - {finding.code for finding in (*checked, *findings)}
    of_sessions = _SESSION_CODES if SESSION_NAMES.fullmatch(folds.by.rpartition(".")[2]) else ()
    settings = {
        "spaces": list(held),
        "by": by,
        **({"paper": paper} if paper else {}),
        "classifier": describe_estimator(usual),
        "transformers": {space.name: describe_estimator(space.transformer) for space in planned},
        "baselines": baselines,
        **({"accept": list(accepted)} if accepted else {}),
        "seed": seed,
    }
    return EvaluationResult(
        held=held,
        folds=folds,
        at_random=at_random,
        gap=Gap.of(drawn_for, held[drawn_for], at_random[drawn_for]) if at_random else None,
        why_no_gap=why_no_gap,
        baselines=measured,
        adapted=_adapted(held),
        paper_accuracies={s.name: s.paper_accuracy for s in planned if s.paper_accuracy is not None},
        findings=findings,
        names=tuple(data.names),
        settings=settings,
        data=describe_data(data),
        versions=versions(),
        report_data=report_data_of(data, [space.transformer for space in planned]),
        chosen=_chosen(held),
        notes=(
            *folds.notes,
            *notes,
            *fewer,
            *(f"accept: the checks found nothing called {name!r}" for name in accepted if name in unknown),
            *data_warnings(
                data, [one for one in checked if one not in findings and one.code not in of_sessions]
            ),
            *dict.fromkeys(note for one in held.values() for note in one.notes),
        ),
        synthetic=data.is_synthetic,
        command=_call(settings, classifier),
        wall_s=time.perf_counter() - start,
    )


class _Trial(NamedTuple):
    """A pipeline that is scored under the folds of the headline, then under some of the draws."""

    name: str
    pipeline: Pipeline
    n_draws: int
    X: Floats | None = None  # what stands for the samples


def _trials(
    planned: Sequence[FeatureSpace],
    usual: BaseEstimator,
    untouched: Sequence[Untouched],
    folds: Folds,
    n_draws: int,
) -> tuple[list[_Trial], str, list[str]]:
    """Return all that is scored, the space that takes all draws, and notes."""
    names = [space.name for space in planned]
    drawn_for = "multiband" if names[0] == "best" and "multiband" in names else names[0]
    few = min(1, n_draws)
    trials, notes = [], []
    for space in planned:
        fewer = limit_components(space.transformer, min(fold.train.size for fold in folds))
        notes += [f"{space.name}: {fewer}"] if fewer else []
        pipeline = space_pipeline(space.transformer, usual if space.classifier is None else space.classifier)
        trials.append(_Trial(space.name, pipeline, n_draws if space.name == drawn_for else few))
    trials += [
        _Trial(f"baseline {one.name}", pipeline, few, X)
        for one, pipeline, X in untouched
        if pipeline is not None
    ]
    return trials, drawn_for, notes


# The arguments.


def _seed(random_state: int | None) -> int:
    if random_state is None:
        return secrets.randbits(32)
    return whole_number("random_state", random_state, least=0, or_else=" or None")


def _usual(classifier: Any, planned: Sequence[FeatureSpace]) -> BaseEstimator:
    """Return the classifier of the spaces that bring none, by default the paper's."""
    if classifier is None:
        return ECOCClassifier()
    if isinstance(classifier, type) or not all(hasattr(classifier, name) for name in ("fit", "get_params")):
        wanted = f"must be a classifier of scikit-learn such as LinearSVC(), got {classifier!r:.60}"
        raise argument_error(TypeError, "classifier", wanted)
    names = [space.name for space in planned if space.classifier is not None]
    if len(names) == len(planned):
        problem = f"has no use: {', '.join(names)} {verb(len(names), 'has', 'have')} one of its own"
        raise argument_error(GranularIdError, "classifier", problem)
    return classifier


def _folds(data: Dataset, by: str, paper: bool | tuple[int, int, int], seed: int) -> Folds:
    if paper is False:
        return hold_out(data, by, seed=seed)
    if by != "auto":
        raise argument_error(GranularIdError, "by", f"={by!r} has no use with paper: leave one out")
    if paper is True:
        return paper_folds(data, seed=seed)
    if not isinstance(paper, tuple | list) or len(paper) != 3:
        wanted = "must be True or three numbers, of partitions and of training and test recordings"
        raise argument_error(TypeError, "paper", f"{wanted}, got {paper!r:.60}")
    return paper_folds(data, *paper, seed=seed)


def _planned(data: Dataset, spaces: Any, paper: bool) -> tuple[list[FeatureSpace], list[str]]:
    """Turn the `spaces` argument into a list, for recordings of this rate; say what was taken instead of what."""
    rate_hz, notes = data.rate_hz, []
    if spaces is None:
        spaces = "paper" if paper else USUAL_SPACES
        if not paper and rate_hz <= 2 * FeatureSpec().cutoff_hz:
            spaces = (*USUAL_SPACES[:2], "raw")
            notes.append(f"raw instead of raw+hfmh: a high-pass at 23 Hz leaves nothing of {rate_hz:g} Hz")
    if hasattr(spaces, "fit"):
        wanted = (
            "must be names or a mapping, as in {'mine': transformer}, with classifier= for what classifies"
        )
        raise argument_error(TypeError, "spaces", f"{wanted}, got {type(spaces).__name__}")
    if isinstance(spaces, Mapping):
        planned = [_own_space(name, transformer, rate_hz) for name, transformer in spaces.items()]
    else:
        known = feature_spaces(rate_hz=rate_hz)
        planned = [known[name] for name in _names(spaces, known)]
    if not planned:
        raise argument_error(GranularIdError, "spaces", "must name at least one feature space, got none")
    return planned, notes


def _names(spaces: str | Sequence[str], known: Mapping[str, FeatureSpace]) -> list[str]:
    if spaces == "all":
        return all_spaces(known)
    if spaces == "paper":
        return paper_spaces(known)
    names = [spaces] if isinstance(spaces, str) else list(spaces)
    for name in names:
        if name not in known:
            choices = ", ".join(map(repr, ("all", "paper", *known)))
            raise argument_error(GranularIdError, "spaces", f"must be among {choices}, got {name!r}")
    if len(set(names)) < len(names):
        raise argument_error(GranularIdError, "spaces", f"must name each feature space once, got {names!r}")
    return names


def _own_space(name: Any, given: Any, rate_hz: float) -> FeatureSpace:
    if not isinstance(name, str) or not name:
        raise argument_error(TypeError, "spaces", f": a name must be non-empty text, got {name!r}")
    if isinstance(given, FeatureSpace):
        space = replace(given, name=name)
    elif hasattr(given, "fit") and hasattr(given, "transform"):
        space = FeatureSpace(name, given, None)
    else:
        wanted = "must have fit and transform like a scikit-learn transformer; what classifies is given as classifier="
        raise argument_error(TypeError, "spaces", f"[{name!r}] {wanted}, got {type(given).__name__}")
    parameters: dict[str, Any] = getattr(space.transformer, "get_params", dict)()
    for key, value in parameters.items():
        # A filter designed for another rate: its cut-off would silently lie elsewhere.
        if key.rpartition("__")[2] == "rate_hz" and value not in (None, rate_hz):
            owner = parameters[key.removesuffix("__rate_hz")] if "__" in key else space.transformer
            problem = f"{type(owner).__name__} has rate_hz={value:g}, the recordings have {rate_hz:g} Hz"
            raise argument_error(
                GranularIdError, "spaces", f"[{name!r}]: {problem}: pass rate_hz={rate_hz:g}"
            )
    return replace(space, transformer=with_rate(clone(space.transformer), rate_hz))


# What each fold shows beside its answers.


def _observed(
    y: NDArray[np.str_], adapts: bool, fitted: Pipeline, X: Floats, train: Rows, X_new: Floats, test: Rows
) -> tuple[Choice | None, NDArray[np.bool_] | None]:
    """Return what a model chose and, where models are to adapt, what it names right then."""
    return choice_of(fitted), _adapted_answers(fitted, X, y[train], X_new, y[test]) if adapts else None


def _adapted_answers(
    fitted: Pipeline, X: Floats, y: NDArray[np.str_], X_new: Floats, y_new: NDArray[np.str_]
) -> NDArray[np.bool_] | None:
    """Whether each recording is named right by a model that was adapted to the other half of them.

    The halves take turns; each is declared to hold all materials. None where a half holds too few of one, or far more
    of one than of another.
    """
    labels, truth, counts = np.unique(y_new, return_inverse=True, return_counts=True)
    if (
        not isinstance(fitted[-1], BestClassifier)
        or labels.size < len(fitted[-1].classes_)
        or counts.min() < 2 * _LEAST_TO_ADAPT
        or counts.max() > _ABOUT_EQUAL * counts.min()
    ):
        return None
    half = np.zeros(len(y_new), dtype=np.intp)
    for k, count in enumerate(counts.tolist()):
        half[truth == k] = np.arange(count) % 2
    right = np.zeros(len(y_new), dtype=np.bool_)
    for turn in (0, 1):
        adapted = adapted_classifier(fitted[-1], X, y, X_new[half == turn])
        others = half != turn
        right[others] = adapted.predict(X_new[others]) == y_new[others]
    return right


def _chosen(held: Mapping[str, Held]) -> dict[str, tuple[Choice, ...]]:
    found = {name: tuple(chosen for chosen, _ in one.observed) for name, one in held.items()}
    return {name: chosen for name, chosen in found.items() if all(one is not None for one in chosen)}


def _adapted(held: Mapping[str, Held]) -> dict[str, Floats]:
    """Balanced accuracy after adapting in each fold, of spaces that could be adapted in all of them."""
    found = {}
    for name, one in held.items():
        right = [adapted for _, adapted in one.observed]
        if all(own is not None for own in right):
            wrong = (one.truth + 1) % len(one.classes)
            adapted = replace(one, predicted=np.where(np.concatenate(right), one.truth, wrong))
            found[name] = adapted.fold_accuracies()
    return found


def _call(settings: Mapping[str, Any], classifier: BaseEstimator | None) -> str:
    """Return the call as text, for the reader of a result."""
    given = {name: settings[name] for name in ("spaces", "by", "paper", "accept") if name in settings}
    if settings.get("paper") or settings["by"] == "auto":
        del given["by"]
    arguments = [f"{name}={value!r}" for name, value in given.items()]
    if classifier is not None:
        arguments.append(f"classifier={' '.join(repr(classifier).split())}")
    if not settings["baselines"]:
        arguments.append("baselines=False")
    return f"granular_id.evaluate(data, {', '.join(arguments)}, random_state={settings['seed']})"
