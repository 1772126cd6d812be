"""Refusing what is none of the known materials, by the novelty of the scores of a row.

Sources: Lee, Lee, Lee, Shin, "A simple unified framework for detecting out-of-distribution samples" (NeurIPS 2018) for
the Mahalanobis distance to the nearest class; Scheirer et al., "Toward open set recognition" (IEEE TPAMI 2013) for the
task.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id.confidence.conformal import (
    check_classes,
    checked_scores,
    conformal_quantile,
    rule_from_dict,
    rule_to_dict,
)

# scikit-learn is loaded where it is used: whoever reads a stored rule does not wait for it.

if TYPE_CHECKING:
    from granular_id.confidence.held_out import HeldOutScores

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_MATRIX = [[float, ...], ...]
_FORM = {
    "format": "granular-id unknown rule 1",
    "classes": [str, ...],
    "threshold": (float, None),
    "share_known": float,
    "n_calibration": int,
    "means": _MATRIX,
    "whitener": _MATRIX,
    "of_pairs": bool,
    "held_out": str,
}

_LEAST_VARIANCE = 1e-12
"""Share of the largest variance below which a direction is rounding."""


@dataclass(frozen=True)
class UnknownRule:
    """A limit of novelty: a row beyond it is none of the known materials.

    Attributes
    ----------
    classes : tuple of str
        In the order of the class values.
    threshold : float
        Rows with a larger novelty score are rejected; infinite, so that none is, with too few calibration rows.
    share_known : float
        Share of rows of known materials that was to be accepted, in (0, 1).
    n_calibration : int
        Rows of known materials behind the threshold.
    means : tuple of tuple of float
        Mean class values of each class (K, K).
    whitener : tuple of tuple of float
        Matrix (K, K) whose product with class values has the unit matrix as covariance within a class.
    of_pairs : bool
        Whether the class values are those under the hinge, made of the scores of one learner for each pair of classes;
        else they are those that decide.
    held_out : str
        What the rows behind the threshold were to the models that scored them.

    Examples
    --------
    >>> from granular_id.confidence import UnknownRule
    >>> near = ((-0.2, -0.8), (-0.8, -0.2))
    >>> rule = UnknownRule(("oat", "rice"), 0.3, 0.95, 60, near, ((1.0, 0.0), (0.0, 1.0)), of_pairs=False)
    >>> rule.knows([-0.2, -0.9]), rule.knows([-0.50, -0.55])
    (True, False)
    >>> UnknownRule.from_dict(rule.to_dict()) == rule
    True
    """

    classes: tuple[str, ...]
    threshold: float
    share_known: float
    n_calibration: int
    means: tuple[tuple[float, ...], ...] = field(repr=False)
    whitener: tuple[tuple[float, ...], ...] = field(repr=False)
    of_pairs: bool
    held_out: str = ""
    _nearest: _core.NearestMean = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_classes(self.classes)
        if math.isnan(self.threshold) or self.threshold == -math.inf:
            raise ValueError(f"threshold must be a number or infinite, got {self.threshold}")
        if not 0 < self.share_known < 1:
            raise ValueError(f"share_known must lie between 0 and 1, got {self.share_known}")
        if self.n_calibration < 0:
            raise ValueError(f"n_calibration must not be negative, got {self.n_calibration}")
        size = len(self.classes)
        means, whitener = _matrix("means", self.means, size), _matrix("whitener", self.whitener, size)
        object.__setattr__(self, "_nearest", _core.NearestMean(means, whitener, of_pairs=self.of_pairs))

    @property
    def notes(self) -> tuple[str, ...]:
        """Say where nothing is refused, because there were too few calibration rows."""
        if self.threshold < math.inf:
            return ()
        return (
            f"too few calibration rows ({self.n_calibration}) to accept {100 * self.share_known:g} % of the known: "
            "nothing is refused",
        )

    def novelty(self, values: npt.ArrayLike, binary: npt.ArrayLike | None = None) -> FloatArray:
        """Novelty scores of rows; larger is more novel.

        Parameters
        ----------
        values : array-like, shape (K,) or (n, K)
            Class values of the fitted model, larger for what is likelier.
        binary : array-like, shape (L,) or (n, L), optional
            Scores of its learners, needed where the rule is `of_pairs`.

        Returns
        -------
        ndarray, shape () or (n,)

        Raises
        ------
        ValueError
            Another shape than the rule knows, or scores of learners that are missing.
        """
        given = checked_scores("values", values, len(self.classes))
        scores: npt.ArrayLike = given
        if self.of_pairs:
            if binary is None:
                raise ValueError("binary must hold the scores of the learners of pairs, got None")
            if np.shape(binary)[:-1] != given.shape[:-1]:
                raise ValueError(
                    f"values and binary must hold the same rows, got shapes {given.shape} and {np.shape(binary)}"
                )
            scores = binary
        name = "binary" if self.of_pairs else "values"
        return self._nearest.distances(scores, name).reshape(given.shape[:-1])

    def knows(self, values: npt.ArrayLike, binary: npt.ArrayLike | None = None) -> Any:
        """Whether rows are of a known material: a bool, or an array (n,) of them; see `novelty`."""
        known = self.novelty(values, binary) <= self.threshold
        return bool(known) if known.ndim == 0 else known

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self).from_dict, (self.to_dict(),)

    def to_dict(self) -> dict[str, Any]:
        """Return the rule in types that JSON knows; an infinite threshold becomes None."""
        return rule_to_dict(self, _FORM)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> UnknownRule:
        """Read what `to_dict` wrote.

        Raises
        ------
        TypeError, ValueError
            Another format, a part that is missing, unknown or of another type, or a rule that cannot be.
        """
        return cls(**rule_from_dict(stored, _FORM, "the unknown rule"))


def _matrix(name: str, rows: tuple[tuple[float, ...], ...], size: int) -> FloatArray:
    if [len(row) for row in rows] != [size] * size:
        raise ValueError(f"{name} must be {size} rows of {size} numbers")
    found = np.array(rows, dtype=np.float64)
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite")
    return found


def unknown_rule(scored: HeldOutScores, *, share_known: float = 0.95) -> UnknownRule:
    """Set the limit so that a wanted share of the rows of known materials is accepted.

    The novelty score is the Mahalanobis distance of the class values to those of the nearest class. Where a model has a
    learner for each pair of classes, class values are those under the hinge, whatever loss decides. The covariance
    within classes is shrunken after Ledoit & Wolf (2004), "A well-conditioned estimator for large-dimensional
    covariance matrices".

    Parameters
    ----------
    scored : HeldOutScores
        Cross-fitted scores of known materials. Rows of unknown ones are not needed.
    share_known : float, default 0.95
        In (0, 1). The threshold is the ceil((n + 1) share)-th smallest novelty score, so that a new row of a known
        material, recorded as the others were, is accepted at least so often.

    Returns
    -------
    UnknownRule

    Raises
    ------
    ValueError
        A share outside (0, 1).

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import held_out_scores, unknown_rule
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> scored = held_out_scores(X, ECOCClassifier(), y)
    >>> rule = unknown_rule(scored)
    >>> float(rule.knows(scored.scores.values, scored.scores.binary).mean()) >= 0.95
    True
    """
    from granular_id.ecoc import decode, onevsone

    own, binary, coding = scored.scores.values, scored.scores.binary, scored.scores.coding
    pairs = onevsone(len(scored.classes))
    of_pairs = coding is not None and np.array_equal(coding, pairs)
    if binary is not None and of_pairs:
        own = decode(binary, pairs)
    rule = UnknownRule(
        classes=scored.classes,
        threshold=np.inf,
        share_known=float(share_known),
        n_calibration=len(scored.truth),
        of_pairs=of_pairs,
        held_out=scored.held_out,
        **_distances(own, scored.truth),
    )
    return replace(
        rule, threshold=conformal_quantile(_held_out_distances(rule, own, scored), rule.share_known)
    )


def _held_out_distances(rule: UnknownRule, own: FloatArray, scored: HeldOutScores) -> FloatArray:
    """Novelty of each row by means and covariance of the other folds: those of its own would flatter it."""
    strange, binary = np.empty(len(own)), scored.scores.binary
    for fold in np.unique(scored.folds):
        held, others = scored.folds == fold, scored.folds != fold
        if np.unique(scored.truth[others]).size < len(scored.classes):
            others = np.ones_like(held)  # a single fold, or one that holds all of a class
        partial = replace(rule, **_distances(own[others], scored.truth[others]))
        strange[held] = partial.novelty(scored.scores.values[held], None if binary is None else binary[held])
    return strange


def _distances(scores: FloatArray, truth: IntArray) -> dict[str, Any]:
    """Means of the classes, and the inverse root of the shrunken covariance within them."""
    from sklearn.covariance import ledoit_wolf

    means = np.array([scores[truth == k].mean(axis=0) for k in range(truth.max() + 1)])
    covariance, _ = ledoit_wolf(scores - means[truth], assume_centered=True)
    variances, axes = np.linalg.eigh(covariance)
    # Two class values are one number twice: the other direction has no variance, and must not count as strange.
    told = variances > _LEAST_VARIANCE * max(variances.max(), np.finfo(float).tiny)
    roots = np.zeros_like(variances)
    roots[told] = 1.0 / np.sqrt(variances[told])
    return {"means": _plain(means), "whitener": _plain((axes * roots) @ axes.T)}


def _plain(matrix: FloatArray) -> tuple[tuple[float, ...], ...]:
    return tuple(map(tuple, matrix.tolist()))
