"""How far the confidence of a model can be trusted: its probabilities, its candidates, its refusal of the unknown."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.metrics import roc_auc_score

from granular_id._checks import argument_error, checked_share, named
from granular_id._estimators import versions
from granular_id._files import json_value, write_json
from granular_id._parallel import in_threads, single_threaded_blas
from granular_id._progress import ProgressCallback, Ticker, check_progress, showing
from granular_id._text import Table, percent, short
from granular_id.confidence import (
    candidate_rule,
    fit_temperature,
    held_out_parts,
    rotated,
    softmax,
    weights_of,
)
from granular_id.ecoc import ECOCClassifier
from granular_id.recording import Dataset, describe_data
from granular_id.score import Held, fit_and_score, space_pipeline
from granular_id.spaces import BlockScaler, FeatureSpace, block_sizes, feature_spaces, limit_components
from granular_id.splits import Folds, hold_out
from granular_id.statistics import mean_interval

Floats = NDArray[np.float64]
Codes = NDArray[np.intp]

LEVELS = (0.8, 0.9, 0.95)
MOST_WORST = 3
_N_BINS = 15  # the number usual since Guo et al. (2017)


@dataclass(frozen=True)
class Bin:
    """Held-out recordings whose answer has a probability in (low, high]."""

    low: float
    high: float
    n: int
    probability: float  # mean probability of the answer
    accuracy: float  # share of right answers


@dataclass(frozen=True)
class Reliability:
    """Whether probabilities mean what they say.

    Attributes
    ----------
    accuracy, probability : float
        Share of right answers; mean probability of the answer; each session weighing alike.
    too_sure : float
        Their difference: positive where answers are less often right than stated.
    interval : (float, float)
        95 % interval of `too_sure` over new sessions (Student's t); NaN with fewer than three.
    ece : float
        Expected calibration error in 15 bins. Above 0 by chance even where probabilities are right. Naeini, Cooper,
        Hauskrecht (AAAI 2015).
    brier, log_loss : float
        Mean squared distance of the probabilities from 1 for the right material and 0 for others, 0 to 2; mean of minus
        the logarithm of the probability of the right material.
    bins : tuple of Bin
        Those that hold recordings.
    """

    accuracy: float
    probability: float
    too_sure: float
    interval: tuple[float, float]
    ece: float
    brier: float
    log_loss: float
    bins: tuple[Bin, ...]

    @property
    def summary(self) -> str:
        """Say in a few words whether probabilities can be taken as they are."""
        low, high = self.interval
        if math.isnan(low):
            return "too few sessions to tell of new ones"
        if low > 0:
            return "too sure in new sessions"
        return "not sure enough in new sessions" if high < 0 else "not shown to be off"


@dataclass(frozen=True)
class Coverage:
    """What candidates of one level hold: each held-out session judged by the rule of the others."""

    level: float
    mean: float
    worst: float
    size: float  # mean number of candidates


@dataclass(frozen=True)
class LeftOut:
    """One material that a model has never met.

    Attributes
    ----------
    label : str
    auroc : float
        Share of pairs, one recording of it and one of a known material, in which it has the larger novelty score.
    refused : float
        Share of its recordings that is refused at a limit that refuses as many of the known as was requested.
    """

    label: str
    auroc: float
    refused: float


@dataclass(frozen=True, eq=False)
class ConfidenceStudy:
    """How far the confidence of a model can be trusted, as `confidence_study` finds it.

    Attributes
    ----------
    space : str
        The feature space.
    held_out : str
        What was held out, in words.
    n_rows, n_sessions : int
        Held-out recordings and sessions; 0 sessions where none were held out.
    reliability : Reliability
        Of the probabilities.
    coverage : tuple of Coverage
        Of the candidates, one entry for each level.
    unknown : tuple of LeftOut
        Each material left out in turn; empty with fewer than three.
    share_known : float
        Share of known recordings that is not refused.
    novelty : tuple of two float arrays
        Novelty scores of known and of left-out materials over the limit, of all turns.
    notes : tuple of str
    data, versions : mapping
    synthetic : bool
        Such figures say nothing about real materials.
    """

    space: str
    held_out: str
    n_rows: int
    n_sessions: int
    reliability: Reliability
    coverage: tuple[Coverage, ...]
    unknown: tuple[LeftOut, ...]
    share_known: float
    novelty: tuple[Floats, Floats]
    notes: tuple[str, ...] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    synthetic: bool = False

    def table(self) -> str:
        """Return all figures as one screen of text."""
        sure = self.reliability
        low, high = sure.interval
        within = "" if math.isnan(low) else f", 95 % interval {100 * low:+.1f} to {100 * high:+.1f}"
        mark = "SYNTHETIC recordings: " if self.synthetic else ""
        sessions = f"{self.n_sessions} sessions" if self.n_sessions else "no sessions"
        lines = [
            f"{mark}{self.space} with {self.held_out}: {self.n_rows} recordings, {sessions}",
            f"probabilities: stated {percent(sure.probability)}, right {percent(sure.accuracy)}: {sure.summary}",
            f"  stated minus right {100 * sure.too_sure:+.1f} points{within}",
            f"  calibration error {percent(sure.ece)}, Brier {sure.brier:.3f}, log loss {sure.log_loss:.3f}",
            "",
            str(self.coverage_table()),
        ]
        if self.unknown:
            auroc, refused = (
                float(np.mean([getattr(one, of) for one in self.unknown])) for of in ("auroc", "refused")
            )
            lines += [
                "",
                f"unknown materials, each left out in turn: AUROC {auroc:.3f}, {percent(refused, 0)} refused while "
                f"{percent(1 - self.share_known, 0)} of the known are",
            ]
            flawed = [one for one in self.unknown if min(one.auroc, one.refused) < 1]
            worst = sorted(flawed, key=lambda one: one.auroc)[:MOST_WORST]
            lines += [
                f"  worst: {short(one.label)}, AUROC {one.auroc:.3f}, {percent(one.refused, 0)} refused"
                for one in worst
            ]
        return "\n".join((*lines, *self.notes))

    __str__ = table

    def coverage_table(self) -> Table:
        """Return what candidates hold as a table."""
        sessions = ("worst session",) if self.n_sessions else ()
        rows = tuple(
            (
                percent(one.level, 0),
                percent(one.mean),
                *((percent(one.worst),) if sessions else ()),
                f"{one.size:.2f}",
            )
            for one in self.coverage
        )
        notes = (
            () if sessions else ("no sessions were held out: this holds within those of the recordings only",)
        )
        header = ("requested", "held the right one", *sessions, "materials in a set")
        return Table("Candidates", header, rows, notes)

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        shown = {name: json_value(value) for name, value in asdict(self).items() if name != "novelty"}
        return {"format": "granular_id.confidence/1", **shown}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as one JSON file; whole or not at all."""
        write_json(path, self.to_dict())


def confidence_study(
    data: Dataset,
    space: str | FeatureSpace = "best",
    *,
    by: str = "auto",
    levels: Sequence[float] = LEVELS,
    share_known: float = 0.95,
    n_jobs: int | None = None,
    random_state: int = 0,
    progress: bool | ProgressCallback = False,
) -> ConfidenceStudy:
    """Measure how far probabilities, candidates and refusal can be trusted in new sessions.

    Parameters
    ----------
    data : Dataset
        Recordings of equal length and rate with a label each.
    space : str or FeatureSpace, default "best"
        What is judged; the default is what `Identifier.fit` trains.
    by : str
        What is held out, as in `granular_id.evaluate`.
    levels : sequence of float, default (0.8, 0.9, 0.95)
        Of the candidates, in (0, 1).
    share_known : float, default 0.95
        Share of recordings of known materials that is not to be refused, in (0, 1).
    n_jobs : int, optional
        Threads, as in joblib; the numbers do not depend on it.
    random_state : int, default 0
        Of random folds and of every ``random_state`` left open.
    progress : bool or callable
        As in `granular_id.evaluate`.

    Returns
    -------
    ConfidenceStudy
        ``print`` shows one screen.

    Raises
    ------
    TypeError, ValueError
        As `granular_id.evaluate`, and levels outside (0, 1).

    Notes
    -----
    Each recording is scored by models that did not train on its session. Its probability comes from a temperature, its
    candidates from a threshold, that the *other* sessions set, as those of a model hold in a new session. Of the
    unknown nothing is trained twice: the novelty score needs no learner.

    Examples
    --------
    >>> from granular_id import synthesize
    >>> from granular_id.evaluation import confidence_study
    >>> data = synthesize(["rice", "fine sugar", "oat flakes"], n_per_class=8, sessions=4, duration_s=0.5)
    >>> found = confidence_study(data)
    >>> found.n_sessions, len(found.unknown)
    (4, 3)
    """
    if not isinstance(data, Dataset):
        raise argument_error(TypeError, "data", f"must be a granular_id.Dataset, got {type(data).__name__}")
    check_progress(progress)
    wanted = tuple(checked_share("levels", level) for level in levels)
    share_known = checked_share("share_known", share_known)
    folds = hold_out(data, by, seed=random_state)
    planned = space
    if not isinstance(planned, FeatureSpace):
        planned = named(feature_spaces(rate_hz=data.rate_hz), "space", space)
    # Where two are known, a model of all but one has nothing to tell apart.
    tested = np.unique(data.y[np.concatenate([fold.test for fold in folds])]).tolist()
    left_out = tested if np.unique(data.y).size > 2 else []
    with showing(progress) as step:
        tick = Ticker(len(folds) + len(left_out), step).tick
        classifier = ECOCClassifier() if planned.classifier is None else planned.classifier
        transformer = clone(planned.transformer)
        fewest = min(fold.train.size for fold in folds), *((data.y != label).sum() for label in left_out)
        fewer = limit_components(transformer, min(fewest))
        pipeline = space_pipeline(transformer, classifier)
        held = fit_and_score(
            pipeline, data, folds, seed=random_state, n_jobs=n_jobs, tick=tick, name=planned.name
        )
        places = held.places
        reliability = _reliability(held, places)
        coverage = tuple(_coverage(held, places, level) for level in wanted)

        def leave_out(label: str) -> tuple[LeftOut, Floats, Floats]:
            found = _leave_out(data, transformer, folds, label, share_known)
            tick(f"without {label}")
            return found

        with single_threaded_blas():
            unknown = in_threads(leave_out, left_out, n_jobs)
    notes = [f"not tested: {label}, {why}" for label, why in folds.untested.items()]
    notes += [f"{planned.name}: {fewer}"] if fewer else []
    if not unknown:
        notes.append(
            "two materials only: none can be left out, so nothing is known of how the unknown is refused"
        )
    return ConfidenceStudy(
        space=planned.name,
        held_out=folds.name,
        n_rows=len(held.rows),
        n_sessions=len(np.unique(places)) if folds.sessions_apart else 0,
        reliability=reliability,
        coverage=coverage,
        unknown=tuple(found for found, _, _ in unknown),
        share_known=share_known,
        novelty=(
            np.concatenate([np.empty(0), *(known for _, known, _ in unknown)]),
            np.concatenate([np.empty(0), *(beyond for _, _, beyond in unknown)]),
        ),
        notes=tuple(notes),
        data=describe_data(data),
        versions=versions(),
        synthetic=data.is_synthetic,
    )


def _others(places: Codes) -> Iterator[tuple[NDArray[np.bool_], NDArray[np.bool_]]]:
    """Rows of each session, and those of the others, of which a single session has none but itself."""
    for place in np.unique(places):
        own = places == place
        yield own, own if own.all() else ~own


def _reliability(held: Held, places: Codes) -> Reliability:
    shares = np.empty_like(held.values)
    for own, others in _others(places):
        temperature = fit_temperature(held.values[others], held.truth[others], places[others])
        shares[own] = softmax(held.values[own], temperature)
    rows = np.arange(len(shares))
    stated, right = shares[rows, held.predicted], held.right.astype(np.float64)
    n_of = np.bincount(places)  # from 0 on, none without rows
    probability, accuracy = (np.bincount(places, weights=each) / n_of for each in (stated, right))
    too_sure = probability - accuracy
    interval = mean_interval(too_sure) if held.folds.sessions_apart else (math.nan, math.nan)
    edges = np.linspace(0, 1, _N_BINS + 1)
    place = np.clip(np.searchsorted(edges, stated, side="left") - 1, 0, _N_BINS - 1)
    bins = tuple(
        Bin(
            float(edges[k]),
            float(edges[k + 1]),
            int(own.sum()),
            float(stated[own].mean()),
            float(right[own].mean()),
        )
        for k in range(_N_BINS)
        if (own := place == k).any()
    )
    truth = np.eye(shares.shape[1])[held.truth]
    return Reliability(
        accuracy=float(accuracy.mean()),
        probability=float(probability.mean()),
        too_sure=float(too_sure.mean()),
        interval=interval,
        ece=sum(one.n * abs(one.probability - one.accuracy) for one in bins) / len(shares),
        brier=float(((shares - truth) ** 2).sum(axis=1).mean()),
        log_loss=float(-np.log(np.maximum(shares[rows, held.truth], 1e-15)).mean()) + 0.0,  # never -0
        bins=bins,
    )


def _coverage(held: Held, places: Codes, level: float) -> Coverage:
    """Judge each session by the rule that the others set; without sessions by folds."""
    shares, sizes = [], []
    for own, others in _others(places):
        sessions = places[others] if held.folds.sessions_apart else None
        rule = candidate_rule(held.classes, held.values[others], held.truth[others], sessions, level)
        sets = rule.sets(held.values[own])
        sets[np.arange(len(sets)), held.predicted[own]] = True  # at least one
        shares.append(float(sets[np.arange(len(sets)), held.truth[own]].mean()))
        sizes.append(float(sets.sum(axis=1).mean()))
    return Coverage(level, float(np.mean(shares)), min(shares), float(np.mean(sizes)))


def _leave_out(
    data: Dataset, transformer: Any, folds: Folds, label: str, share_known: float
) -> tuple[LeftOut, Floats, Floats]:
    """Score held-out recordings by models that have never met one material; nothing else has seen it either."""
    known = data.y != label
    space = clone(transformer).fit(data.X[known], data.y[known])
    features = np.asarray(space.transform(data.X), dtype=np.float64)
    s = rotated(BlockScaler(block_sizes(space)).fit(features[known]).transform(features))
    codes = np.unique(np.where(known, data.y, data.y[known][0]), return_inverse=True)[1].astype(np.intp)
    parts = held_out_parts(
        s, codes, int(codes.max()) + 1, [(fold.train[known[fold.train]], fold.test) for fold in folds]
    )
    tested = np.isfinite(parts.d).all(axis=1)
    of_known = np.flatnonzero(tested & known)
    novelty = parts.score(weights_of(parts.take(of_known), codes[of_known]))
    inside, outside = novelty[of_known], novelty[tested & ~known]
    limit = float(np.quantile(inside, share_known))
    auroc = roc_auc_score(np.r_[np.zeros(len(inside)), np.ones(len(outside))], np.r_[inside, outside])
    found = LeftOut(label, float(auroc), float((outside > limit).mean()))
    return found, inside / limit, outside / limit
