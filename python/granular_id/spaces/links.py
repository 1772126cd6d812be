"""From the columns of any fitted feature space, pipelines included, back to the recording."""

from __future__ import annotations

from typing import Any

from sklearn.pipeline import Pipeline

from granular_id.spaces.base import RecordingFilter, real_steps
from granular_id.spaces.blocks import FeatureBlock

__all__ = ["block_sizes", "feature_blocks", "tell_blocks"]


def block_sizes(transformer: Any) -> dict[str, int] | None:
    """Columns of each block of a fitted feature space that has blocks of statistics, as `MultiBand`; else None.

    Parameters
    ----------
    transformer : transformer or Pipeline
        A fitted feature space; of a pipeline the last step counts.
    """
    steps = real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]
    sizes: dict[str, int] | None = getattr(steps[-1], "block_sizes_", None)
    return None if sizes is None else dict(sizes)


def tell_blocks(estimator: Any, sizes: dict[str, int] | None) -> None:
    """Set `blocks` of an estimator that has that parameter and leaves it open, as `BlockScaler` has.

    Parameters
    ----------
    estimator : estimator
        Changed in place; not fitted.
    sizes : dict of str to int, or None
        See `block_sizes`; None: nothing to tell.

    Examples
    --------
    >>> from granular_id.spaces import BlockScaler, tell_blocks
    >>> scaler, given = BlockScaler(), BlockScaler([3])
    >>> for estimator in (scaler, given):
    ...     tell_blocks(estimator, {"left": 2, "right": 1})
    >>> scaler.blocks, given.blocks
    ({'left': 2, 'right': 1}, [3])
    """
    if sizes is not None and estimator.get_params().get("blocks", ...) is None:
        estimator.set_params(blocks=sizes)


def feature_blocks(transformer: Any) -> tuple[FeatureBlock, ...]:
    """Say what the columns of a fitted feature space stand for.

    Parameters
    ----------
    transformer : transformer or Pipeline
        A fitted feature space; a pipeline may have steps in front that keep time, as `Tare` does.

    Returns
    -------
    tuple of FeatureBlock

    Raises
    ------
    TypeError
        The columns do not stand for instants, bins or frequencies: a step mixes them (principal components), or
        shuffles time in front, or is not from here.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.pipeline import make_pipeline
    >>> from granular_id.spaces import RawHFMH, Tare, feature_blocks
    >>> pipeline = make_pipeline(Tare(), RawHFMH()).fit(np.zeros((2, 400, 6)))
    >>> [(block.name, block.unit, block.columns) for block in feature_blocks(pipeline)]
    [('raw', 's', slice(0, 2400, None)), ('hfmh', 'N, N m', slice(2400, 3000, None))]
    """
    steps = real_steps(transformer) if isinstance(transformer, Pipeline) else [transformer]
    while steps and isinstance(steps[0], RecordingFilter) and steps[0].keeps_time:
        steps = steps[1:]
    if len(steps) != 1 or not hasattr(steps[0], "feature_blocks"):
        kinds = ", ".join(type(step).__name__ for step in steps) or "nothing behind filters"
        raise TypeError(
            "transformer must give columns that stand for instants, bins or frequencies: one feature space, with or "
            f"without filters in front that keep time, got {kinds}"
        )
    blocks: tuple[FeatureBlock, ...] = steps[0].feature_blocks()
    return blocks
