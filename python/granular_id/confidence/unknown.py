"""Refusing what is none of the known materials, by the novelty of the scores of a row.

Sources: Hendrycks & Gimpel, "A baseline for detecting misclassified and out-of-distribution examples" (ICLR 2017) for
the largest value; Lee, Lee, Lee, Shin, "A simple unified framework for detecting out-of-distribution samples"
(NeurIPS 2018) for the Mahalanobis distance to the nearest class; Scheirer et al., "Toward open set recognition" (IEEE
TPAMI 2013) for the task.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id import _core
from granular_id._checks import argument_error, named
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
    "kind": str,
    "threshold": (float, None),
    "share_known": float,
    "n_calibration": int,
    "held_out": str,
    "means": _MATRIX,
    "whitener": _MATRIX,
    "coding": _MATRIX,
}

NOVELTY: Mapping[str, str] = MappingProxyType(
    {
        "hinge_distance": "Mahalanobis distance of the class values under the hinge to those of the nearest class",
        "value_distance": "the same under the loss that decides",
        "learner_distance": "Mahalanobis distance of the learners' scores to those of the nearest class",
        "learners": "how clearly the least clear learner of the winning class speaks for it, negated",
        "value": "minus the largest class value",
        "margin": "the second largest class value minus the largest",
    }
)
"""Novelty scores by name; larger is more novel."""

_OF_LEARNERS = ("hinge_distance", "learner_distance", "learners")
_OF_DISTANCE = ("hinge_distance", "value_distance", "learner_distance")
_OF_CLASSES = ("hinge_distance", "value_distance")

_LEAST_VARIANCE = 1e-12
"""Share of the largest variance below which a direction is rounding."""


@dataclass(frozen=True)
class UnknownRule:
    """A limit of novelty: a row beyond it is none of the known materials.

    Attributes
    ----------
    classes : tuple of str
        In the order of the class values.
    kind : str
        The novelty score: ``"hinge_distance"`` (Mahalanobis distance of the class values under the hinge to those of
        the nearest class), ``"value_distance"`` (the same under the loss that decides), ``"learner_distance"`` (the
        same of the learners' scores), ``"learners"`` (how clearly the least clear learner of the winning class speaks
        for it, negated), ``"value"`` (minus the largest class value) or ``"margin"`` (the second largest minus it).
    threshold : float
        Rows with a larger novelty score are rejected; infinite, so that none is, with too few calibration rows.
    share_known : float
        Share of rows of known materials that was to be accepted, in (0, 1).
    n_calibration : int
        Rows of known materials behind the threshold.
    held_out : str
        What these rows were to the models that scored them.
    means : tuple of tuple of float
        Of the distances: mean scores of each class (K, S), S = K classes or L learners; else empty.
    whitener : tuple of tuple of float
        Of the distances: matrix (S, S) whose product with a score has the unit matrix as covariance within a class.
    coding : tuple of tuple of float
        Of ``"learners"``: side -1, 0, +1 of each class in each learner (K, L); else empty.

    Examples
    --------
    >>> from granular_id.confidence import UnknownRule
    >>> rule = UnknownRule(("oat", "rice"), "margin", -0.1, 0.95, 60)
    >>> rule.knows([-0.2, -0.9]), rule.knows([-0.50, -0.55])
    (True, False)
    >>> UnknownRule.from_dict(rule.to_dict()) == rule
    True
    """

    classes: tuple[str, ...]
    kind: str
    threshold: float
    share_known: float
    n_calibration: int
    held_out: str = ""
    means: tuple[tuple[float, ...], ...] = field(default=(), repr=False)
    whitener: tuple[tuple[float, ...], ...] = field(default=(), repr=False)
    coding: tuple[tuple[float, ...], ...] = field(default=(), repr=False)
    _nearest: _core.NearestMean | None = field(init=False, repr=False, compare=False)
    _coding: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        n_classes = len(self.classes)
        check_classes(self.classes)
        named(NOVELTY, "kind", self.kind)
        if math.isnan(self.threshold) or self.threshold == -math.inf:
            raise ValueError(f"threshold must be a number or infinite, got {self.threshold}")
        if not 0 < self.share_known < 1:
            raise ValueError(f"share_known must lie between 0 and 1, got {self.share_known}")
        if self.n_calibration < 0:
            raise ValueError(f"n_calibration must not be negative, got {self.n_calibration}")
        of_distance, of_learners = self.kind in _OF_DISTANCE, self.kind == "learners"
        for name, wanted in (("means", of_distance), ("whitener", of_distance), ("coding", of_learners)):
            if bool(getattr(self, name)) != wanted:
                raise ValueError(f"{name} must {'be given' if wanted else 'be empty'} for kind {self.kind!r}")
        nearest, coding = None, np.empty((0, 0))
        if of_distance:
            means, whitener = _matrix("means", self.means, n_classes), _matrix("whitener", self.whitener)
            size = means.shape[1]
            if whitener.shape != (size, size):
                raise ValueError(f"whitener must have shape ({size}, {size}), got {whitener.shape}")
            if self.kind in _OF_CLASSES and size != n_classes:
                raise ValueError(f"means must have {n_classes} values a class, got {size}")
            nearest = _core.NearestMean(means, whitener, of_pairs=self.kind == "hinge_distance")
        if of_learners:
            coding = _matrix("coding", self.coding, n_classes)
            if not (coding != 0).any(axis=1).all():
                raise argument_error(ValueError, "coding", "must show each class to at least one learner")
        object.__setattr__(self, "_nearest", nearest)
        object.__setattr__(self, "_coding", coding)

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
            Scores of its learners, which the kinds ``"hinge_distance"``, ``"learner_distance"`` and ``"learners"``
            need.

        Returns
        -------
        ndarray, shape () or (n,)

        Raises
        ------
        ValueError
            Another shape than the rule knows, or scores of learners that are missing.
        """
        given = checked_scores("values", values, len(self.classes))
        if self.kind == "value":
            return np.asarray(-given.max(axis=-1))
        if self.kind == "margin":
            two = np.partition(given, -2, axis=-1)
            return np.asarray(two[..., -2] - two[..., -1])
        if self.kind in _OF_LEARNERS:
            if binary is None:
                raise ValueError(
                    f"binary must hold the scores of the learners for kind {self.kind!r}, got None"
                )
            if self.kind == "learners":
                binary = checked_scores("binary", binary, self._coding.shape[1])
            if np.shape(binary)[:-1] != given.shape[:-1]:
                raise ValueError(
                    f"values and binary must hold the same rows, got shapes {given.shape} and {np.shape(binary)}"
                )
        if self._nearest is None:
            sides = self._coding[given.argmax(axis=-1)]
            return np.asarray(-np.where(sides == 0, np.inf, sides * np.asarray(binary)).min(axis=-1))
        of_values = binary is None or self.kind not in _OF_LEARNERS
        distances = self._nearest.distances(*((given, "values") if of_values else (binary, "binary")))
        return distances.reshape(given.shape[:-1])

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


def _matrix(name: str, rows: tuple[tuple[float, ...], ...], height: int | None = None) -> FloatArray:
    if len({len(row) for row in rows}) != 1 or not rows[0] or height not in (None, len(rows)):
        of_them = "" if height is None else f", {height} of them"
        raise ValueError(f"{name} must be rows of one length{of_them}")
    found = np.array(rows, dtype=np.float64)
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite")
    return found


def available_kinds(scored: HeldOutScores) -> tuple[str, ...]:
    """Kinds of `NOVELTY` that the scores suffice for."""
    from granular_id.ecoc import onevsone

    coding = scored.scores.coding
    if coding is None:
        return tuple(kind for kind in NOVELTY if kind not in _OF_LEARNERS)
    of_pairs = np.array_equal(coding, onevsone(len(coding)))
    return tuple(kind for kind in NOVELTY if of_pairs or kind != "hinge_distance")


def unknown_rule(scored: HeldOutScores, *, share_known: float = 0.95, kind: str | None = None) -> UnknownRule:
    """Set the limit so that a wanted share of the rows of known materials is accepted.

    Parameters
    ----------
    scored : HeldOutScores
        Cross-fitted scores of known materials. Rows of unknown ones are not needed.
    share_known : float, default 0.95
        In (0, 1). The threshold is the ceil((n + 1) share)-th smallest novelty score, so that a new row of a known
        material, recorded as the others were, is accepted at least so often.
    kind : str, optional
        As `UnknownRule.kind`. Default: ``"hinge_distance"`` where a model has a learner for each pair of classes,
        else ``"value_distance"``; these did best where one material after the other was left out, see
        :doc:`/guide/confidence`. The covariance within classes is shrunken after Ledoit & Wolf (2004), "A
        well-conditioned estimator for large-dimensional covariance matrices".

    Returns
    -------
    UnknownRule

    Raises
    ------
    ValueError
        An unknown kind, one that needs learners where there are none, a share outside (0, 1).

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

    available = available_kinds(scored)
    kind = available[0] if kind is None else kind
    named(NOVELTY, "kind", kind)
    if kind not in available:
        of_pairs = " with a learner for each pair of classes" if kind == "hinge_distance" else ""
        raise ValueError(
            f"kind {kind!r} needs a model that ends in ECOCClassifier{of_pairs}, with one coding matrix for all folds; "
            f"{', '.join(map(repr, available))} do not"
        )
    values, binary, coding = scored.scores.values, scored.scores.binary, scored.scores.coding
    own: FloatArray | None = None  # scores of which distances are taken
    if kind == "value_distance":
        own = values
    elif binary is not None and kind in _OF_DISTANCE:
        own = binary if kind == "learner_distance" else decode(binary, onevsone(len(scored.classes)))
    parts: dict[str, Any] = {}
    if own is not None:
        parts = _distances(own, scored.truth)
    elif kind == "learners" and coding is not None:
        parts = {"coding": _plain(coding.astype(np.float64))}
    rule = UnknownRule(
        classes=scored.classes,
        kind=kind,
        threshold=np.inf,
        share_known=float(share_known),
        n_calibration=len(scored.truth),
        held_out=scored.held_out,
        **parts,
    )
    strange = rule.novelty(values, binary) if own is None else _held_out_distances(rule, own, scored)
    return replace(rule, threshold=conformal_quantile(strange, rule.share_known))


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
