"""Sets of materials that hold the right one as often as was requested, in the mean over new sessions.

Background: Vovk, Gammerman, Shafer, "Algorithmic Learning in a Random World" (2005); Dunn, Wasserman, Ramdas,
"Distribution-free prediction sets for two-layer hierarchical models" (JASA 2022).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from granular_id._checks import argument_error
from granular_id._core import GranularIdError
from granular_id._schema import check_form

FloatArray = npt.NDArray[np.float64]

_FORM = {
    "format": "granular-id candidates 1",
    "classes": [str, ...],
    "level": float,
    "threshold": float,
    "n_rows": int,
    "n_sessions": int,
    "mean": float,
    "worst": float,
}

_ROUNDING = 1e-9  # (n + 1) * 0.9 may come out a hair above a whole number


@dataclass(frozen=True)
class CandidateRule:
    """A threshold that turns the class values of a recording into a set of materials.

    A material is a candidate where the best other value exceeds its own by at most the threshold.

    Attributes
    ----------
    classes : tuple of str
        In the order of the class values.
    level : float
        Wanted share of recordings whose candidates hold the right material, in (0, 1), in the mean over new sessions.
    threshold : float
    n_rows : int
        Held-out recordings behind the threshold.
    n_sessions : int
        Held-out sessions behind it; 0 where none were held out: the level then holds within these sessions only.
    mean, worst : float
        Share of held-out recordings whose candidates held the right material, each session judged by the others: the
        mean over sessions, and the worst session. Without sessions that of all.

    Examples
    --------
    >>> from granular_id.confidence import CandidateRule
    >>> rule = CandidateRule(("oat", "rice", "salt"), 0.9, 0.2, 62, 4, 0.91, 0.85)
    >>> rule.names([-0.5, -0.2, -0.9]), rule.names([-0.3, -0.2, -0.9])
    (('rice',), ('rice', 'oat'))
    """

    classes: tuple[str, ...]
    level: float
    threshold: float
    n_rows: int
    n_sessions: int
    mean: float
    worst: float

    def sets(self, values: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Tell which materials are candidates.

        Parameters
        ----------
        values : array-like, shape (K,) or (n, K)
            Class values, larger for what is likelier: minus the mean losses of a decision.

        Returns
        -------
        ndarray of bool, shape (K,) or (n, K)
            A set may be empty: no material fits as well as the right one usually does.

        Raises
        ------
        ValueError
            Values of another shape, NaN.
        """
        given = np.asarray(values, dtype=np.float64)
        if given.ndim not in (1, 2) or given.shape[-1] != len(self.classes):
            width = len(self.classes)
            raise argument_error(
                GranularIdError, "values", f"must have shape ({width},) or (n, {width}), got {given.shape}"
            )
        if np.isnan(given).any():
            raise argument_error(GranularIdError, "values", "must be numbers, got NaN")
        inside: npt.NDArray[np.bool_] = behind_best(given) <= self.threshold
        return inside

    def names(self, values: npt.ArrayLike) -> tuple[str, ...]:
        """Names of the candidates of one recording, from values (K,): the likeliest first, and at least one."""
        given = np.asarray(values, dtype=np.float64)
        order = np.argsort(-given, kind="stable").tolist()
        found = [k for k in order if self.sets(given)[k]] or order[:1]
        return tuple(self.classes[k] for k in found)

    @property
    def promise(self) -> str:
        """What the candidates are worth, in a line."""
        share = f"hold the right material of {100 * self.level:g} % of recordings"
        if not self.n_sessions:
            return f"{share}, within the sessions of the training only"
        reached = f"{100 * self.mean:.0f} % in {self.n_sessions} held-out ones, {100 * self.worst:.0f} % in the worst"
        return f"{share} in the mean over new sessions ({reached})"

    def to_dict(self) -> dict[str, Any]:
        """Return the rule in types that JSON knows."""
        return {"format": _FORM["format"], **vars(self), "classes": list(self.classes)}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> CandidateRule:
        """Read what `to_dict` wrote.

        Raises
        ------
        TypeError, ValueError
            Another format, or a part that is missing, unknown or of another type.
        """
        check_form(stored, _FORM, what="the rule of candidates", closed=True)
        parts = {name: stored[name] for name in _FORM if name != "format"}
        return cls(**parts | {"classes": tuple(stored["classes"])})


def candidate_rule(
    classes: tuple[str, ...],
    values: FloatArray,
    truth: npt.NDArray[np.intp],
    sessions: npt.NDArray[np.intp] | None,
    level: float,
) -> CandidateRule:
    """Set the threshold of candidates on held-out recordings.

    Recordings of a session resemble each other: what a threshold promises is judged session by session. The threshold
    is the quantile of all recordings, at the lowest share for which quantiles of the *other* sessions cover each
    session as often as wanted, in the mean.

    Parameters
    ----------
    classes : tuple of K str
    values : (n, K) float array
        Class values by models that did not train on the recording, nor on its session.
    truth : (n,) int array
        Its material.
    sessions : (n,) int array, optional
        Number of its session; None where none were held out.
    level : float
        In (0, 1).

    Returns
    -------
    CandidateRule
    """
    own = behind_best(values)[np.arange(len(truth)), truth]
    numbers = () if sessions is None else np.unique(sessions)
    named = own < 0  # the best material is always a candidate
    if len(numbers) < 2:
        threshold = quantile(own, level)
        reached = float((named | (own <= threshold)).mean())
        return CandidateRule(classes, level, threshold, len(own), 0, reached, reached)
    shares = np.r_[np.arange(level, 0.9901, 0.01), 0.995, 1.0]
    covered = np.array(
        [
            [(own[sessions == s] <= quantile(own[sessions != s], share)).mean() for s in numbers]
            for share in shares.tolist()
        ]
    )
    enough = np.flatnonzero(covered.mean(axis=1) >= level - _ROUNDING)
    best = int(enough[0]) if enough.size else len(shares) - 1
    share = float(shares[best])
    held = [(named | (own <= quantile(own[sessions != s], share)))[sessions == s].mean() for s in numbers]
    mean, worst = float(np.mean(held)), float(min(held))
    return CandidateRule(classes, level, quantile(own, share), len(own), len(numbers), mean, worst)


def quantile(scores: FloatArray, share: float) -> float:
    """Return the ceil((n + 1) share)-th smallest of n scores, the largest where n is too small."""
    rank = min(len(scores), math.ceil((len(scores) + 1) * share - _ROUNDING))
    return float(np.partition(scores, rank - 1)[rank - 1])


def behind_best(values: FloatArray) -> FloatArray:
    """How far each class is behind: the best other value minus its own, for class values (..., K)."""
    order = np.argpartition(values, -2, axis=-1)[..., -2:]
    two = np.take_along_axis(values, order, axis=-1)
    behind: FloatArray = two[..., 1:] - values
    np.put_along_axis(behind, order[..., 1:], two[..., :1] - two[..., 1:], axis=-1)
    return behind
