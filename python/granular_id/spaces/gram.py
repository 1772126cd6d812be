"""Which scalar products a feature space is made of, so that an evaluation computes each of them once.

The scalar products of a union are the sum of those of its blocks, each times its squared weight. So one Gram
matrix of all recordings per block serves every space that holds the block, and every partition is a slice.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.pipeline import make_pipeline

from granular_id._estimators import learns
from granular_id.spaces.base import RecordingFilter, steps_of
from granular_id.spaces.components import PrincipalComponents
from granular_id.spaces.hfmh import HFMH, RawHFMH
from granular_id.spaces.raw import RawSignal
from granular_id.spaces.union import BlockUnion, check_block_weights


@dataclass(frozen=True)
class GramPlan:
    """A feature space taken apart.

    Attributes
    ----------
    blocks : tuple of (name, transformer)
        Not fitted. None learns, so that each can be computed for all recordings at once; see `block_key`.
    block_weights : None, "unit" or tuple of float
        What scales the features of each block: nothing; `unit_weight` of the norms of the training rows, the
        square roots of the diagonal of the block's Gram matrix; or these numbers. Gram matrices take the square.
    after : tuple of transformers
        Not fitted. They work on features, in this order, and are fitted on training rows. Empty, or the first is
        `PrincipalComponents`, which works on the Gram matrix as well.
    """

    blocks: tuple[tuple[str, Any], ...]
    block_weights: str | tuple[float, ...] | None
    after: tuple[Any, ...]


def gram_plan(transformer: Any) -> GramPlan | None:
    """Take a feature space apart into blocks whose scalar products add up to its own.

    None where it does not come apart like this: a block learns (``bin_range="auto"``), a step in front draws a seed of
    its own at each fit, or a step other than `PrincipalComponents` is the first to work on features.
    """
    steps = steps_of(transformer)
    filters: list[Any] = []
    while steps and isinstance(steps[0], RecordingFilter):
        filters.append(steps.pop(0))
    if not steps:
        return None
    space, after = steps[0], tuple(steps[1:])
    if after and type(after[0]) is not PrincipalComponents:
        return None
    blocks, weights = _apart(space)
    if any(learns(part) for part in (*filters, *(block for _, block in blocks))):
        return None
    if any(getattr(step, "random_state", 0) is None for step in filters):
        return None  # each block would see recordings shuffled in another way
    if filters:
        blocks = tuple((name, make_pipeline(*filters, block)) for name, block in blocks)
    return GramPlan(blocks, weights, after)


def block_key(transformer: Any) -> Hashable:
    """Return a key under which blocks with equal features are equal, whatever space they come from.

    It holds class and parameters, without those that change no feature: threads, and a rate that only labels
    coordinates. A parameter that cannot be compared makes the key equal to its own kind only.
    """
    steps = steps_of(transformer)
    if len(steps) != 1:
        return ("pipeline", *map(block_key, steps))
    (step,) = steps
    idle: frozenset[str] = getattr(step, "without_effect", frozenset())
    params = sorted(step.get_params(deep=False).items())
    return (type(step), tuple((name, _value_key(value)) for name, value in params if name not in idle))


def _apart(space: Any) -> tuple[tuple[tuple[str, Any], ...], str | tuple[float, ...] | None]:
    if type(space) is RawHFMH:
        params = space.get_params(deep=False)
        weights = check_block_weights(params.pop("block_weights"), ("raw", "hfmh"))
        raw = RawSignal(rate_hz=space.rate_hz, threads=space.threads)
        return (("raw", raw), ("hfmh", HFMH(**params))), weights
    if type(space) is BlockUnion:
        blocks = space.checked_blocks()
        return tuple(blocks), check_block_weights(space.block_weights, [name for name, _ in blocks])
    return ((type(space).__name__.lower(), space),), None


def _value_key(value: Any) -> Hashable:
    if isinstance(value, type) or value is None or isinstance(value, (str, bytes, bool)):
        return (type(value).__name__, value)
    if isinstance(value, (int, float, np.number)):
        return float(value) if float(value) == value else value
    if isinstance(value, np.ndarray):
        return _value_key(value.tolist())
    if isinstance(value, (list, tuple)):
        return tuple(_value_key(one) for one in value)
    if hasattr(value, "get_params"):
        return block_key(value)
    return (type(value).__qualname__, id(value))
