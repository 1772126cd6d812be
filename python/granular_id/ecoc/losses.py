"""Binary losses: what the score of one learner costs a class, by the code that the class has there.

Sources: Allwein, Schapire, Singer (2000), "Reducing multiclass to binary", JMLR 1:113-141 (loss-based decoding);
names, scale and score ranges are those of MATLAB's `fitcecoc`, but for "root", which is ours: half way from votes
(the power 0 of a score) to the hinge (the power 1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from granular_id.ecoc.training import named

__all__ = ["LOSSES", "SCORE_RANGES", "BinaryLoss", "fitting_loss"]

FloatArray = npt.NDArray[np.float64]

# exp() is continued along its tangent from here on: exp(650) times any score of a float64 learner up to 1e6,
# summed over a million learners, still is a finite number.
_EXP_TANGENT_FROM = 650.0
# ... as far as the sum over any allowed number of learners is finite, and level from there.
_EXP_TANGENT_TO = 1e20

SCORE_RANGES: Mapping[str, str] = MappingProxyType(
    {"real": "any real number, as decision_function gives", "unit": "a probability in [0, 1]"}
)
"""Ranges that scores of learners have, by the name in `BinaryLoss.scores`."""

_DEFAULTS = {"real": "hinge", "unit": "quadratic"}


@dataclass(frozen=True)
class BinaryLoss:
    """What a score costs a class whose code is `m`: `g(m, s)`, 1/2 where the score says nothing.

    Attributes
    ----------
    name : str
        Name in `LOSSES`.
    formula : str
        The definition, with z = m * s (real scores) or z = m * (2 s - 1) (scores in [0, 1]).
    of_agreement : callable
        The loss as a function of the agreement z.
    scores : {"real", "unit"}
        Range of the scores that it takes, a key of `SCORE_RANGES`.
    """

    name: str
    formula: str
    of_agreement: Callable[[FloatArray], FloatArray]
    scores: str = "real"

    def __call__(self, code: int, scores: FloatArray) -> FloatArray:
        """Loss of each of `scores` for the code +1 or -1."""
        return self.of_agreement(code * (scores if self.scores == "real" else 2.0 * scores - 1.0))


def _hamming(z: FloatArray) -> FloatArray:
    return (1.0 - np.sign(z)) / 2.0


def _root(z: FloatArray) -> FloatArray:
    graded: FloatArray = np.copysign(np.sqrt(np.abs(np.minimum(z, 1.0))), z)
    return (1.0 - graded) / 2.0


def _linear(z: FloatArray) -> FloatArray:
    return (1.0 - z) / 2.0


def _hinge(z: FloatArray) -> FloatArray:
    return np.maximum(0.0, 1.0 - z) / 2.0


def _exponential(z: FloatArray) -> FloatArray:
    beyond = np.clip(-z - _EXP_TANGENT_FROM, 0.0, _EXP_TANGENT_TO)
    inside: FloatArray = np.exp(np.minimum(-z, _EXP_TANGENT_FROM))
    return inside * (1.0 + beyond) / 2.0


def _logit(z: FloatArray) -> FloatArray:
    loss: FloatArray = np.logaddexp(0.0, -z) / (2.0 * np.log(2.0))
    return loss


def _binodeviance(z: FloatArray) -> FloatArray:
    loss: FloatArray = np.logaddexp(0.0, -2.0 * z) / (2.0 * np.log(2.0))
    return loss


def _quadratic(z: FloatArray) -> FloatArray:
    return np.square(1.0 - z) / 2.0


LOSSES: Mapping[str, BinaryLoss] = MappingProxyType(
    {
        loss.name: loss
        for loss in (
            BinaryLoss("hinge", "max(0, 1 - z) / 2", _hinge),
            BinaryLoss("hamming", "(1 - sign(z)) / 2", _hamming),
            BinaryLoss("root", "(1 - sign(z) sqrt(|min(1, z)|)) / 2", _root),
            BinaryLoss("linear", "(1 - z) / 2", _linear),
            BinaryLoss("exponential", "exp(-z) / 2, along its tangent below z = -650", _exponential),
            BinaryLoss("logit", "log(1 + exp(-z)) / (2 log 2)", _logit),
            BinaryLoss("binodeviance", "log(1 + exp(-2 z)) / (2 log 2)", _binodeviance),
            BinaryLoss("quadratic", "(1 - z)^2 / 2", _quadratic, scores="unit"),
        )
    }
)
"""Binary losses by name; each is finite for scores up to 1e6."""


def fitting_loss(loss: object, scores: str | None) -> BinaryLoss:
    """Return the loss that a name asks for, if it fits the scores.

    Parameters
    ----------
    loss : str
        A key of `LOSSES`, or "auto": the hinge for real scores, the quadratic loss for scores in [0, 1].
    scores : {"real", "unit"} or None
        Range of the learners' scores; None when it is not known yet ("auto" then is the hinge).

    Returns
    -------
    BinaryLoss

    Raises
    ------
    ValueError
        Unknown name, or a loss for another range: the message says which ones fit.

    Examples
    --------
    >>> from granular_id.ecoc.losses import fitting_loss
    >>> fitting_loss("auto", "unit").name
    'quadratic'
    """
    if isinstance(loss, str) and loss == "auto":
        return LOSSES[_DEFAULTS[scores or "real"]]
    rule: BinaryLoss = named({"auto": None, **LOSSES}, "loss", loss)
    if scores is not None and rule.scores != scores:
        fitting = ", ".join(repr(name) for name, other in LOSSES.items() if other.scores == scores)
        raise ValueError(
            f"loss={loss!r} does not fit the learners: their score is {SCORE_RANGES[scores]}; "
            f"use 'auto' or one of {fitting}"
        )
    return rule
