"""The limit beyond which a row is none of the known materials, from scores of rows that did not train."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.covariance import ledoit_wolf

from granular_id.confidence.conformal_fit import conformal_quantile
from granular_id.confidence.held_out import HeldOutScores
from granular_id.confidence.unknown import STRANGENESS, UnknownRule, is_of_pairs, uses_learners
from granular_id.ecoc.codings import onevsone
from granular_id.ecoc.decoding import decode

__all__ = ["available_kinds", "unknown_rule"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_LEAST_VARIANCE = 1e-12
"""Share of the largest variance below which a direction is rounding."""


def available_kinds(scored: HeldOutScores) -> tuple[str, ...]:
    """Kinds of `STRANGENESS` that the scores suffice for."""
    coding = scored.scores.coding
    return tuple(
        kind
        for kind in STRANGENESS
        if not uses_learners(kind)
        or (coding is not None and (kind != "hinge_distance" or is_of_pairs(coding)))
    )


def unknown_rule(scored: HeldOutScores, *, share_known: float = 0.95, kind: str | None = None) -> UnknownRule:
    """Set the limit so that a wanted share of the rows of known materials is accepted.

    Parameters
    ----------
    scored : HeldOutScores
        Cross-fitted scores of known materials. Rows of unknown ones are not needed.
    share_known : float, default 0.95
        In (0, 1). The threshold is the ceil((n + 1) share)-th smallest strangeness, so that a new row of a known
        material, recorded as the others were, is accepted at least so often.
    kind : str, optional
        A key of `STRANGENESS`. Default: ``"hinge_distance"`` where a model has a learner for each pair of classes,
        else ``"value_distance"``; these did best where one material after the other was left out, see
        ``docs/confidence.md``. The covariance within classes is shrunken after Ledoit & Wolf (2004), "A
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
    >>> from granular_id.confidence.rows import rows_of
    >>> from granular_id.ecoc import ECOCClassifier
    >>> scored = held_out_scores(ECOCClassifier(), rows_of(*load_iris(return_X_y=True)))
    >>> rule = unknown_rule(scored)
    >>> float(rule.knows(scored.scores.values, scored.scores.binary).mean()) >= 0.95
    True
    """
    kind = available_kinds(scored)[0] if kind is None else kind
    if kind not in STRANGENESS:
        raise ValueError(f"kind must be one of {', '.join(map(repr, STRANGENESS))}, got {kind!r}")
    values, binary, coding = scored.scores.values, scored.scores.binary, scored.scores.coding
    if kind not in available_kinds(scored):
        of_pairs = " with a learner for each pair of classes" if kind == "hinge_distance" else ""
        raise ValueError(
            f"kind {kind!r} needs a model that ends in ECOCClassifier{of_pairs}, with one coding matrix for all folds; "
            f"{', '.join(map(repr, available_kinds(scored)))} do not"
        )
    own = values if kind == "value_distance" else None
    if binary is not None and kind in ("hinge_distance", "learner_distance"):
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
    strange = rule.strangeness(values, binary) if own is None else _held_out_distances(rule, own, scored)
    return replace(rule, threshold=conformal_quantile(strange, rule.share_known))


def _held_out_distances(rule: UnknownRule, own: FloatArray, scored: HeldOutScores) -> FloatArray:
    """Strangeness of each row by means and covariance of the other folds: those of its own would flatter it."""
    strange, binary = np.empty(len(own)), scored.scores.binary
    for fold in np.unique(scored.folds):
        held, others = scored.folds == fold, scored.folds != fold
        if np.unique(scored.truth[others]).size < len(scored.classes):
            others = np.ones_like(held)  # a single fold, or one that holds all of a class
        partial = replace(rule, **_distances(own[others], scored.truth[others]))
        strange[held] = partial.strangeness(
            scored.scores.values[held], None if binary is None else binary[held]
        )
    return strange


def _distances(scores: FloatArray, truth: IntArray) -> dict[str, Any]:
    """Means of the classes, and the inverse root of the shrunken covariance within them."""
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
