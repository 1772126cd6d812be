"""Sets of materials that hold the right one as often as was asked for.

Source: Vovk, Gammerman, Shafer, "Algorithmic Learning in a Random World" (2005).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id._schema import check_form

if TYPE_CHECKING:
    from granular_id.confidence.held_out import HeldOutScores

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_FORM = {
    "format": "granular-id conformal rule 1",
    "classes": [str, ...],
    "levels": [float, ...],
    "thresholds": [(float, None), ...],
    "n_calibration": int,
    "held_out": str,
}

LEVELS = (0.8, 0.9, 0.95)
"""Default coverages: the usual ones; 0.95 needs 19 calibration rows."""

_ROUNDING = 1e-9  # (n + 1) * 0.9 may come out a hair above a whole number


@dataclass(frozen=True)
class ConformalRule:
    """Thresholds that turn the class values of one row into a set of classes.

    A class is in the set of a level when the best other value exceeds its own by at most the threshold of that level.
    Where calibration rows and the new row are exchangeable, the set holds the true class with at least the probability
    that was asked for, whatever the model. No randomness is involved.

    Attributes
    ----------
    classes : tuple of str
        In the order of the class values.
    levels : tuple of float
        Wanted coverages in (0, 1), ascending.
    thresholds : tuple of float
        One for each level; infinite where there were too few calibration rows for the level: every class is then in
        the set.
    n_calibration : int
        Rows behind the thresholds.
    held_out : str
        What the calibration rows were to the models that scored them, such as ``"5 folds of whole sessions"``.

    Examples
    --------
    >>> from granular_id.confidence import ConformalRule
    >>> rule = ConformalRule(("oat", "rice", "salt"), (0.8, 0.95), (-0.1, 0.3), 62)
    >>> rule.names([-0.5, -0.2, -0.9], 0.8), rule.names([-0.5, -0.2, -0.9], 0.95)
    (('rice',), ('rice', 'oat'))
    >>> ConformalRule.from_dict(rule.to_dict()) == rule
    True
    """

    classes: tuple[str, ...]
    levels: tuple[float, ...]
    thresholds: tuple[float, ...]
    n_calibration: int
    held_out: str = ""

    def __post_init__(self) -> None:
        check_classes(self.classes)
        checked_levels(self.levels)
        if list(self.levels) != sorted(self.levels):
            raise ValueError(f"levels must ascend, got {self.levels}")
        if len(self.thresholds) != len(self.levels):
            raise ValueError(
                f"thresholds must hold a number for each of {len(self.levels)} levels, got {len(self.thresholds)}"
            )
        if any(math.isnan(limit) or limit == -math.inf for limit in self.thresholds):
            raise ValueError("thresholds must be numbers or infinite, got NaN or minus infinity")
        if self.n_calibration < 0:
            raise ValueError(f"n_calibration must not be negative, got {self.n_calibration}")

    @property
    def notes(self) -> tuple[str, ...]:
        """Say for which levels there were too few calibration rows."""
        return tuple(
            f"{100 * level:g} % needs {rows_needed(level)} calibration rows, there are {self.n_calibration}: "
            "every set is full"
            for level, limit in zip(self.levels, self.thresholds, strict=True)
            if limit == math.inf
        )

    def sets(self, values: npt.ArrayLike, level: float | None = None) -> npt.NDArray[np.bool_]:
        """Tell which classes are in the set of a level.

        Parameters
        ----------
        values : array-like, shape (K,) or (n, K)
            Class values of the fitted model, larger for what is likelier: minus the mean losses of a decision.
        level : float, optional
            One of `levels`. Default: the largest.

        Returns
        -------
        ndarray of bool, shape (K,) or (n, K)
            A set may be empty: no class fits as well as the right one does in `level` of all cases.

        Raises
        ------
        ValueError
            A level that is not stored, values of another shape, NaN.
        """
        level = self.levels[-1] if level is None else level
        if level not in self.levels:
            raise ValueError(f"level must be one of {', '.join(map(str, self.levels))}, got {level!r}")
        given = checked_scores("values", values, len(self.classes))
        inside: npt.NDArray[np.bool_] = nonconformity(given) <= self.thresholds[self.levels.index(level)]
        return inside

    def names(
        self, values: npt.ArrayLike, level: float | None = None, *, at_least_one: bool = False
    ) -> tuple[str, ...]:
        """Names in the set of one row (K,), the likeliest first.

        Parameters
        ----------
        values, level
            As in `sets`.
        at_least_one : bool, default False
            Name the best class where the set is empty. Coverage then exceeds the level where the model is right more
            often than that.
        """
        given = np.asarray(values, dtype=np.float64)
        if given.ndim != 1:
            raise ValueError(f"values must have shape (K,), got {given.shape}")
        listed = given.tolist()
        found = np.flatnonzero(self.sets(given, level)).tolist()
        found.sort(key=listed.__getitem__, reverse=True)
        if not found and at_least_one:
            found = [listed.index(max(listed))]
        return tuple(self.classes[k] for k in found)

    def to_dict(self) -> dict[str, Any]:
        """Return the rule in types that JSON knows; an infinite threshold becomes None."""
        return rule_to_dict(self, _FORM)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> ConformalRule:
        """Read what `to_dict` wrote.

        Raises
        ------
        TypeError, ValueError
            Another format, a part that is missing, unknown or of another type, or a rule that cannot be.
        """
        return cls(**rule_from_dict(stored, _FORM, "the conformal rule"))


# What the rules of this package share.


def rule_to_dict(rule: Any, form: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a form in types that JSON knows: lists for tuples, None for what is infinite."""

    def plain(value: Any) -> Any:
        if isinstance(value, tuple):
            return [plain(part) for part in value]
        return None if value == math.inf else value

    entries = {name: plain(getattr(rule, name)) for name in form if name != "format"}
    return {"format": form["format"], **entries}


def rule_from_dict(stored: Any, form: dict[str, Any], what: str) -> dict[str, Any]:
    """Return the arguments of a rule that `rule_to_dict` wrote."""

    def read(value: Any, form: Any) -> Any:
        if isinstance(form, list):
            return tuple(read(part, form[0]) for part in value)
        if form in (float, (float, None)):
            return math.inf if value is None else float(value)
        return value

    check_form(stored, form, what=what, closed=True)
    return {name: read(stored[name], part) for name, part in form.items() if name != "format"}


def check_classes(classes: tuple[str, ...]) -> None:
    """Refuse classes of a rule that are not at least two different names."""
    if len(classes) < 2 or len(set(classes)) < len(classes):
        raise ValueError(f"classes must be at least 2 different names, got {classes!r:.200}")


def checked_scores(argument: str, scores: npt.ArrayLike, width: int) -> FloatArray:
    """Return finite scores (width,) or (n, width), or say what is wrong with them."""
    given = np.asarray(scores, dtype=np.float64)
    if given.ndim not in (1, 2) or given.shape[-1] != width:
        raise ValueError(f"{argument} must have shape ({width},) or (n, {width}), got {given.shape}")
    if not np.isfinite(given).all():
        raise ValueError(f"{argument} must be finite, got NaN or infinity")
    return given


def checked_levels(levels: Sequence[float]) -> tuple[float, ...]:
    """Return levels ascending, or say what is wrong with them."""
    found = tuple(float(level) for level in levels)
    if not found or not all(0 < level < 1 for level in found) or len(set(found)) < len(found):
        raise ValueError(f"levels must be different numbers between 0 and 1, got {tuple(levels)}")
    return tuple(sorted(found))


def rank_of(n: int, level: float) -> int:
    """Which of n calibration scores, in ascending order from 1, is the threshold; above n where n is too small."""
    return math.ceil((n + 1) * level - _ROUNDING)


def rows_needed(level: float) -> int:
    """Fewest calibration rows with which a level can be kept without sets that hold everything."""
    n = max(1, math.floor(level / (1 - level)) - 1)
    while rank_of(n, level) > n:
        n += 1
    return n


def conformal_rule(scored: HeldOutScores, levels: Sequence[float] = LEVELS) -> ConformalRule:
    """Set the thresholds of prediction sets.

    Parameters
    ----------
    scored : HeldOutScores
        Calibration rows. Where each was scored by the one model that decides in the end (split), the coverage is
        guaranteed; where by models of a cross-fit, it comes close, see :doc:`/guide/confidence`.
    levels : sequence of float, default (0.8, 0.9, 0.95)
        Wanted coverages in (0, 1).

    Returns
    -------
    ConformalRule
        Its `notes` say where there were too few rows.

    Examples
    --------
    >>> from sklearn.datasets import load_iris
    >>> from granular_id.confidence import conformal_rule, held_out_scores
    >>> from granular_id import ECOCClassifier
    >>> X, y = load_iris(return_X_y=True)
    >>> scored = held_out_scores(X, ECOCClassifier(), y)
    >>> rule = conformal_rule(scored, [0.9])
    >>> covered = rule.sets(scored.scores.values)[range(150), scored.truth]
    >>> float(covered.mean()) >= 0.9
    True
    """
    wanted = checked_levels(levels)
    own = nonconformity(scored.scores.values)[np.arange(len(scored.truth)), scored.truth]
    thresholds = tuple(conformal_quantile(own, level) for level in wanted)
    return ConformalRule(scored.classes, wanted, thresholds, len(own), scored.held_out)


def conformal_quantile(scores: FloatArray, level: float) -> float:
    """Return the ceil((n + 1) level)-th smallest of n scores; infinite where that is more than n."""
    rank = rank_of(len(scores), level)
    return math.inf if rank > len(scores) else float(np.partition(scores, rank - 1)[rank - 1])


def nonconformity(values: FloatArray) -> FloatArray:
    """How badly each class fits: the best other value minus its own, for class values (..., K)."""
    order = np.argpartition(values, -2, axis=-1)[..., -2:]
    two = np.take_along_axis(values, order, axis=-1)
    margins: FloatArray = two[..., 1:] - values
    np.put_along_axis(margins, order[..., 1:], two[..., :1] - two[..., 1:], axis=-1)
    return margins
