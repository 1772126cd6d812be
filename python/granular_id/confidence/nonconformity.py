"""How badly each class fits a row, by its class values: what sets of classes are made of.

Source: Romano, Sesia, Candes, "Classification with valid and adaptive coverage" (NeurIPS 2020) for the cumulative
score; Sadinle, Lei, Wasserman, "Least ambiguous set-valued classifiers with bounded error levels" (JASA 2019) for the
probability score.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

__all__ = ["KINDS", "nonconformity", "softmax"]

FloatArray = npt.NDArray[np.float64]

KINDS: Mapping[str, str] = MappingProxyType(
    {
        "margin": "the best other value minus the own",
        "probability": "minus the own probability",
        "cumulative": "the probability of all classes down to the own, the likeliest first",
    }
)
"""How badly a class fits a row, by name."""


def nonconformity(values: FloatArray, kind: str, temperature: float) -> FloatArray:
    """How badly each class fits, by a kind of `KINDS`, for class values (..., K).

    Examples
    --------
    >>> nonconformity(np.array([3.0, 1.0, 2.0]), "margin", 1.0).tolist()
    [-1.0, 2.0, 1.0]
    """
    if kind == "margin":
        order = np.argpartition(values, -2, axis=-1)[..., -2:]
        two = np.take_along_axis(values, order, axis=-1)
        margins: FloatArray = two[..., 1:] - values
        np.put_along_axis(margins, order[..., 1:], two[..., :1] - two[..., 1:], axis=-1)
        return margins
    shares = softmax(values / temperature)
    if kind == "probability":
        return -shares
    order = np.argsort(-shares, axis=-1, kind="stable")
    cumulative = np.empty_like(shares)
    sums = np.take_along_axis(shares, order, axis=-1).cumsum(axis=-1)
    np.put_along_axis(cumulative, order, sums, axis=-1)
    return cumulative


def softmax(values: FloatArray) -> FloatArray:
    """Shares (..., K) proportional to the exponentials of values (..., K)."""
    powers = np.exp(values - values.max(axis=-1, keepdims=True))
    shares: FloatArray = powers / powers.sum(axis=-1, keepdims=True)
    return shares
