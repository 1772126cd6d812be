"""Whether probabilities mean what they say.

Sources: Naeini, Cooper, Hauskrecht, "Obtaining well calibrated probabilities using Bayesian binning" (AAAI 2015) for
the expected calibration error; Brier, "Verification of forecasts expressed in terms of probability" (1950); Bröcker &
Smith, "Increasing the reliability of reliability diagrams" (2007) for what a calibrated model would show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar
from scipy.special import softmax

from granular_id._text import Table, percent
from granular_id.confidence.held_out import FloatArray, HeldOutScores, IntArray, StudyResult

_N_BINS = 15  # the number usual since Guo et al. (2017)
_N_BOOTSTRAP = 1000
_MOST_BY_CHANCE = 0.2  # where calibrated models reach further, probabilities that are 20 points off go unseen
_LEAST = 1e-15  # a probability of 0 for what happened would make the log loss infinite
_LEAST_SHARE = 1e-300  # the same where a temperature is fitted
_LOG_RANGE = 12.0  # temperatures from e^-12 to e^12 of the spread of the values
_SUM_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Bin:
    """Rows whose likeliest class has a probability in (low, high]."""

    low: float
    high: float
    n: int
    confidence: float  # mean probability of the likeliest class
    accuracy: float  # share of rows where it is the true one


@dataclass(frozen=True)
class Reliability(StudyResult):
    """How far probabilities are from what happens.

    Attributes
    ----------
    n : int
        Rows.
    accuracy, confidence : float
        Share of rows whose likeliest class is the true one; mean probability of the likeliest class.
    ece, ece_interval : float and (float, float)
        Expected calibration error of the likeliest class, with its 95 % bootstrap interval; whole sessions are drawn
        where there are several.
    ece_if_calibrated : (float, float)
        Where 95 % of the errors lie that a perfectly calibrated model would show with so many rows: by chance they
        are above 0. Above the interval the probabilities are off; where it reaches beyond 0.2 an error within it
        tells nothing.
    brier : float
        Mean squared distance of the probabilities from 1 for the true class and 0 for others: 0 to 2.
    log_loss : float
        Mean of minus the natural logarithm of the probability of the true class.
    bins : tuple of Bin
        Those that hold rows.
    source : str
        Where the probabilities come from.
    held_out : str
        What the rows were to the models that scored them.
    synthetic : bool
    """

    n: int
    accuracy: float
    confidence: float
    ece: float
    ece_interval: tuple[float, float]
    ece_if_calibrated: tuple[float, float]
    brier: float
    log_loss: float
    bins: tuple[Bin, ...]
    source: str = ""
    held_out: str = ""
    synthetic: bool = False

    @property
    def verdict(self) -> str:
        """Say in a few words whether the probabilities can be taken as they are, or that these rows cannot tell."""
        if self.accuracy == 1.0 and percent(self.confidence) == percent(1.0):
            return "no mistakes, so nothing to judge by"
        if self.ece <= self.ece_if_calibrated[1]:
            few = self.ece_if_calibrated[1] > _MOST_BY_CHANCE
            return "too few rows to tell" if few else "no sign of being off"
        return "too sure" if self.confidence > self.accuracy else "not sure enough"

    def table(self) -> Table:
        """Return the figures as a table."""
        low, high = self.ece_interval
        rows = (
            ("accuracy", percent(self.accuracy)),
            ("mean probability of the answer", percent(self.confidence)),
            ("expected calibration error", f"{percent(self.ece)} ({100 * low:.1f} to {100 * high:.1f})"),
            ("the same of a calibrated model", " to ".join(percent(edge) for edge in self.ece_if_calibrated)),
            ("Brier score", f"{self.brier:.3f}"),
            ("log loss", f"{self.log_loss:.3f}"),
        )
        notes = [f"verdict: {self.verdict}"]
        if self.source:
            notes.append(f"probabilities: {self.source}")
        if self.held_out:
            notes.append(f"held out: {self.held_out}")
        return Table(f"Probabilities of {self.n} rows{self._mark}", ("", ""), rows, tuple(notes))

    def to_dict(self) -> dict[str, Any]:
        """Return everything in types that JSON knows."""
        return {
            **vars(self),
            "ece_interval": list(self.ece_interval),
            "ece_if_calibrated": list(self.ece_if_calibrated),
            "bins": [vars(part).copy() for part in self.bins],
        }


def probabilities_of(scored: HeldOutScores) -> tuple[FloatArray, str]:
    """Probabilities (n, K) of held-out rows, and where they come from.

    Those of the model where it gives any (`ECOCClassifier` with ``posterior``); else its class values through a
    softmax, whose one temperature for each fold is fitted on the other folds.
    """
    given = scored.scores.probabilities
    if given is not None:
        if not ((given >= 0).all() and (np.abs(given.sum(axis=1) - 1) <= _SUM_TOLERANCE).all()):
            raise ValueError("predict_proba of model must not be negative, and sum to 1 in each row")
        return given, "predict_proba of the model"
    values, truth = scored.scores.values, scored.truth
    found = np.empty_like(values)
    folds = np.unique(scored.folds)
    for fold in folds:
        held = scored.folds == fold
        others = ~held if folds.size > 1 else held
        found[held] = softmax(values[held] / fit_temperature(values[others], truth[others]), axis=-1)
    return found, "softmax of the class values, its temperature fitted on the other folds"


def fit_temperature(values: FloatArray, truth: IntArray) -> float:
    """Temperature that makes class values (n, K) the likeliest logarithms of probabilities.

    Source: Guo, Pleiss, Sun, Weinberger, "On calibration of modern neural networks" (ICML 2017), section 4.2.
    """
    spread = float(values.std()) or 1.0
    rows = np.arange(len(truth))

    def loss(log_temperature: float) -> float:
        shares = softmax(values / (spread * math.exp(log_temperature)), axis=-1)[rows, truth]
        return -float(np.log(np.maximum(shares, _LEAST_SHARE)).mean())

    found = minimize_scalar(loss, bounds=(-_LOG_RANGE, _LOG_RANGE), method="bounded")
    return spread * math.exp(float(found.x))


def reliability(
    probabilities: FloatArray,
    truth: IntArray,
    groups: IntArray,
    *,
    seed: int = 0,
    source: str = "",
    held_out: str = "",
    synthetic: bool = False,
) -> Reliability:
    """Compare probabilities (n, K) of rows that did not train with what happened; the bootstrap draws whole groups."""
    rows = np.arange(len(truth))
    sure, right = probabilities.max(axis=1), probabilities.argmax(axis=1) == truth
    places = np.clip(np.ceil(sure * _N_BINS).astype(np.intp) - 1, 0, _N_BINS - 1)

    def error(chosen: IntArray, hits: npt.NDArray[np.bool_]) -> float:
        gaps = np.bincount(places[chosen], weights=hits[chosen] - sure[chosen], minlength=_N_BINS)
        return float(np.abs(gaps).sum() / len(chosen))

    rng = np.random.default_rng(seed)
    members = [np.flatnonzero(groups == group) for group in np.unique(groups)]
    drawn = (
        np.concatenate([members[k] for k in rng.integers(len(members), size=len(members))])
        for _ in range(_N_BOOTSTRAP)
    )
    bootstrap = [error(chosen, right) for chosen in drawn]
    calibrated = [error(rows, rng.random(len(rows)) < sure) for _ in range(_N_BOOTSTRAP)]
    wanted = np.zeros_like(probabilities)
    wanted[rows, truth] = 1.0
    bins = tuple(
        Bin(k / _N_BINS, (k + 1) / _N_BINS, int(own.sum()), float(sure[own].mean()), float(right[own].mean()))
        for k in range(_N_BINS)
        if (own := places == k).any()
    )
    return Reliability(
        n=len(truth),
        accuracy=float(right.mean()),
        confidence=float(sure.mean()),
        ece=error(rows, right),
        ece_interval=_middle(bootstrap),
        ece_if_calibrated=_middle(calibrated),
        brier=float(((probabilities - wanted) ** 2).sum(axis=1).mean()),
        log_loss=float(np.log(1.0 / np.clip(probabilities[rows, truth], _LEAST, 1.0)).mean()),  # never -0
        bins=bins,
        source=source,
        held_out=held_out,
        synthetic=synthetic,
    )


def _middle(values: Sequence[float]) -> tuple[float, float]:
    low, high = np.quantile(values, [0.025, 0.975]).tolist()
    return low, high
