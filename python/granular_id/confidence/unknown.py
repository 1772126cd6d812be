"""Refusing what is none of the known materials: a limit of novelty.

Source: Scheirer et al., "Toward open set recognition" (IEEE TPAMI 2013), for the task; for the score see `Novelty`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import checked_share
from granular_id._schema import check_form
from granular_id.confidence.novelty import Parts, limit, weights_of

FloatArray = npt.NDArray[np.float64]

_FORM = {
    "format": "granular-id unknown rule 1",
    "classes": [str, ...],
    "weights": [float, ...],
    "threshold": float,
    "share_known": float,
    "n_calibration": int,
    "held_out": str,
}


@dataclass(frozen=True)
class UnknownRule:
    """A limit of novelty: a row beyond it is none of the known materials.

    The novelty of a row is ``min_k (w_d d_k + w_e e_k)``, with d_k and e_k its squared distances to the mean of class
    k: along the directions that tell classes apart, and over all features.

    Attributes
    ----------
    classes : tuple of str
        In the order of the means.
    weights : tuple of two floats
        w_d and w_e, not negative.
    threshold : float
        Rows with a larger novelty are refused.
    share_known : float
        Share of rows of known materials that was to be accepted, in (0, 1).
    n_calibration : int
        Rows of known materials behind the threshold.
    held_out : str
        What new recordings will not share and was held out, in words; empty where neither sessions nor a condition was.

    Examples
    --------
    >>> from granular_id.confidence import Parts, UnknownRule
    >>> rule = UnknownRule(("oat", "rice"), (1.0, 0.5), 0.3, 0.95, 60)
    >>> rule.knows(Parts([0.1, 0.9], [0.2, 0.4])), rule.knows(Parts([0.4, 0.9], [0.2, 0.4]))
    (True, False)
    >>> UnknownRule.from_dict(rule.to_dict()) == rule
    True
    """

    classes: tuple[str, ...]
    weights: tuple[float, float]
    threshold: float
    share_known: float
    n_calibration: int
    held_out: str = ""

    @property
    def promise(self) -> str:
        """What the refusal is worth, in a line."""
        least = math.ceil(self.share_known / (1 - self.share_known) - 1e-9)
        few = f" (only {self.n_calibration}, {least} are needed)" if self.n_calibration < least else ""
        where = "" if self.held_out else ", within the sessions of the training only"
        return (
            f"refused, with {100 - 100 * self.share_known:.3g} % of recordings of the known ones{where}{few}"
        )

    def novelty(self, parts: Parts) -> FloatArray:
        """Novelty of rows from their distances (K,) or (n, K); larger is more novel."""
        return Parts(*(np.asarray(part, dtype=np.float64) for part in parts)).score(self.weights)

    def knows(self, parts: Parts) -> Any:
        """Whether rows are of a known material: a bool, or an array (n,) of them; see `novelty`."""
        known = self.novelty(parts) <= self.threshold
        return bool(known) if np.ndim(known) == 0 else known

    def to_dict(self) -> dict[str, Any]:
        """Return the rule in types that JSON knows."""
        lists = {"classes": list(self.classes), "weights": list(self.weights)}
        return {"format": _FORM["format"], **vars(self), **lists}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> UnknownRule:
        """Read what `to_dict` wrote.

        Raises
        ------
        TypeError, ValueError
            Another format, or a part that is missing, unknown or of another type.
        """
        check_form(stored, _FORM, what="the rule of refusal", closed=True)
        parts = {name: stored[name] for name in _FORM if name != "format"}
        return cls(**parts | {"classes": tuple(stored["classes"]), "weights": tuple(stored["weights"])})


def unknown_rule(
    classes: tuple[str, ...],
    parts: Parts,
    codes: npt.NDArray[np.integer],
    *,
    share_known: float = 0.95,
    of_folds: tuple[Parts, Parts] | None = None,
    blocks: npt.NDArray[np.integer] | None = None,
    held_out: str = "",
) -> UnknownRule:
    """Set the limit so that a wanted share of the rows of known materials is accepted.

    Parameters
    ----------
    classes : tuple of str
        The K known materials.
    parts : Parts
        Distances (n, K) of rows of known materials to the means of models that did not train on them; NaN where no
        model left a row out.
    codes : ndarray of int, shape (n,)
        Class of each.
    share_known : float, default 0.95
        In (0, 1). The threshold is the ceil((n + 1) share)-th smallest novelty, at most the largest.
    of_folds : tuple of two Parts, optional
        Of the same rows, held out in 10 random folds, and in as many random folds as `parts` come from. Models of folds
        train on less, and find known rows stranger than the final model does: the limit is multiplied by the ratio of
        their quantiles.
    blocks : ndarray of int, shape (n,), optional
        Block in time of each row, where no sessions are known. The limit is then one that four fifths of the blocks
        keep.
    held_out : str, default ""
        What the rows were to the models, in words.

    Returns
    -------
    UnknownRule

    Raises
    ------
    ValueError
        A share outside (0, 1).

    Examples
    --------
    >>> import numpy as np
    >>> from granular_id.confidence import Novelty, held_out_parts, unknown_rule
    >>> rng = np.random.default_rng(0)
    >>> codes = np.repeat([0, 1], 40)
    >>> rows = rng.normal(size=(80, 3)) + 4.0 * codes[:, None]
    >>> odd = np.arange(80) % 2 == 1
    >>> folds = [(np.flatnonzero(odd), np.flatnonzero(~odd)), (np.flatnonzero(~odd), np.flatnonzero(odd))]
    >>> rule = unknown_rule(("oat", "rice"), held_out_parts(rows, codes, 2, folds), codes)
    >>> rule.knows(Novelty.fit(rows, codes, 2).parts(np.array([[4.0, 4.0, 4.0], [9.0, -9.0, 0.0]]))).tolist()
    [True, False]
    """
    share_known = checked_share("share_known", share_known)
    rows = np.flatnonzero(~np.isnan(parts.d).any(axis=1))
    parts, codes = parts.take(rows), codes[rows]
    weights = weights_of(parts, codes)
    threshold = limit(
        parts,
        weights,
        share_known,
        of_folds=of_folds,
        blocks=None if blocks is None else blocks[rows],
    )
    return UnknownRule(classes, weights, threshold, share_known, len(rows), held_out)
