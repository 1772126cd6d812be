"""Sets of materials that hold the right one as often as was asked for.

Sources: Vovk, Gammerman, Shafer, "Algorithmic Learning in a Random World" (2005); Romano, Sesia, Candes,
"Classification with valid and adaptive coverage" (NeurIPS 2020) for the cumulative score; Sadinle, Lei, Wasserman,
"Least ambiguous set-valued classifiers with bounded error levels" (JASA 2019) for the probability score.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import named
from granular_id._schema import check_form

# scipy is loaded where it is used: whoever reads a stored rule does not wait for it.

if TYPE_CHECKING:
    from granular_id.confidence.held_out import HeldOutScores

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_FORM = {
    "format": "granular-id conformal rule 1",
    "classes": [str, ...],
    "kind": str,
    "levels": [float, ...],
    "thresholds": [[(float, None), ...], ...],
    "n_calibration": [int, ...],
    "temperature": float,
    "held_out": str,
}

LEVELS = (0.8, 0.9, 0.95)
"""Default coverages: the usual ones; 0.95 needs 19 calibration rows."""

KINDS: Mapping[str, str] = MappingProxyType(
    {
        "margin": "the best other value minus the own",
        "probability": "minus the own probability",
        "cumulative": "the probability of all classes down to the own, the likeliest first",
    }
)
"""How badly a class fits a row, by name."""

_NAMED = 3
_ROUNDING = 1e-9  # (n + 1) * 0.9 may come out a hair above a whole number
_LOG_RANGE = 12.0  # temperatures from e^-12 to e^12 of the spread of the values
_LEAST = 1e-300


@dataclass(frozen=True)
class ConformalRule:
    """Thresholds that turn the class values of one row into a set of classes.

    A class is in the set of a level when its score (see `kind`) is at most the threshold of that level. Where
    calibration rows and the new row are exchangeable, the set holds the true class with at least the probability
    that was asked for, whatever the model. No randomness is involved.

    Attributes
    ----------
    classes : tuple of str
        In the order of the class values.
    kind : str
        How badly a class fits: ``"margin"`` (the best other value minus its own), ``"probability"`` (minus its own
        probability) or ``"cumulative"`` (the probability of all classes down to it, the likeliest first).
    levels : tuple of float
        Wanted coverages in (0, 1), ascending.
    thresholds : tuple of tuple of float
        For each level one number, or one for each class; infinite where there were too few calibration rows for the
        level: every class is then in the set.
    n_calibration : tuple of int
        Rows behind the threshold, or behind that of each class.
    temperature : float
        Class values are divided by it before they become probabilities; of no effect on ``"margin"``.
    held_out : str
        What the calibration rows were to the models that scored them, such as ``"5 folds of whole sessions"``.

    Examples
    --------
    >>> from granular_id.confidence import ConformalRule
    >>> rule = ConformalRule(("oat", "rice", "salt"), "margin", (0.8, 0.95), ((-0.1,), (0.3,)), (62,))
    >>> rule.names([-0.5, -0.2, -0.9], 0.8), rule.names([-0.5, -0.2, -0.9], 0.95)
    (('rice',), ('rice', 'oat'))
    >>> ConformalRule.from_dict(rule.to_dict()) == rule
    True
    """

    classes: tuple[str, ...]
    kind: str
    levels: tuple[float, ...]
    thresholds: tuple[tuple[float, ...], ...]
    n_calibration: tuple[int, ...]
    temperature: float = 1.0
    held_out: str = ""
    _limits: dict[float, tuple[float, ...]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        n_classes = len(self.classes)
        check_classes(self.classes)
        named(KINDS, "kind", self.kind)
        checked_levels(self.levels)
        if list(self.levels) != sorted(self.levels):
            raise ValueError(f"levels must ascend, got {self.levels}")
        widths = {len(row) for row in self.thresholds}
        if len(self.thresholds) != len(self.levels) or widths not in ({1}, {n_classes}):
            raise ValueError(
                f"thresholds must hold 1 or {n_classes} numbers for each of {len(self.levels)} levels, got "
                f"{[len(row) for row in self.thresholds]}"
            )
        if any(math.isnan(limit) or limit == -math.inf for row in self.thresholds for limit in row):
            raise ValueError("thresholds must be numbers or infinite, got NaN or minus infinity")
        if {len(self.n_calibration)} != widths or min(self.n_calibration) < 0:
            raise ValueError(f"n_calibration must hold {widths.pop()} counts, got {self.n_calibration}")
        if not 0 < self.temperature < math.inf:
            raise ValueError(f"temperature must be positive and finite, got {self.temperature}")
        repeat = n_classes if widths == {1} else 1
        limits = {level: row * repeat for level, row in zip(self.levels, self.thresholds, strict=True)}
        object.__setattr__(self, "_limits", limits)

    @property
    def per_class(self) -> bool:
        """Whether each class has a threshold, and its own coverage, of its own (Mondrian)."""
        return len(self.n_calibration) > 1

    @property
    def notes(self) -> tuple[str, ...]:
        """Say for which levels, and classes, there were too few calibration rows."""
        lines = []
        for level, limits in zip(self.levels, self.thresholds, strict=True):
            short = [k for k, limit in enumerate(limits) if limit == math.inf]
            if not short:
                continue
            more = f" and {len(short) - _NAMED} more" if len(short) > _NAMED else ""
            names = ", ".join(self.classes[k] for k in short[:_NAMED])
            who = f" for {names}{more}" if self.per_class else ""
            have = min(self.n_calibration[k] for k in short)
            what = "always in the set" if self.per_class else "every set is full"
            lines.append(
                f"{100 * level:g} % needs {rows_needed(level)} calibration rows, there are {have}{who}: {what}"
            )
        return tuple(lines)

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
        limits = self.limits_of(level)
        given = checked_scores("values", values, len(self.classes))
        inside: npt.NDArray[np.bool_] = nonconformity(given, self.kind, self.temperature) <= limits
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

    def limits_of(self, level: float | None = None) -> tuple[float, ...]:
        """Return the threshold of each class (K,) for one of `levels`; default: the largest."""
        limits = self._limits.get(self.levels[-1] if level is None else level)
        if limits is None:
            raise ValueError(f"level must be one of {', '.join(map(str, self.levels))}, got {level!r}")
        return limits

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


def conformal_rule(
    scored: HeldOutScores,
    levels: Sequence[float] = LEVELS,
    *,
    kind: str = "margin",
    per_class: bool = False,
) -> ConformalRule:
    """Set the thresholds of prediction sets.

    Parameters
    ----------
    scored : HeldOutScores
        Calibration rows. Where each was scored by the one model that decides in the end (split), the coverage is
        guaranteed; where by models of a cross-fit, it comes close, see :doc:`/guide/confidence`.
    levels : sequence of float, default (0.8, 0.9, 0.95)
        Wanted coverages in (0, 1).
    kind : str, default "margin"
        As `ConformalRule.kind`. The margin gives the smallest sets with a linear model, and needs no probabilities.
    per_class : bool, default False
        A threshold for each class (Mondrian): each material alone is covered as often as wanted. Each class then
        needs as many rows as otherwise all have together.

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
    named(KINDS, "kind", kind)
    wanted = checked_levels(levels)
    values, truth = scored.scores.values, scored.truth
    temperature = 1.0 if kind == "margin" else fit_temperature(values, truth)
    own = nonconformity(values, kind, temperature)[np.arange(len(truth)), truth]
    parts = [own[truth == k] for k in range(len(scored.classes))] if per_class else [own]
    return ConformalRule(
        scored.classes,
        kind,
        wanted,
        tuple(tuple(conformal_quantile(part, level) for part in parts) for level in wanted),
        tuple(len(part) for part in parts),
        temperature,
        scored.held_out,
    )


def conformal_quantile(scores: FloatArray, level: float) -> float:
    """Return the ceil((n + 1) level)-th smallest of n scores; infinite where that is more than n."""
    rank = rank_of(len(scores), level)
    return math.inf if rank > len(scores) else float(np.partition(scores, rank - 1)[rank - 1])


def fit_temperature(values: FloatArray, truth: IntArray) -> float:
    """Temperature that makes class values (n, K) the likeliest logarithms of probabilities.

    Source: Guo, Pleiss, Sun, Weinberger, "On calibration of modern neural networks" (ICML 2017), section 4.2.
    """
    from scipy.optimize import minimize_scalar
    from scipy.special import softmax

    spread = float(values.std()) or 1.0
    rows = np.arange(len(truth))

    def loss(log_temperature: float) -> float:
        shares = softmax(values / (spread * math.exp(log_temperature)), axis=-1)[rows, truth]
        return -float(np.log(np.maximum(shares, _LEAST)).mean())

    found = minimize_scalar(loss, bounds=(-_LOG_RANGE, _LOG_RANGE), method="bounded")
    return spread * math.exp(float(found.x))


def nonconformity(values: FloatArray, kind: str, temperature: float) -> FloatArray:
    """How badly each class fits, by a kind of `KINDS`, for class values (..., K)."""
    if kind == "margin":
        order = np.argpartition(values, -2, axis=-1)[..., -2:]
        two = np.take_along_axis(values, order, axis=-1)
        margins: FloatArray = two[..., 1:] - values
        np.put_along_axis(margins, order[..., 1:], two[..., :1] - two[..., 1:], axis=-1)
        return margins
    from scipy.special import softmax

    shares: FloatArray = softmax(values / temperature, axis=-1)
    if kind == "probability":
        return -shares
    order = np.argsort(-shares, axis=-1, kind="stable")
    cumulative = np.empty_like(shares)
    sums = np.take_along_axis(shares, order, axis=-1).cumsum(axis=-1)
    np.put_along_axis(cumulative, order, sums, axis=-1)
    return cumulative
